"""Holds the sources of an operator and its handlers."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from fuseline._fuseline import Latency, nanoseconds
from fuseline._item import Call, Item
from fuseline._side import SideRequest
from fuseline._state import CarriedState
from fuseline._validation import Cloud, ns
from fuseline._wiring import check_awaitable, check_value, is_awaitable
from fuseline.deadline import Policy

if TYPE_CHECKING:
    from fuseline._encoding import Encoder


@dataclass(slots=True)
class RegisteredCloud:
    """Holds a cloud and its handlers."""

    cloud: Cloud
    handle: Callable[[Any, Call], Awaitable[Any]]
    message_handler: Callable[[Any, int], tuple[Any, Any] | None]
    response_handler: Callable[[Any], Any]
    #: Encodes the message handler's request in a thread.
    encode: Callable[[Any], Any] | None
    calls: int
    linger: ns
    policy: Policy | None
    max_age: int
    #: The last deadline that was a float, and its nanoseconds. Usually the next deadline is the
    #: same object.
    last_deadline: tuple[float, ns] = (0.0, ns(0))

    def deadline_of(self, deadline: Any) -> ns:
        """Returns the message handler's deadline in nanoseconds."""
        last = self.last_deadline
        if deadline is last[0]:
            return last[1]
        nanos = nanoseconds(deadline)
        if type(deadline) is float:
            self.last_deadline = deadline, nanos
        return nanos


@dataclass(slots=True)
class OutputHandlers:
    """Holds the further handlers of items and messages."""

    #: Returns the value to send for a message that is missed or refused (E4).
    substitute: Callable[[Item[Any]], Any] | None = None
    #: The states, each with the function that reads it from a result that is sent (E10).
    states: list[tuple[CarriedState[Any], Callable[[Any], Any]]] = field(default_factory=list)
    sides: list[SideRequest] = field(default_factory=list)
    #: Records how long messages take.
    latency: Latency | None = None
    #: True if items carry their messages.
    carry_messages: bool = False
    #: True if messages, and local's results, are copied.
    copy_messages: bool = True


@dataclass(slots=True)
class SourceTasks:
    """Holds the calls or computations of one source."""

    #: The greatest number of running tasks, including those that should have ended.
    limit: int
    cloud: RegisteredCloud | None
    #: Encodes the source's requests, if they need it.
    encoder: Encoder | None = None
    #: The tasks by timestamp, including those that linger. None stands for a task that is about to
    #: be created.
    in_flight: dict[int, asyncio.Task[None] | None] = field(default_factory=dict)
    #: The tasks that were cancelled and have not ended.
    aborted: set[asyncio.Task[None]] = field(default_factory=set)

    def abort(self, t: int) -> None:
        """Cancels a task. Its result is not used."""
        task = self.in_flight.pop(t, None)
        if task is not None:
            self.aborted.add(task)
            task.add_done_callback(self.aborted.discard)
            task.cancel()


async def value_of(returned: Any) -> Any:
    """Returns local's result."""
    value = await returned
    check_value(value, "local", "give an async def, which awaits it")
    return value


async def response_of(cloud: RegisteredCloud, returned: Any) -> Any:
    """Returns the result that the response handler makes of a handle's response."""
    check_awaitable(returned, "the handle")
    response = await returned
    check_value(response, "the handle", "await it there")
    value = cloud.response_handler(response)
    if is_awaitable(value):
        return await awaited_value(value)
    check_value(value, "the response handler", "await it there")
    return value


async def awaited_value(value: Awaitable[Any]) -> Any:
    """Returns the result of a response handler's awaitable."""
    awaited = await value
    check_value(awaited, "the response handler", "await it there")
    return awaited
