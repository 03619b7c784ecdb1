"""LeRobot's RobotClient on an arm that records: python lerobot_client.py steps|ticks FOLDER SCENARIO.

`steps` records what is sent for each timestep, `ticks` what each tick of the control loop does.
"""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from typing import Any

import stubs  # noqa: F401
from facts import MS, Facts, Scenario, Server
from lerobot.async_inference import robot_client
from lerobot.async_inference.configs import RobotClientConfig

logging.disable(logging.CRITICAL)
mode, folder, scenario = sys.argv[1], sys.argv[2], Scenario(sys.argv[3])
server = Server("lerobot", folder, scenario)
record = Facts(folder, "robot")
PERIOD = int(scenario.period * MS)


class Arm:
    """An arm whose servo bus takes a while."""

    def __init__(self) -> None:
        self.action_features = {"of": float, "t": float}
        self.seen: set[int] = set()
        self.tick = -1

    def connect(self) -> None: ...

    def get_observation(self) -> dict[str, Any]:
        return {}

    def send_action(self, action: dict[str, float]) -> dict[str, float]:
        t, of = int(action["t"]), int(action["of"])
        if mode == "ticks":
            record("emit", self.tick, p=1)
        else:
            if t not in self.seen:  # an action of a chunk may be used at its own tick
                self.seen.add(t)
                record("open", t)
                record("request", t, p=1, deadline=PERIOD)
                record("result", t, p=1, of=of)
            record("emit", t, p=1, of=of)
        time.sleep(scenario.bus / 1e3)
        return action


class Client(robot_client.RobotClient):
    """Records what `actions_available` says at the head of each tick; changes nothing."""

    def actions_available(self) -> bool:
        is_available = super().actions_available()
        arm.tick += 1
        if arm.tick == scenario.kill_at:
            server.signal(scenario.signal)
        if mode == "ticks":
            record("open", arm.tick)
            record("request", arm.tick, p=1, deadline=PERIOD)
            record("result" if is_available else "fail", arm.tick, p=1)
            if not is_available:
                record("miss", arm.tick)  # the arm holds its position, as it must
        return is_available


arm = Arm()
robot_client.make_robot_from_config = lambda _: arm
robot_client.map_robot_keys_to_lerobot_features = lambda _: {}
client = Client(
    RobotClientConfig(
        policy_type="act",
        pretrained_name_or_path="x",
        robot=None,
        actions_per_chunk=scenario.chunk,
        server_address=f"127.0.0.1:{server.port}",
        fps=round(1e3 / scenario.period),
        chunk_size_threshold=0.5,
        aggregate_fn_name="latest_only",
    )
)
assert client.start()
for target, args in ((client.receive_actions, ()), (client.control_loop, ("",))):
    threading.Thread(target=target, args=args, daemon=True).start()
end = time.monotonic() + scenario.ticks * scenario.period / 1e3
while arm.tick < scenario.ticks and time.monotonic() < end:
    time.sleep(0.02)
record("tick")
server.end()
os._exit(0)  # its threads may hang
