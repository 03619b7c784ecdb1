"""LeRobot's RTCInferenceEngine on an arm that records: python lerobot_rtc.py released|mended FOLDER SCENARIO.

A message is a step of the arm; while the queue has no action, the arm stands still. What was released skips as many actions of a
chunk as fit into the time of its inference, also while the arm stood still; pull requests 4223 and 4454 of LeRobot are about that.
`mended` skips as many as the arm executed.
"""

from __future__ import annotations

import importlib.util
import logging
import os
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import stubs
from facts import MS, Facts, Scenario

stubs.LEROBOT.append("lerobot.rollout")
ROOT = Path(next(iter(importlib.util.find_spec("lerobot").submodule_search_locations)))


def real(name: str) -> Any:
    """A module of LeRobot whose package is a stub."""
    file = ROOT.joinpath(*name.split(".")[1:]).with_suffix(".py")
    spec = importlib.util.spec_from_file_location(name, file)
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


package = importlib.import_module("lerobot.policies.rtc")
package.ActionQueue = real("lerobot.policies.rtc.action_queue").ActionQueue
package.LatencyTracker = real("lerobot.policies.rtc.latency_tracker").LatencyTracker
importlib.import_module("lerobot.rollout.inference")
real("lerobot.rollout.inference.base")
rtc = real("lerobot.rollout.inference.rtc")
rtc.build_dataset_frame = lambda _, observation, prefix: dict(observation)
rtc.prepare_observation_for_inference = lambda batch, *_: batch
rtc._normalize_prev_actions_length = lambda actions, target_steps: actions
logging.disable(logging.CRITICAL)
mode, folder, scenario = sys.argv[1], sys.argv[2], Scenario(sys.argv[3])
record = Facts(folder, "robot")


class MendedQueue(package.ActionQueue):  # type: ignore[misc]
    """Skips what the arm has executed."""

    def _check_and_resolve_delays(self, real_delay: int, before: int | None = None) -> int:
        return real_delay if before is None else self.last_index - before


class Policy:
    """Replies with a chunk; an action says of which step's observation it is, and for which step."""

    config = None
    calls = 0

    def predict_action_chunk(self, observation: dict[str, Any], **_: Any) -> Any:
        time.sleep(scenario.delays[self.calls % len(scenario.delays)] / 1e3)
        self.calls += 1
        step = observation["step"]
        return stubs.Tensor([[(step, step + k) for k in range(scenario.chunk)]])


class Processor:
    steps = ()

    def __call__(self, value: Any) -> Any:
        return value


if mode == "mended":
    rtc.ActionQueue = MendedQueue
engine = rtc.RTCInferenceEngine(
    Policy(), Processor(), Processor(), SimpleNamespace(robot_type="arm"),
    SimpleNamespace(enabled=True, execution_horizon=scenario.chunk), {}, "", 1e3 / scenario.period,
    "cpu", rtc_queue_threshold=scenario.chunk // 2,
)  # fmt: skip
engine.start()
engine.notify_observation({"step": 0})
engine.resume()
start, step = time.monotonic(), 0
for tick in range(scenario.ticks):
    scenario.wait_for(start, tick)
    # The engine looks at both or at neither.
    with engine._obs_lock:
        action = engine.get_action(None)
        step += action is not None
        engine._obs_holder["obs"] = {"step": step}
    if action is not None:
        t, said = step - 1, {"of": int(action[0]), "for": int(action[1])}
        record("open", t)
        record("request", t, p=1, deadline=int(scenario.period * MS))
        record("result", t, p=1, **said)
        record("emit", t, p=1, **said)
record("tick")
os._exit(0)  # its thread may compute
