"""Tests misuse in what user code raises and returns. See test_misuse.py."""

from __future__ import annotations

import logging
from typing import Any

import pytest
from conftest import Run
from fuseline import Call, Ending, Item, Local, Operator, StampedValue
from fuseline.testing import VirtualLoop
from misuse import Counts, ask, echo, misuse, played
from operator_support import after


class Unreadable(Exception):
    """Fails to return its text, because it has none."""

    def __str__(self) -> str:
        return str(self.args[0])


class Surrogate(Exception):
    """Has a text with bytes of a file's name that are not UTF-8."""

    def __init__(self) -> None:
        super().__init__(b"frame-\xff.jpg".decode("utf-8", "surrogateescape"))


class NoString(Exception):
    """Returns a text that is not a string."""

    def __str__(self) -> str:
        return 7  # type: ignore[return-value]


UNREADABLE = [Unreadable, Surrogate, NoString]
TEXTS = {
    Unreadable: "Unreadable, whose text cannot be read (IndexError)",
    Surrogate: "frame-\\udcff.jpg",
    NoString: "NoString, whose text cannot be read (TypeError)",
}


def only_local(run: Run[Any], local: Any, of: str = "abc") -> tuple[list[Item[Any]], Counts]:
    """Plays a message for each letter, one after the other, with local alone."""

    async def main(loop: VirtualLoop) -> tuple[list[Item[Any]], Counts]:
        operator: Operator[str, Any] = Operator(local, clock=loop.time_ns)
        items = []
        async with operator:
            for message in of:
                operator.write(message)
                item = await operator.read()
                assert item is not None
                items.append(item)
            return items, operator.counts

    return run(main)  # type: ignore[no-any-return]


@pytest.mark.parametrize("kind", UNREADABLE)
@misuse("raises in a handle what has no readable text", "a failure at once, with the type")
def test_cloud_error_without_text(run: Run[Any], kind: type[Exception]) -> None:
    async def handle(request: Any, call: Call) -> Any:
        raise kind

    (item,), counts = played(run, lambda it, _: it.use_cloud(handle, ask, str, 1))
    assert (item.value, item.latency) == ("a on board", 0.0)
    assert item.failures[0].why == TEXTS[kind]
    assert counts["cloud-1", "failure", "accepted"] == 1


@pytest.mark.parametrize("kind", UNREADABLE)
@misuse("raises in a response handler what has no readable text", "a failure at once")
def test_response_error_without_text(run: Run[Any], kind: type[Exception]) -> None:
    def respond(response: Any) -> Any:
        raise kind

    (item,), _ = played(run, lambda it, _: it.use_cloud(echo, ask, respond, 1))
    assert (item.value, item.latency, len(item.failures)) == ("a on board", 0.0, 1)


@pytest.mark.parametrize("kind", UNREADABLE)
@pytest.mark.parametrize("where", ["task", "thread"])
@misuse("raises in local what has no readable text", "a failure at once; local computes on")
def test_local_error_without_text(run: Run[Any], kind: type[Exception], where: str) -> None:
    def plain(message: str, t: int) -> str:
        if message == "a":
            raise kind
        return message

    async def task(message: str, t: int) -> str:
        return plain(message, t)

    items, counts = only_local(
        run, task if where == "task" else Local.threads(plain, deadline=None)
    )
    assert [item.ending for item in items] == [Ending.MISSED, Ending.FORWARDED, Ending.FORWARDED]
    assert items[0].latency < 0.5
    assert counts["local", "failure", "accepted"] == 1


@misuse("raises in a side request what has no readable text", "counted and logged")
def test_side_error_without_text(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    async def handle(request: Any, call: Call) -> Any:
        raise Unreadable

    def prepare(operator: Operator[Any, Any], _: VirtualLoop) -> None:
        operator.use_side_request(handle, ask, print, name="side")
        operator.use_cloud(after(0.05), ask, str, 1)

    _, counts = played(run, prepare)
    assert counts["side", "side request", "failed"] == 1
    assert "whose text cannot be read" in caplog.text


class BadFilter(logging.Filter):
    """Raises, as a filter does that looks for a field that these records lack."""

    def filter(self, record: logging.LogRecord) -> bool:
        raise AttributeError("no robot_id")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@misuse("sets a filter of logs that raises", "what is logged is a failure all the same")
def test_filter_of_logs_that_raises(run: Run[Any]) -> None:
    def prepare(operator: Operator[Any, Any], loop: VirtualLoop) -> None:
        loop.set_exception_handler(lambda *_: None)
        operator.use_cloud(lambda r, c: 7, ask, str, 1)  # type: ignore[arg-type, return-value]

    log, bad = logging.getLogger("fuseline"), BadFilter()
    log.addFilter(bad)
    try:
        (item,), counts = played(run, prepare)
    finally:
        log.removeFilter(bad)
    assert (item.value, item.latency) == ("a on board", 0.0)
    assert counts["cloud-1", "failure", "accepted"] == 1


@pytest.mark.parametrize("of", ["3", 3.0, True, -1, 2**64])
@misuse("says with no timestamp of which message a value is", "a failure, with the remedy")
def test_odd_timestamp_of_a_value(run: Run[Any], of: Any) -> None:
    def respond(response: Any) -> Any:
        return StampedValue(response, of)

    (item,), _ = played(run, lambda it, _: it.use_cloud(echo, ask, respond, 1, max_age=3))
    assert (item.value, item.latency) == ("a on board", 0.0)
    assert "timestamp" in item.failures[0].why or "2**64" in item.failures[0].why


@misuse("sets no timestamp in local's value after it was made", "a failure; local computes on")
def test_timestamp_changed_in_local(run: Run[Any]) -> None:
    async def local(message: str, t: int) -> Any:
        value = StampedValue(message, t)
        if message == "a":
            object.__setattr__(value, "of", "first")
        return value

    items, _ = only_local(run, Local.task(local))
    assert [item.value for item in items] == [None, "b", "c"]
    assert items[0].latency == 0.0
