"""A robot with a policy on a server and one on board: no tick is ever without an action.

    python examples/remote_policy.py [--seconds S] [--plot FILE]

It has the shape of asynchronous inference as LeRobot does it: a policy server computes actions
from observations, and a client on the robot asks it 30 times a second. There, a robot whose server
is gone only logs that. Here each observation goes to both policies. The server's action is taken
if it comes within 25 ms, else the one from on board, at the latest when the 25 ms are over.

A third of the way through the server is killed, after another third it is started again. At the
end the trace is judged, and what happened is drawn. The arm has one joint, which is to follow a
target; the policy on board only sees where the target is, the one on the server also where it is
going.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import fuseline
from fuseline.grpc import Description, Remote, Server

RATE = 30.0
DEADLINE = 0.025


def target(seconds: float) -> float:
    """Returns the wanted position of the joint, in radians."""
    return math.sin(2.0 * seconds) + 0.4 * math.sin(5.0 * seconds)


class Arm:
    """One joint, whose actions are velocities in rad/s, kept for a tick."""

    def __init__(self) -> None:
        self.tick = 0
        self.joint = target(0.0)
        self.log: list[tuple[float, float, float, str]] = []

    def observe(self) -> dict[str, float]:
        seconds = self.tick / RATE
        return {"seconds": seconds, "joint": self.joint, "target": target(seconds)}

    def act(self, velocity: float, source: str) -> None:
        self.tick += 1
        self.joint += velocity / RATE
        self.log.append((self.tick / RATE, target(self.tick / RATE), self.joint, source))


def on_board(observation: dict[str, float], _: int) -> float:
    """Acts as the small policy: goes to where the target is."""
    return 6.0 * (observation["target"] - observation["joint"])


async def on_the_server(payload: bytes, _: fuseline.Call) -> bytes:
    """Acts as the large policy: goes to where the target will be, after a model's runtime."""
    observation = json.loads(payload)
    await asyncio.sleep(0.008)
    ahead = target(observation["seconds"] + 1 / RATE)
    return json.dumps((ahead - observation["joint"]) * RATE).encode()


async def serve(address: str) -> None:
    """The policy server, in a process of its own."""
    async with Server(on_the_server, address, description=Description("large policy")) as server:
        print(server.address, flush=True)
        await asyncio.Event().wait()


class PolicyServer:
    """The policy server's process, which can be killed and started again at the same address."""

    def __init__(self) -> None:
        self.address = "127.0.0.1:0"

    def start(self) -> None:
        words = [sys.executable, __file__, "--serve", self.address]
        self._process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)

    def ready(self) -> None:
        """Waits until it listens."""
        assert self._process.stdout is not None
        self.address = self._process.stdout.readline().strip()

    def kill(self) -> None:
        self._process.kill()
        self._process.communicate()


async def run(ticks: int, trace: Path) -> Arm:
    """Moves the arm this many ticks."""
    server = PolicyServer()
    server.start()
    server.ready()
    try:
        async with Remote(f"http://{server.address}") as remote:
            description = await remote.describe()
            print(f"asking a {description.model if description else 'policy'} at {remote.url}")
            operator: fuseline.Operator[dict[str, float], float]
            operator = fuseline.Operator(on_board, name="arm", trace=trace)
            operator.use_cloud(
                remote.infer,
                lambda observation, _: (json.dumps(observation).encode(), DEADLINE),
                json.loads,
                1,
                name="server",
            )
            async with operator:
                return await drive(operator, server, ticks)
    finally:
        server.kill()


async def drive(operator: fuseline.Operator[Any, float], server: PolicyServer, ticks: int) -> Arm:
    """Runs the robot's loop: an observation, an action, 30 times a second."""
    arm, loop = Arm(), asyncio.get_running_loop()
    start = loop.time()
    for tick in range(ticks):
        if tick == ticks // 3:
            print("the server is killed")
            server.kill()
        if tick == 2 * ticks // 3:
            print("the server is started again")
            server.start()
        await asyncio.sleep(max(0.0, start + tick / RATE - loop.time()))
        operator.write(arm.observe())
        item = await anext(operator)
        assert item.value is not None, "an action is missing"
        arm.act(item.value, str(item.source))
    return arm


def draw(arm: Arm, trace: Path, file: Path) -> None:
    """Draws where the joint was, and whose actions moved it, above their response times."""
    import matplotlib.pyplot as plt

    figure, (above, below) = plt.subplots(2, figsize=(10, 6), sharex=True, layout="constrained")
    seconds, wanted, joint, sources = zip(*arm.log, strict=True)
    above.plot(seconds, wanted, color="#999999", lw=1, label="target")
    for source, colour in (("local", "#E69F00"), ("server", "#0072B2")):
        at = [place for place, it in enumerate(sources) if it == source]
        x, y = [seconds[place] for place in at], [joint[place] for place in at]
        above.scatter(x, y, s=14, color=colour, linewidths=0, label=f"moved by {source}")
    above.set(ylabel="joint, rad")
    above.spines[["top", "right"]].set_visible(False)
    above.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    fuseline.Trace(trace).timeline(below)
    below.set(xlabel="s")
    below.set_title("", loc="left")
    figure.savefig(file, dpi=150)
    plt.close(figure)


def main() -> int:
    """Runs it and says what happened."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--trace", type=Path, default=Path("remote_policy.jsonl"))
    parser.add_argument("--plot", type=Path, help="where to draw it; needs matplotlib")
    parser.add_argument("--serve", metavar="ADDRESS", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.serve:
        asyncio.run(serve(args.serve))
        return 0
    ticks = max(1, round(args.seconds * RATE))
    arm = asyncio.run(run(ticks, args.trace))
    sources = Counter(source for *_, source in arm.log)
    print(f"{len(arm.log)} actions in {ticks} ticks: {dict(sources)}")
    verdict = fuseline.check(args.trace)
    print(verdict)
    if args.plot:
        draw(arm, args.trace, args.plot)
        print(f"drawn in {args.plot}")
    return 0 if verdict.conforms and len(arm.log) == ticks else 1


if __name__ == "__main__":
    sys.exit(main())
