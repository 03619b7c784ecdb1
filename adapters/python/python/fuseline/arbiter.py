"""Answers `fuseline drive`: reads an input line, and writes the machine's decisions.

    fuseline drive -- python -m fuseline.arbiter

It is also the shortest example of a driver for `Fusion`, because it makes every line from the
machine's typed answers.

>>> from io import BytesIO
>>> lines = BytesIO(b'''{"fuseline":1,"window":16,"clouds":[]}
... {"ev":"open","at":0,"t":1}
... {"ev":"result","at":5,"t":1,"p":0}
... ''')
>>> out = BytesIO()
>>> serve(lines, out)
>>> print(out.getvalue().decode(), end="")
{"ev":"done"}
{"ev":"done"}
{"ev": "emit", "at": 5, "t": 1, "p": 0}
{"ev":"done"}
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from typing import IO, Any

from fuseline._fuseline import Fusion
from fuseline._validation import (
    Accepted,
    Admission,
    Admitted,
    Dropped,
    Final,
    Firing,
    Forwarded,
    Held,
    Missed,
    Opening,
    Outcome,
    Preliminary,
    Refused,
    Waiting,
    ns,
)

Decision = dict[str, Any]


def decisions(fusion: Fusion, event: dict[str, Any]) -> Iterator[Decision]:
    """Applies an input to the machine, and yields the decisions in order."""
    fired, answer = _apply(fusion, event)
    now = fusion.now
    for firing in fired:
        for p in firing.timers:
            yield {"ev": "timer", "at": now, "t": firing.t, "p": p}
        yield from _decisions_of(firing.outcome, now, {"t": firing.t})
    about: dict[str, int] = {key: event[key] for key in ("t", "p") if key in event}
    yield from _decisions_of(answer, now, about)
    if isinstance(answer, Forwarded) and fusion.commit == "progressive":
        # An output that retires its timestamp is followed by its end (F9).
        yield {"ev": "final", "at": now, "t": about["t"], "p": answer.by}


def _apply(
    fusion: Fusion, event: dict[str, Any]
) -> tuple[tuple[Firing, ...], Opening | Admission | Outcome]:
    at = event["at"]
    match event:
        case {"ev": "open", "t": t}:
            return fusion.open(at, t, ns(event["deadline"]) if "deadline" in event else None)
        case {"ev": "offer", "t": t, "p": p, "deadline": deadline, "backlog": backlog}:
            return fusion.offer(at, t, p, ns(deadline), backlog)
        case {"ev": "result", "t": t, "p": p}:
            return fusion.result(at, t, p)
        case {"ev": "fail", "t": t, "p": p}:
            return fusion.fail(at, t, p)
        case _:
            return fusion.tick(at), Waiting()


def _decisions_of(
    answer: Opening | Admission | Outcome, now: int, about: dict[str, int]
) -> Iterator[Decision]:
    match answer:
        case Accepted() | Waiting():
            pass
        case Refused(why):
            yield {"ev": "refuse", "at": now, **about, "why": why}
        case Admitted(due):
            yield {"ev": "request", "at": now, **about, "due": due}
        case Dropped(why):
            yield {"ev": "drop", "at": now, **about, "why": why}
        case Held():
            yield {"ev": "hold", "at": now, **about}
        case Missed():
            yield {"ev": "miss", "at": now, "t": about["t"]}
        case Final(by):
            yield {"ev": "final", "at": now, "t": about["t"], "p": by}
        case Preliminary(by, cancelled) | Forwarded(by, cancelled):
            yield {"ev": "emit", "at": now, "t": about["t"], "p": by}
            for p in cancelled:
                yield {"ev": "cancel", "at": now, "t": about["t"], "p": p}


def serve(lines: IO[bytes], out: IO[bytes]) -> None:
    """Answers each line: a header makes a new machine, an input leads to decisions and ``done``."""
    fusion: Fusion | None = None
    for line in lines:
        event = json.loads(line)
        decided: list[Decision] = []
        if "fuseline" in event:
            fusion = Fusion.from_header(line)
        elif fusion is not None:
            decided = list(decisions(fusion, event))
        # The other side waits for the whole answer, so flush it.
        out.write("\n".join([*map(json.dumps, decided), '{"ev":"done"}\n']).encode())
        out.flush()


if __name__ == "__main__":
    serve(sys.stdin.buffer, sys.stdout.buffer)
