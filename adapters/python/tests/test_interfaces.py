"""Tests what threads and loops around an operator may do, and what is reported to them."""

from __future__ import annotations

import asyncio
import pickle
import subprocess
import sys
import threading
import time
from concurrent.futures import Future
from typing import Any

import fuseline
import pytest
from fuseline import BlockingOperator, Call, Closed, Item, Local, Operator
from fuseline.deadline import Accuracy, Constant, End, Expected, Guard, Observations, Situation

MS = 0.001


async def echo(request: Any, call: Call) -> Any:
    return request


async def at_once(message: Any, t: int) -> Any:
    return f"{message} on board"


def once(deadline: float) -> Any:
    return lambda message, t: (message, deadline)


def in_thread(work: Any) -> Any:
    """Runs a function in a thread of its own. Returns what it returns or raises."""
    ended: Future[Any] = Future()

    def run() -> None:
        try:
            ended.set_result(work())
        except BaseException as error:
            ended.set_exception(error)

    threading.Thread(target=run).start()
    return ended


def test_a_cameras_callback_writes_from_its_thread() -> None:
    async def main() -> list[Item[Any]]:
        operator: Operator[int, str] = Operator(at_once, window=64, output_len=64)

        def camera() -> list[int]:
            return [operator.write_threadsafe(frame).result(5) for frame in range(40)]

        async with operator:
            assert await asyncio.wrap_future(in_thread(camera)) == list(range(40))
            operator.close()
            return [item async for item in operator]

    items = asyncio.run(main(), debug=True)
    assert [item.value for item in items] == [f"{n} on board" for n in range(40)]


def test_encoding_runs_in_a_thread_and_takes_its_part_of_the_deadline() -> None:
    threads: list[str] = []
    left: list[float] = []

    def encode(frame: int) -> bytes:
        threads.append(threading.current_thread().name)
        time.sleep(0.03)
        return bytes([frame])

    async def handle(request: bytes, call: Call) -> bytes:
        left.append(call.deadline)
        return request

    async def main() -> list[Item[Any]]:
        operator: Operator[int, Any] = Operator(at_once, lag_warning=10.0)
        operator.use_cloud(handle, once(60.0), bytes.hex, 1, encode=encode)
        async with operator:
            operator.feed([1, 2])
            return [item async for item in operator]

    assert sorted(str(item.value) for item in asyncio.run(main())) == ["01", "02"]
    assert threads == ["fuseline-encode"] * 2
    assert all(0.0 < seconds < 59.98 for seconds in left)


def test_local_has_a_deadline_of_a_second_unless_it_is_given() -> None:
    def local(message: Any, t: int) -> Any:
        return message

    made = [Local.task(at_once), Local.threads(local), Local.threads_of(lambda: local)]
    assert [it.deadline for it in [*made, Local.processes(local)]] == [10**9] * 4
    assert Local.threads(local, deadline=None).deadline is None


def test_a_program_ends_although_local_hangs() -> None:
    program = """
import asyncio, threading, fuseline
async def main():
    operator = fuseline.Operator(lambda n, t: threading.Event().wait(), window=4)
    async with operator:
        operator.write(1)
        await asyncio.sleep(0.05)
        raise KeyboardInterrupt
asyncio.run(main())
"""
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert "KeyboardInterrupt" in ended.stderr, ended.stderr


def test_a_script_without_a_loop_uses_an_operator() -> None:
    def local(message: int, t: int) -> str:
        return f"{message} on board"

    with BlockingOperator(Operator(local, output_len=4)) as operator:
        assert operator.read(timeout=0.01) is None
        assert [operator.write(n) for n in range(3)] == [0, 1, 2]
        first = operator.read(timeout=5.0)
        assert first is not None and first.value == "0 on board"
        operator.close()
        with pytest.raises(Closed):
            operator.write(4)
        assert [item.value for item in operator] == ["1 on board", "2 on board"]
    with pytest.raises(fuseline.ConfigError, match="does not run"):
        operator.read()
    with pytest.raises(KeyError), BlockingOperator(Operator(local)) as operator:
        raise KeyError


def test_policies_can_be_pickled() -> None:
    expected = Expected(Accuracy(0.3, 0.5, 0.001), 0.1, probe_every=None)
    for age in (0.01, 0.02, 0.02, 0.09):
        expected.ended(End.ANSWERED, age)
    expected.ended(End.CENSORED, 0.05)
    observations = Observations()
    for end, age in ((End.ANSWERED, 0.3), (End.CENSORED, 0.1), (End.FAILED, 0.2)):
        observations.add(end, age)
    policy = Guard().cap(expected)
    copies = pickle.loads(pickle.dumps((policy, expected, Constant(0.5), observations)))
    situation = Situation(speed=11.0)
    assert copies[0].decide(situation, 5.0) == policy.decide(situation, 5.0)
    assert copies[1].observations() == expected.observations()
    assert copies[2].deadline == 500_000_000
    assert copies[3].survival() == observations.survival() != []
    assert copies[3].sorted() == observations.sorted()
