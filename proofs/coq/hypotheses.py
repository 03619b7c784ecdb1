"""Puts True in the place of each hypothesis of each statement in a copy, and shows that its theorem is proved no more.

    hypotheses.py BUILD            BUILD has the compiled files of this folder
    hypotheses.py BUILD NAME       those of one statement

A proof that stops refutes nothing: it only says that the proof rests on the hypothesis. That the script of the proof is as it
was, with the same names for the same hypotheses, makes it stop where the hypothesis is used and not before.
"""

import os
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).parent
# Hypotheses that no proof rests on, each with the reason why it stands all the same.
NEEDLESS = {}
DEFINITION = re.compile(r"^Definition ([A-Z]\w*_\w+|goes_at_once) ?(.*?): Prop :=(.*?)\.\n(?=\n|\(\*|Definition|End|\Z)", re.M | re.S)


def parts(body):
    """The hypotheses of a statement and its conclusion: what stands between arrows outside of all brackets."""
    found, depth, start, i = [], 0, 0, 0
    while i < len(body):
        depth += (body[i] in "([") - (body[i] in ")]")
        if depth == 0 and body.startswith(("exists ", "if "), i):
            break
        if depth == 0 and body.startswith("->", i):
            found.append((start, i))
            start = i = i + 2
            continue
        if depth == 0 and not found and body[i] == ",":
            start = i + 1
        i += 1
    return found


def statements():
    text = (HERE / "Statements.v").read_text(encoding="utf-8")
    for name, parameters, body in DEFINITION.findall(text):
        uses = "cfg" in body
        own = parameters.strip() or f"{'(cfg : config) ' if uses else ''}(tr : trace)"
        for start, end in parts(body):
            # Such an equation only names a line and what is before it.
            if body[start:end].strip().startswith("tr = "):
                continue
            yield name, own, " ".join(body[start:end].split()), f"{body[:start]} True {body[end:]}"


def theorem_file(name):
    for path in sorted(HERE.glob("*.v")):
        if path.stem not in {"Statements", "Broken", "Examples"}:
            text = path.read_text(encoding="utf-8")
            found = re.search(rf"^ *(?:Local )?(?:Lemma|Theorem) (\w+)[^.]*?(?::|->) {name}\b", text, re.M)
            if found:
                return path, text, found[1]
    sys.exit(f"error: no theorem {name}")


def outcome(build, name, parameters, hypothesis, body):
    path, text, theorem = theorem_file(name)
    imports = text.index("Open Scope N_scope.\n") + len("Open Scope N_scope.\n")
    changed = f"{text[:imports]}Definition {name} {parameters} : Prop :={body}.\n{text[imports:]}"
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "Without.v"
        copy.write_text(changed, encoding="utf-8")
        command = ["coqc", "-q", "-Q", str(build), "Fuseline", str(copy)]
        made = subprocess.run(command, capture_output=True, text=True, check=False)
    if not made.returncode:
        return None
    line = int(re.search(r"line (\d+)", made.stderr)[1])
    before = "\n".join(changed.split("\n")[:line])
    above = re.findall(r"^ *(?:Local )?(?:Lemma|Theorem) (\w+)", before, re.M)
    return above[-1] if above else f"nothing: {made.stderr.strip()}", theorem


build = Path(sys.argv[1]).resolve()
wanted = [it for it in statements() if len(sys.argv) < 3 or it[0] == sys.argv[2]]
with ThreadPoolExecutor(os.cpu_count()) as pool:
    outcomes = list(pool.map(lambda it: outcome(build, *it), wanted))
wrong = 0
for (name, _, hypothesis, _), stopped in zip(wanted, outcomes, strict=True):
    is_needless = (name, hypothesis) in NEEDLESS
    if stopped is None and not is_needless:
        why = "is proved without it"
    elif stopped and is_needless:
        why = "rests on it, and is said not to"
    elif stopped and stopped[0] != stopped[1]:
        why = f"the proof of {stopped[0]} stops, not that of {stopped[1]}"
    else:
        continue
    wrong += 1
    print(f"{name}, {hypothesis}: {why}")
print(f"{len(wanted)} hypotheses of {len({it[0] for it in wanted})} statements: {len(wanted) - wrong - len(NEEDLESS)} are needed, "
      f"{len(NEEDLESS)} are known not to be, {wrong} are not as said")
sys.exit(wrong > 0 or not wanted)
