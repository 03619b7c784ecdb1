"""Reads a trace as objects, for notebooks."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from fuseline import _fuseline

if TYPE_CHECKING:
    import pyarrow as pa
    from matplotlib.axes import Axes

    from fuseline._judge import Traced

#: The instant at which a message was opened, in seconds, and its response time in milliseconds.
Point: TypeAlias = tuple[float, float]


class Line(NamedTuple):
    """Holds a line of a trace after its header. A key that the line lacks is None."""

    #: The line's number, counted from 1; the header's is 1.
    line: int
    #: The kind of the line: an input or a decision.
    ev: str
    #: The instant, in nanoseconds.
    at: int
    #: The timestamp.
    t: int | None
    #: The source; 0 is local.
    p: int | None
    #: The deadline of a request or of local, in nanoseconds.
    deadline: int | None
    #: The number of queued requests.
    backlog: int | None
    #: The due instant, in nanoseconds.
    due: int | None
    #: The reason for a refusal or a drop.
    why: str | None
    #: The message that the value was computed from.
    of: int | None = None
    #: The message that the value is meant for, the key ``for``.
    meant_for: int | None = None
    #: The number of the attempt, the key ``try``.
    attempt: int | None = None
    #: The message's own deadline, in nanoseconds.
    within: int | None = None
    #: The message's age when it was opened, in nanoseconds.
    age: int | None = None
    #: The sensor's stream that the message comes from.
    origin: str | None = None
    #: The message's timestamp there.
    seq: int | None = None
    #: The inputs of joins on the message's way from which nothing came.
    missing: list[str] | None = None


class Trace:
    """Holds all lines of a trace in memory.

    Args:
        trace: The trace's bytes, the path of its file, or an iterable of its lines.
        name: Its name in errors; by default its path.

    Raises:
        ReadError: if it cannot be read to its end. Use `check` to judge whether it conforms.
        OSError: if its file cannot be opened or read.

    >>> trace = Trace(b'''{"fuseline":1,"operator":"lane","window":16,"clouds":[]}
    ... {"ev":"open","at":0,"t":1}
    ... {"ev":"result","at":5,"t":1,"p":0}
    ... {"ev":"emit","at":5,"t":1,"p":0}
    ... ''')
    >>> trace
    Trace('<bytes>', operator='lane', lines=3)
    >>> [line.ev for line in trace.lines]
    ['open', 'result', 'emit']
    """

    def __init__(self, trace: Traced, *, name: str | None = None) -> None:
        file, header, rows = _fuseline.read(trace, name)
        #: The trace's name.
        self.file = file
        #: The header, as JSON has it.
        self.header: dict[str, Any] = json.loads(header)
        #: The lines after it.
        self.lines = [
            Line(line, ev, at, t, p, deadline, backlog, due, why, *(further or ()))
            for line, ev, at, (t, p, deadline, backlog, due), why, further in rows
        ]

    def __repr__(self) -> str:
        operator = self.header.get("operator")
        return f"Trace({self.file!r}, operator={operator!r}, lines={len(self.lines)})"

    def __len__(self) -> int:
        return len(self.lines)

    def source(self, p: int) -> str:
        """Returns the name of a source."""
        if p == 0:
            return "local"
        for cloud in self.header["clouds"]:
            if cloud["p"] == p:
                return str(cloud.get("name", f"cloud-{p}"))
        return f"cloud-{p}"

    def to_arrow(self) -> pa.Table:
        """Returns the lines as a table, with a column for each field of `Line`.

        Raises:
            ImportError: if pyarrow is not there: ``pip install fuseline[arrow]``.
        """
        from fuseline._arrow import LINES, table

        return table([tuple(line) for line in self.lines], LINES)

    def timeline(self, ax: Axes | None = None) -> Axes:
        """Draws the source of each message's output, and the clouds that were awaited in vain.

        Each message is a point: its height is the time that it took, and its colour the source
        whose result was sent. A line below it is a cloud that was awaited in vain.

        Args:
            ax: The axes to draw on; a new figure by default.

        Raises:
            ImportError: if matplotlib is not there: ``pip install fuseline[plot]``.
        """
        from fuseline._timeline import draw

        went, waits, missed = self._latencies()
        order = [0, *sorted(cloud["p"] for cloud in self.header["clouds"])]
        named = [
            (self.source(p), order.index(p) if p in order else None, went[p]) for p in sorted(went)
        ]
        return draw(ax, str(self.header.get("operator") or self.file), named, waits, missed)

    def _latencies(self) -> tuple[dict[int, list[Point]], list[Point], list[float]]:
        """Returns the points of outputs by source and of waits in vain, and when misses came."""
        opened: dict[int, int] = {}
        requested: dict[tuple[int, int], int] = {}
        waits: list[Point] = []
        missed: list[float] = []
        # The latest output of each message, and the messages that have ended.
        outputs: dict[int, tuple[int, int]] = {}
        ended: dict[int, None] = {}
        is_progressive = self.header.get("commit") == "progressive"
        for line in self.lines:
            t, p = line.t, line.p
            if t is None:
                continue
            if line.ev == "open":
                opened[t] = line.at
            elif t not in opened:
                continue
            elif p is None:
                if line.ev == "refuse":
                    missed.append(opened.pop(t) / 1e9)
                elif line.ev == "miss":
                    missed.append(opened[t] / 1e9)
            elif line.ev == "request":
                requested[t, p] = line.at
            elif line.ev in ("timer", "cancel") and p > 0:
                took = line.at - requested.get((t, p), line.at)
                waits.append((opened[t] / 1e9, took / 1e6))
            elif line.ev == "emit":
                outputs[t] = p, line.at
                if not is_progressive:
                    ended[t] = None
            elif line.ev == "final":
                outputs.setdefault(t, (p, line.at))
                ended[t] = None
        went: dict[int, list[Point]] = {}
        for t in ended:
            p, at = outputs[t]
            went.setdefault(p, []).append((opened[t] / 1e9, (at - opened[t]) / 1e6))
        return went, waits, missed
