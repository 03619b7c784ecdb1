"""openpi-client's policy in its own Runtime: python openpi_policy.py plain|timeout FOLDER SCENARIO.

`timeout` is the usual patch: a recv() with a timeout, and the last action held when it is over.
"""

from __future__ import annotations

import os
import sys
import threading
from typing import Any

from facts import Facts, Scenario, Server
from openpi_client import msgpack_numpy
from openpi_client.runtime import environment, runtime
from openpi_client.runtime.agents.policy_agent import PolicyAgent
from openpi_client.websocket_client_policy import WebsocketClientPolicy

mode, folder, scenario = sys.argv[1], sys.argv[2], Scenario(sys.argv[3])
server = Server("openpi", folder, scenario)
record = Facts(folder, "robot")


class Robot(environment.Environment):
    """Records what its loop does."""

    t = -1

    def reset(self) -> None: ...

    def is_episode_complete(self) -> bool:
        return self.t + 1 >= len(scenario.delays)

    def get_observation(self) -> dict[str, Any]:
        self.t += 1
        if self.t == scenario.kill_at:
            server.signal(scenario.signal)
        record("open", self.t)
        record("request", self.t, p=1, deadline=scenario.deadline)
        if mode == "timeout":
            record("result", self.t, p=0)  # the action that is held is there at once
        return {"t": self.t}

    def apply_action(self, action: dict[str, Any]) -> None:
        record("emit", self.t, **action)


class Policy(WebsocketClientPolicy):
    """The client as it is; its result has the source's priority."""

    def infer(self, obs: dict[str, Any]) -> dict[str, Any]:
        try:
            return {"p": 1} | super().infer(obs)
        except Exception:
            record("fail", obs["t"], p=1)
            raise


class PatchedPolicy(WebsocketClientPolicy):
    """The client with the usual patch."""

    def infer(self, obs: dict[str, Any]) -> dict[str, Any]:
        try:
            self._ws.send(self._packer.pack(obs))
            reply = self._ws.recv(timeout=scenario.deadline / 1e9)
            return {"p": 1} | msgpack_numpy.unpackb(reply)
        except TimeoutError:
            return {"p": 0}
        except Exception:  # noqa: BLE001 — whatever the client raises
            record("fail", obs["t"], p=1)
            return {"p": 0}


policy = (Policy if mode == "plain" else PatchedPolicy)("127.0.0.1", server.port)
loop = runtime.Runtime(Robot(), PolicyAgent(policy), [], max_hz=1e3 / scenario.period)
thread = threading.Thread(target=loop.run, daemon=True)
thread.start()
thread.join(len(scenario.delays) * scenario.period / 1e3 + 1)
record("tick")
server.end()
os._exit(0)  # its thread may hang
