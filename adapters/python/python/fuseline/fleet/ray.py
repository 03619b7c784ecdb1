"""Judges a fleet on Ray Data: ``pip install fuseline[arrow] 'ray[data]'``."""

from __future__ import annotations

import os
from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING, Any

from fuseline import fleet

if TYPE_CHECKING:
    import pyarrow as pa
    from ray.data import Dataset

__all__ = ["judge"]


def judge(
    paths: Iterable[str | os.PathLike[str]],
    *,
    files_per_task: int = 16,
    remote: dict[str, Any] | None = None,
    **how: Any,
) -> Dataset:
    """Returns the rows of all traces, lazily: write them with ``write_parquet``, or take them.

    A task that dies with its worker runs again from its first trace; what it had judged by then was
    not in the table yet.

    Args:
        paths: The traces' paths, as every node sees them.
        files_per_task: The number of traces that a task judges.
        remote: Options of Ray's tasks, such as ``{"num_cpus": 0.5}``.
        how: The other arguments of `fuseline.fleet.judge`.

    Raises:
        ImportError: if Ray is not there.
    """
    try:
        from ray import data
    except ImportError as error:
        raise ImportError("a fleet on Ray needs Ray Data: pip install 'ray[data]'") from error

    fleet.check_how(**how)
    files = [{"file": os.fspath(path)} for path in paths]
    if not files:
        return data.from_arrow(fleet.judge_all([]))
    tasks = -(-len(files) // files_per_task)
    parts = data.from_items(files, override_num_blocks=tasks)
    options = remote or {}
    judge = partial(_batch, how)
    return parts.map_batches(judge, batch_size=None, batch_format="pyarrow", **options)


def _batch(how: dict[str, Any], files: pa.Table) -> pa.Table:
    return fleet.judge_all(files["file"].to_pylist(), **how)
