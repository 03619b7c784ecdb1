"""Lists the arguments that operators and local accept and refuse, for `test_arguments`."""

from __future__ import annotations

import asyncio
import functools
import io
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from typing import Any

from fuseline import (
    BlockingOperator,
    Call,
    CarriedState,
    ConfigError,
    Local,
    Operator,
    TimeError,
    ns,
)
from fuseline.deadline import Constant, Expected, Guard

#: A value that is refused, the error, and words of its message.
Bad = list[tuple[Any, type[Exception], str]]
DRIVE = "cicv5g/rural_n8_v10"
TRACE = b'{"fuseline":1,"window":16,"clouds":[{"p":1,"limit":9,"name":"west"}]}\n'


async def echo(request: Any, call: Any) -> Any:
    return request


async def respond(response: Any) -> Any:
    return response


async def yields(request: Any, call: Call) -> AsyncIterator[Any]:
    yield request


def plain(message: Any, t: int) -> Any:
    return message


def many(message: Any, t: int) -> Any:
    yield message


class AsyncObject:
    """Has instances that are called like an ``async def``."""

    async def __call__(self, message: Any, t: int) -> Any:
        return message


class PlainObject:
    def __call__(self, message: Any, t: int) -> Any:
        return message


class UnlearningPolicy:
    def decide(self, situation: Any, cap: Any) -> Any: ...


class UndecidedPolicy:
    def ended(self, end: Any, age: Any) -> None: ...


class SilentSubscriber:
    def registerCallback(self, callback: Any, *arguments: Any) -> Any:  # noqa: N802
        pass


def count(what: str, least: int = 1) -> Bad:
    message = f"{what} of {{!r}}; it must be an int of at least {least}"
    values = (least - 1, True, 1.5, "3", None)
    return [(it, ConfigError, message.format(it)) for it in values]


def function(what: str) -> Bad:
    asynchronous = f"{what} must be a plain function, not an async def"
    return [
        (7, ConfigError, f"{what} must be a function, not 7"),
        (Call, ConfigError, f"the class Call for {what}; give an instance"),
        (echo, ConfigError, asynchronous),
        (AsyncObject(), ConfigError, asynchronous),
    ]


DURATION: Bad = [
    (3, TypeError, "a duration of 3: write 3.0 for seconds, or ns(3) for nanoseconds"),
    (-0.5, TimeError, "it must be 0 or more"),
    ("3", TypeError, "seconds as a float"),
]
HANDLE: Bad = [
    (7, ConfigError, "a handle must be a function, not 7"),
    (Call, ConfigError, "the class Call for a handle; give an instance"),
    (plain, ConfigError, "the handle plain is not async: make it an async def"),
    (many, ConfigError, "yields nothing"),
    (yields, ConfigError, "yields nothing"),
]
RESERVE: Bad = [
    (7, ConfigError, "a reserve of 7; it must be a list of Latency"),
    ([7], ConfigError, "a reserve of [7]"),
    ("half a second", ConfigError, "it must be a list of Latency"),
]
NAME: Bad = [
    ("", ConfigError, "a name must be a str that is not empty"),
    (7, ConfigError, "named 7"),
    ("local", ConfigError, "which is the name of the computation on board"),
    ("w\udc80st", ConfigError, "not valid text"),
]
RESPONSE_HANDLER: Bad = [(7, ConfigError, "a response handler must be a function, not 7")]
SKIPPED = "skip is 'executed' or 'none', not 'all'"
PRIORITY = "a priority of {!r}; it must be an int from 1 to 65535"
RANGE = "a priority of {}; a cloud has 1 to 65535, and local has 0"


def but_none(bad: Bad) -> Bad:
    """Returns the bad values except None, for an argument for which None means the default."""
    return [it for it in bad if it[0] is not None]


@dataclass
class Arguments:
    """Holds the arguments that a call accepts, and those that it refuses."""

    #: Called with all arguments by name.
    call: Callable[..., Any]
    good: dict[str, Any] = field(default_factory=dict)
    bad: dict[str, Bad] = field(default_factory=dict)
    #: Further accepted values, at the bounds.
    taken: dict[str, list[Any]] = field(default_factory=dict)
    #: Arguments that are accepted as they are, or refused by the code that they are passed to.
    free: str = ""
    #: The function with the signature, if it is not the call.
    of: Callable[..., Any] | None = None


def operator(**of: Any) -> Operator[Any, Any]:
    return Operator(**{"local": plain, **of})


def started(**of: Any) -> None:
    """Starts an operator, because only the start can refuse some arguments."""

    async def main() -> None:
        made = operator(**of)
        await made.start()
        made.stop()

    asyncio.run(main())


def method(make: Callable[[], Any], name: str) -> Callable[..., Any]:
    return lambda **of: getattr(make(), name)(**of)


def clouded() -> Operator[Any, Any]:
    """Returns an operator with a cloud of priority 7."""
    made = operator()
    made.use_cloud(echo, plain, str, 7)
    return made


def linger(**of: Any) -> None:
    policy = Expected(lambda *_: 0.0, 0.1, probe_every=None)
    operator().use_cloud(echo, plain, str, 1, policy=Constant(0.5).cap(policy), **of)


LOCAL_OPTIONS = {"workers": 1, "deadline": 0.5, "waiting": 4, "skip_answered": True}
LOCAL_BAD: dict[str, Bad] = {
    "deadline": [(0.0, ConfigError, "local's deadline is 0"), *DURATION],
    "waiting": but_none(count("messages that wait for local", 0)),
}
LOCAL_TAKEN: dict[str, list[Any]] = {"deadline": [None, ns(1)], "waiting": [None, 0]}
WORKERS = {"workers": count("local computations at once")}
CLOUD = {"handle": echo, "message_handler": plain, "response_handler": str, "priority": 1}
OPERATOR_CASES: dict[str, Arguments] = {
    "Operator": Arguments(
        operator,
        {"local": plain},
        {
            "local": [
                (7, ConfigError, "must be a function, not 7"),
                (Call, ConfigError, "give an instance"),
                (AsyncObject, ConfigError, "give an instance"),
                (Local.task(echo, deadline=60.1), ConfigError, "deadline of 60.1 s is above the"),
            ],
            "output_len": count("an output_len"),
            "clock": function("a clock"),
            "lag_warning": DURATION,
            "greatest_deadline": [(0.9, ConfigError, "above the greatest"), *DURATION],
            "name": NAME,
            "window": [
                *count("a window"),
                (1025, ConfigError, "a window of 1025; it must be at most 1024"),
            ],
            "trace": [(it, ConfigError, "give the path") for it in (7, True, io.StringIO())],
            "reserve": RESERVE,
            "latency": [(7, ConfigError, "a latency is a Latency, not 7")],
        },
        {
            "local": [AsyncObject(), PlainObject(), Local.task(echo, deadline=60.0)],
            "output_len": [1],
            "greatest_deadline": [1.0],
            "window": [1, 1024],
            "copy_messages": [False],
        },
        free="commit carry_messages copy_messages",
        of=Operator,
    ),
    "Operator.start": Arguments(
        started,
        {"local": plain},
        {
            "commit": [("never", ConfigError, "it must be eager, patient or progressive")],
        },
        {"commit": ["eager", "patient", "progressive"]},
        free="local name window output_len trace clock lag_warning greatest_deadline reserve "
        "latency carry_messages copy_messages",
        of=Operator,
    ),
    "Operator.use_cloud": Arguments(
        method(clouded, "use_cloud"),
        CLOUD,
        {
            "handle": HANDLE,
            "message_handler": function("a message handler"),
            "response_handler": RESPONSE_HANDLER,
            "priority": [
                *((it, ConfigError, PRIORITY.format(it)) for it in (True, 1.0, "1", None)),
                *((it, ConfigError, RANGE.format(it)) for it in (0, -1, 65536)),
                (7, ConfigError, "two clouds have the priority 7; give each its own"),
            ],
            "encode": but_none(function("encode")),
            "calls": count("calls at once"),
            "policy": [
                (Guard, ConfigError, "the class Guard for a policy; give an instance"),
                (UnlearningPolicy(), ConfigError, "needs both methods, decide and ended"),
                (UndecidedPolicy(), ConfigError, "needs both methods, decide and ended"),
                (7, ConfigError, "a policy must be a function, not 7"),
                (echo, ConfigError, "a policy must be a plain function, not an async def"),
                (Expected(lambda *_: 0.0, 0.1, None), ConfigError, "the policy of cloud-1 neither"),
            ],
            "linger": DURATION,
            "max_age": count("a max_age", 0),
        },
        {
            "handle": [AsyncObject(), PlainObject(), functools.partial(echo), lambda r, c: echo],
            "response_handler": [respond, list],
            "priority": [1, 65535],
            "calls": [1],
            "max_age": [0],
            "policy": [None, Guard(), plain, Guard().cap(Constant(0.5))],
            "limit": [None, 1],
            "encode": [None, plain],
        },
        free="name limit resume",
        of=Operator.use_cloud,
    ),
    "Operator.use_cloud, a policy without probes": Arguments(
        linger,
        {"linger": 0.1},
        {"linger": [(0.0, ConfigError, "neither probes nor sees lingering calls")]},
        free="handle message_handler response_handler priority encode name limit resume calls "
        "policy max_age",
        of=Operator.use_cloud,
    ),
    "Operator.use_situation": Arguments(
        method(operator, "use_situation"),
        {"situation": plain},
        {"situation": function("a situation's handler")},
        of=Operator.use_situation,
    ),
    "Operator.use_substitute": Arguments(
        method(operator, "use_substitute"),
        {"substitute": lambda item: None},
        {"substitute": function("a substitute's handler")},
        of=Operator.use_substitute,
    ),
    "Operator.use_state": Arguments(
        method(operator, "use_state"),
        {"state": CarriedState(None), "state_of": plain},
        {
            "state": [(7, ConfigError, "a state is a CarriedState, not 7")],
            "state_of": function("state_of"),
        },
        of=Operator.use_state,
    ),
    "Operator.use_side_request": Arguments(
        method(operator, "use_side_request"),
        {"handle": echo, "message_handler": plain, "response_handler": str},
        {
            "handle": HANDLE,
            "message_handler": function("a message handler"),
            "response_handler": RESPONSE_HANDLER,
            "limit": count("a limit"),
            "resume": [*count("a resume", 0), (8, ConfigError, "a limit of 8 with a resume of 8")],
            "calls": count("calls at once"),
        },
        {"limit": [1], "resume": [0, 7], "calls": [1]},
        free="name",
        of=Operator.use_side_request,
    ),
    "Local.task": Arguments(
        Local.task,
        {"compute": echo, "at_once": 2, "deadline": 0.5, "waiting": 4, "may_lose_results": True},
        {
            "compute": [
                (it, ConfigError, "takes an async function; give a plain one to Local.threads")
                for it in (plain, PlainObject(), 7)
            ],
            "at_once": count("local computations at once"),
            **LOCAL_BAD,
            "may_lose_results": [],
        },
        {"compute": [AsyncObject()], "at_once": [1], "deadline": [ns(1)], "waiting": [None, 0]},
        free="skip_answered",
    ),
    "Local.task, may_lose_results": Arguments(
        lambda deadline: Local.task(echo, deadline=deadline, may_lose_results=True),
        {"deadline": 0.5},
        {"deadline": [(None, ConfigError, "needs a deadline, so that a loss is noticed")]},
    ),
    "Local.threads": Arguments(
        Local.threads,
        {"compute": plain, **LOCAL_OPTIONS},
        {
            "compute": [
                (echo, ConfigError, "Local.threads takes a plain function; give an async one to"),
                (7, ConfigError, "compute of Local.threads must be a function, not 7"),
                (Call, ConfigError, "the class Call for compute of Local.threads"),
            ],
            **WORKERS,
            **LOCAL_BAD,
        },
        LOCAL_TAKEN,
        free="skip_answered",
    ),
    "Local.threads_of": Arguments(
        Local.threads_of,
        {"make": lambda: plain, **LOCAL_OPTIONS, "replaceable": 1},
        {
            "make": function("make"),
            **WORKERS,
            **LOCAL_BAD,
            "replaceable": but_none(count("computations that may be replaced", 0)),
        },
        {**LOCAL_TAKEN, "replaceable": [None, 0]},
        free="skip_answered",
    ),
    "Local.processes": Arguments(
        Local.processes,
        {"compute": plain, **LOCAL_OPTIONS},
        {
            "compute": [
                (echo, ConfigError, "Local.processes takes a plain function; give an async one"),
                (7, ConfigError, "compute of Local.processes must be a function, not 7"),
                (Call, ConfigError, "the class Call for compute of Local.processes"),
            ],
            **WORKERS,
            **LOCAL_BAD,
        },
        LOCAL_TAKEN,
        free="skip_answered",
    ),
    "BlockingOperator": Arguments(
        BlockingOperator,
        {"operator": operator()},
        {"operator": [(plain, ConfigError, "a BlockingOperator runs an Operator, not <function")]},
    ),
}
