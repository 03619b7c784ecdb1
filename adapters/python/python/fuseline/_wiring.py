"""Whether what an operator is made of fits where it is given; before the drive, if it shows."""

from __future__ import annotations

import inspect
from types import GeneratorType
from typing import Any

from fuseline._errors import ConfigError
from fuseline.deadline import Policy, needs_linger


class WiringError(ConfigError):
    """A mistake in what an operator is made of that shows only in a call."""


def check_function(function: Any, what: str) -> None:
    """A plain function, or what can be called like one.

    Raises:
        ConfigError: if it cannot be called, is a class, or is an ``async def``.
    """
    _check_callable(function, what)
    if is_async(function):
        raise ConfigError(f"{what} is a plain function, not an async def: it runs at one instant")


def check_handle(handle: Any) -> None:
    """An ``async def``, or what may return an awaitable.

    Raises:
        ConfigError: if it cannot be called, is a class or a generator, or is not async.
    """
    _check_callable(handle, "a handle")
    if inspect.isasyncgenfunction(handle) or inspect.isgeneratorfunction(handle):
        raise ConfigError("a handle is an async def that returns its response, and yields nothing")
    function = inspect.unwrap(getattr(handle, "__func__", handle))
    is_named = inspect.isfunction(function) and function.__name__ != "<lambda>"
    if is_named and not is_async(handle):
        raise ConfigError(
            f"the handle {function.__qualname__} is not async: make it an async def; if it blocks, "
            "let it await asyncio.to_thread"
        )


def check_awaitable(returned: Any, what: str) -> None:
    """What a handle returned when it was called, to be awaited.

    Raises:
        WiringError: if it is no awaitable, as of a lambda that returns a value.
    """
    if not is_awaitable(returned):
        kind = type(returned).__name__
        raise WiringError(f"{what} returned {kind}, which cannot be awaited: make it an async def")


def check_value(value: Any, what: str, remedy: str) -> None:
    """A value that is sent on, such as a response.

    Raises:
        WiringError: if it is an awaitable that nobody would await.
    """
    kind = type(value)
    if not hasattr(kind, "__await__") and kind is not GeneratorType:
        return
    if is_awaitable(value):
        if inspect.iscoroutine(value):
            value.close()
        raise WiringError(f"{what} gave an awaitable for a value: {remedy}")


def check_response_handler(handler: Any) -> None:
    """Anything that can be called; a class makes the output of the response."""
    if not callable(handler):
        raise ConfigError(f"a response handler is a function, not {handler!r}")


def check_priority(priority: Any, others: list[int]) -> None:
    """A whole number of its own.

    Raises:
        ConfigError: if it is none, out of range, or another cloud's.
    """
    if isinstance(priority, bool) or not isinstance(priority, int):
        raise ConfigError(f"a priority of {priority!r}; it is an int from 1 to 65535")
    if not 1 <= priority <= 65535:
        raise ConfigError(f"a priority of {priority}; clouds have 1 to 65535, and local has 0")
    if priority in others:
        raise ConfigError(f"two clouds of priority {priority}; each has one of its own")


def check_count(count: Any, least: int, what: str) -> None:
    """A whole number of at least this."""
    if isinstance(count, bool) or not isinstance(count, int) or count < least:
        raise ConfigError(f"{what} of {count!r}; it is an int of at least {least}")


def check_policy(policy: Any) -> None:
    """An object with the methods of a policy, or a plain function.

    Raises:
        ConfigError: if it is a class, neither of both, or lacks a method.
    """
    if inspect.isclass(policy):
        raise ConfigError(f"the class {policy.__name__} for a policy; give an instance")
    has = [callable(getattr(policy, method, None)) for method in ("decide", "ended")]
    if any(has) and not all(has):
        raise ConfigError(f"the policy {policy!r} needs both methods, decide and ended")
    if not any(has):
        check_function(policy, "a policy")


def check_linger(policy: Policy, linger: int, name: str) -> None:
    """A policy that would learn nothing of longer deadlines.

    Raises:
        ConfigError: if it does not probe, and calls do not linger.
    """
    if not linger and needs_linger(policy):
        raise ConfigError(
            f"the policy of {name} does not probe, and its calls do not linger, so that it would "
            "never wait for a cloud again that was gone; give it probe_every, or the cloud a linger"
        )


def is_awaitable(value: Any) -> bool:
    """Whether it can be awaited. As `inspect.isawaitable`, which takes several times as long."""
    kind = type(value)
    if kind is GeneratorType:
        return inspect.isawaitable(value)
    return hasattr(kind, "__await__")


def is_async(function: Any) -> bool:
    """Whether it is an ``async def``, or an object, not its class, that is called like one."""
    called = None if inspect.isclass(function) else getattr(function, "__call__", None)  # noqa: B004
    return inspect.iscoroutinefunction(function) or inspect.iscoroutinefunction(called)


def _check_callable(function: Any, what: str) -> None:
    if inspect.isclass(function):
        raise ConfigError(f"the class {function.__name__} for {what}; give an instance")
    if not callable(function):
        raise ConfigError(f"{what} is a function, not {function!r}")
