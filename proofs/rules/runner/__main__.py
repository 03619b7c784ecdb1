"""The command: `proofs/rules/prove`."""

from __future__ import annotations

import argparse
import random
import secrets
import sys

from . import agree, code, question, report, solver, text

DESCRIPTION = """\
Shows the promises of SPEC.md of its rules, for any number of clouds, timestamps and places of the
window.

Two solvers check each obligation of promises.smt2: whether it can fail, whether it speaks
of anything, and whether each fault of faults.toml makes it fail. Then the rules are evaluated and
compared with what the shipped core does."""
EPILOGUE = """\
exit codes: 0 all of it is as it must be; 1 something is not; 2 bad use, or a file that cannot be
read; 77 the solvers cannot be installed here"""


def main() -> int:
    """Runs what the options say."""
    options = _options()
    try:
        rules, promises = text.RULES.read_text(), text.PROMISES.read_text()
        stated = text.obligations(promises, text.SPEC.read_text())
        seeded = text.faults(text.FAULTS.read_text(), stated)
    except (text.Malformed, OSError, ValueError) as why:
        print(f"error: {why}", file=sys.stderr)
        return 2
    if options.list:
        for one in stated:
            print(f"{one.name}\n    {one.sentence}\n    for instance: {one.instance}")
        return 0
    if options.only:
        stated = [one for one in stated if options.only in one.name]
        if not stated:
            print(
                f"error: no obligation has {options.only} in its name; see --list", file=sys.stderr
            )
            return 2
        names = {one.name for one in stated}
        seeded = [fault for fault in seeded if names & set(fault.breaks)]
    if options.sample:
        stated = random.Random(options.seed).sample(stated, min(options.sample, len(stated)))
        names = {one.name for one in stated}
        seeded = [fault for fault in seeded if names & set(fault.breaks)]
    run = report.Run(stated, seeded, solver.versions(), options.seed)
    try:
        return _run(options, run, rules, promises)
    except (text.Malformed, code.Unbuilt) as why:
        print(f"error: {why}", file=sys.stderr)
        return 2


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="proofs/rules/prove",
        description=DESCRIPTION,
        epilog=EPILOGUE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--list", action="store_true", help="say what is shown, and show nothing")
    parser.add_argument(
        "--only", metavar="PART", help="obligations with this in their name, without the core"
    )
    parser.add_argument(
        "--sample", metavar="N", type=int, help="only so many obligations, drawn anew"
    )
    parser.add_argument("--json", action="store_true", help="print the results as JSON")
    parser.add_argument("--record", action="store_true", help="also write record.json")
    parser.add_argument(
        "--seed", type=int, default=secrets.randbits(32), help="of what is drawn; else a new one"
    )
    parser.add_argument(
        "--seconds", type=int, default=120, help="for one question; 120 unless given"
    )
    options = parser.parse_args()
    if options.record and (options.only or options.sample):
        parser.error("--record is about all obligations")
    return options


def _run(options: argparse.Namespace, run: report.Run, rules: str, promises: str) -> int:
    questions = list(question.questions(rules, promises, run.stated, run.seeded))
    for count, answer in enumerate(question.answers(questions, options.seconds), 1):
        run.add(answer)
        _show_progress(count, len(questions))
    if not options.json:
        print(run.table())
    if not options.only:
        for agreement in agree.agreements(rules + promises, run.seed):
            run.agreements.append(agreement)
            if not options.json:
                print(agreement.text(), flush=True)
    if options.json:
        print(run.json())
    else:
        print(f"{run.summary()}; seed {run.seed}")
    if options.record and run.holds:
        disagreeing = [
            fault.name
            for fault in run.seeded
            if agree.disagrees(fault.put_into(rules) + promises, run.seed)
        ]
        report.RECORD.write_text(report.record(run, disagreeing))
    elif not options.only and not report.is_recorded():
        print("record.json is about other files: run proofs/rules/prove --record", file=sys.stderr)
        return 1
    return 0 if run.holds else 1


def _show_progress(count: int, total: int) -> None:
    """Keeps one line on a terminal up to date; a log needs none."""
    if sys.stderr.isatty():
        end = "\n" if count == total else ""
        print(f"\r{count} of {total} questions answered", end=end, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
