"""Tables for pyarrow, which may not be there."""

from __future__ import annotations

from typing import TYPE_CHECKING

try:
    import pyarrow as pa
except ImportError as error:
    raise ImportError("to_arrow() needs pyarrow: pip install fuseline[arrow]") from error

if TYPE_CHECKING:
    from fuseline._judge import Verdict
    from fuseline._trace import Trace

#: The columns of a table of verdicts.
VERDICTS = pa.schema(
    [
        pa.field("file", pa.string(), nullable=False),
        pa.field("conforms", pa.bool_(), nullable=False),
        pa.field("judged", pa.uint64(), nullable=False),
        pa.field("lines", pa.uint64(), nullable=False),
        pa.field("line", pa.uint64()),
        pa.field("t", pa.uint64()),
        pa.field("rule", pa.string()),
        pa.field("found", pa.string()),
        pa.field("expected", pa.string()),
        pa.field("late", pa.uint64()),
    ]
)
#: The columns of a table of a trace's lines.
LINES = pa.schema(
    [
        pa.field("line", pa.uint64(), nullable=False),
        pa.field("ev", pa.string(), nullable=False),
        pa.field("at", pa.uint64(), nullable=False),
        *(pa.field(name, pa.uint64()) for name in ("t", "p", "deadline", "backlog", "due")),
        pa.field("why", pa.string()),
    ]
)


def verdict_table(verdict: Verdict) -> pa.Table:
    """A row for each violation, at least one."""
    whole = (verdict.file, verdict.conforms, verdict.judged, verdict.lines)
    rows: list[tuple[object, ...]] = [
        (*whole, it.line, it.t, it.rule, it.found, it.expected, it.late)
        for it in verdict.violations
    ] or [(*whole, None, None, None, None, None, None)]
    return _table(rows, VERDICTS)


def lines_table(trace: Trace) -> pa.Table:
    """A row for each line but the header."""
    return _table([tuple(line) for line in trace.lines], LINES)


def _table(rows: list[tuple[object, ...]], schema: pa.Schema) -> pa.Table:
    columns = list(zip(*rows, strict=True)) or [()] * len(schema)
    arrays = [pa.array(column, field.type) for column, field in zip(columns, schema, strict=True)]
    return pa.Table.from_arrays(arrays, schema=schema)
