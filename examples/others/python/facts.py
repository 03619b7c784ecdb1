"""The scenario that a harness is driven through, and the facts that it records."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

#: Nanoseconds of a millisecond.
MS = 1_000_000


class Facts:
    """Records facts, each with an instant of CLOCK_MONOTONIC, which all processes share."""

    def __init__(self, folder: str, who: str) -> None:
        self._file = (Path(folder) / f"{who}.facts").open("a", buffering=1)
        self._lock = threading.Lock()

    def __call__(self, ev: str, t: int | None = None, **keys: Any) -> None:
        fact = {"ev": ev, "at": time.monotonic_ns()} | ({} if t is None else {"t": t}) | keys
        with self._lock:
            self._file.write(json.dumps(fact) + "\n")


class Scenario:
    """States how long each reply takes, and what else happens to the operator; times are milliseconds."""

    def __init__(self, text: str) -> None:
        self.text = text
        fields = json.loads(text)
        #: For each message a delay, None for a reply that never comes, "fail" for one that fails.
        self.delays: list[Any] = fields["delays"]
        self.period: float = fields.get("period", 60)
        self.deadline: int = int(fields.get("deadline", 100) * MS)
        #: The message at which the server is killed (9) or stopped (19).
        self.kill_at: int | None = fields.get("kill_at")
        self.signal: int = fields.get("signal", 9)
        #: Settings of one harness alone.
        self.repeats: bool = fields.get("repeats", False)
        self.chunk: int = fields.get("chunk", 1)
        self.bus: float = fields.get("bus", 0)
        self.ticks: int = fields.get("ticks", len(self.delays))

    def wait_for(self, start: float, message: int) -> None:
        """Sleep until a message is to be opened."""
        time.sleep(max(0.0, start + message * self.period / 1e3 - time.monotonic()))


class Server:
    """A server in a process of its own, that can be killed."""

    def __init__(self, kind: str, folder: str, scenario: Scenario, port: int = 0) -> None:
        command = [sys.executable, str(Path(__file__).with_name("server.py")), kind, folder]
        self._process = subprocess.Popen(
            [*command, scenario.text, str(port)],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        assert self._process.stdout is not None
        self.port = int(self._process.stdout.readline())

    def signal(self, number: int) -> None:
        """Kill or stop it."""
        self._process.send_signal(number)
        if number == 9:
            self._process.wait()

    def end(self) -> None:
        """Leave nothing behind."""
        time.sleep(0.2)  # It may have yet to record the last reply.
        self._process.kill()
        self._process.wait()
