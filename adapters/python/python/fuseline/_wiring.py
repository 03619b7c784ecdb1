"""Checks that the parts of an operator fit where they are given, before it starts if possible."""

from __future__ import annotations

import inspect
import os
import unicodedata
from collections.abc import AsyncIterable, Iterable, Mapping
from concurrent.futures import Future
from datetime import timedelta
from types import AsyncGeneratorType, CoroutineType, GeneratorType
from typing import Any, TypeVar

from fuseline._errors import ConfigError, as_text
from fuseline._fuseline import Latency
from fuseline._validation import Commit, ns
from fuseline.deadline import Policy, learners

Made = TypeVar("Made", bound=type)


class WiringError(ConfigError):
    """Reports a mistake in an operator's parts that shows only in a call."""


def check_function(function: Any, what: str) -> None:
    """Refuses a value that is not a plain function and cannot be called like one.

    Raises:
        ConfigError: if it cannot be called, is a class, yields, or is an ``async def``.
    """
    _check_callable(function, what)
    if inspect.isgeneratorfunction(function) or inspect.isasyncgenfunction(function):
        raise ConfigError(f"{what} must be a function that returns; this one yields")
    if is_async(function):
        raise ConfigError(
            f"{what} must be a plain function, not an async def: it runs at one instant"
        )


def check_handle(handle: Any) -> None:
    """Refuses a handle that is not an ``async def`` and cannot return an awaitable.

    Raises:
        ConfigError: if it cannot be called, is a class or a generator, or is not async.
    """
    _check_callable(handle, "a handle")
    if inspect.isasyncgenfunction(handle) or inspect.isgeneratorfunction(handle):
        raise ConfigError(
            "a handle must be an async def that returns its response, and yields nothing"
        )
    function = inspect.unwrap(getattr(handle, "__func__", handle))
    is_named = inspect.isfunction(function) and function.__name__ != "<lambda>"
    # A plain decorator of an async function returns that function's awaitable.
    if is_named and not is_async(handle) and not is_async(function):
        raise ConfigError(
            f"the handle {function.__qualname__} is not async: make it an async def; if it blocks, "
            "let it await asyncio.to_thread"
        )


def check_takes(function: Any, what: str, *arguments: str) -> None:
    """Refuses a function whose signature does not accept these arguments.

    Raises:
        ConfigError: if the signature does not accept them.
    """
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        # Some functions that are not written in Python have no signature.
        return
    try:
        signature.bind(*arguments)
    except TypeError as error:
        raise ConfigError(f"{what} is called with ({', '.join(arguments)}): {error}") from error


def check_awaitable(returned: Any, what: str) -> None:
    """Refuses a handle's return value if it cannot be awaited.

    Raises:
        WiringError: if it is not an awaitable, for example because a lambda returned a value.
    """
    if not is_awaitable(returned):
        kind = type(returned).__name__
        raise WiringError(f"{what} returned {kind}, which cannot be awaited: make it an async def")


def check_value(value: Any, what: str, remedy: str) -> None:
    """Refuses a value that cannot be passed on, such as an awaitable in place of a response.

    Raises:
        WiringError: if it is an awaitable, which nobody would await, or a generator.
    """
    kind = type(value)
    is_generator = kind is GeneratorType or kind is AsyncGeneratorType
    if not hasattr(kind, "__await__") and not is_generator:
        return
    if is_awaitable(value):
        if inspect.iscoroutine(value):
            value.close()
        raise WiringError(f"{what} returned an awaitable instead of a value: {remedy}")
    if is_generator:
        raise WiringError(
            f"{what} returned a generator instead of a value: return the value, and do not yield"
        )


def no_value(what: str) -> WiringError:
    """Returns the error for None as a value. Nearly always a ``return`` is missing."""
    return WiringError(
        f"{what} returned None, which is not a value: add the return, or return an empty value "
        "that is not None"
    )


def check_read(value: Any, what: str) -> None:
    """Refuses a plain handler's return value if it is not a value.

    Raises:
        WiringError: if it is None, an awaitable or a generator.
    """
    check_value(value, what, "make it a plain function")
    if value is None:
        raise no_value(what)


def check_response_handler(handler: Any) -> None:
    """Refuses a handler that cannot be called. A class may make the output."""
    if not callable(handler):
        raise ConfigError(f"a response handler must be a function, not {handler!r}")


def check_priority(priority: Any, others: list[int]) -> None:
    """Refuses an invalid priority, or another cloud's.

    Raises:
        ConfigError: if it is not an int, out of range, or another cloud's.
    """
    if isinstance(priority, bool) or not isinstance(priority, int):
        raise ConfigError(f"a priority of {priority!r}; it must be an int from 1 to 65535")
    if not 1 <= priority <= 65535:
        raise ConfigError(f"a priority of {priority}; a cloud has 1 to 65535, and local has 0")
    if priority in others:
        raise ConfigError(f"two clouds have the priority {priority}; give each its own")


def check_count(count: Any, least: int, what: str) -> None:
    """Refuses a value that is not a whole number of at least ``least``."""
    if isinstance(count, bool) or not isinstance(count, int) or count < least:
        raise ConfigError(f"{what} of {count!r}; it must be an int of at least {least}")


def check_range(count: Any, least: int, most: int, what: str) -> None:
    """Refuses a value that is not a whole number from ``least`` to ``most``."""
    check_count(count, least, what)
    if count > most:
        raise ConfigError(f"{what} of {count}; it must be at most {most}")


def check_name(name: Any, what: str, others: Iterable[str] = ()) -> None:
    """Refuses a name that would make counts, logs and traces unreadable.

    Raises:
        ConfigError: if it is not text, empty, or already used.
    """
    check_text(name, what)
    if name == "local":
        raise ConfigError(
            f"{what} named 'local', which is the name of the computation on board; give another "
            "name"
        )
    if name in others:
        raise ConfigError(
            f"{what} named {name!r}, as another one is; counts and logs could not tell them apart: "
            "give another name"
        )


def check_text(name: Any, what: str) -> None:
    """Refuses a name that logs cannot show in one line.

    Raises:
        ConfigError: if it is not text, empty, or has a line break or another control character.
    """
    if not isinstance(name, str) or not name:
        raise ConfigError(f"{what} named {name!r}; a name must be a str that is not empty")
    if name != as_text(name):
        raise ConfigError(f"{what} named {name!r}, which is not valid text; give another name")
    if any(unicodedata.category(it) in ("Cc", "Zl", "Zp") for it in name):
        raise ConfigError(
            f"{what} named {name!r}, with a line break or another control character: logs show a "
            "name in one line, so give another name"
        )


def check_commit(commit: Any) -> None:
    """Refuses a value that is not the name of a commit rule.

    Raises:
        ConfigError: if there is no such rule.
    """
    words = [str(it) for it in Commit]
    if commit not in words:
        raise ConfigError(
            f"a commit rule {commit!r}; it must be {', '.join(words[:-1])} or {words[-1]}"
        )


def check_message(message: Any) -> None:
    """Refuses a coroutine or a generator in place of a message.

    Raises:
        ConfigError: if it is a coroutine or a generator.
    """
    if type(message) is CoroutineType:
        message.close()
        raise ConfigError("a coroutine for a message; await it, and write what it returns")
    if type(message) in (GeneratorType, AsyncGeneratorType):
        raise ConfigError("a generator for a message; feed it, or write what it yields")


def check_result(value: Any) -> None:
    """Refuses a value that stands for the lack of a result.

    Raises:
        WiringError: if it is a future that nobody waits for.
        Exception: the exception that was returned in place of a result.
    """
    if isinstance(value, BaseException):
        raise value if isinstance(value, Exception) else RuntimeError(repr(value))
    if value is NotImplemented:
        raise WiringError("NotImplemented for a value: raise NotImplementedError")
    if isinstance(value, Future):
        raise WiringError("a concurrent Future for a value: await asyncio.wrap_future(future)")


def check_clock(clock: Any) -> None:
    """Refuses a clock that does not read whole nanoseconds.

    Raises:
        ConfigError: if it is not a clock, or reads something else, such as seconds as a float.
    """
    check_function(clock, "a clock")
    try:
        now = clock()
    except Exception as error:
        raise ConfigError(f"the clock raised {error!r}; give time.monotonic_ns") from error
    if isinstance(now, bool) or not hasattr(now, "__index__") or not 0 <= now < 2**64:
        raise ConfigError(
            f"the clock read {now!r}; it must read whole nanoseconds from 0, as time.monotonic_ns "
            "does"
        )


def check_trace(path: Any) -> None:
    """Refuses a value that is not the path of a file.

    Raises:
        ConfigError: if it is not a path, for example an open file.
    """
    if path is not None and not isinstance(path, (str, bytes, os.PathLike)):
        raise ConfigError(f"a trace of {path!r}; give the path of the file to write")


def check_reserve(reserve: Any) -> None:
    """Refuses a value that is not a list of `Latency`.

    Raises:
        ConfigError: if it is not such a list.
    """
    is_list = isinstance(reserve, Iterable) and not isinstance(reserve, (str, bytes))
    if not is_list or not all(isinstance(it, Latency) for it in reserve):
        raise ConfigError(
            f"a reserve of {reserve!r}; it must be a list of Latency, such as "
            "[Latency.stated(0.05)]"
        )


def check_messages(messages: Any) -> None:
    """Refuses a value that is not a stream of messages.

    Raises:
        ConfigError: if it is not a stream, or is most likely one message, such as a text or a
            dictionary.
    """
    if isinstance(messages, (str, bytes, bytearray, memoryview, Mapping)):
        kind = type(messages).__name__
        raise ConfigError(
            f"a {kind} for messages, which would be fed part by part; give an iterable of "
            "messages, such as a list with it or a reader of the file that it names"
        )
    if not isinstance(messages, (AsyncIterable, Iterable)) and not hasattr(messages, "__getitem__"):
        if inspect.iscoroutine(messages):
            messages.close()
        remedy = "; call the function" if callable(messages) else ""
        raise ConfigError(f"messages are an iterable, plain or async, not {messages!r}{remedy}")


def check_timeout(timeout: Any) -> float | None:
    """Returns the time to wait in seconds, or None to wait forever.

    Raises:
        TypeError: if it is not a duration.
    """
    if timeout is None:
        return None
    if isinstance(timeout, ns):
        return timeout / 1e9
    if isinstance(timeout, timedelta):
        return timeout.total_seconds()
    if isinstance(timeout, bool) or not hasattr(timeout, "__float__") or timeout != timeout:
        raise TypeError(
            f"a timeout of {timeout!r}; it must be seconds as a number, a timedelta, or None"
        )
    return float(timeout)


def check_policy(policy: Any) -> None:
    """Refuses a value that is neither an object with a policy's methods nor a plain function.

    Raises:
        ConfigError: if it is a class, is neither of these, or lacks a method.
    """
    if inspect.isclass(policy):
        raise ConfigError(f"the class {policy.__name__} for a policy; give an instance")
    has = [callable(getattr(policy, method, None)) for method in ("decide", "ended")]
    if any(has) and not all(has):
        raise ConfigError(f"the policy {policy!r} needs both methods, decide and ended")
    if not any(has):
        check_function(policy, "a policy")


def check_own_policy(policy: Policy, others: Iterable[Policy | None], name: str) -> None:
    """Refuses a policy that would learn from two clouds as if they were one.

    Raises:
        ConfigError: if another cloud shares the policy or a part of it.
    """
    own = learners(policy)
    if any(a is b for other in others if other is not None for b in learners(other) for a in own):
        raise ConfigError(
            f"the policy of {name} is also another cloud's, and would treat both clouds as one; "
            "make one for each cloud"
        )


def is_awaitable(value: Any) -> bool:
    """Returns True if a value can be awaited, in a fraction of `inspect.isawaitable`'s time."""
    kind = type(value)
    if kind is GeneratorType:
        return inspect.isawaitable(value)
    return hasattr(kind, "__await__")


def is_async(function: Any) -> bool:
    """Returns True for an ``async def``, or an object that is called like one."""
    called = None if inspect.isclass(function) else getattr(function, "__call__", None)  # noqa: B004
    return inspect.iscoroutinefunction(function) or inspect.iscoroutinefunction(called)


def _check_callable(function: Any, what: str) -> None:
    if inspect.isclass(function):
        raise ConfigError(f"the class {function.__name__} for {what}; give an instance")
    if not callable(function):
        raise ConfigError(f"{what} must be a function, not {function!r}")


class ConstructorArgument:
    """Refuses to set an argument of the constructor afterwards, which would have no effect."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __get__(self, instance: object, owner: type) -> ConstructorArgument:
        if instance is None:
            return self
        raise AttributeError(f"{owner.__name__!r} object has no attribute {self.name!r}")

    def __set__(self, instance: object, value: object) -> None:
        kind = type(instance).__name__
        raise AttributeError(
            f"{self.name} is given when the {kind} is made; to set it later has no effect"
        )


def fix_arguments(kind: Made) -> Made:
    """Makes the constructor's arguments `ConstructorArgument`s, except for attributes."""
    for name in list(inspect.signature(kind).parameters):
        if not hasattr(kind, name) and name != "name":
            setattr(kind, name, ConstructorArgument(name))
    return kind
