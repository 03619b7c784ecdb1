"""Removes each hypothesis, each row of the tables of reasons and each rule in a copy, and shows that a proof or the corpus stops.

    without.py BUILD            BUILD has the compiled files of this folder and Corpus.v
    without.py BUILD NAME       the hypotheses of one statement or theorem

In the place of a hypothesis comes that it implies True, or True twice where it is a pair. A proof that stops refutes nothing: it
only says that the proof rests on the hypothesis. Its script stays as it was, with the same names for the same hypotheses, so it
stops where the hypothesis is used and not before.
"""

import os
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).parent
STATEMENT = re.compile(r"^Definition ([A-Z]\w*_\w+|goes_at_once) ?(.*?): Prop :=(.*?)\.\n(?=\n|\(\*|Definition|End|\Z)", re.M | re.S)
# A theorem whose statement has no name of its own.
THEOREM = re.compile(r"^Theorem ([epst]\d+_\w+)(.*?)\.\s+(?:\(\* ANCHOR_END.*?\n)?Proof", re.M | re.S)
ASSUMED = re.compile(r"^Hypothesis (\w+) : (.*?)\.$", re.M)
# These are two by their definition, and taken apart as two.
PAIR = re.compile(r"within |.* <= .* <= ")
# What each rule of Rules.v does, and how it does nothing.
RULES = {
    "F0": ("let s0 := set_clock (at_ i) s in", "let s0 := s in"),
    "F1": ("| Open t deadline => open cfg s t deadline", "| Open t deadline => (s, [])"),
    "F2": ("| Offer t p deadline backlog => offer cfg s t p deadline backlog", "| Offer t p deadline backlog => (s, [])"),
    "F2g": ("Some c => shut_then s c backlog | None", "Some c => false | None"),
    "F3": ("| Result t p => arrive cfg s t p (result cfg (clock s) t p)", "| Result t p => (s, [])"),
    "F4": ("| Fail t p => arrive cfg s t p (fail cfg (clock s) t p)", "| Fail t p => (s, [])"),
    "F5": ("if due <=? clock s then", "if false then"),
    "F6": ("if is_progressive cfg then\n    match pending", "if true then (Some sl, []) else if true then\n    match pending"),
    "F7": ("(None, Emit now t m :: map (Cancel now t) (clouds_of (pending sl)))", "(None, [])"),
    "F9": ("if is_progressive cfg then improve now t p sl", "if is_progressive cfg then (Some sl, [])"),
}
ROW = re.compile(r"^  \((\w+), .*?\)(;?)$", re.M)


class Removal(NamedTuple):
    """A file without something, and the theorem that should stop."""

    of: str
    what: str
    text: str
    theorem: str | None
    """Without one, any of its section."""


def source(name):
    return (HERE / name).read_text(encoding="utf-8")


def hypotheses(body):
    """Where the hypotheses of a statement stand: between arrows outside of all brackets."""
    found, depth, start, i = [], 0, 0, 0
    while i < len(body):
        depth += (body[i] in "([") - (body[i] in ")]")
        if depth == 0 and body.startswith(("exists ", "if "), i):
            break
        if depth == 0 and body.startswith("->", i):
            found.append((start, i))
            start = i = i + 2
            continue
        if depth == 0 and (body[i] == "," or re.match(r"\sin\s", body[i:])):
            start = i + 1 if body[i] == "," else i + 4
        i += 1
    return found


def without(body):
    for start, end in hypotheses(body):
        what = " ".join(body[start:end].split())
        # Such an equation only names a line and what is before it.
        if not what.startswith("tr = "):
            nothing = "(True /\\ True)" if PAIR.match(what) else f"({what} -> True)"
            yield what, f"{body[:start]} {nothing} {body[end:]}"


def of_statements(wanted):
    for name, parameters, body in STATEMENT.findall(source("Statements.v")):
        if wanted not in {None, name}:
            continue
        own = parameters.strip() or f"{'(cfg : config) ' if 'cfg' in body else ''}(tr : trace)"
        text, theorem = proof_of(name)
        imports = text.index("Open Scope N_scope.\n") + len("Open Scope N_scope.\n")
        for what, rest in without(body):
            yield Removal(name, what, f"{text[:imports]}Definition {name} {own} : Prop :={rest}.\n{text[imports:]}", theorem)


def proof_of(name):
    for path in sorted(HERE.glob("*.v")):
        if path.stem not in {"Statements", "Broken", "Examples"}:
            text = source(path.name)
            found = re.search(rf"^ *(?:Local )?(?:Lemma|Theorem) (\w+)[^.]*?(?::|->) {name}\b", text, re.M)
            if found:
                return text, found[1]
    sys.exit(f"error: no theorem {name}")


def body_at(text, i):
    """What follows the first colon outside of brackets."""
    depth = 0
    while depth or text[i] != ":":
        depth += (text[i] in "([") - (text[i] in ")]")
        i += 1
    return i + 1


def of_theorems(wanted):
    for path in sorted(HERE.glob("*.v")):
        text = source(path.name)
        if path.stem == "Statements":
            continue
        for found in [*STATEMENT.finditer(text), *THEOREM.finditer(text), *ASSUMED.finditer(text)]:
            name, last = found[1], found.lastindex
            if wanted not in {None, name}:
                continue
            if found.re is ASSUMED:
                yield Removal(name, found[2], f"{text[: found.start(2)]}True{text[found.end(2) :]}", None)
                continue
            start = found.start(last) if found.re is STATEMENT else body_at(text, found.start(2))
            theorem = proof_of(name)[1] if found.re is STATEMENT else name
            for what, rest in without(text[start : found.end(last)]):
                yield Removal(name, what, text[:start] + rest + text[found.end(last) :], theorem)


def compiled(folder, build, name):
    command = ["coqc", "-q", "-Q", str(build), "Fuseline", name]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def proved(build, removal):
    """Why it is not as it should be, if so."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "Without.v").write_text(removal.text, encoding="utf-8")
        made = compiled(folder, build, "Without.v")
    if not made.returncode:
        return "everything is proved without it"
    line, column = map(int, re.search(r"line (\d+), characters (\d+)", made.stderr).groups())
    lines = removal.text.split("\n")
    before = "\n".join([*lines[: line - 1], lines[line - 1][:column]])
    above = re.findall(r"^ *(?:Local )?(?:Lemma|Theorem|Example) (\w+)", before, re.M)
    stopped = above[-1] if above and before.rfind("Proof.") > before.rfind(above[-1]) else None
    if removal.theorem is None:
        assumed = removal.text.index(f"Hypothesis {removal.of} :")
        is_there = "\nEnd " not in before[assumed:]
        return None if stopped and is_there else f"nothing of its section stops: {made.stderr.strip()}"
    return None if stopped == removal.theorem else f"it is not the proof of {removal.theorem} that stops: {made.stderr.strip()}"


def of_rules():
    """Each row of a table and each rule, with the rules that lack it."""
    text = source("Rules.v")
    headings = set(re.findall(r"^\(\*\* \*\* (F\d+g?)\b", text, re.M))
    if headings != set(RULES):
        sys.exit(f"error: Rules.v and RULES differ in {', '.join(headings ^ set(RULES))}")
    for rule, (find, replace) in RULES.items():
        if text.count(find) != 1:
            sys.exit(f"error: `{find}` stands {text.count(find)} times in Rules.v")
        yield rule, text.replace(find, replace)
    for table in re.finditer(r"^Definition (f\d)_reasons .*?\n\]\.", text, re.M | re.S):
        for row in ROW.finditer(table[0]):
            cut = table[0].replace(row[0], f"  ({row[1]}, false){row[2]}")
            yield f"{table[1].upper()} {row[1].lower()}", text.replace(table[0], cut)


def ruled(build, rules):
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        (here / "Words.vo").symlink_to(build / "Words.vo")
        (here / "Rules.v").write_text(rules, encoding="utf-8")
        (here / "Corpus.v").symlink_to(build / "Corpus.v")
        for name in ["Rules.v", "Corpus.v"]:
            made = compiled(here, here, name)
            if made.returncode:
                found = "Unable to unify" in made.stderr and name == "Corpus.v"
                return None if found else f"{name} does not compile: {made.stderr.strip()}"
    return "no trace of the corpus fails"


def main():
    build = Path(sys.argv[1]).resolve()
    wanted = sys.argv[2] if len(sys.argv) > 2 else None
    removals = [*of_statements(wanted), *of_theorems(wanted)]
    rules = [] if wanted else [*of_rules()]
    wrong = 0
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        jobs = [(f"{it.of}, {it.what}", pool.submit(proved, build, it)) for it in removals]
        jobs += [(name, pool.submit(ruled, build, text)) for name, text in rules]
        for name, job in jobs:
            if why := job.result():
                wrong += 1
                print(f"{name}: {why}", flush=True)
    print(f"{len(removals)} hypotheses of {len({it.of for it in removals})} statements, {len(rules)} rules and reasons removed: "
          f"{len(jobs) - wrong} are needed, {wrong} are not")
    sys.exit(wrong > 0 or not jobs)


main()
