"""A dataflow of dora-rs whose robot falls back when its input's `input_timeout` is over.

    python dora_fallback.py default|checked FOLDER SCENARIO

The daemon looks for such inputs every 5 s; `checked` has it look every 20 ms. Local's result is
there at once; it is sent when the cloud's input is closed, and until a reply comes again.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pyarrow as pa
from dora import Node
from facts import Facts, Scenario


def launch(mode: str, folder: str, scenario: str) -> int:
    """Run the dataflow in a daemon of its own."""
    reply = {"source": "cloud/reply", "input_timeout": Scenario(scenario).deadline / 1e9}
    # A node whose inputs are all closed is stopped: the timer's is not.
    inputs = {"reply": reply, "timer": "dora/timer/secs/1"}
    robot = {"id": "robot", "inputs": inputs, "outputs": ["frame"]}
    cloud = {"id": "cloud", "inputs": {"frame": "robot/frame"}, "outputs": ["reply"]}
    this = {"path": sys.executable, "args": __file__}
    nodes = [node | this | {"env": {"ROLE": node["id"]}} for node in (robot, cloud)]
    interval = 0.02 if mode == "checked" else 5
    path = Path(folder) / "flow.yml"
    path.write_text(json.dumps({"nodes": nodes, "health_check_interval": interval}))
    command = [Path(sys.executable).with_name("dora"), "run", path]
    env = os.environ | {"FOLDER": folder, "SCENARIO": scenario}
    return subprocess.call(command, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.STDOUT)


class Robot:
    """Sends frames, and records what it would act on."""

    def __init__(self) -> None:
        self.waiting: list[int] = []
        self.is_closed = self.is_connected = False

    def drive(self) -> None:
        """All frames, and a second for what is still under way."""
        node.send_output("frame", pa.array([-1]))  # until both are connected
        while not self.is_connected:
            self.read_until(time.monotonic() + 0.01)
        start = time.monotonic()
        for t in range(len(scenario.delays)):
            self.read_until(start + t * scenario.period / 1e3)
            record("open", t)
            record("result", t, p=0)
            record("request", t, p=1, deadline=scenario.deadline)
            node.send_output("frame", pa.array([t]))
            self.waiting.append(t)
            if self.is_closed:
                self.fall_back()
        self.read_until(time.monotonic() + 1)
        record("tick")

    def read_until(self, end: float) -> None:
        while (left := end - time.monotonic()) > 0:
            event = node.next(timeout=left) or {}
            if event.get("id") == "reply" and event["type"] in ("INPUT", "INPUT_CLOSED"):
                self.is_closed, self.is_connected = event["type"] == "INPUT_CLOSED", True
                if self.is_closed:
                    self.fall_back()
                elif (of := event["value"].to_pylist()[0]) in self.waiting:
                    self.waiting.remove(of)
                    record("emit", of, p=1, of=of)

    def fall_back(self) -> None:
        while self.waiting:
            record("emit", self.waiting.pop(0), p=0)


def reply(of: int) -> None:
    if of >= 0:
        record("result", of, p=1, of=of)
    node.send_output("reply", pa.array([of]))


if "ROLE" not in os.environ:
    sys.exit(launch(*sys.argv[1:]))
node, scenario = Node(), Scenario(os.environ["SCENARIO"])
record = Facts(os.environ["FOLDER"], os.environ["ROLE"])
if os.environ["ROLE"] == "robot":
    Robot().drive()
else:
    for event in node:
        if event["type"] == "INPUT":
            of = event["value"].to_pylist()[0]
            if (delay := 0 if of < 0 else scenario.delays[of]) is not None:
                threading.Timer(delay / 1e3, reply, [of]).start()
