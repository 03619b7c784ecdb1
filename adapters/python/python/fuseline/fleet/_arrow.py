"""Makes the table of rows for pyarrow, which is optional."""

from __future__ import annotations

from collections.abc import Iterable

try:
    import pyarrow as pa
except ImportError as error:
    raise ImportError("a table of rows needs pyarrow: pip install fuseline[arrow]") from error

from fuseline.fleet import Row

#: An output of a source.
OUTPUT = pa.struct(
    [
        pa.field("p", pa.int64(), nullable=False),
        pa.field("source", pa.string(), nullable=False),
        pa.field("seconds", pa.float64(), nullable=False),
        pa.field("items", pa.int64(), nullable=False),
    ]
)
#: The table's columns. A timestamp may be any 64-bit number.
SCHEMA = pa.schema(
    [
        pa.field("file", pa.string(), nullable=False),
        pa.field("drive", pa.string(), nullable=False),
        pa.field("operator", pa.string()),
        pa.field("conforms", pa.bool_(), nullable=False),
        pa.field("manner", pa.string(), nullable=False),
        pa.field("judge", pa.string(), nullable=False),
        pa.field("error", pa.string()),
        pa.field("judged", pa.int64()),
        pa.field("lines", pa.int64()),
        pa.field("seconds", pa.float64()),
        pa.field("messages", pa.int64()),
        pa.field("missed", pa.int64()),
        pa.field("refused", pa.int64()),
        pa.field("outputs", pa.list_(pa.field("item", OUTPUT, nullable=False))),
        pa.field("violations", pa.int64()),
        pa.field("doubts", pa.string()),
        pa.field("line", pa.int64()),
        pa.field("t", pa.uint64()),
        pa.field("rule", pa.string()),
        pa.field("found", pa.string()),
        pa.field("expected", pa.string()),
        pa.field("late", pa.float64()),
    ]
)


def table(rows: Iterable[Row]) -> pa.Table:
    """Returns the rows as a table."""
    columns = list(zip(*rows, strict=True)) or [()] * len(SCHEMA)
    outputs = Row._fields.index("outputs")
    columns[outputs] = tuple(
        None if it is None else [output._asdict() for output in it] for it in columns[outputs]
    )
    arrays = [pa.array(column, field.type) for column, field in zip(columns, SCHEMA, strict=True)]
    return pa.Table.from_arrays(arrays, schema=SCHEMA)
