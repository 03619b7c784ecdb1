"""Runs the tests with real peers, each in a network and mounts of its own.

    python3 run.py --node PROGRAM --fuseline PROGRAM [--fastdds PROGRAM] [--clock LIBRARY] [--zenoh] [--list] [--misuse]
                   [NAME…]

A NAME is a part of a test's name. Without the right to make networks the tests share the loopback of the machine,
each with a domain of its own.
"""

import argparse
import faulthandler
import inspect
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback

if "--zenoh" in sys.argv:
    os.environ["MIDDLEWARE"] = "zenoh"

import chaos
import clock
import deadlines
import faults
import forwarding
import images
import lifecycle
import links
import misuse
import running
from bench import Bench, Skipped

CAP_S = 150
SKIPPED = 77
# The peers themselves did not run when they should have: what failed says nothing about the node.
STALLED = 75
STALL_S = 0.1
# Two vendors' discovery was seen to hang once in hundreds of runs, and a fault of the node that shows itself now and then
# fails again: a test that failed once must pass twice in a row.
FAILURES = 2
TRIES = 6
LOG_HEAD, LOG_TAIL = 3000, 5000
OWN_NETWORK = ["unshare", "--net", "--mount", "--map-root-user"]
AS_ROOT = ["unshare", "--net", "--mount"]
LOOPBACK_UP = ["sh", "-c", 'ip link set lo up && exec "$@"', "sh"]


def cases():
    """Every public function of the test modules that takes a bench."""
    return {
        name: case
        for module in (forwarding, deadlines, running, lifecycle, faults, misuse, links, clock, chaos, images)
        for name, case in vars(module).items()
        if inspect.isfunction(case) and case.__module__ == module.__name__
        and list(inspect.signature(case).parameters) == ["bench"] and not name.startswith("_")
    }


class Stalls(threading.Thread):
    """How long the peers' process, which this is, did not run when it should have: deadlines here are fractions of a
    second, and a machine with other things to do may stand still for one."""

    def __init__(self):
        super().__init__(daemon=True)
        self.longest_s = 0.0
        self.start()

    def run(self):
        while True:
            due = time.monotonic() + 0.01
            time.sleep(0.01)
            self.longest_s = max(self.longest_s, time.monotonic() - due)


def shortened(log):
    """Its beginning and its end: what went wrong first, and last."""
    cut = len(log) - LOG_HEAD - LOG_TAIL
    return log if cut <= 0 else f"{log[:LOG_HEAD]}\n… {cut} characters …\n{log[-LOG_TAIL:]}"


def alone(name, programs):
    """Runs one test in this process and exits with its outcome."""
    # A test that hangs says where.
    faulthandler.dump_traceback_later(CAP_S - 10)
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(folder, programs)
        stalls = Stalls()
        code = 1
        try:
            cases()[name](bench)
            bench.finish()
            code = 0
        except Skipped as why:
            print(f"skipped: {why}")
            code = SKIPPED
        except BaseException:
            traceback.print_exc()
            print(f"the peers stood still for {stalls.longest_s:.3f} s at most")
            code = STALLED if stalls.longest_s > STALL_S else 1
            for node in bench.nodes:
                print(f"--- log of {node.folder.name}\n{shortened(node.log())}")
        finally:
            bench.kill()
    sys.stdout.flush()
    sys.stderr.flush()
    # The threads of the peers end here, whatever they wait for.
    os._exit(code)


def network():
    """The prefix of a command that gives it a network of its own, if this machine grants one."""
    for prefix in (OWN_NETWORK, AS_ROOT):
        try:
            if subprocess.run([*prefix, *LOOPBACK_UP, "true"], capture_output=True).returncode == 0:
                return [*prefix, *LOOPBACK_UP]
        except FileNotFoundError:
            pass
    print("no network namespaces here: the tests share the loopback")
    return []


def run(name, number, prefix, arguments):
    """Runs one test in a process of its own; returns its exit code and what it printed."""
    command = [*prefix, sys.executable, __file__, "--alone", name, *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                               env=os.environ | {"ROS_DOMAIN_ID": str(20 + number), "IS_ALONE": "yes" if prefix else ""},
                               start_new_session=True)
    try:
        output = process.communicate(timeout=CAP_S)[0]
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        output = process.communicate()[0] + f"\nended after {CAP_S} s"
    except BaseException:
        os.killpg(process.pid, signal.SIGKILL)
        raise
    return process.returncode, output


def verdict(name, *how):
    """Runs one test until it is known what to say of it; returns that, what it printed at last, and what each run
    printed that failed."""
    failures, unexplained, passes = [], 0, 0
    for _ in range(TRIES):
        code, output = run(name, *how)
        if code == SKIPPED:
            return "skipped", output, failures
        if code == 0:
            passes += 1
            if passes == (2 if failures else 1):
                return "passed", output, failures
            continue
        passes = 0
        failures.append(output)
        unexplained += code != STALLED
        if unexplained == FAILURES:
            break
    return "failed", output, failures


def shown(output):
    for line in output.strip().splitlines():
        print(f"           {line}", flush=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--node", required=True)
    parser.add_argument("--fuseline", required=True)
    parser.add_argument("--fastdds")
    parser.add_argument("--clock")
    parser.add_argument("--zenoh", action="store_true", help="all topics over Zenoh, through a router")
    parser.add_argument("--alone", metavar="NAME")
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--misuse", action="store_true", help="only the cases of the catalogue of misuse")
    parser.add_argument("--sample", metavar="N", type=int, help="only this many of them, drawn again each time")
    parser.add_argument("names", nargs="*")
    chosen = parser.parse_args()
    programs = {"node": chosen.node, "fuseline": chosen.fuseline, "fastdds": chosen.fastdds,
                "clock": chosen.clock}
    # Some are started in other folders, and the loader passes over a library that it does not find.
    programs = {name: program and os.path.abspath(program) for name, program in programs.items()}
    if chosen.alone:
        alone(chosen.alone, programs)
    names = [name for name in cases() if not chosen.names or any(part in name for part in chosen.names)]
    if chosen.misuse:
        names = [name for name in names if (cases()[name].__doc__ or "").startswith("misuse: ")]
    if chosen.sample:
        # Those that break things, step the clock or stream images need a computer of their own.
        calm = [name for name in names if not any(name in vars(module) for module in (chaos, clock, images))]
        names = sorted(random.sample(calm, min(chosen.sample, len(calm))), key=calm.index)
    if chosen.list:
        print("\n".join(names))
        return 0
    # Who is ended takes the test along that runs.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    prefix = network()
    arguments = ["--zenoh"] if chosen.zenoh else []
    arguments += [word for name, program in programs.items() if program for word in (f"--{name}", program)]
    counts = {"passed": 0, "failed": 0, "skipped": 0}
    failed_at = {}
    for number, name in enumerate(names):
        start = time.monotonic()
        outcome, output, failures = verdict(name, number, prefix, arguments)
        counts[outcome] += 1
        if failures:
            failed_at[name] = failures
        again = f", after {len(failures)} that failed" if failures and outcome != "failed" else ""
        print(f"{outcome:8}{time.monotonic() - start:6.1f} s  {name}{again}", flush=True)
        if outcome != "failed":
            shown(output)
    # At the end, where it is looked for, all that failed once.
    for name, failures in failed_at.items():
        for failure in failures:
            print(f"a run that failed of {name}")
            shown(failure)
    skipped = f", {counts['skipped']} skipped" if counts["skipped"] else ""
    print(f"{counts['passed']} passed, {counts['failed']} failed{skipped}")
    return 0 if counts["passed"] and not counts["failed"] else 1


if __name__ == "__main__":
    sys.exit(main())
