"""Tests a fleet on a local Spark, whose session and workers are separate processes."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from fuseline import fleet

pytest.importorskip("pyspark")
if not shutil.which("java"):
    pytest.skip("no java (package openjdk-17-jre-headless)", allow_module_level=True)
from fuseline.fleet import spark as on_spark
from pyspark.sql import SparkSession


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SparkSession]:
    """Starts a session with two workers, which end with the tests."""
    os.environ["PYSPARK_PYTHON"] = sys.executable
    os.environ["SPARK_LOCAL_IP"] = "127.0.0.1"
    settings = {
        "spark.driver.host": "127.0.0.1",
        "spark.ui.enabled": "false",
        "spark.sql.shuffle.partitions": "2",
        "spark.local.dir": str(tmp_path_factory.mktemp("spark")),
        "spark.sql.warehouse.dir": str(tmp_path_factory.mktemp("warehouse")),
    }
    builder = SparkSession.builder.master("local[2]").appName("fuseline")
    for name, value in settings.items():
        builder = builder.config(name, value)
    session = builder.getOrCreate()
    session.sparkContext.setLogLevel("ERROR")
    yield session
    session.stop()


def plain(value: Any) -> Any:
    if isinstance(value, Decimal):
        return int(value)
    if isinstance(value, list):
        return [it.asDict() for it in value]
    return value


def comparable(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Returns the rows, sorted by file and line."""
    return sorted(rows, key=lambda row: (row["file"], row["line"] or 0, row["t"] or 0))


def test_spark_gives_the_rows_that_judging_one_by_one_gives(
    session: SparkSession, drives: list[str], tmp_path: Path
) -> None:
    frame = on_spark.judge(session, drives, files_per_task=20)
    assert frame.columns == fleet.schema().names
    rows = [{name: plain(it) for name, it in row.asDict().items()} for row in frame.collect()]
    alone = comparable(fleet.judge_all(drives).to_pylist())
    assert comparable(rows) == alone

    frame.write.parquet(str(tmp_path / "rows"))
    fleet.report(tmp_path / "rows", tmp_path / "page.html")
    assert "42 of 49 traces conform" in (tmp_path / "page.html").read_text()


def test_spark_answers_the_summaries_as_duckdb_does(
    session: SparkSession, drives: list[str], tmp_path: Path
) -> None:
    import duckdb
    import pyarrow.parquet as pq

    pq.write_table(fleet.judge_all(drives), tmp_path / "rows.parquet")
    session.read.parquet(str(tmp_path / "rows.parquet")).createOrReplaceTempView("verdicts")
    session.sql(fleet.FLATTEN["spark"])
    with duckdb.connect() as engine:
        engine.execute(f"CREATE VIEW verdicts AS SELECT * FROM '{tmp_path / 'rows.parquet'}'")
        engine.execute(fleet.FLATTEN["duckdb"])
        for name, sql in fleet.SUMMARIES.items():
            answered = [tuple(map(number, row)) for row in session.sql(sql).collect()]
            assert answered == [
                tuple(map(number, row)) for row in engine.execute(sql).fetchall()
            ], name


def number(value: Any) -> Any:
    return pytest.approx(float(value)) if isinstance(value, (float, Decimal)) else value
