"""Tests a fleet on a local cluster of Ray, which has several processes on loopback."""

from __future__ import annotations

import os
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fuseline import fleet

ray = pytest.importorskip("ray")
from fuseline.fleet import ray as on_ray  # noqa: E402


@pytest.fixture(scope="module")
def cluster() -> Iterator[None]:
    """Starts a head and at most three workers, which end with the tests."""
    # The path of a socket may have only about a hundred characters.
    folder = tempfile.mkdtemp(prefix="ray-", dir="/tmp")
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    os.environ["RAY_DATA_DISABLE_PROGRESS_BARS"] = "1"
    ray.init(
        address="local",
        num_cpus=3,
        include_dashboard=False,
        object_store_memory=100 << 20,
        log_to_driver=False,
        _node_ip_address="127.0.0.1",
        _temp_dir=folder,
    )
    yield
    ray.shutdown()
    shutil.rmtree(folder, ignore_errors=True)


def comparable(table: pa.Table) -> list[dict[str, Any]]:
    """Returns the rows, sorted by file and line."""
    rows: list[dict[str, Any]] = table.to_pylist()
    return sorted(rows, key=lambda row: (row["file"], row["line"] or 0, row["t"] or 0))


def read(folder: Path) -> pa.Table:
    return pa.concat_tables([pq.read_table(path) for path in sorted(folder.glob("*.parquet"))])


@pytest.mark.usefixtures("cluster")
def test_ray_gives_the_rows_that_judging_one_by_one_gives(
    drives: list[str], tmp_path: Path
) -> None:
    on_ray.judge(drives, files_per_task=5).write_parquet(str(tmp_path / "rows"))
    rows = read(tmp_path / "rows")
    assert rows.schema.names == fleet.schema().names
    assert comparable(rows) == comparable(fleet.judge_all(drives))


@pytest.mark.usefixtures("cluster")
def test_no_verdict_is_lost_or_doubled_when_a_worker_is_killed(
    drives: list[str], tmp_path: Path
) -> None:
    seen = tmp_path / "seen"
    seen.mkdir()

    def slowly(file: str) -> str:
        # This file names the process and its trace, so that the test can kill a process at work.
        (seen / f"{os.getpid()}-{Path(file).stem}-{time.monotonic_ns()}").touch()
        time.sleep(0.1)
        return Path(file).stem

    killed: list[int] = []

    def kill() -> None:
        while len(names := [it.name for it in seen.iterdir()]) < 12:
            time.sleep(0.005)
        victim = int(max(names, key=lambda name: int(name.rsplit("-", 1)[1])).split("-")[0])
        os.kill(victim, signal.SIGKILL)
        killed.append(victim)

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    on_ray.judge(drives, files_per_task=4, drive=slowly).write_parquet(str(tmp_path / "rows"))
    killer.join(10)
    assert killed, "nobody was killed: the job was over too soon"
    names = [it.name for it in seen.iterdir()]
    workers = {int(name.split("-")[0]) for name in names}
    begun = [name.split("-", 1)[1].rsplit("-", 1)[0] for name in names]
    assert len(workers) >= 3, "a single process did it all"
    assert len(begun) > len(drives), "nothing was judged again: the killed worker was idle"
    rows = comparable(read(tmp_path / "rows"))
    alone = comparable(fleet.judge_all(drives, drive=lambda file: Path(file).stem))
    assert rows == alone


@pytest.mark.usefixtures("cluster")
def test_a_fleet_of_no_drives_and_a_mistake_in_the_call() -> None:
    assert on_ray.judge([]).count() == 0
    with pytest.raises(ValueError, match="go together"):
        on_ray.judge(["a"], tolerance=0.1)
