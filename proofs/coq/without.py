"""Removes each hypothesis in a copy, and runs the proof scripts; removes each row of the tables of reasons and each rule, and runs
the corpus.

    without.py BUILD            BUILD has the compiled files of this folder and Corpus.v
    without.py BUILD NAME       the hypotheses of one statement or theorem

In the place of a hypothesis comes that it implies True, or True twice where it is a pair, so that the scripts find as many
hypotheses under the same names. Where a script stops, that script uses the hypothesis. This does not show that the statement is
false without it, for another script might prove it; a script that does not stop shows that the hypothesis can go. Where a trace of
the corpus fails without a row or a rule, the corpus tells the rules with it from those without it.
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
STATEMENT = re.compile(r"^Definition ([A-Z]\w*_\w+) ?(.*?): Prop :=(.*?)\.\n(?=\n|\(\*|Definition|End|\Z)", re.M | re.S)
# A theorem whose statement has no name of its own.
THEOREM = re.compile(r"^Theorem ([epst]\d+_\w+)(.*?)\.\s+(?:\(\* ANCHOR_END.*?\n)?Proof", re.M | re.S)
ASSUMED = re.compile(r"^Hypothesis (\w+) : (.*?)\.$", re.M)
IMPORTS = re.compile(r"^From Fuseline Require (?:Import|Export) ([^.]*)\.", re.M)
# These are pairs by definition, and scripts take them apart as pairs.
PAIR = re.compile(r"within |.* <= .* <= ")
# They only compute; no theorem is proved in them.
COMPUTING = {"Statements", "Computed", "Broken", "Cases", "Examples"}
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
TEXTS = {path.stem: path.read_text(encoding="utf-8") for path in sorted(HERE.glob("*.v"))}
NEEDS = {name: {it for found in IMPORTS.findall(text) for it in found.split()} for name, text in TEXTS.items()}


class Removal(NamedTuple):
    """Files without something, in the order in which they are compiled."""

    of: str
    what: str
    files: list[tuple[str, str]]


def above(name):
    """All that a file rests on."""
    found = set(NEEDS[name])
    for it in NEEDS[name]:
        found |= above(it)
    return found


def hypotheses(body):
    """Finds where the hypotheses of a statement begin and end: between arrows outside of all brackets."""
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
        # An equation of this form only names a line and the lines before it.
        if not what.startswith("tr = "):
            nothing = "(True /\\ True)" if PAIR.match(what) else f"({what} -> True)"
            yield what, f"{body[:start]} {nothing} {body[end:]}"


def parameters(own, body):
    """Returns the parameters that a definition of Statements.v needs outside of its section."""
    if "tr" in own:
        return own.strip()
    return f"{'(cfg : config) ' if 'cfg' in body else ''}(tr : trace) {own.strip()}".strip()


def redefined(name, own, rest, statements):
    """Returns the definition of a statement without a hypothesis, and of the statements that rest on it."""
    text = f"Definition {name} {parameters(own, rest)} : Prop :={rest}.\n"
    arguments = "cfg tr" if "cfg" in rest else "tr"
    for other, params, body in statements:
        if other != name and re.search(rf"\b{name}\b", body):
            used = re.sub(rf"\b{name}\b", f"{name} {arguments}", body)
            text += f"Definition {other} {parameters(params, used)} : Prop :={used}.\n"
    return text


def of_statements(wanted):
    statements = STATEMENT.findall(TEXTS["Statements"])
    imports = TEXTS["Statements"][: TEXTS["Statements"].index("Open Scope N_scope.")].split("*)")[-1]
    header = f"{imports}From Fuseline Require Import Statements.\nOpen Scope N_scope.\n"
    for name, own, body in statements:
        if wanted not in {None, name}:
            continue
        for what, rest in without(body):
            text = redefined(name, own, rest, statements)
            names = "|".join(re.findall(r"^Definition (\w+)", text, re.M))
            proving = [it for it in TEXTS if it not in COMPUTING and re.search(rf"\b(?:{names})\b", TEXTS[it])]
            between = [it for it in TEXTS if above(it) & set(proving) and any(it in above(last) for last in proving)]
            files = sorted({*proving, *between}, key=lambda it: (len(above(it)), it))
            imported = r"\g<0>\nFrom Fuseline Require Import Without."
            changed = [(it, re.sub(r"(?s)\A.*^From Fuseline[^.]*\.$", imported, TEXTS[it], count=1, flags=re.M)) for it in files]
            yield Removal(name, what, [("Without", header + text), *changed])


def body_at(text, i):
    """Returns the position behind the first colon outside of brackets."""
    depth = 0
    while depth or text[i] != ":":
        depth += (text[i] in "([") - (text[i] in ")]")
        i += 1
    return i + 1


def of_theorems(wanted):
    for path, text in TEXTS.items():
        if path == "Statements":
            continue
        for found in [*STATEMENT.finditer(text), *THEOREM.finditer(text), *ASSUMED.finditer(text)]:
            name, last = found[1], found.lastindex
            if wanted not in {None, name}:
                continue
            if found.re is ASSUMED:
                yield Removal(name, found[2], [(path, f"{text[: found.start(2)]}True{text[found.end(2) :]}")])
                continue
            start = found.start(last) if found.re is STATEMENT else body_at(text, found.start(2))
            for what, rest in without(text[start : found.end(last)]):
                yield Removal(name, what, [(path, text[:start] + rest + text[found.end(last) :])])


def linked(folder, build, names):
    """Links to what is compiled, so that a file compiled here comes before that of the same name there."""
    for it in build.glob("*.vo"):
        if it.stem not in names:
            (folder / it.name).symlink_to(it)


def compiled(folder, name):
    return subprocess.run(["coqc", "-q", "-Q", ".", "Fuseline", name], cwd=folder, capture_output=True, text=True, check=False)


def unused(build, removal):
    """Returns why no script is seen to use what was removed, or None if one uses it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        linked(folder, build, {file for file, _ in removal.files})
        for file, text in removal.files:
            (folder / f"{file}.v").write_text(text, encoding="utf-8")
            made = compiled(folder, f"{file}.v")
            if made.returncode:
                line = int(re.search(r"line (\d+), characters", made.stderr)[1])
                before = "\n".join(text.split("\n")[:line])
                is_proof = before.rfind("Proof.") > max(before.rfind("\nDefinition "), before.rfind("\nFrom "))
                return None if file != "Without" and is_proof else f"{file}.v does not compile: {made.stderr.strip()}"
    return "no script stops without it: it can go"


def of_rules():
    """Each row of a table and each rule, with the rules that lack it."""
    text = TEXTS["Rules"]
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
            made = compiled(here, name)
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
        jobs = [(f"{it.of}, {it.what}", pool.submit(unused, build, it)) for it in removals]
        jobs += [(name, pool.submit(ruled, build, text)) for name, text in rules]
        for name, job in jobs:
            if why := job.result():
                wrong += 1
                print(f"{name}: {why}", flush=True)
    print(f"{len(removals)} hypotheses of {len({it.of for it in removals})} statements removed one at a time: the proof scripts use each, "
          f"but for those above; {len(rules)} rules and reasons removed: a trace of the corpus fails without each, but for those above")
    sys.exit(wrong > 0 or not jobs)


main()
