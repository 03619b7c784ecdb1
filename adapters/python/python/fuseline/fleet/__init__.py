r"""Judges fleets: one function from a trace's path to rows of a table, for any engine.

>>> from pathlib import Path
>>> from tempfile import TemporaryDirectory
>>> with TemporaryDirectory() as logs:
...     path = Path(logs, "drive-7.jsonl")
...     header = '{"fuseline":1,"operator":"lanes","window":16,"clouds":[]}\n'
...     opened = '{"ev":"open","at":0,"t":1}\n{"ev":"result","at":5,"t":1,"p":0}\n'
...     _ = path.write_text(header + opened + '{"ev":"emit","at":5,"t":1,"p":0}\n')
...     (row,) = judge(path)
>>> row.drive, row.operator, row.conforms, row.lines
('drive-7', 'lanes', True, 4)

`fuseline.fleet.ray` and `fuseline.fleet.spark` run it on these engines. `SUMMARIES` has SQL queries
for the table, and `report` makes a page of it.

A trace has one row of its own, without a ``rule``, and one more for each violation, up to 100. A
trace that cannot be read to its end has one row with its ``error``. Only a trace's own row has
counts, so sums over the table are right.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple, TypeAlias

from fuseline import _fuseline
from fuseline._errors import Error, ReadError
from fuseline._fuseline import nanoseconds
from fuseline._judge import DoubtKind, Duration, check_kinds, slack
from fuseline.fleet._summaries import FLATTEN, SUMMARIES

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["FLATTEN", "SUMMARIES", "Output", "Row", "judge", "judge_all", "report", "schema"]

#: A trace's path.
Path_: TypeAlias = str | os.PathLike[str]


class Output(NamedTuple):
    """Counts the messages that one source answered within one range of times."""

    #: The source's priority; 0 is local.
    p: int
    #: The source's name.
    source: str
    #: The greatest time from a message to its output, in seconds. It is rounded up by at most a
    #: 32nd.
    seconds: float
    #: The number of outputs.
    items: int


class Row(NamedTuple):
    """Holds a row of the table: a trace's own, or one of its violations."""

    #: The trace's path, as it was given.
    file: str
    #: The drive to which the trace belongs; the file's name up to its first dot by default.
    drive: str
    #: The operator's name, as the trace has it.
    operator: str | None
    #: True if the trace breaks no rule, and every doubt is accepted. A trace that cannot be read
    #: does not conform.
    conforms: bool
    #: The way of judging: ``strict``, or ``observed`` with tolerance and lateness.
    manner: str
    #: The digest of the judge: SHA-256 of the compiled extension that judged it.
    judge: str
    #: The reason why it cannot be read.
    error: str | None = None
    #: The number of timestamps that were judged.
    judged: int | None = None
    #: The number of lines.
    lines: int | None = None
    #: The seconds from its first instant to its last.
    seconds: float | None = None
    #: The number of messages.
    messages: int | None = None
    #: The number of messages without a result in time.
    missed: int | None = None
    #: The number of messages that were not accepted.
    refused: int | None = None
    #: The outputs, by source and by time.
    outputs: list[Output] | None = None
    #: The number of violations, with those that have no row.
    violations: int | None = None
    #: The kinds of doubt that are not accepted, such as ``silent, coarse``.
    doubts: str | None = None
    #: The violation's line, counted from 1.
    line: int | None = None
    #: The violation's timestamp.
    t: int | None = None
    #: The rule or promise that is broken.
    rule: str | None = None
    #: The line or fact that was found.
    found: str | None = None
    #: The line or fact that the rules demand or allow.
    expected: str | None = None
    #: The seconds by which it came too late; only for observed traces.
    late: float | None = None


def judge(
    path: Path_,
    *,
    tolerance: Duration | None = None,
    lateness: Duration | None = None,
    drive: Callable[[str], str] | None = None,
    open: Callable[[str], BinaryIO] | None = None,  # noqa: A002
    accept: Sequence[DoubtKind] = (),
) -> list[Row]:
    """Judges one trace while it is read, in bounded memory.

    Gzip, zstd and MCAP are unpacked on the way. A trace that cannot be read raises nothing: its row
    has the reason.

    Args:
        path: The trace's path.
        tolerance: The error of recorded instants. With it, and ``lateness``, the trace is judged
            as `fuseline.check_observed` does, else strictly.
        lateness: The greatest delay of timers and outputs.
        drive: Returns the drive to which a path belongs.
        open: Opens a path in mode ``rb``, for stores that are not a file system, such as ``lambda
            path: fsspec.open(path).open()``.
        accept: Kinds of doubt to take as they are; see `fuseline.Verdict.accepting`.

    Raises:
        ValueError: if only one of tolerance and lateness is given, or there is no such kind of
            doubt.
        TimeError: if one of them is not a duration.
    """
    manner, within = _manner(tolerance, lateness)
    check_kinds(accept)
    file = os.fspath(path)
    named = (drive or _drive)(file)
    try:
        if open is None:
            surveyed = _fuseline.survey(file, None, within)
        else:
            with open(file) as stream:
                surveyed = _fuseline.survey(stream, file, within)
    except (Error, OSError, ValueError, EOFError) as error:
        why = _reason(error, file)
        return [Row(file, named, None, False, manner, digest(), why)]
    operator, verdict, (span, messages, missed, refused, outputs) = surveyed
    _, _, judged, lines, violations, more, seen, _ = verdict
    doubts = ", ".join(kind for kind, *_ in seen if kind not in accept) or None
    conforms = not violations and doubts is None
    whole = (file, named, operator, conforms, manner, digest(), None)
    counts = [Output(p, source, upto / 1e9, items) for p, source, upto, items in outputs]
    found = len(violations) + more
    own = Row(*whole, judged, lines, span / 1e9, messages, missed, refused, counts, found, doubts)
    return [own] + [
        Row(
            *whole,
            line=line,
            t=t,
            rule=rule,
            found=found_,
            expected=expected,
            late=None if late is None else late / 1e9,
        )
        for line, t, rule, _, found_, expected, late, _ in violations
    ]


def judge_all(paths: Iterable[Path_], **how: Any) -> pa.Table:
    """Judges traces one after the other, and returns their rows as a table with `schema`.

    Args:
        paths: The traces' paths.
        how: The other arguments of `judge`.

    Raises:
        ImportError: if pyarrow is not there: ``pip install fuseline[arrow]``.
    """
    from fuseline.fleet._arrow import table

    return table(row for path in paths for row in judge(path, **how))


def schema() -> pa.Schema:
    """Returns the columns of the table for pyarrow, which are the fields of `Row`.

    Raises:
        ImportError: if pyarrow is not there: ``pip install fuseline[arrow]``.
    """
    from fuseline.fleet._arrow import SCHEMA

    return SCHEMA


def report(rows: Path_, page: Path_, *, title: str = "Fleet") -> None:
    """Makes a page of rows in Parquet, for a browser. The page needs no network.

    Args:
        rows: A Parquet file, a folder of them, or a pattern such as ``verdicts/*.parquet``.
        page: The page's path.
        title: Its title.

    Raises:
        ImportError: if duckdb is not there: ``pip install fuseline[fleet]``.
        ValueError: if there are no rows.
        OSError: if the page cannot be written.
    """
    from fuseline.fleet._page import write

    write(os.fspath(rows), Path(page), title)


def check_how(
    *,
    tolerance: Duration | None = None,
    lateness: Duration | None = None,
    drive: Callable[[str], str] | None = None,  # noqa: ARG001
    open: Callable[[str], BinaryIO] | None = None,  # noqa: A002, ARG001
    accept: Sequence[DoubtKind] = (),
) -> None:
    """Raises what `judge` would raise for these arguments, before a job begins."""
    _manner(tolerance, lateness)
    check_kinds(accept)


@lru_cache(maxsize=1)
def digest() -> str:
    """Returns the digest of this judge: SHA-256 of the compiled extension."""
    return hashlib.sha256(Path(_fuseline.__file__).read_bytes()).hexdigest()


def _manner(
    tolerance: Duration | None, lateness: Duration | None
) -> tuple[str, tuple[int, int] | None]:
    given = slack(tolerance, lateness)
    if given is None:
        return "strict", None
    nanos = nanoseconds(given[0]), nanoseconds(given[1])
    return f"observed, tolerance {nanos[0]} ns, lateness {nanos[1]} ns", nanos


def _drive(file: str) -> str:
    return PurePath(file).name.split(".")[0] or file


def _reason(error: Exception, file: str) -> str:
    """Returns an error as a line that begins with the file."""
    if isinstance(error, ReadError):
        return str(error)
    words = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return f"{file}: {words}"
