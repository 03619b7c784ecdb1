"""Tests that the machine behind `fuseline drive` decides as the corpus does."""

from __future__ import annotations

import io
import json
from collections import Counter
from typing import Any

from conftest import CORPUS
from fuseline import arbiter

INPUTS = {"open", "offer", "result", "fail", "tick"}


def test_each_input_of_the_corpus_is_answered_with_its_decisions() -> None:
    """One process answers all traces, and each header starts a new machine."""
    given: list[bytes] = []
    expected: list[list[dict[str, Any]]] = []
    kinds: Counter[str] = Counter()
    for path in CORPUS:
        for line in path.read_bytes().splitlines(keepends=True):
            event = json.loads(line)
            if "fuseline" in event or event["ev"] in INPUTS:
                given.append(line)
                expected.append([])
            else:
                kinds[event["ev"]] += 1
                expected[-1].append(event)
    assert not {"refuse", "request", "drop", "hold", "miss", "emit", "final", "cancel"} - set(kinds)
    assert any("deadline" in it for it in map(json.loads, given) if it.get("ev") == "open")
    out = FlushedAnswers()
    arbiter.serve(io.BytesIO(b"".join(given)), out)
    answers: list[list[dict[str, Any]]] = [[]]
    for decision in map(json.loads, out.getvalue().splitlines()):
        if decision == {"ev": "done"}:
            answers.append([])
        else:
            answers[-1].append(decision)
    assert answers == [*expected, []]
    assert out.flushed == len(out.getvalue()), "who waits for it would wait for ever"


class FlushedAnswers(io.BytesIO):
    """Records how much was flushed, and checks that each flush ends with a whole answer."""

    flushed = 0

    def flush(self) -> None:
        super().flush()
        assert self.getvalue()[self.flushed :].count(b'"done"') == 1
        self.flushed = len(self.getvalue())
