"""Measures what the machine and the operator cost in Python.

    python benches/cost.py [--messages N] [--rounds N] [--uvloop]

The operator computes each message on board and in two clouds. Beside it stands what one would write
by hand with `asyncio.wait`: a deadline for both clouds, the best that is in, and what is left is
cancelled. It has no window, queue, gate, counts, reasons or trace. Both run in turns in one
process; each figure is the median of the rounds.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import platform
import statistics
import time
from collections.abc import Awaitable, Callable
from typing import Any

from fuseline import Call, Cloud, Fusion, Local, Operator

DEADLINE = 0.5


def machine(messages: int) -> float:
    """Open, an offer, and two results: µs a message."""
    fusion = Fusion([Cloud(1)])
    clock = time.monotonic_ns
    start = time.process_time_ns()
    for t in range(messages):
        fusion.open(clock(), t)
        fusion.offer(clock(), t, 1, DEADLINE)
        fusion.result(clock(), t, 0)
        fusion.result(clock(), t, 1)
    return (time.process_time_ns() - start) / messages / 1e3


def calls(messages: int) -> dict[str, float]:
    """Each input by itself, less the loop around it: ns."""
    spent: dict[str, float] = {}

    def timed(name: str, inputs: Callable[[int], Any]) -> None:
        start = time.process_time_ns()
        for t in range(messages):
            inputs(t)
        spent[name] = (time.process_time_ns() - start) / messages

    timed("loop", lambda t: t)
    window = 1024
    fusions = [Fusion([Cloud(1)], window=window) for _ in range(messages // window + 1)]
    timed("open", lambda t: fusions[t // window].open(0, t))
    timed("offer", lambda t: fusions[t // window].offer(0, t, 1, DEADLINE))
    timed("result, held", lambda t: fusions[t // window].result(1, t, 0))
    timed("result, forwarded", lambda t: fusions[t // window].result(1, t, 1))
    loop = spent.pop("loop")
    return {name: nanos - loop for name, nanos in spent.items()}


class Sources:
    """Local and two clouds, which answer at once or after a while."""

    def __init__(self, seconds: tuple[float, float, float]) -> None:
        self._seconds = seconds

    async def local(self, message: int, t: int) -> int:
        await asyncio.sleep(self._seconds[0])
        return message

    async def west(self, message: int, call: Call | None) -> int:
        await asyncio.sleep(self._seconds[1])
        return message

    async def east(self, message: int, call: Call | None) -> int:
        await asyncio.sleep(self._seconds[2])
        return message


async def by_hand(sources: Sources, message: int) -> int:
    """The best result that is in by the deadline, else local's."""
    loop = asyncio.get_running_loop()
    until = loop.time() + DEADLINE
    east = loop.create_task(sources.east(message, None))
    west = loop.create_task(sources.west(message, None))
    local = loop.create_task(sources.local(message, 0))
    waiting = {east, west, local}
    try:
        while waiting and (left := until - loop.time()) > 0:
            _, waiting = await asyncio.wait(
                waiting, timeout=left, return_when=asyncio.FIRST_COMPLETED
            )
            if east.done() and not east.exception():
                return east.result()
            if east.done() and west.done() and not west.exception():
                return west.result()
        if west.done() and not west.exception():
            return west.result()
        return await local
    finally:
        for task in waiting:
            task.cancel()


def operator(sources: Sources, lag_warning: float = 0.02) -> Operator[int, int]:
    """An operator with two clouds."""
    local = Local.task(sources.local, at_once=16)
    made: Operator[int, int] = Operator(local, output_len=64, lag_warning=lag_warning)
    for priority, handle in [(1, sources.west), (2, sources.east)]:
        made.use_cloud(handle, lambda m, t: (m, DEADLINE), lambda it: it, priority)
    return made


async def one_by_one(ask: Callable[[int], Awaitable[Any]], messages: int) -> float:
    """µs of processor time a message, each after the one before."""
    start = time.process_time_ns()
    for message in range(messages):
        await ask(message)
    return (time.process_time_ns() - start) / messages / 1e3


async def back_to_back(messages: int) -> tuple[float, float]:
    """Sources that answer at once."""
    sources = Sources((0, 0, 0))
    async with operator(sources) as ours:

        async def ask(message: int) -> None:
            ours.write(message)
            await anext(ours)

        fused = await one_by_one(ask, messages)
    return fused, await one_by_one(lambda message: by_hand(sources, message), messages)


async def at_rate(messages: int) -> tuple[float, float]:
    """200 messages a second, sources of 5, 10 and 20 ms; messages overlap."""
    sources, period = Sources((0.005, 0.01, 0.02)), 0.005

    async def paced(take: Callable[[int], Any]) -> None:
        loop = asyncio.get_running_loop()
        start = loop.time()
        for message in range(messages):
            await asyncio.sleep(max(0.0, start + message * period - loop.time()))
            take(message)

    async with operator(sources) as ours:

        async def read() -> None:
            for _ in range(messages):
                await anext(ours)

        start = time.process_time_ns()
        await asyncio.gather(paced(ours.write), read())
        fused = (time.process_time_ns() - start) / messages / 1e3

    items: asyncio.Queue[int] = asyncio.Queue()
    tasks = set()

    async def answer(message: int) -> None:
        items.put_nowait(await by_hand(sources, message))

    def take(message: int) -> None:
        task = asyncio.get_running_loop().create_task(answer(message))
        tasks.add(task)
        task.add_done_callback(tasks.discard)

    async def receive() -> None:
        for _ in range(messages):
            await items.get()

    start = time.process_time_ns()
    await asyncio.gather(paced(take), receive())
    return fused, (time.process_time_ns() - start) / messages / 1e3


def compare(name: str, run: Callable[[int], Any], messages: int, rounds: int, make: Any) -> float:
    pairs = []
    for _ in range(rounds):
        loop = make()
        try:
            pairs.append(loop.run_until_complete(run(messages)))
        finally:
            loop.close()
    fused, hand = (statistics.median(it) for it in zip(*pairs, strict=True))
    ratio: float = statistics.median(ours / theirs for ours, theirs in pairs)
    print(f"{name:<34}{fused:>8.1f} µs{hand:>10.1f} µs by hand{ratio:>8.2f} times")
    return ratio


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--messages", type=int, default=5000)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--uvloop", action="store_true")
    args = parser.parse_args()
    make: Any = asyncio.SelectorEventLoop
    if args.uvloop:
        import uvloop

        make = uvloop.new_event_loop
    load = os.getloadavg()[0]
    print(f"Python {platform.python_version()}, load {load:.1f}, median of {args.rounds} rounds")
    per_message = statistics.median(machine(args.messages) for _ in range(args.rounds))
    each = [calls(args.messages) for _ in range(args.rounds)]
    medians = {name: statistics.median(it[name] for it in each) for name in each[0]}
    print("\n".join(f"{name:<34}{nanos:>8.0f} ns" for name, nanos in medians.items()))
    print(f"{'the machine, a message':<34}{per_message:>8.1f} µs")
    compare("the operator, back to back", back_to_back, args.messages, args.rounds, make)
    few = max(1, args.messages // 10)
    compare("at 200 Hz, 5, 10 and 20 ms", at_rate, few, min(3, args.rounds), make)


if __name__ == "__main__":
    main()
