"""Tests the asyncio operator's failures, queues, windows and places in virtual time."""

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
    Operator,
    Trigger,
)
from fuseline.testing import VirtualLoop
from operator_support import after, ask, items_of, local_after


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


def test_a_message_handler_that_fails_does_not_ask(
    run: Run[Any], caplog: pytest.LogCaptureFixture
) -> None:
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


def test_a_lagging_reader_holds_back_new_messages_and_loses_none(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(
            local_after(0), clock=loop.time_ns, output_len=2, window=4
        )
        async with operator:
            assert [operator.write("a"), operator.write("b")] == [0, 1]
            await asyncio.sleep(1)
            with pytest.raises(fuseline.Full, match="2 items wait"):
                operator.write("c")
            assert (await anext(operator)).timestamp == 0
            assert operator.write("c") == 2
            operator.feed(range(100))
            assert sorted([it.timestamp async for it in operator]) == list(range(1, 103))
            with pytest.raises(fuseline.Closed):
                operator.write("d")

    run(main)
