"""Judges traces."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from html import escape
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias, cast, get_args

from fuseline import _fuseline
from fuseline._validation import ns

if TYPE_CHECKING:
    import pyarrow as pa

#: A trace: its bytes, the path of its file, or an iterable of its lines. Gzip is unpacked.
Traced: TypeAlias = bytes | str | PathLike[str] | Iterable[bytes] | Iterable[str]
#: A duration: seconds as a float, a timedelta, or nanoseconds as `ns`. A plain int is refused.
Duration: TypeAlias = float | timedelta | ns


@dataclass(frozen=True)
class Violation:
    """Reports a decision that the rules do not demand, or a timestamp that they cannot explain."""

    #: The line, counted from 1. If a decision is missing, the line after which it should stand.
    line: int
    #: The timestamp.
    t: int | None
    #: The identifier of the rule or promise that is broken.
    rule: str
    #: The rule in a sentence.
    sentence: str
    #: The line or fact that was found.
    found: str
    #: The line or fact that the rules demand or allow.
    expected: str
    #: The time by which it came too late, in nanoseconds; only for observed traces.
    late: int | None = None
    #: The timestamp's last lines before it, with their numbers.
    story: tuple[str, ...] = ()

    def __str__(self) -> str:
        about = "" if self.t is None else f"timestamp {self.t} "
        lines = [
            f"{self.line}: {about}breaks {self.rule}: {self.sentence}",
            f"  found    {self.found}",
            f"  expected {self.expected}",
        ]
        return "\n".join(lines + [f"  | {line}" for line in self.story])


#: The kinds of doubt. Section 7 of SPEC.md defines each one.
DoubtKind: TypeAlias = Literal[
    "unjudged",
    "unanswered",
    "unfinished",
    "unopened",
    "silent",
    "coarse",
    "blurred",
    "endless",
    "cut",
]


@dataclass(frozen=True)
class Doubt:
    """Reports one kind of doubt: what the judge could not see."""

    #: The kind of doubt.
    kind: DoubtKind
    #: The number of messages, requests or lines in doubt.
    count: int
    #: The finding, in a sentence.
    found: str
    #: The first message in doubt, if the doubt is about messages.
    t: int | None = None
    #: True if the kind is accepted.
    accepted: bool = False

    def __str__(self) -> str:
        return f"{self.kind}: {self.found}"


@dataclass(frozen=True)
class Verdict:
    r"""Holds the verdict on one trace, with its violations and doubts.

    >>> verdict = check(b'{"fuseline":1,"window":16,"clouds":[]}\n')
    >>> verdict.conforms, verdict.judged
    (False, 0)
    >>> print(verdict)
    <bytes>: no violation found; 0 timestamps judged in 1 lines
      unjudged: no timestamp was judged
    """

    #: The name that the trace was given.
    file: str
    #: True if the trace breaks no rule, and every doubt is accepted.
    conforms: bool
    #: The number of timestamps that were judged.
    judged: int
    #: The number of lines, with the header.
    lines: int
    #: The violations, up to 100.
    violations: tuple[Violation, ...] = ()
    #: The number of further violations.
    more: int = 0
    #: The doubts: the things that the judge could not see.
    doubts: tuple[Doubt, ...] = ()
    #: The cause that explains most violations of an observed trace, if one cause does.
    cause: str | None = None

    def accepting(self, *kinds: DoubtKind) -> Verdict:
        """Returns the same verdict with these kinds of doubt accepted.

        Raises:
            ValueError: if there is no such kind.
        """
        check_kinds(kinds)
        doubts = tuple(replace(it, accepted=it.accepted or it.kind in kinds) for it in self.doubts)
        conforms = not self.violations and all(it.accepted for it in doubts)
        return replace(self, doubts=doubts, conforms=conforms)

    def __bool__(self) -> bool:
        """Raises a TypeError, because every verdict would be true."""
        raise TypeError("a verdict is neither true nor false; ask for its conforms")

    def _summary(self) -> str:
        if self.violations:
            return "does not conform"
        if not self.conforms:
            return "no violation found"
        accepted = ", ".join(it.kind for it in self.doubts)
        return f"conforms, accepting {accepted}" if accepted else "conforms"

    def __str__(self) -> str:
        word = self._summary()
        lines = [f"{self.file}: {word}; {self.judged} timestamps judged in {self.lines} lines"]
        lines += [f"  likely: {self.cause}"] if self.cause else []
        lines += [f"  {doubt}" for doubt in self.doubts]
        lines += [f"{self.file}:{violation}" for violation in self.violations]
        if self.more:
            lines.append(f"{self.more} more violations")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Shows the verdict in a notebook."""
        colour = "#cf222e" if self.violations else "#9a6700" if self.doubts else "#1a7f37"
        head = (
            f"<p><b style='color:{colour}'>{self._summary()}</b> &nbsp;"
            f"<code>{escape(self.file)}</code>, "
            f"{self.judged:,} timestamps judged in {self.lines:,} lines</p>"
        )
        beside = ([f"likely: {self.cause}"] if self.cause else []) + list(map(str, self.doubts))
        head += "".join(f"<p>{escape(text)}</p>" for text in beside)
        if not self.violations:
            return head
        left = "style='text-align:left;vertical-align:top;white-space:pre-wrap'"
        names = ("line", "timestamp", "rule", "found", "expected")
        row = "".join(f"<th {left}>{name}</th>" for name in names)
        rows = [f"<tr>{row}</tr>"]
        for it in self.violations:
            story = escape("\n".join(it.story), quote=True)
            t = "" if it.t is None else str(it.t)
            cells = (str(it.line), t, f"{it.rule}: {it.sentence}", it.found, it.expected)
            row = "".join(f"<td {left}>{escape(cell)}</td>" for cell in cells)
            rows.append(f'<tr title="{story}">{row}</tr>')
        more = f"<p>{self.more:,} more violations</p>" if self.more else ""
        return f"{head}<table>{''.join(rows)}</table>{more}"

    def to_arrow(self) -> pa.Table:
        """Returns a table with a row for each violation, or one row if there is none.

        So a table of many files has at least one row for each file.

        Raises:
            ImportError: if pyarrow is not there: ``pip install fuseline[arrow]``.
        """
        from fuseline._arrow import VERDICTS, table

        whole = (self.file, self.conforms, self.judged, self.lines)
        rows: list[tuple[object, ...]] = [
            (*whole, it.line, it.t, it.rule, it.found, it.expected, it.late)
            for it in self.violations
        ]
        return table(rows or [(*whole, None, None, None, None, None, None)], VERDICTS)


def check_kinds(kinds: Iterable[str]) -> None:
    """Raises ValueError if one of them is not a kind of doubt."""
    known = get_args(DoubtKind)
    if unknown := [kind for kind in kinds if kind not in known]:
        raise ValueError(f"{unknown[0]!r} is not a kind of doubt; the kinds are {', '.join(known)}")


def check(
    trace: Traced,
    *,
    name: str | None = None,
    ended: bool = False,
    accept: Sequence[DoubtKind] = (),
) -> Verdict:
    """Judges a trace strictly: every decision must be the one that the rules demand.

    Files and lines are judged while they are read, in bounded memory. Other threads run meanwhile,
    and Ctrl-C ends the judging.

    Args:
        trace: The trace's bytes, the path of its file, or an iterable of its lines, either all with
            their line ends or all without. Gzip is unpacked.
        name: Its name in the verdict and in errors; by default its path.
        ended: True if the run is known to be over. Each timer that has not fired is then overdue,
            even if it is due after the trace's end. A message that waits only for local is in doubt
            (``unfinished``).
        accept: Kinds of doubt to take as they are; see `Verdict.accepting`.

    Raises:
        ReadError: if it cannot be read to its end.
        OSError: if its file cannot be opened or read.
        ValueError: if there is no such kind of doubt.

    >>> trace = b'''{"fuseline":1,"window":16,"clouds":[]}
    ... {"ev":"open","at":0,"t":1}
    ... {"ev":"result","at":5,"t":1,"p":0}
    ... {"ev":"emit","at":5,"t":1,"p":0}
    ... '''
    >>> print(check(trace))
    <bytes>: conforms; 1 timestamps judged in 4 lines
    """
    return _verdict(_fuseline.check(trace, name, None, (), ended, None)).accepting(*accept)


def check_observed(
    trace: Traced,
    *,
    tolerance: Duration,
    lateness: Duration,
    tolerances: Mapping[str, Duration] | None = None,
    name: str | None = None,
    ended: bool = False,
    period: Duration | None = None,
    accept: Sequence[DoubtKind] = (),
) -> Verdict:
    """Judges a trace that a concurrent implementation recorded, each timestamp by itself.

    Args:
        trace: The trace, as for `check`.
        tolerance: The error of every recorded instant, either way.
        lateness: The greatest delay of a timer after its due instant, and of an output after its
            decision.
        tolerances: The errors of single sources' instants, by the source's name: ``local`` or the
            cloud's.
        name: Its name in the verdict and in errors; by default its path.
        ended: True if the run is known to be over, as for `check`.
        period: The time from one message to the next. A longer gap is a violation (J1).
        accept: Kinds of doubt to take as they are; see `Verdict.accepting`.

    Raises:
        ReadError: if it cannot be read to its end, or is out of order by more than the tolerance.
        OSError: if its file cannot be opened or read.
        ValueError: if the trace has no source of a name in ``tolerances``, or there is no such
            kind of doubt.
    """
    by_source = list((tolerances or {}).items())
    slack = tolerance, lateness
    verdict = _verdict(_fuseline.check(trace, name, slack, by_source, ended, period))
    return verdict.accepting(*accept)


def replay(trace: Traced, *, name: str | None = None) -> bytes:
    """Gives a trace's inputs to a fresh machine, and returns the trace with its decisions.

    >>> inputs = b'''{"fuseline":1,"window":16,"clouds":[]}
    ... {"ev":"open","at":0,"t":1}
    ... {"ev":"result","at":5,"t":1,"p":0}
    ... '''
    >>> print(replay(inputs).decode().splitlines()[-1])
    {"ev":"emit","at":5,"t":1,"p":0}

    Raises:
        ReadError: if it cannot be read to its end.
        OSError: if its file cannot be opened or read.
    """
    return _fuseline.replay(trace, name)


def report(
    *traces: Traced | list[str | PathLike[str]],
    page: str | PathLike[str] = "report.html",
    names: Sequence[str] | None = None,
    tolerance: Duration | None = None,
    lateness: Duration | None = None,
    tolerances: Mapping[str, Duration] | None = None,
) -> tuple[Verdict, ...]:
    """Judges traces and writes the page about them: the page of ``fuseline report``.

    The page is one file that needs no network. It has a summary by source, the response times, and
    a timeline with violations. The timeline shows the whole run, and for each timestamp what
    happened and why.

    Args:
        traces: The traces, each as for `check`, or one list of paths.
        page: The page's path. The page is written once all traces are read, and replaces an
            existing file only then.
        names: The traces' names, one for each; their paths by default.
        tolerance: The error of recorded instants. With it, and ``lateness``, the traces are judged
            as `check_observed` does, else strictly.
        lateness: The greatest delay of timers and outputs.
        tolerances: The errors of single sources' instants, by name, as for `check_observed`.

    Returns:
        A verdict for each trace.

    Raises:
        ReadError: if a trace cannot be read to its end.
        OSError: if a trace cannot be opened or read, or the page cannot be written.
        ValueError: if there is no trace, or a list of paths beside other traces. Also if only one
            of tolerance and lateness is given, or the number of names is not the number of traces.
            Also if ``tolerances`` names no source, or is given without a tolerance for all others.
    """
    each = _each_trace(traces)
    if not each:
        raise ValueError("report takes at least one trace")
    if names is not None and len(names) != len(each):
        raise ValueError(f"there are {len(each)} traces and {len(names)} names")
    called: Sequence[str | None] = names or [None] * len(each)
    named = list(zip(each, called, strict=True))
    judged_by = slack(tolerance, lateness)
    if tolerances and judged_by is None:
        raise ValueError("tolerances need a tolerance for all other sources; give tolerance= too")
    verdicts, html = _fuseline.report(named, judged_by, list((tolerances or {}).items()))
    replace_file(Path(page), html)
    return tuple(map(_verdict, verdicts))


def _each_trace(traces: tuple[Traced | list[str | PathLike[str]], ...]) -> list[Traced]:
    """Returns the traces. A list of paths stands for all its paths.

    A list of lines is one trace, like any other iterable of lines. Its first line is the header, a
    JSON object.
    """
    lists = [given for given in traces if isinstance(given, list) and _are_paths(given)]
    if not lists:
        return list(traces)  # type: ignore[arg-type]
    if len(traces) > 1:
        raise ValueError("a list of paths stands for all traces; name the page's path with page=")
    return list(lists[0])


def _are_paths(given: list[str | PathLike[str]]) -> bool:
    first = given[0] if given else ""
    return isinstance(first, PathLike) or (isinstance(first, str) and not first.startswith("{"))


def slack(
    tolerance: Duration | None, lateness: Duration | None
) -> tuple[Duration, Duration] | None:
    """Returns both values, or None if neither is given. Refuses one without the other."""
    if tolerance is None and lateness is None:
        return None
    if tolerance is None or lateness is None:
        raise ValueError("tolerance and lateness go together; give both, or none to judge strictly")
    return tolerance, lateness


def replace_file(path: Path, content: bytes) -> None:
    """Writes a file completely or not at all."""
    beside = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        with beside.open("xb") as file:
            file.write(content)
        beside.replace(path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def _verdict(fields: _fuseline._Verdict) -> Verdict:
    file, conforms, judged, lines, violations, more, doubts, cause = fields
    listed = tuple(Violation(*violation[:7], tuple(violation[7])) for violation in violations)
    seen = tuple(Doubt(cast("DoubtKind", doubt[0]), *doubt[1:]) for doubt in doubts)
    return Verdict(file, conforms, judged, lines, listed, more, seen, cause)
