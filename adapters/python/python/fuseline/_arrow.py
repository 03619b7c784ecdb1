"""Makes tables for pyarrow, which is optional."""

from __future__ import annotations

try:
    import pyarrow as pa
except ImportError as error:
    raise ImportError("to_arrow() needs pyarrow: pip install fuseline[arrow]") from error

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
        *(pa.field(name, pa.uint64()) for name in ("of", "meant_for", "attempt", "within", "age")),
        pa.field("origin", pa.string()),
        pa.field("seq", pa.uint64()),
        pa.field("missing", pa.list_(pa.string())),
    ]
)


def table(rows: list[tuple[object, ...]], schema: pa.Schema) -> pa.Table:
    """Returns a table of these rows."""
    columns = list(zip(*rows, strict=True)) or [()] * len(schema)
    arrays = [pa.array(column, field.type) for column, field in zip(columns, schema, strict=True)]
    return pa.Table.from_arrays(arrays, schema=schema)
