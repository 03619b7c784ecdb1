"""fuseline.robot's Always, with the real clients: python always.py openpi|lerobot FOLDER SCENARIO.

The server is slow, does not answer, is killed and started again, stopped and continued. Each tick
has an action in time, none is older than allowed, and between chunks no action jumps.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections import Counter
from typing import Any

import stubs  # noqa: F401
from facts import Scenario, Server
from fuseline.robot import Always, Chunk, Hold, fade, lerobot, openpi
from openpi_client import base_policy
from openpi_client.runtime import environment, runtime
from openpi_client.runtime.agents.policy_agent import PolicyAgent

mode, folder, scenario = sys.argv[1], sys.argv[2], Scenario(sys.argv[3])
server = Server(mode, folder, scenario)
PERIOD = scenario.period / 1e3
MAX_AGE, MAX_JUMP = 15, 2.0
where = {"port": server.port}
if mode == "openpi":
    chunk, first = None, {"of": -1}
    connect = openpi("127.0.0.1", server.port)
else:
    chunk = Chunk(every=5, max_age=MAX_AGE, blend=fade(3, max_jump=MAX_JUMP), split=list)
    first, connect = [0.0, 0.0], lerobot(f"127.0.0.1:{server.port}")
policy = Always(
    connect,
    Hold(first),
    deadline=PERIOD / 2,
    chunk=chunk,
    period=PERIOD,
    linger=0.3,
    trace=f"{folder}/trace.jsonl",
)
base_policy.BasePolicy.register(Always)


class Robot(environment.Environment):
    """Harms the server, and checks each action."""

    def __init__(self) -> None:
        self.t = -1
        self.sources: Counter[str] = Counter()
        self.last: Any = first
        self.ages: Counter[int] = Counter()

    def reset(self) -> None: ...

    def is_episode_complete(self) -> bool:
        return self.t + 1 >= scenario.ticks

    def get_observation(self) -> dict[str, Any]:
        self.t += 1
        self.harm(self.t * 10 // scenario.ticks if self.t * 10 % scenario.ticks == 0 else None)
        return {"t": self.t}

    def harm(self, tenth: int | None) -> None:
        if tenth == 3:
            server.signal(signal.SIGKILL)
        elif tenth == 4:
            threading.Thread(target=self.restart).start()
        elif tenth == 6:
            server.signal(signal.SIGSTOP)
        elif tenth == 7:
            server.signal(signal.SIGCONT)

    def restart(self) -> None:
        global server
        server = Server(mode, folder, scenario, where["port"])

    def apply_action(self, action: Any) -> None:
        item = policy.item
        assert item is not None and item.source is not None and item.timestamp == self.t
        self.sources[item.source.name] += 1
        if item.source.name == "remote" and mode == "openpi":
            assert action["of"] == self.t, f"tick {self.t} acts on {action}"
        elif item.source.name == "remote":
            assert item.of is not None
            self.ages[self.t - item.of] += 1
            jump = max(abs(float(a) - float(b)) for a, b in zip(action, self.last, strict=True))
            assert jump <= MAX_JUMP + 1e-9, f"tick {self.t} jumps by {jump}"
        self.last = action


robot = Robot()
loop = runtime.Runtime(robot, PolicyAgent(policy), [], max_hz=1 / PERIOD)
start = time.monotonic()
loop.run()
policy.close()
server.end()
print(mode, dict(robot.sources), f"{time.monotonic() - start:.0f} s", dict(robot.ages))
assert robot.t + 1 == scenario.ticks and set(robot.sources) == {"remote", "local"}
assert max(robot.ages, default=0) <= MAX_AGE
os._exit(0)
