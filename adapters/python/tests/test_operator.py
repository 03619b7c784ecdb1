"""Tests in virtual time which result the asyncio operator sends, and when."""

from __future__ import annotations

import asyncio
from typing import Any

import fuseline
import pytest
from conftest import Run
from fuseline import (
    Call,
    Ending,
    Item,
    Items,
    Local,
    Operator,
    Trigger,
)
from fuseline.deadline import (
    Accuracy,
    Expected,
    Guard,
)
from fuseline.testing import VirtualLoop
from operator_support import MS, Handle, after, ask, items_of, local_after


def test_what_is_no_longer_wanted_is_cancelled_at_once(run: Run[Any]) -> None:
    ended: dict[str, float] = {}

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        def slow(name: str) -> Handle:
            async def handle(request: Any, call: Call) -> Any:
                try:
                    await asyncio.sleep(10)
                finally:
                    ended[name] = round(loop.time() - 1000, 6)

            return handle

        operator: Operator[Any, Any] = Operator(local_after(1 * MS), clock=loop.time_ns)
        operator.use_cloud(slow("timer"), ask(20 * MS), str, 1, name="timer")
        operator.use_cloud(slow("cancelled"), ask(5.0), str, 3, name="cancelled")
        operator.use_cloud(after(50 * MS), ask(5.0), str, 4)
        async with operator:
            operator.write("a")
            item = await anext(operator)
            # The operator continues, so its end is not what ends the calls.
            await asyncio.sleep(1)
            return [item]

    (item,) = run(main)
    # Under eager the first timer commits, and the pending requests are cancelled with it.
    assert (item.decided, ended) == (20_000_000, {"timer": 0.02, "cancelled": 0.02})


def progressive(loop: VirtualLoop) -> Operator[Any, Any]:
    """Returns an operator whose first message also waits for a cloud that never answers."""
    local = Local.task(local_after(10 * MS), at_once=2)
    operator: Operator[Any, Any] = Operator(local, commit="progressive", clock=loop.time_ns)
    operator.use_cloud(after(20 * MS), ask(1.0), "{} of west".format, 1)
    operator.use_cloud(after(9.0), lambda m, t: (m, 0.1) if t == 0 else None, str, 2)
    return operator


def test_lagging_reader_gets_the_newest_items(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        async with progressive(loop) as operator:
            operator.write("a")
            operator.write("b")
            await asyncio.sleep(15 * MS)
            first = [await anext(operator)]
            await asyncio.sleep(1)
            operator.close()
            return first + [item async for item in operator]

    items = run(main)
    seen = [(item.timestamp, item.revision, item.value, item.last) for item in items]
    # A value that was read is not returned again. A value that was not read comes with the last
    # item.
    assert seen == [
        (0, 0, "a on board", False),
        (1, 1, "b of west", True),
        (0, 2, "a of west", True),
    ]


def test_last_only_gives_one_item_with_its_value(
    run: Run[Any],
) -> None:
    async def main(loop: VirtualLoop) -> list[list[Item[Any]]]:
        async with progressive(loop) as operator:
            every = Items(operator)
            last = every.new_reader().last_only()
            operator.write("a")
            operator.write("b")
            operator.close()

            async def all_of(items: Items[Item[Any]]) -> list[Item[Any]]:
                return [item async for item in items]

            return list(await asyncio.gather(all_of(every), all_of(last)))

    every, last = run(main)
    forwarded, final = Ending.FORWARDED, Ending.FINAL
    assert [(it.timestamp, it.revision, it.ending, it.value) for it in last] == [
        (1, 1, forwarded, "b of west"),
        (0, 2, forwarded, "a of west"),
    ]
    # The other reader's item is unchanged.
    assert [it.revision for it in every] == [0, 0, 1, 1, 2]
    assert (every[-1].ending, every[-1].value) == (final, None)


def test_a_guard_under_progressive_is_refused_with_the_remedy(run: Run[Any]) -> None:
    class MyGuard(Guard):
        pass

    expected = Expected(Accuracy(local=42.0, cloud=50.0, price_per_ms=0.01), 0.05)

    async def main(loop: VirtualLoop) -> None:
        for policy in (Guard(), MyGuard(), Guard().cap(expected)):
            operator: Operator[Any, Any] = Operator(local_after(0), commit="progressive")
            operator.use_cloud(after(0), ask(1.0), str, 1, name="west", policy=policy)
            with pytest.raises(fuseline.ConfigError, match="the policy of west assumes"):
                await operator.start()
        async with Operator[Any, Any](local_after(0), commit="progressive") as operator:
            operator.close()
        other: Operator[Any, Any] = Operator(local_after(0), commit="progressive")
        other.use_cloud(after(0), ask(1.0), str, 1, policy=expected)
        async with other:
            other.close()

    run(main)


def test_a_reader_that_gives_up_is_forgotten(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(local_after(0.9), clock=loop.time_ns)
        async with operator:
            for _ in range(3):
                with pytest.raises(asyncio.TimeoutError):
                    await asyncio.wait_for(anext(operator), 0.1)
            assert not operator._output.readers.waiters
            operator.write("a")
            assert (await anext(operator)).value == "a on board"

    run(main)


def test_an_error_is_a_failure_of_its_message_alone(
    run: Run[Any], caplog: pytest.LogCaptureFixture
) -> None:
    async def broken(request: Any, call: Call) -> Any:
        raise OSError("connection refused")

    def response_handler(response: Any) -> Any:
        raise ValueError("no such\nclass " + "x" * 1000)

    async def local(message: int, t: int) -> Any:
        if message % 2:
            raise RuntimeError("odd")
        return message

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[Any, Any] = Operator(local, clock=loop.time_ns)
        operator.use_cloud(broken, ask(1.0), str, 1, name="broken")
        operator.use_cloud(after(0), ask(1.0), response_handler, 2, name="odd")
        return await items_of(operator, [0, 1])

    even, odd = run(main)
    assert (even.ending, even.value, even.trigger) == (Ending.FORWARDED, 0, Trigger.FAILURE)
    assert odd.ending is Ending.MISSED
    whys = {str(failure.source): failure.why for failure in odd.failures}
    assert whys["local"] == "odd"
    assert whys["broken"] == "connection refused"
    assert whys["odd"].startswith("no such class xxx")
    assert len(whys["odd"].encode()) == 200
    assert "operator: message missed (timestamp=1, why=failure)" in caplog.text
    assert "no result will come (timestamp=0, source=broken, why=connection refused)" in caplog.text


def test_message_handler_that_fails_does_not_ask(
    run: Run[Any], caplog: pytest.LogCaptureFixture
) -> None:
    """A message handler that fails makes no request, and stops no other handler (D7)."""

    def broken(message: Any, t: int) -> Any:
        raise RuntimeError("no frame")

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[Any, Any] = Operator(local_after(0.9), clock=loop.time_ns)
        operator.use_cloud(after(0), broken, str, 1)
        operator.use_cloud(after(0), lambda message, t: (message, -1.0), str, 2)
        return await items_of(operator, ["a"])

    (item,) = run(main)
    assert item.value == "a on board"
    assert "no frame" in caplog.text
    assert "a duration of -1" in caplog.text
