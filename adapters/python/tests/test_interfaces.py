"""Tests what threads and loops around an operator may do, and what is reported to them."""

from __future__ import annotations

import asyncio
import logging
import pickle
import subprocess
import sys
import threading
import time
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import fuseline
import pytest
from conftest import Run
from fuseline import BlockingOperator, Call, Closed, Ending, Full, Item, Local, Operator
from fuseline.deadline import Accuracy, Constant, End, Expected, Guard, Observations, Situation
from fuseline.testing import VirtualLoop

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


def test_write_in_another_thread_is_refused_with_the_remedy() -> None:
    async def main() -> None:
        async with Operator(at_once) as operator:
            for method in (lambda: operator.write(1), operator.close, operator.stop):
                with pytest.raises(RuntimeError, match=r"in another thread .*threadsafe"):
                    await asyncio.wrap_future(in_thread(method))
            assert operator.counts == {}

    asyncio.run(main(), debug=True)


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


def test_a_message_from_another_thread_that_is_not_taken_is_counted(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main() -> None:
        operator: Operator[int, str] = Operator(at_once, window=2, output_len=1)
        with pytest.raises(fuseline.ConfigError, match="has not started"):
            operator.write_threadsafe(0)
        async with operator:
            # The loop gets no turn here, so two messages are on their way and no more fit.
            two = [operator.write_threadsafe(n) for n in range(2)]
            with pytest.raises(Full, match="on their way"):
                operator.write_threadsafe(2)
            assert await asyncio.wrap_future(two[0]) == 0
            while not operator._output.items:
                await asyncio.sleep(0)
            full = operator.write_threadsafe(3)
            with pytest.raises(Full, match="wait to be read"):
                await asyncio.wrap_future(full)
            operator.stop()
            with pytest.raises(Closed):
                await asyncio.wrap_future(operator.write_threadsafe(4))
            assert operator.counts["operator", "message", "not taken"] >= 3

    asyncio.run(main())
    assert "a message was not taken" in caplog.text


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


def test_an_encoding_that_fails_is_a_failure_of_its_message() -> None:
    def encode(frame: int) -> bytes:
        raise StopIteration(frame)

    async def main() -> list[Item[Any]]:
        operator: Operator[int, Any] = Operator(at_once)
        operator.use_cloud(echo, once(30.0), str, 1, encode=encode)
        async with operator:
            operator.feed([1])
            return [item async for item in operator]

    (item,) = asyncio.run(main())
    assert "StopIteration" in item.failures[0].why


@pytest.mark.parametrize("who", ["handle", "message handler", "local", "somebody"])
def test_who_holds_up_the_loop_is_counted_and_logged(
    run: Run[Any], caplog: pytest.LogCaptureFixture, who: str
) -> None:
    async def main(loop: VirtualLoop) -> Any:
        def block(name: str) -> None:
            if name == who:
                loop.block(0.4)

        async def local(message: Any, t: int) -> Any:
            block("local")
            return message

        async def handle(request: Any, call: Call) -> Any:
            block("handle")
            await asyncio.sleep(0.01)
            return request

        def wanted(message: Any, t: int) -> Any:
            block("message handler")
            return message, 0.1

        operator: Operator[Any, Any] = Operator(local, clock=loop.time_ns)
        operator.use_cloud(handle, wanted, str, 1, name="west")
        async with operator:
            operator.write("a")
            if who == "somebody":
                await asyncio.sleep(0.001)
                block("somebody")
            operator.close()
            async for _ in operator:
                pass
        assert operator.greatest_lag >= 0.3
        return operator.counts

    counts = run(main)
    held_up = {of: n for (of, what, how), n in counts.items() if how == "held up the loop"}
    source = {"handle": "west", "message handler": "west", "local": "local"}.get(who)
    assert held_up == ({source: 1} if source else {})
    if who != "message handler":
        assert counts["operator", "timer", "late"] == 1
    expected = "the event loop was blocked" if who == "somebody" else "held up"
    assert expected in caplog.text


def test_local_has_a_deadline_of_a_second_unless_it_is_given() -> None:
    def local(message: Any, t: int) -> Any:
        return message

    made = [Local.task(at_once), Local.threads(local), Local.threads_of(lambda: local)]
    assert [it.deadline for it in [*made, Local.processes(local)]] == [10**9] * 4
    assert Local.threads(local, deadline=None).deadline is None


def test_a_local_that_hangs_is_reported_and_replaced_up_to_a_bound(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """One of several threads hangs, others answer, and it ends with its computation."""
    release = threading.Event()

    def make() -> Any:
        def compute(message: int, t: int) -> str:
            if message == 0:
                release.wait(30)
            return f"{message} on board"

        return compute

    async def main(local: Local[int, str]) -> tuple[list[Item[str]], Any]:
        operator: Operator[int, str] = Operator(local, window=16)
        async with operator:
            items: list[Item[str]] = []
            # On a busy host later messages may be late too, but not all of them.
            while len(items) < 100 and (not items or items[-1].ending is Ending.MISSED):
                operator.write(len(items))
                items.append(await operator.__anext__())
            release.set()
            return items, operator.counts

    items, counts = asyncio.run(main(Local.threads_of(make, deadline=0.2)))
    assert items[0].value is None and items[-1].value == f"{len(items) - 1} on board"
    assert "another worker replaces it" in caplog.text
    # A single function may keep state, so it does not run again while it hangs.
    release.clear()
    items, counts = asyncio.run(main(Local.threads(make(), deadline=0.02)))
    assert [item.ending for item in items] == [Ending.MISSED] * 100
    assert counts["local", "request", "lost"] >= 1
    assert "it occupies its worker until it ends" in caplog.text


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


def test_a_feed_waits_for_room_in_the_window(run: Run[Any]) -> None:
    async def local(message: Any, t: int) -> Any:
        await asyncio.sleep(0.01)
        return message

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[Any, Any] = Operator(local, clock=loop.time_ns)
        async with operator:
            operator.feed(range(100))
            return [item async for item in operator]

    items = run(main)
    assert [item.value for item in items] == list(range(100))


def test_failures_of_handlers_and_policies_are_counted(run: Run[Any]) -> None:
    def fails(*_: Any) -> Any:
        raise OSError("on purpose")

    async def main(loop: VirtualLoop) -> Any:
        operator: Operator[Any, Any] = Operator(at_once, clock=loop.time_ns)
        operator.use_situation(fails)
        operator.use_cloud(echo, fails, str, 1, name="west")
        operator.use_cloud(echo, once(0.1), str, 2, name="east", policy=fails)
        async with operator:
            operator.feed(range(3))
            async for _ in operator:
                pass
        return operator.counts

    counts = run(main)
    assert counts["operator", "handler", "failed"] == 3
    assert counts["west", "handler", "failed"] == 3
    assert counts["east", "policy", "failed"] == 3


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


def test_a_report_takes_a_list_of_paths(tmp_path: Path) -> None:
    lines = (Path(__file__).parents[3] / "traces/corpus").glob("f1-*.jsonl")
    paths = [str(path) for path in sorted(lines)[:2]]
    page = tmp_path / "page.html"
    assert len(fuseline.report(paths, page=page)) == 2
    whole = page.read_bytes()
    fuseline.report(*paths, page=page)
    assert page.read_bytes() == whole
    # A list of lines is still one trace.
    assert len(fuseline.report(Path(paths[0]).read_text().splitlines(True), page=page)) == 1
    with pytest.raises(ValueError, match="name the page's path with page="):
        fuseline.report(paths, str(page))


def test_an_eager_operator_that_gives_a_better_clouds_chance_away_is_reported(
    run: Run[Any], caplog: pytest.LogCaptureFixture
) -> None:
    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(at_once, clock=loop.time_ns)
        operator.use_cloud(echo, once(0.1), str, 1, name="west")
        operator.use_cloud(echo, once(0.2), str, 2, name="east")
        async with operator:
            operator.feed(range(3))
            async for _ in operator:
                pass

    caplog.set_level(logging.WARNING)
    run(main)
    assert caplog.text.count("ends the wait for a better one (A4)") == 1
