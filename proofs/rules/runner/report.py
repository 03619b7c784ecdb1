"""The results of a run, for people and for programs."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from typing import Any

from .agree import Agreement
from .question import Answer
from .solver import SOLVERS
from .text import FAULTS, FOLDER, PROMISES, RULES, Fault, Obligation

RECORD = FOLDER / "record.json"


@dataclass
class SolverResult:
    """What one solver answered about one obligation."""

    seconds: float = 0.0
    holds: bool = True
    # A word for each reply that is not the wanted one.
    wrong: list[str] = field(default_factory=list)

    def add(self, answer: Answer) -> None:
        """Takes one reply into account."""
        self.seconds += answer.seconds
        if answer.is_as_wanted:
            return
        match answer.question.about, answer.reply:
            case "holds", "sat":
                self.wrong.append("REFUTED")
            case "holds", _:
                self.wrong.append("NO ANSWER")
            case "case", "unsat":
                self.wrong.append("VACUOUS")
            case "case", _:
                self.wrong.append("NO ANSWER about its case")
            case fault, "unsat":
                self.wrong.append(f"HOLDS with {fault}")
            case fault, _:
                self.wrong.append(f"NO ANSWER with {fault}")

    def text(self) -> str:
        """A few words."""
        return "holds" if not self.wrong else ", ".join(dict.fromkeys(self.wrong))


@dataclass
class Run:
    """The questions and results of a run."""

    stated: list[Obligation]
    seeded: list[Fault]
    versions: dict[str, str]
    seed: int
    results: dict[tuple[str, str], SolverResult] = field(default_factory=dict)
    agreements: list[Agreement] = field(default_factory=list)

    def add(self, answer: Answer) -> None:
        """Takes one reply into account."""
        key = (answer.question.obligation, answer.question.solver)
        self.results.setdefault(key, SolverResult()).add(answer)

    @property
    def holds(self) -> bool:
        """Whether everything is as it must be."""
        agree = all(agreement.difference is None for agreement in self.agreements)
        return agree and not any(result.wrong for result in self.results.values())

    def broken_by(self, name: str) -> list[str]:
        """The faults that break this obligation."""
        return [fault.name for fault in self.seeded if name in fault.breaks]

    def table(self) -> str:
        """For people."""
        rows: list[tuple[str, ...]] = [("obligation", *SOLVERS, "broken by")]
        for one in self.stated:
            results = [self.results[one.name, solver].text() for solver in SOLVERS]
            rows.append((one.name, *results, ", ".join(self.broken_by(one.name))))
        widths = [max(map(len, column)) for column in zip(*rows)]
        padded = ([cell.ljust(width) for cell, width in zip(row, widths)] for row in rows)
        return "\n".join("  ".join(cells).rstrip() for cells in padded)

    def summary(self) -> str:
        """One line for people."""
        solvers = " and ".join(f"{name} {version}" for name, version in self.versions.items())
        if not self.holds:
            return "something does not hold, see above"
        return (
            f"all hold by {solvers}: {len(self.stated)} obligations, none of them vacuous; "
            f"faults that break them: {len(self.seeded)}"
        )

    def json(self) -> str:
        """For programs."""
        obligations = [
            stating(one, self.broken_by(one.name))
            | {
                solver: {
                    "verdict": self.results[one.name, solver].text(),
                    "seconds": round(self.results[one.name, solver].seconds, 2),
                }
                for solver in SOLVERS
            }
            for one in self.stated
        ]
        agreements = [
            {"what": one.what, "compared": one.compared, "difference": one.difference}
            for one in self.agreements
        ]
        report = {
            "holds": self.holds,
            "solvers": self.versions,
            "seed": self.seed,
            "obligations": obligations,
            "agreements": agreements,
        }
        return json.dumps(report, indent=1)


def stating(one: Obligation, faults: list[str]) -> dict[str, Any]:
    """What is stated, without the results of a run."""
    return {
        "name": one.name,
        "shows": list(one.identifiers),
        "sentence": one.sentence,
        "instance": one.instance,
        "faults": faults,
    }


def digest() -> str:
    """Of the files that the record is about."""
    taken = hashlib.sha256()
    for path in (RULES, PROMISES, FAULTS):
        taken.update(path.read_bytes())
    return taken.hexdigest()


def record(run: Run, disagreeing: list[str]) -> str:
    """What the matrix of evidence reads: what each obligation shows, and what breaks it."""
    recorded = {
        "sources": digest(),
        "solvers": run.versions,
        "obligations": [stating(one, run.broken_by(one.name)) for one in run.stated],
        "faults": [
            {"name": one.name, "breaks": list(one.breaks), "disagrees": one.name in disagreeing}
            for one in run.seeded
        ],
    }
    return json.dumps(recorded, indent=1, ensure_ascii=False) + "\n"


def is_recorded() -> bool:
    """Whether the record is about the files as they are."""
    try:
        return bool(json.loads(RECORD.read_text())["sources"] == digest())
    except (OSError, ValueError, KeyError):
        return False
