"""Writes to standard output each strict trace of a folder as an equation that the kernel of Coq computes."""

import json
import sys
from pathlib import Path

INPUTS = {
    "open": lambda o: f"Open {o['t']} {option(o, 'deadline')}",
    "offer": lambda o: f"Offer {o['t']} {o['p']} {o['deadline']} {o['backlog']}",
    "result": lambda o: f"Result {o['t']} {o['p']}",
    "fail": lambda o: f"Fail {o['t']} {o['p']}",
    "tick": lambda o: "Tick",
}
# The keys of each decision, in the order of its constructor. The constructor is the decision's name
# with a capital.
DECISIONS = {
    "timer": ["p"],
    "request": ["p", "due"],
    "hold": ["p"],
    "drop": ["p", "why"],
    "emit": ["p"],
    "final": ["p"],
    "miss": [],
    "cancel": ["p"],
}


def option(o, key):
    return f"(Some {o[key]})" if key in o else "None"


def decision(o):
    words = [o["ev"].capitalize(), str(o["at"]), str(o["t"])]
    if o["ev"] == "refuse":
        words += [option(o, "p"), o["why"].capitalize()]
    else:
        words += [str(o[key]).capitalize() for key in DECISIONS[o["ev"]]]
    return " ".join(words)


def equation(name, lines):
    header, *rest = lines
    clouds = "; ".join(f"cloud_with {c['p']} {c['limit']} {option(c, 'resume')}" for c in header["clouds"])
    rule = header.get("commit", "eager").capitalize()
    steps = []
    for o in rest:
        if o["ev"] in INPUTS:
            steps.append((f"{{| at_ := {o['at']}; what := {INPUTS[o['ev']](o)} |}}", []))
        else:
            steps[-1][1].append(decision(o))
    inputs = "; ".join(i for i, _ in steps)
    answers = "; ".join(f"[{'; '.join(ds)}]" for _, ds in steps)
    return (
        f"Example {name} : answers {{| window := {header['window']}; rule := {rule}; clouds := [{clouds}] |}} initial\n"
        f"  [{inputs}]\n  = [{answers}].\nProof. vm_compute. reflexivity. Qed."
    )


files = sorted(Path(sys.argv[1]).glob("*.jsonl"))
if not files:
    sys.exit(f"error: no trace in {sys.argv[1]}")
print("""(* Written by corpus.py. *)
From Coq Require Import List NArith.
From Fuseline Require Import Rules.
Import ListNotations.
Open Scope N_scope.
Fixpoint answers cfg s ins :=
  match ins with
  | [] => []
  | i :: rest => let (s1, ds) := step cfg s i in filter written ds :: answers cfg s1 rest
  end.""")
for file in files:
    lines = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    print(equation(file.stem.replace("-", "_"), lines))
