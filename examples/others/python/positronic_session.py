"""positronic's InferenceSession with its timeout: python positronic_session.py hold|reopen FOLDER SCENARIO.

When an inference is over time or fails the last action is held, and with `reopen` a new session begun.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time

import stubs  # noqa: F401
from facts import Facts, Scenario, Server
from positronic.offboard.client import InferenceClient
from positronic_wire import registry, wire

mode, folder, scenario = sys.argv[1], sys.argv[2], Scenario(sys.argv[3])
server = Server("positronic", folder, scenario)
record = Facts(folder, "robot")
client = InferenceClient(
    registry.client_wire("websocket"),
    wire.HostPortAddress("127.0.0.1", server.port, "/", ""),
    infer_timeout=scenario.deadline / 1e9,
    connect_deadline=0.05,
    reconnect_deadline=0.05,
)
session = client.new_session()
start = time.monotonic()
for t in range(len(scenario.delays)):
    scenario.wait_for(start, t)
    if t == scenario.kill_at:
        server.signal(scenario.signal)
    record("open", t)
    record("request", t, p=1, deadline=scenario.deadline)
    record("result", t, p=0)  # the action that is held is there at once
    try:
        record("emit", t, p=1, of=session.infer({"t": t})["of"])
        continue
    except Exception:  # noqa: BLE001 — whatever the client raises
        record("fail", t, p=1)  # after the deadline it changes nothing
        record("emit", t, p=0)
    if mode == "reopen":
        with contextlib.suppress(Exception):  # without a server the next message fails
            session = client.new_session()
record("tick")
server.end()
os._exit(0)
