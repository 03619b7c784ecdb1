"""Computes in processes, each with a thread that waits for it. No process outlives the program."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import signal
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from typing import Any

from fuseline._errors import ConfigError, in_one_line

_log = logging.getLogger("fuseline")

#: The number of seconds that a process may still compute after its operator has ended.
GRACE = 1.0


class WorkerProcess:
    """Computes one message at a time in a process. A process that dies is started again.

    The process is a daemon, so a computation that hangs does not keep the program from ending.
    """

    def __init__(self, compute: Callable[..., Any]) -> None:
        self._compute = compute
        self._lock = threading.Lock()
        self._is_computing = self._is_over = False
        self._connection, self._process = self._start()

    def __call__(self, *arguments: Any) -> Any:
        """Computes a message in the process. Only the thread that owns the process calls this."""
        with self._lock:
            if self._is_over:
                raise RuntimeError("the operator has ended")
            self._is_computing = True
        try:
            if not self._process.is_alive():
                self._replace()
            return self._computed(arguments)
        finally:
            with self._lock:
                self._is_computing = False
                if self._is_over:
                    self._connection.close()

    def wait(self) -> None:
        """Waits until it can compute.

        Raises:
            ConfigError: if it cannot be started.
        """
        try:
            self._connection.recv()
        except EOFError:
            self._process.join(GRACE)
            raise ConfigError(
                f"a process of local's ended with code {self._process.exitcode} at its start: the "
                "function must be in a module that can be imported, and a script that starts "
                'processes must begin with `if __name__ == "__main__":`'
            ) from None

    def end(self) -> None:
        """Ends the process, even while it computes, after at most `GRACE` seconds."""
        with self._lock:
            self._is_over = True
            if not self._is_computing:
                # The process ends when it reads the end of the connection.
                self._connection.close()
        timer = threading.Timer(GRACE, self._kill)
        timer.daemon = True
        with contextlib.suppress(RuntimeError):  # the program ends, and the process with it
            timer.start()

    def _computed(self, arguments: tuple[Any, ...]) -> Any:
        try:
            self._connection.send(arguments)
            is_value, value = self._connection.recv()
        except (EOFError, ConnectionError):
            self._process.join(GRACE)
            code = self._process.exitcode
            self._replace()
            raise RuntimeError(f"its process died with code {code}") from None
        if is_value:
            return value
        raise value

    def _replace(self) -> None:
        with self._lock:
            if self._is_over:
                return
            _log.error("a process of local's died; others take over")
            self._connection.close()
            self._connection, self._process = self._start()
        self.wait()

    def _start(self) -> tuple[Connection, BaseProcess]:
        # A fork would copy locks that this process's threads hold.
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(
            target=_serve, args=(theirs, self._compute), name="fuseline-local", daemon=True
        )
        try:
            process.start()
        except Exception as error:
            ours.close()
            raise ConfigError(
                "the function of Local.processes cannot be sent to a process, "
                f"{in_one_line(error)}: give a function of a module"
            ) from error
        finally:
            theirs.close()
        return ours, process

    def _kill(self) -> None:
        if self._process.is_alive():
            _log.warning(
                "a local computation continues after the operator's end: its process is killed"
            )
            self._process.kill()


def _serve(connection: Connection, compute: Callable[..., Any]) -> None:
    """Runs in a process, and computes until its connection is closed."""
    # Ctrl-C is for the program, which then ends this process. This process may start processes of
    # its own.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    multiprocessing.current_process()._config["daemon"] = False  # type: ignore[attr-defined]
    connection.send(None)
    while True:
        try:
            arguments = connection.recv()
        except EOFError:
            return
        except BaseException as error:
            connection.send((False, _sendable(error)))
            continue
        try:
            answer = True, compute(*arguments)
        except BaseException as error:
            answer = False, _sendable(error)
        try:
            connection.send(answer)
        except Exception as error:
            why = f"the result cannot be sent: {in_one_line(error)}"
            connection.send((False, RuntimeError(why)))


def _sendable(error: BaseException) -> Exception:
    """Returns an error that can be sent and raised: the error itself, or one with its text."""
    if isinstance(error, Exception):
        with contextlib.suppress(Exception):
            ForkingPickler.loads(ForkingPickler.dumps(error))
            return error
    return RuntimeError(f"{type(error).__name__}: {in_one_line(error)}")
