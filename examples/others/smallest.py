"""The smallest trace that breaks a rule: what happened to one message, and when the run ended."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cases import Case


def smallest(
    case: Case, trace: Path, folder: Path, judge: Callable[[Path], dict[str, Any]]
) -> None:
    """Write one for each rule that a case is expected to break."""
    header, *rows = map(json.loads, trace.read_text().splitlines())
    for rule in sorted(case.breaks):
        violations = [it for it in judge(trace)["violations"] if it["rule"] == rule]
        for violation in violations:
            t = violation.get("t")
            if rule == "J1":  # the message after which nothing comes
                t = max(row["t"] for row in rows if row["ev"] == "open")
            kept = [row for row in rows if row.get("t", t) == t]
            start = kept[0]["at"]
            head = header | {"x": {"breaks": rule, "options": case.options}}
            lines = [head, *(row | {"at": row["at"] - start} for row in kept)]
            path = folder / f"{case.name}-{rule.lower()}.jsonl"
            text = (json.dumps(line, separators=(",", ":")) + "\n" for line in lines)
            path.write_text("".join(text))
            if {it["rule"] for it in judge(path)["violations"]} == {rule}:
                break
