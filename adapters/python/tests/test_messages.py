"""Tests shared encodings, items that carry their messages, and logs of clouds that are gone."""

from __future__ import annotations

import asyncio
import logging
import threading
from typing import Any

import pytest
from conftest import Run
from fuseline import Call, Item, Local, Operator
from fuseline.testing import VirtualLoop
from operator_support import MS, after, ask, items_of, local_after


class Encoder:
    """Counts what it encodes. Its bound method is a new object each time."""

    def __init__(self) -> None:
        self.encoded: list[Any] = []
        self._lock = threading.Lock()

    def encode(self, frame: Any) -> str:
        with self._lock:
            self.encoded.append(frame)
        if frame == "broken":
            raise ValueError("no JPEG")
        return f"JPEG of {frame}"


def test_a_message_of_two_clouds_is_encoded_once() -> None:
    jpeg, other = Encoder(), Encoder()

    async def west(request: str, call: Call) -> str:
        raise OSError("west is gone")

    async def east(request: str, call: Call) -> str:
        return f"east's of the {request}"

    async def main() -> list[Item[str]]:
        operator: Operator[str, str] = Operator(local_after(0.05), commit="patient")
        operator.use_cloud(west, ask(5.0), str, 2, encode=jpeg.encode)
        operator.use_cloud(east, ask(5.0), str, 1, encode=jpeg.encode)
        # Another request for the same message, and another encoder, do not share the encoding.
        operator.use_cloud(west, lambda it, t: (it + "!", 5.0), str, 3, encode=jpeg.encode)
        operator.use_cloud(west, ask(5.0), str, 4, encode=other.encode)
        return await items_of(operator, ["frame", "broken"])

    items = asyncio.run(main())
    assert [it.value for it in items] == ["east's of the JPEG of frame", "broken on board"]
    assert sorted(jpeg.encoded) == ["broken", "broken!", "frame", "frame!"]
    assert sorted(other.encoded) == ["broken", "frame"]
    whys = {str(it.source): it.why for it in items[1].failures}
    assert "no JPEG" in whys["cloud-1"] and "no JPEG" in whys["cloud-2"]


def test_a_call_that_is_aborted_does_not_end_an_encoding_that_another_waits_for() -> None:
    class Slow(Encoder):
        def encode(self, frame: Any) -> str:
            begun.set()
            assert go_on.wait(10)
            return super().encode(frame)

    jpeg, begun, go_on = Slow(), threading.Event(), threading.Event()

    async def echo(request: str, call: Call) -> str:
        return request

    async def main() -> list[Item[str]]:
        async def local(frame: str, t: int) -> str:
            await asyncio.to_thread(begun.wait, 10)
            await asyncio.sleep(0.05)
            go_on.set()
            return "local's"

        operator: Operator[str, str] = Operator(Local.task(local, deadline=10.0), commit="patient")
        # The request's timer fires while it is being encoded.
        operator.use_cloud(echo, ask(0.02), str, 1, encode=jpeg.encode)
        operator.use_cloud(echo, ask(10.0), str, 2, encode=jpeg.encode)
        return await items_of(operator, ["frame"])

    assert [it.value for it in asyncio.run(main())] == ["JPEG of frame"]
    assert jpeg.encoded == ["frame"]


@pytest.mark.parametrize("carry_messages", [True, False])
def test_items_carry_their_messages_if_that_is_wanted(
    run: Run[list[Item[Any]]], carry_messages: bool
) -> None:
    async def local(message: str, t: int) -> str:
        if message == "b":
            raise ValueError("broken")
        return "local's"

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[str, Any] = Operator(
            Local.task(local, at_once=3),
            clock=loop.time_ns,
            commit="progressive",
            window=2,
            carry_messages=carry_messages,
        )
        operator.use_cloud(
            after(50 * MS), lambda message, t: (message, 0.2) if t == 0 else None, str, 1
        )
        async with operator:
            for message in "abc":
                operator.write(message)
            operator.close()
            return [item async for item in operator]

    items = run(main)
    found = sorted((it.ending.value, it.message) for it in items)
    expected = [("forwarded", "a"), ("missed", "b"), ("preliminary", "a"), ("refused", "c")]
    assert found == [(ending, it if carry_messages else None) for ending, it in expected]


def test_cloud_that_is_gone_is_logged_and_its_return(
    run: Run[Any], caplog: pytest.LogCaptureFixture
) -> None:
    async def flaky(t: int, call: Call) -> int:
        if t < 3:
            raise OSError("refused")
        return t

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[int, Any] = Operator(local_after(20 * MS), clock=loop.time_ns)
        operator.use_cloud(flaky, ask(0.5), str, 1, name="west")
        return await items_of(operator, range(6))

    caplog.set_level(logging.INFO, "fuseline")
    run(main)
    logged = [(it.levelname, it.getMessage()) for it in caplog.records]
    assert [it for it in logged if "west" in it[1]] == [
        ("WARNING", "operator: no result will come (timestamp=0, source=west, why=refused)"),
        ("INFO", "operator: results arrive again (source=west, requests=3, seconds=0)"),
    ]
