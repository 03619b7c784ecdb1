"""Holds a trace's file while it is written, so that nobody else writes or removes it."""

from __future__ import annotations

import os
import weakref
from pathlib import Path
from typing import Any

from fuseline._errors import ConfigError

try:
    import fcntl
except ImportError:  # not on this system
    fcntl = None  # type: ignore[assignment]


#: The first bytes of a trace.
_HEAD = b'{"fuseline":'


class TraceFile:
    """Holds the file of a trace, locked."""

    def __init__(self, path: Path, descriptor: int, *, is_new: bool) -> None:
        self._path, self._descriptor, self._is_new = path, descriptor, is_new
        self._close = weakref.finalize(self, os.close, descriptor)
        _HELD.add(self)

    def lost(self) -> OSError | None:
        """Returns an error if the file was removed or replaced."""
        if not self._close.alive:
            return None
        try:
            there = self._path.stat()
        except FileNotFoundError:
            return OSError(f"{self._path} was removed while it was written")
        except OSError as error:
            return error
        if not os.path.samestat(there, os.fstat(self._descriptor)):
            return OSError(f"{self._path} was replaced while it was written")
        return None

    def close(self) -> None:
        """Releases the file."""
        self._close()

    def give_up(self) -> None:
        """Releases the file because nothing will be written, and removes it if it is new."""
        self._close()
        if self._is_new:
            self._path.unlink()


#: The held files. A forked process must close them, or it would keep holding them.
_HELD: weakref.WeakSet[TraceFile] = weakref.WeakSet()


def _let_go() -> None:
    for held in list(_HELD):
        held.close()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_let_go)


def _is_trace(file: Path) -> bool:
    """Returns True if the file is an earlier trace, or empty."""
    with file.open("rb") as opened:
        head = opened.read(len(_HEAD))
    return head in (b"", _HEAD)


def hold(path: Any) -> TraceFile | None:
    """Locks the file for a trace. Returns None if it is not a plain file.

    Raises:
        ConfigError: if another operator writes it, or if the file exists and is not a trace.
    """
    if path is None or fcntl is None:
        return None
    file = Path(os.fsdecode(path))
    try:
        is_new = not os.path.lexists(file)
        if not is_new and not file.is_file():
            return None
        if not is_new and not _is_trace(file):
            raise ConfigError(
                f"the trace {file} would overwrite a file that is not a trace; remove it, or give "
                "another path"
            )
        descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o666)
    except OSError:
        # The writer reports why the file cannot be written.
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise ConfigError(
            f"the trace {file} is being written by another operator; give each a file of its own"
        ) from None
    except OSError:
        # The file system has no locks.
        pass
    return TraceFile(file, descriptor, is_new=is_new)
