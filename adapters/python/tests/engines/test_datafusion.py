"""Compares the summaries in DataFusion with duckdb's answers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import duckdb
import pyarrow.parquet as pq
import pytest
from fuseline import fleet

datafusion = pytest.importorskip("datafusion")


def test_datafusion_answers_the_summaries_as_duckdb_does(drives: list[str], tmp_path: Path) -> None:
    path = str(tmp_path / "rows.parquet")
    pq.write_table(fleet.judge_all(drives), path)
    context = datafusion.SessionContext()
    context.register_parquet("verdicts", path)
    context.sql(fleet.FLATTEN["datafusion"]).collect()
    with duckdb.connect() as engine:
        engine.execute(f"CREATE VIEW verdicts AS SELECT * FROM '{path}'")
        engine.execute(fleet.FLATTEN["duckdb"])
        for name, sql in fleet.SUMMARIES.items():
            answered = [
                tuple(row.values()) for row in context.sql(sql).to_arrow_table().to_pylist()
            ]
            assert [tuple(map(number, row)) for row in answered] == [
                tuple(map(number, row)) for row in engine.execute(sql).fetchall()
            ], name


def number(value: Any) -> Any:
    return pytest.approx(value) if isinstance(value, float) else value
