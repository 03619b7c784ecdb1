"""Measures what judging a fleet costs, alone and on engines.

    python benches/fleet.py FOLDER [--engine alone|ray|spark] [--workers N] [--rounds N]

FOLDER has the drives, such as ``python tests/drives.py FOLDER`` writes. Each figure is the median
of the rounds: seconds of wall time, lines a second, and the machine's load meanwhile. Engines start
before the clock does; how long that takes is printed, a first job over two drives is not counted.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from fuseline import fleet


def alone(workers: int) -> Callable[[list[str]], int]:
    """One process, and no engine."""
    if workers != 1:
        raise SystemExit("error: alone is one worker")
    return lambda paths: fleet.judge_all(paths).num_rows


def on_ray(workers: int) -> Callable[[list[str]], int]:
    """Starts Ray on this host with `workers` workers. Returns what judges files with it."""
    import ray
    from fuseline.fleet import ray as engine

    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    ray.init(
        address="local",
        num_cpus=workers,
        include_dashboard=False,
        log_to_driver=False,
        object_store_memory=200 << 20,
        _node_ip_address="127.0.0.1",
        _temp_dir=tempfile.mkdtemp(prefix="ray-", dir="/tmp"),
    )
    ray.data.DataContext.get_current().enable_progress_bars = False
    return lambda paths: engine.judge(paths).materialize().count()


def on_spark(workers: int) -> Callable[[list[str]], int]:
    """Starts Spark on this host with `workers` workers. Returns what judges files with it."""
    from fuseline.fleet import spark as engine
    from pyspark.sql import SparkSession

    os.environ["PYSPARK_PYTHON"] = sys.executable
    os.environ["SPARK_LOCAL_IP"] = "127.0.0.1"
    builder = SparkSession.builder.master(f"local[{workers}]")
    session = builder.config("spark.ui.enabled", "false").getOrCreate()
    session.sparkContext.setLogLevel("ERROR")

    def judge(paths: list[str]) -> int:
        with tempfile.TemporaryDirectory() as folder:
            rows = str(Path(folder, "rows"))
            engine.judge(session, paths).write.parquet(rows)
            return int(session.read.parquet(rows).count())

    return judge


ENGINES = {"alone": alone, "ray": on_ray, "spark": on_spark}


def main() -> None:
    """Measure one engine and print a line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--engine", choices=ENGINES, default="alone")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    paths = [str(path) for path in sorted(given.folder.glob("*.jsonl"))]
    size = sum(Path(path).stat().st_size for path in paths)
    lines = sum(Path(path).read_bytes().count(b"\n") for path in paths)
    start = time.monotonic()
    judge = ENGINES[given.engine](given.workers)
    judge(paths[:2])
    started = time.monotonic() - start
    took = []
    for _ in range(given.rounds):
        start = time.monotonic()
        rows = judge(paths)
        took.append(time.monotonic() - start)
        assert rows >= len(paths), "a drive has no row"
    median = statistics.median(took)
    print(
        f"{given.engine}, {given.workers} worker(s): {len(paths)} drives, {size / 1e9:.2f} GB, "
        f"{lines:,} lines in {median:.1f} s ({min(took):.1f} to {max(took):.1f}): "
        f"{lines / median / 1e6:.2f} M lines/s; started in {started:.1f} s; "
        f"load {os.getloadavg()[0]:.1f}"
    )


if __name__ == "__main__":
    main()
