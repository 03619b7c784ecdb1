"""Makes each fault of faults.toml in a copy of Rules.v, and shows that it is caught as its entry says.

    faults.py BUILD             BUILD has the compiled files of this folder and Corpus.v
    faults.py BUILD --record    writes record.json anew: by theorem, the faults that refute it
    faults.py BUILD N           makes N of them, drawn anew
"""

import json
import os
import random
import re
import subprocess
import sys
import tempfile
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).parent
OTHERS = {"local_goes_at_once": ["T1"]}
SHARED = ["Words", "Trace", "Statements", "Broken", "Cases"]
HEADER = """From Coq Require Import List NArith.
From Fuseline Require Import Rules Trace Statements Broken Cases.
Import ListNotations.
Open Scope N_scope.
"""


def compiles(folder, name):
    command = ["coqc", "-q", "-Q", ".", "Fuseline", name]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def takes_rule(statement):
    text = (HERE / "Statements.v").read_text(encoding="utf-8")
    return "cfg" in re.search(rf"Definition {statement} : Prop :=.*?\.\n", text, re.DOTALL)[0]


def counterexample(fault):
    """The negation of a theorem's statement, with the lemma that computes it."""
    if "claim" in fault:
        claim = fault["claim"]
    else:
        rule = f"(under {fault['rule']})"
        claim = f"~ {fault['refutes']} {rule + ' ' if takes_rule(fault['refutes']) else ''}(trace_of {rule} ({fault['inputs']}))"
    return f"{HEADER}Example refuted : {claim}.\nProof. breaks ({fault['by']}). Qed.\n"


def caught(fault, build, folder):
    for name in SHARED:
        (folder / f"{name}.vo").symlink_to(build / f"{name}.vo")
    source = (HERE / "Rules.v").read_text(encoding="utf-8")
    if source.count(fault["find"]) != 1:
        return f"what it replaces stands {source.count(fault['find'])} times in Rules.v"
    (folder / "Rules.v").write_text(source.replace(fault["find"], fault["replace"]), encoding="utf-8")
    made = compiles(folder, "Rules.v")
    if made.returncode:
        return f"its rules do not compile: {made.stderr}"
    if "by" in fault:
        (folder / "Refuted.v").write_text(counterexample(fault), encoding="utf-8")
        made = compiles(folder, "Refuted.v")
        return f"its counterexample computes to no refutation: {made.stderr}" if made.returncode else None
    (folder / "Corpus.v").write_text((build / "Corpus.v").read_text(encoding="utf-8"), encoding="utf-8")
    made = compiles(folder, "Corpus.v")
    if not made.returncode:
        return "no trace of the corpus fails"
    return None if "Unable to unify" in made.stderr else f"the corpus does not compile: {made.stderr}"


build = Path(sys.argv[1])
faults = tomllib.loads((HERE / "faults.toml").read_text(encoding="utf-8"))["fault"]


def lost_because(fault):
    with tempfile.TemporaryDirectory() as folder:
        return caught(fault, build, Path(folder))


drawn = random.sample(faults, int(sys.argv[2])) if sys.argv[2:] and sys.argv[2].isdecimal() else faults
lost = 0
with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
    for fault, why in zip(drawn, pool.map(lost_because, drawn), strict=True):
        if why:
            lost += 1
            print(f"fault {fault['name']}: {why}")
refuting = [fault for fault in faults if "by" in fault]
by_theorem = {}
for fault in refuting:
    by_theorem.setdefault(fault.get("theorem", fault.get("refutes", "").lower()), []).append(fault["name"])
if drawn != faults:
    print(f"{len(drawn)} of {len(faults)} faults, drawn anew: {', '.join(fault['name'] for fault in drawn)}; {lost} are not caught as said")
else:
    print(f"{len(faults)} faults of the rules: {len(refuting)} refute one of {len(by_theorem)} theorems by a computed counterexample, "
          f"{len(faults) - len(refuting)} are caught by the corpus alone, {lost} are not caught as said")


def shows(theorem):
    """The rules and promises of a theorem: those at the head of its name."""
    head = re.match(r"[fpte]\d+g?", theorem)
    return [head[0].capitalize()] if head else OTHERS[theorem]


version = subprocess.run(["coqc", "--print-version"], capture_output=True, text=True, check=True).stdout.split()[0]
obligations = [{"name": name, "shows": shows(name), "faults": by_theorem[name]} for name in sorted(by_theorem)]
text = json.dumps({"solvers": {"Coq": version}, "obligations": obligations}, indent=1) + "\n"
kept = HERE / "record.json"
if "--record" in sys.argv and not lost:
    kept.write_text(text, encoding="utf-8")
elif not kept.exists() or json.loads(kept.read_text(encoding="utf-8"))["obligations"] != obligations:
    sys.exit("error: record.json is older than the faults; run: proofs/coq/check --record")
sys.exit(lost > 0)
