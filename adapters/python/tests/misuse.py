"""Marks cases of misuse for the table of `docs/safety/make`, and has the code that they share."""

from __future__ import annotations

import logging
import threading
from collections import Counter
from collections.abc import Callable
from typing import Any, TypeVar

import pytest
from conftest import Run
from fuseline import Call, ConfigError, Item, Operator
from fuseline.testing import VirtualLoop

Case = TypeVar("Case", bound=Callable[..., None])
Counts = Counter[tuple[str, str, str]]


def misuse(does: str, happens: str) -> Callable[[Case], Case]:
    """Marks a test with what the caller does, and how it is refused or reported."""
    assert does and happens
    return lambda case: case


async def echo(request: Any, call: Call) -> Any:
    return request


async def on_board(message: Any, t: int) -> Any:
    return f"{message} on board"


def ask(message: Any, t: int) -> Any:
    return message, 0.1


def operator_of(local: Any = on_board, **of: Any) -> Operator[Any, Any]:
    return Operator(local, **of)


def refused(message: str, make: Callable[[], Any], kind: type[Exception] = ConfigError) -> None:
    with pytest.raises(kind, match=message):
        make()


def cloud_refused(message: str, *of: Any, **options: Any) -> None:
    refused(message, lambda: operator_of().use_cloud(*of, **options))


def played(
    run: Run[Any],
    prepare: Callable[[Operator[Any, Any], VirtualLoop], None],
    of: str = "a",
    **options: Any,
) -> tuple[list[Item[Any]], Counts]:
    """Plays a message for each letter with a prepared operator."""

    async def main(loop: VirtualLoop) -> tuple[list[Item[Any]], Counts]:
        operator = operator_of(clock=loop.time_ns, **options)
        prepare(operator, loop)
        async with operator:
            operator.feed(list(of))
            return [item async for item in operator], operator.counts

    return run(main)  # type: ignore[no-any-return]


def wiring_errors(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [it.getMessage() for it in caplog.records if it.levelno == logging.ERROR]


def elsewhere(work: Callable[[], Any]) -> BaseException | None:
    """Runs `work` in another thread. Returns the exception that it raises."""
    raised: list[BaseException] = []

    def run() -> None:
        try:
            work()
        except BaseException as error:
            raised.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return raised[0] if raised else None
