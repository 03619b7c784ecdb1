"""Makes each fault of faults.toml in a copy of Rules.v, and shows that it is caught as its entry says.

    faults.py BUILD             BUILD has the compiled files of this folder and Corpus.v
    faults.py BUILD N           makes N of them, drawn for this run
"""

import os
import random
import subprocess
import sys
import tempfile
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).parent
SHARED = ["Words", "Trace", "Statements", "Computed", "Broken", "Cases"]
HEADER = """From Coq Require Import List NArith.
From Fuseline Require Import Rules Trace Statements Broken Cases.
Import ListNotations.
Open Scope N_scope.
"""
THEOREMS = "\n".join(path.read_text(encoding="utf-8") for path in sorted(HERE.glob("*.v")))


def compiles(folder, name):
    command = ["coqc", "-q", "-Q", ".", "Fuseline", name]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def counterexample(fault):
    """Returns the negation of a theorem's statement, with the lemma that computes it."""
    if "claim" in fault:
        claim = fault["claim"]
    else:
        rule = f"(under {fault['rule']})"
        of_rule = f"{rule} " if f": {fault['refutes']} cfg tr" in THEOREMS else ""
        claim = f"~ {fault['refutes']} {of_rule}(trace_of {rule} ({fault['inputs']}))"
    return f"{HEADER}Example refuted : {claim}.\nProof. breaks ({fault['by']}). Qed.\n"


def caught(fault, build, folder):
    """Returns why the fault is not caught as its entry says, or None."""
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


def lost_because(fault):
    with tempfile.TemporaryDirectory() as folder:
        return caught(fault, BUILD, Path(folder))


BUILD = Path(sys.argv[1]).resolve()
faults = tomllib.loads((HERE / "faults.toml").read_text(encoding="utf-8"))["fault"]
drawn = random.sample(faults, int(sys.argv[2])) if sys.argv[2:] else faults
lost = 0
with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
    for fault, why in zip(drawn, pool.map(lost_because, drawn), strict=True):
        if why:
            lost += 1
            print(f"fault {fault['name']}: {why}")
if len(drawn) < len(faults):
    print(f"{len(drawn)} of {len(faults)} faults, drawn for this run: {', '.join(fault['name'] for fault in drawn)}; "
          f"{lost} are not caught as their entries say")
else:
    refuting = [fault for fault in faults if "by" in fault]
    theorems = {fault.get("theorem", fault.get("refutes", "").lower()) for fault in refuting}
    print(f"{len(faults)} faults of the rules: {len(refuting)} refute one of {len(theorems)} theorems by a computed counterexample, "
          f"{len(faults) - len(refuting)} are caught by the corpus alone; {lost} are not caught as their entries say")
sys.exit(lost > 0 or not drawn)
