"""Tests calls that end early, late, or otherwise than by a plain value."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Generator
from typing import Any

import pytest
from conftest import Run
from fuseline import Call, Ending, Item, Operator
from operator_support import MS, after, ask, local_after


def the_operator(loop: Any, handle: Any, response: Any = lambda it: it) -> Operator[Any, Any]:
    operator: Operator[Any, Any] = Operator(local_after(5 * MS), name="tasks", clock=loop.time_ns)
    operator.use_cloud(handle, ask(20 * MS), response, 1, name="west")
    return operator


async def one(operator: Operator[Any, Any], message: str = "m") -> Item[Any]:
    operator.write(message)
    return await anext(operator)


async def task_of(operator: Operator[Any, Any]) -> asyncio.Task[None]:
    """Returns west's call for the first message, once it waits."""
    assert operator._driver is not None
    await asyncio.sleep(1 * MS)
    task = operator._driver._sources[1].in_flight[0]
    assert task is not None
    return task


def test_a_call_that_answers_its_cancellation_has_answered(run: Run[Any]) -> None:
    async def stubborn(request: Any, call: Call) -> Any:
        try:
            await asyncio.sleep(1)
        except asyncio.CancelledError:
            return "at the last moment"

    async def main(loop: Any) -> None:
        async with the_operator(loop, stubborn) as operator:
            operator.write("m")
            (await task_of(operator)).cancel()
            item = await anext(operator)
            assert item.value == "at the last moment"
            assert operator.counts["west", "result", "forwarded"] == 1

    run(main)


def test_an_aborted_call_that_answers_is_of_no_use(run: Run[Any]) -> None:
    ended: list[str] = []

    async def stubborn(request: Any, call: Call) -> Any:
        try:
            await asyncio.sleep(1)
        except asyncio.CancelledError:
            ended.append("cancelled")
            return "too late"

    async def main(loop: Any) -> None:
        async with the_operator(loop, stubborn) as operator:
            assert (await one(operator)).value == "m on board"
            await asyncio.sleep(1 * MS)
            assert ended == ["cancelled"]
            assert operator.counts["west", "timer", "fired"] == 1
            assert not any(what == "result" for name, what, _ in operator.counts if name == "west")

    run(main)


def test_a_call_that_others_cancel_has_failed(run: Run[Any]) -> None:
    async def main(loop: Any) -> None:
        async with the_operator(loop, after(1)) as operator:
            operator.write("m")
            task = await task_of(operator)
            task.cancel()
            assert (await anext(operator)).value == "m on board"
            assert operator.counts["west", "failed because", "cancelled"] == 1
            assert task.done() and not task.cancelled()

    run(main)


def test_a_call_that_is_cancelled_before_it_begins_calls_nobody(run: Run[Any]) -> None:
    called: list[Any] = []

    async def handle(request: Any, call: Call) -> Any:
        called.append(request)

    async def main(loop: Any) -> None:
        async with the_operator(loop, handle) as operator:
            operator.write("m")
            assert operator._driver is not None
            task = operator._driver._sources[1].in_flight[0]
            assert task is not None
            task.cancel()
            assert (await anext(operator)).value == "m on board"
            assert task.cancelled() and not called

    run(main)


def test_a_call_that_is_closed_has_failed(run: Run[Any]) -> None:
    async def main(loop: Any) -> None:
        async with the_operator(loop, after(1)) as operator:
            operator.write("m")
            task = await task_of(operator)
            coroutine: Any = task.get_coro()
            coroutine.close()
            assert (await anext(operator)).value == "m on board"
            assert operator.counts["west", "failed because", "GeneratorExit"] == 1
            task.cancel()

    run(main)


def test_a_handle_may_return_any_awaitable(run: Run[Any]) -> None:
    class Answer:
        def __await__(self) -> Generator[Any, Any, str]:
            yield from asyncio.sleep(1 * MS).__await__()
            return "awaited"

    class Handle:
        def __call__(self, request: Any, call: Call) -> Any:
            return (
                Answer() if request == "object" else asyncio.ensure_future(after(MS)("done", call))
            )

    async def main(loop: Any) -> None:
        async with the_operator(loop, Handle(), lambda it: f"{it} by the cloud") as operator:
            assert (await one(operator, "object")).value == "awaited by the cloud"
            assert (await one(operator, "future")).value == "done by the cloud"

    run(main)


@pytest.mark.parametrize("error", [ValueError("bad"), StopIteration(7), asyncio.CancelledError()])
def test_what_a_response_handler_raises_is_a_failure(run: Run[Any], error: BaseException) -> None:
    def response(it: Any) -> Any:
        raise error

    async def main(loop: Any) -> None:
        why = "cancelled" if isinstance(error, asyncio.CancelledError) else str(error)
        async with the_operator(loop, after(MS), response) as operator:
            item = await one(operator)
            assert item.value == "m on board" and item.ending is Ending.FORWARDED
            assert operator.counts["west", "failed because", why] == 1

    run(main)


def test_an_async_response_handler_ends_with_its_call(run: Run[Any]) -> None:
    ended: list[str] = []

    async def response(it: Any) -> Any:
        try:
            await asyncio.sleep(1 if it == "slow" else 0)
        except asyncio.CancelledError:
            ended.append("cancelled")
            raise
        return f"{it} by the cloud"

    async def main(loop: Any) -> None:
        async with the_operator(loop, after(MS), response) as operator:
            assert (await one(operator, "slow")).value == "slow on board"
            assert (await one(operator, "quick")).value == "quick by the cloud"
        assert ended == ["cancelled"]

    run(main)


@pytest.mark.skipif(sys.version_info < (3, 12), reason="no eager tasks")
def test_tasks_may_end_while_they_are_made(run: Run[Any]) -> None:
    async def at_once(request: Any, call: Call) -> Any:
        return f"{request} by the cloud"

    async def main(loop: Any) -> None:
        loop.set_task_factory(asyncio.eager_task_factory)  # type: ignore[attr-defined,unused-ignore]
        async with the_operator(loop, at_once) as operator:
            for message in ["a", "b"]:
                assert (await one(operator, message)).value == f"{message} by the cloud"

    run(main)
