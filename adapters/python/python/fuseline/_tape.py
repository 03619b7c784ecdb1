"""Writing a trace in a thread of its own, so that no disk holds up an operator."""

from __future__ import annotations

import logging
import os
import queue
import threading
from pathlib import Path
from typing import IO

_log = logging.getLogger("fuseline")

#: How many bytes may wait for the disk.
WAITING = 16 * 1024 * 1024


class Tape:
    """A file and the thread that writes it. What it is given begins and ends with whole inputs."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        #: Why the recording ended early, if it did.
        self.error: OSError | None = None
        self._file: IO[bytes] = self.path.open("wb", buffering=0)
        self._chunks: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._waiting = 0
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._write, name="fuseline-tape", daemon=True)
        self._thread.start()

    def write(self, chunk: bytes) -> None:
        """Have it written; D10: if too much waits already, the recording ends here."""
        if self.error is not None or not chunk:
            return
        with self._lock:
            self._waiting += len(chunk)
            is_behind = self._waiting > WAITING
        if is_behind:
            self._fail(OSError(f"the disk is more than {WAITING >> 20} MiB behind"))
        else:
            self._chunks.put(chunk)

    def close(self) -> None:
        """Wait until all is written; may block."""
        self._chunks.put(None)
        self._thread.join()

    def _write(self) -> None:
        whole = 0
        with self._file:
            while (chunk := self._chunks.get()) is not None:
                if self.error is not None:
                    continue
                try:
                    rest = memoryview(chunk)
                    while rest:
                        rest = rest[self._file.write(rest) :]
                    whole += len(chunk)
                except OSError as error:
                    self._fail(error)
                    self._cut(whole)
                with self._lock:
                    self._waiting -= len(chunk)

    def _fail(self, error: OSError) -> None:
        self.error = error
        _log.error("the trace %s ends early: %s", self.path, error)

    def _cut(self, whole: int) -> None:
        """Leave nothing that was written in part."""
        try:
            self._file.truncate(whole)
        except OSError:
            _log.error("the trace %s may end in the midst of a line", self.path)
