"""The node under test as a process: its parameters, its signals, its trace, what it costs."""

import contextlib
import json
import os
import signal
import subprocess
from pathlib import Path

from graph import until

TICKS_PER_S = os.sysconf("SC_CLK_TCK")
PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
POINTS = {"type": "geometry_msgs/msg/PointStamped"}


def yaml(value, indent=""):
    """Nested dictionaries as a parameter file is usually written."""
    if not isinstance(value, dict):
        return f" {json.dumps(value)}\n"
    lines = [f"{indent}{key}:{yaml(inner, indent + '  ')}" for key, inner in value.items()]
    return ("\n" if indent else "") + "".join(lines)


def parameters(clouds=(), **others):
    """Returns the settings of most tests: stamped points both ways, a second to answer, diagnostics five times a second."""
    middleware = {"middleware": os.environ["MIDDLEWARE"]} if "MIDDLEWARE" in os.environ else {}
    usual = middleware | {"input": POINTS, "output": POINTS, "deadline": 1.0, "local": {"deadline": 5.0, "in_flight": 64},
             "clouds": list(clouds), "diagnostics": {"period": 0.2}, "localhost_only": True}
    return usual | others


class Node:
    """A run of `fuseline-ros2`. Its trace and its log are in `folder`."""

    def __init__(self, program, folder, settings, arguments=(), name="fuseline", wall_clock=None, environment=None):
        self.folder = folder / name
        self.folder.mkdir()
        # A panic has its backtrace, if the environment asks for one; an error of a library has none.
        environment = os.environ | {"NO_COLOR": "1", "RUST_LIB_BACKTRACE": "0"} | (environment or {})
        if wall_clock:
            self.offset_file = self.folder / "offset"
            self.offset_file.write_text("0")
            environment |= {"LD_PRELOAD": wall_clock, "CLOCK_OFFSET": str(self.offset_file)}
        trace = {"file": str(self.folder / "trace.jsonl")} | settings.get("trace", {})
        self.trace_file = Path(trace["file"])
        self.log_file = self.folder / "log"
        settings = settings | {"trace": trace}
        (self.folder / "parameters.yaml").write_text(yaml({"/**": {"ros__parameters": settings}}))
        with open(self.log_file, "w") as log:
            self.process = subprocess.Popen(
                [program, "--ros-args", "--params-file", str(self.folder / "parameters.yaml"), *arguments],
                stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT, env=environment)
        self.code = None

    def wall_clock(self, seconds):
        """Its wall clock is this many seconds off from now on."""
        # One write, for it is read all the time.
        with open(self.offset_file, "r+b", buffering=0) as offset:
            offset.write(f"{seconds:<16}\n".encode())

    def participants(self):
        """How many participants of DDS it has: each has one such thread."""
        count = 0
        for name in Path(f"/proc/{self.process.pid}/task").glob("*/comm"):
            # A thread may end before its name is read.
            with contextlib.suppress(FileNotFoundError, ProcessLookupError):
                count += name.read_text().startswith("RustDDS Partici")
        return count

    def urgent_threads(self):
        """The real-time priority and the policy of each thread that has one; SCHED_FIFO is 1."""
        # Fields 40 and 41 of proc_pid_stat(5); the third follows the name in brackets.
        stats = [stat.read_text() for stat in Path(f"/proc/{self.process.pid}/task").glob("*/stat")]
        fields = [stat.rpartition(")")[2].split() for stat in stats]
        return [(int(field[37]), int(field[38])) for field in fields if field[38] != "0"]

    def locked_kib(self):
        """Returns how much of its memory is locked."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(status.partition("VmLck:")[2].split()[0])

    def until_exit(self, cap=15):
        self.code = self.process.wait(timeout=cap)
        return self.code

    def ends(self, by=signal.SIGINT):
        """Asks it to end, and returns its exit code."""
        if self.code is None:
            self.process.send_signal(by)
            self.until_exit()
        return self.code

    def kill(self):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()

    def log(self):
        return self.log_file.read_text()

    def lines(self):
        """The lines of its trace after the header, those that are written: all of them once it has ended."""
        text = self.trace_file.read_text() if self.trace_file.exists() else ""
        return [json.loads(line) for line in text[:text.rfind("\n") + 1].splitlines()[1:]]

    def events(self, event, **keys):
        return [line for line in self.lines() if line["ev"] == event and keys.items() <= line.items()]

    def cpu_s(self):
        with open(f"/proc/{self.process.pid}/stat") as stat:
            fields = stat.read().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / TICKS_PER_S

    def resident_mib(self):
        with open(f"/proc/{self.process.pid}/statm") as statm:
            return int(statm.read().split()[1]) * PAGE_BYTES / 2**20

    def until_running(self):
        """Or ended."""
        until(lambda: self.trace_file.exists() or self.process.poll() is not None, "the node's trace")
