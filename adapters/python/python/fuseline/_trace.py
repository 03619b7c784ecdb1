"""A trace as objects, for notebooks."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, NamedTuple

from fuseline import _fuseline

if TYPE_CHECKING:
    import pyarrow as pa
    from matplotlib.axes import Axes

    from fuseline._judge import Traced


class Line(NamedTuple):
    """A line of a trace after its header; what the line does not have is None."""

    #: The line's number, counted from 1; the header's is 1.
    line: int
    #: What happened or was decided.
    ev: str
    #: The instant, in nanoseconds.
    at: int
    #: The timestamp.
    t: int | None
    #: The source; 0 is local.
    p: int | None
    #: How long a request or local may take, in nanoseconds.
    deadline: int | None
    #: How many requests were queued.
    backlog: int | None
    #: The due instant, in nanoseconds.
    due: int | None
    #: Why it was refused or dropped.
    why: str | None


class Trace:
    """All lines of a trace, in memory.

    Args:
        trace: The trace's bytes, the path of its file, or an iterable of its lines.
        name: Its name in errors; by default its path.

    Raises:
        ReadError: if it cannot be read to its end. Whether it conforms is not looked at: that is
            what `check` is for.
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
        #: The name that it was given.
        self.file = file
        #: The header, as JSON has it.
        self.header: dict[str, Any] = json.loads(header)
        #: The lines after it.
        self.lines = [
            Line(line, ev, at, t, p, deadline, backlog, due, why)
            for line, ev, at, (t, p, deadline, backlog, due), why in rows
        ]

    def __repr__(self) -> str:
        operator = self.header.get("operator")
        return f"Trace({self.file!r}, operator={operator!r}, lines={len(self.lines)})"

    def __len__(self) -> int:
        return len(self.lines)

    def source(self, p: int) -> str:
        """The name of a source."""
        if p == 0:
            return "local"
        for cloud in self.header["clouds"]:
            if cloud["p"] == p:
                return str(cloud.get("name", f"cloud-{p}"))
        return f"cloud-{p}"

    def to_arrow(self) -> pa.Table:
        """The lines as a table, with a column for each field of `Line`.

        Raises:
            ImportError: if pyarrow is not there: ``pip install fuseline[arrow]``.
        """
        from fuseline._arrow import lines_table

        return lines_table(self)

    def timeline(self, ax: Axes | None = None) -> Axes:
        """Draw whose result went out for each message, and what was waited for.

        Each message is a bar from its open to its output, in the colour of the source whose result
        went; requests that were still waited for when it went, or that were late, are marked.

        Args:
            ax: Where to draw; by default a figure of its own.

        Raises:
            ImportError: if matplotlib is not there: ``pip install fuseline[plot]``.
        """
        from fuseline._timeline import draw

        return draw(self, ax)
