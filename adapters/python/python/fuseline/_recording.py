"""Ends an operator's recording: with the operator, or with the program."""

from __future__ import annotations

import asyncio
import atexit
import logging
import os
import time
import weakref
from concurrent.futures import ThreadPoolExecutor

from fuseline._fuseline import Calls, Engine
from fuseline._tracefile import TraceFile

_log = logging.getLogger("fuseline")

#: The number of seconds that an operator waits at its end for the tasks that it has cancelled.
GRACE = 1.0


class Recording:
    """Writes the rest of a trace when its operator ends, and knows how the recording ended."""

    def __init__(self, name: str, engine: Engine, calls: Calls, trace: TraceFile | None) -> None:
        self._name, self._engine, self._calls, self._trace = name, engine, calls, trace
        #: Done once the trace is written.
        self._finished: asyncio.Future[None] | None = None
        self._error: OSError | None = None
        self._process = os.getpid()
        if engine.is_recording:
            _RECORDING.add(self)

    @property
    def recording_error(self) -> OSError | None:
        """Returns the error that ended the recording early, if one did."""
        why = self._engine.counting.recording_error
        if why is not None:
            return OSError(why)
        return self._error or (None if self._trace is None else self._trace.lost())

    def end(self, loop: asyncio.AbstractEventLoop) -> None:
        """Begins to write the rest of the trace. Nothing is recorded after it."""
        self._engine.end(self._calls.now())
        if not self._engine.is_recording:
            self._engine.finish()
            return
        # This uses a thread of its own, because all threads of the loop's executor may hang.
        writer = ThreadPoolExecutor(1, "fuseline-trace")
        try:
            self._finished = loop.run_in_executor(writer, self._engine.finish)
        except RuntimeError:
            # The program is about to end, and no thread can be started.
            self._engine.finish()
        else:
            self._finished.add_done_callback(self._written)
        writer.shutdown(wait=False)

    async def finish(self) -> None:
        """Waits until the trace is written."""
        if self._finished is not None:
            await asyncio.wait({self._finished})
            # Callbacks of the future run after that.
            await asyncio.sleep(0)

    def end_at_exit(self) -> None:
        """Writes the trace up to here, because the program ends."""
        if self._process != os.getpid() or self._calls.is_over:
            return
        _log.warning(
            "%s: the program ends, but the operator was not closed: its trace ends here",
            self._name,
        )
        until = time.monotonic() + GRACE
        try:
            # The operator's thread may be in the middle of an input.
            while not self._ended_at_exit() and time.monotonic() < until:
                time.sleep(0.001)
        except OSError as error:
            _log.error("%s: the trace ends early: %s", self._name, error)

    def _ended_at_exit(self) -> bool:
        try:
            self._engine.end(self._calls.now())
            self._engine.finish()
        except RuntimeError:
            return False
        return True

    def _written(self, finished: asyncio.Future[None]) -> None:
        error = None if finished.cancelled() else finished.exception()
        if isinstance(error, OSError):
            self._error = error
        if self._trace is not None:
            self._error = self._error or self._trace.lost()
            self._trace.close()


#: The operators that record, for the end of the program.
_RECORDING: weakref.WeakSet[Recording] = weakref.WeakSet()


def _end_recordings() -> None:
    for recording in list(_RECORDING):
        recording.end_at_exit()


atexit.register(_end_recordings)
