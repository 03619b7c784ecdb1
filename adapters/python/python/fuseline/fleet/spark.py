"""Judges a fleet on Spark: ``pip install fuseline[arrow] pyspark``."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

from fuseline import fleet

if TYPE_CHECKING:
    import pyarrow as pa
    from pyspark.sql import DataFrame, SparkSession

__all__ = ["COLUMNS", "judge"]

#: The columns for Spark, which has no unsigned 64-bit integers. So a timestamp is a decimal, as
#: when Spark reads Parquet that another engine wrote.
COLUMNS = (
    "file string, drive string, operator string, conforms boolean, manner string, judge string, "
    "error string, judged bigint, lines bigint, seconds double, messages bigint, missed bigint, "
    "refused bigint, "
    "outputs array<struct<p: bigint, source: string, seconds: double, items: bigint>>, "
    "violations bigint, doubts string, line bigint, t decimal(20, 0), rule string, found string, "
    "expected string, late double"
)


def judge(
    spark: SparkSession,
    paths: Iterable[str | os.PathLike[str]],
    *,
    files_per_task: int = 16,
    **how: Any,
) -> DataFrame:
    """Returns the rows of all traces, lazily: write them with ``write.parquet``, or collect.

    Args:
        spark: The session.
        paths: The traces' paths, as every executor sees them.
        files_per_task: The number of traces that a task judges.
        how: The other arguments of `fuseline.fleet.judge`.
    """
    fleet.check_how(**how)
    items = [(os.fspath(path),) for path in paths]
    tasks = max(1, -(-len(items) // files_per_task))
    files = spark.sparkContext.parallelize(items, tasks).toDF("file string")
    return files.mapInArrow(partial(_batches, how), COLUMNS)


def _batches(how: dict[str, Any], batches: Iterator[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
    import pyarrow as pa

    at = fleet.schema().get_field_index("t")
    for batch in batches:
        # This judges one trace at a time, so that a task's memory does not grow with its traces.
        for path in batch.column(0).to_pylist():
            rows = fleet.judge_all([path], **how)
            t = rows.column(at).cast(pa.decimal128(20, 0))
            yield from rows.set_column(at, "t", t).to_batches()
