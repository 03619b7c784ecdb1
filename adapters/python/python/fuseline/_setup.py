"""Registers the parts of an operator before it starts."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from fuseline._drive import Driver
from fuseline._errors import ConfigError
from fuseline._fuseline import Gate, check_linger, nanoseconds
from fuseline._item import Call, Item, StampedValue
from fuseline._side import SideRequest
from fuseline._sources import OutputHandlers, RegisteredCloud
from fuseline._state import CarriedState
from fuseline._validation import Cloud, ns
from fuseline._wiring import (
    check_count,
    check_function,
    check_handle,
    check_name,
    check_own_policy,
    check_policy,
    check_priority,
    check_response_handler,
    check_takes,
)
from fuseline.deadline import Policy, Situation, compiled, policy_of

if TYPE_CHECKING:
    from fuseline._judge import Duration

M = TypeVar("M")
V = TypeVar("V")
S = TypeVar("S")
Req = TypeVar("Req")
Res = TypeVar("Res")


class Setup(Generic[M, V]):
    """Registers the clouds, substitutes, states and side requests of an `Operator`."""

    name: str
    _driver: Driver[M, V] | None

    def __init__(self, handlers: OutputHandlers) -> None:
        self._handlers = handlers
        self._clouds: list[RegisteredCloud] = []
        self._situation: Callable[[M, int], Situation] | None = None

    def use_cloud(
        self,
        handle: Callable[[Req, Call], Awaitable[Res]],
        message_handler: Callable[[M, int], tuple[Req, Duration] | None],
        response_handler: Callable[[Res], V | StampedValue[V]]
        | Callable[[Res], Awaitable[V | StampedValue[V]]],
        priority: int,
        *,
        encode: Callable[[Any], Req] | None = None,
        name: str | None = None,
        limit: int | None = None,
        resume: int = 0,
        calls: int = 8,
        policy: Policy | Callable[[Situation, ns], Duration] | None = None,
        linger: Duration = 0.0,
        max_age: int = 0,
    ) -> None:
        """Registers a cloud; up to 15, before the operator starts.

        Durations are seconds as a float, a timedelta, or nanoseconds as `fuseline.ns`.

        Args:
            handle: Makes the call: an ``async def`` of a request and its `Call`. It runs in a task
                on the loop, which it must not block. It is cancelled when its timer fires or a
                better result is sent (F5, F7). An exception is a failure (F4).
            message_handler: Gets each accepted message and its timestamp. It returns the request
                and the time that the cloud may take, or None to make no request. It must not block,
                and cannot be an ``async def``. If it raises, no request is made.
            response_handler: Turns the response into the result, in the call's task. It may be an
                ``async def``. The result arrives when the handler returns. If the response names
                the message that it was computed from, the handler returns a `StampedValue`.
            encode: Turns the message handler's request into the handle's request, in a thread, such
                as an image into JPEG. Clouds share one encoding if their message handlers return
                the same object and they have the same ``encode``.
            priority: The cloud's rank, 1 to 65535, different for each cloud. The greater one wins.
            name: The cloud's own name in counts and traces; ``cloud-`` and the priority by default.
            limit: The number of waiting requests at which the gate shuts (F2g); ``calls`` by
                default (A15).
            resume: The number of waiting requests at or below which the gate opens again.
            calls: The greatest number of calls under way. Further requests wait.
            policy: Chooses each request's deadline, at most the message handler's, and learns how
                each request ended: see `fuseline.deadline`. Each cloud needs a policy of its own. A
                plain function of a `Situation` and that greatest deadline also works.
            linger: The time that a call may continue after its due instant, so that the policy
                learns how long it really takes. Its result is still dropped (F3).
            max_age: The number of messages by which a `StampedValue` may be older than its message.
                An older value, or a value of a later message, is a failure (F4).

        Raises:
            ConfigError: if the operator has started, or an argument is of the wrong kind or out of
                its range. Examples are a class instead of an instance, and a handle that is not
                async.

        >>> from fuseline import Operator
        >>> async def west(frame, call):
        ...     return {"boxes": frame}
        >>> operator = Operator(lambda frame, t: frame)
        >>> send = lambda frame, t: (frame, 0.1)  # the request, and how many seconds it may take
        >>> operator.use_cloud(west, send, lambda answer: answer["boxes"], 1, name="west")
        >>> operator
        <Operator 'operator' clouds=['west'] not started, 0 messages>
        """
        self._check_not_started("a cloud")
        check_handle(handle)
        check_function(message_handler, "a message handler")
        check_response_handler(response_handler)
        check_takes(handle, "a handle", "request", "call")
        check_takes(message_handler, "a message handler", "message", "timestamp")
        check_takes(response_handler, "a response handler", "response")
        check_priority(priority, [it.cloud.p for it in self._clouds])
        name = f"cloud-{priority}" if name is None else name
        check_name(name, "a cloud", self._names())
        check_count(calls, 1, "calls at once")
        limit = calls if limit is None else limit
        check_count(limit, 1, "a limit")
        check_count(resume, 0, "a resume")
        check_count(max_age, 0, "a max_age")
        if encode is not None:
            check_function(encode, "encode")
        if policy is not None:
            check_policy(policy)
            policy = policy_of(policy)
            check_own_policy(policy, [it.policy for it in self._clouds], name)
            check_linger(name, compiled(policy), nanoseconds(linger))
        cloud = Cloud(priority, limit, resume, name)
        self._clouds.append(
            RegisteredCloud(
                cloud,
                handle,
                message_handler,
                response_handler,
                encode,
                calls,
                nanoseconds(linger),
                policy,
                max_age,
            )
        )

    def use_situation(self, situation: Callable[[M, int], Situation]) -> None:
        """Sets the function that gives policies the vehicle's situation, above all its speed.

        It is called with each message that is written and its timestamp, and returns a
        `fuseline.deadline.Situation`. If it raises, or if no function is set, policies know
        nothing, and the guard takes no risk.

        Raises:
            ConfigError: if it is not a plain function.
        """
        check_function(situation, "a situation's handler")
        self._situation = situation

    def use_substitute(self, substitute: Callable[[Item[V]], V | None]) -> None:
        """Sets the function that returns a value for a message that is missed or refused (E4).

        The value may be the last plan, or a stop. The item has it as its value and as its
        ``substitute``. The ending and the trace do not change. A message with an end-to-end
        deadline is then missed early enough to leave the ``reserve`` to the operators downstream.

        Args:
            substitute: Gets the item, and returns the value, or None to send the item without one.

        Raises:
            ConfigError: if the operator has started, or has a substitute already.
        """
        self._check_not_started("a substitute")
        check_function(substitute, "a substitute's handler")
        if self._handlers.substitute is not None:
            raise ConfigError(
                "the operator has a substitute already; register one handler for all messages"
            )
        self._handlers.substitute = substitute

    def use_state(self, state: CarriedState[S], state_of: Callable[[V], S]) -> None:
        """Takes over the state of each result that is sent, local's or a cloud's (E10).

        Args:
            state: The state that local reads with its next message.
            state_of: Reads the state from a result.

        Raises:
            ConfigError: if the operator has started, or ``state`` is no `CarriedState`.
        """
        self._check_not_started("a state")
        if not isinstance(state, CarriedState):
            raise ConfigError(f"a state is a CarriedState, not {state!r}")
        check_function(state_of, "state_of")
        self._handlers.states.append((state, state_of))

    def use_side_request(
        self,
        handle: Callable[[Req, Call], Awaitable[Res]],
        message_handler: Callable[[M, int], tuple[Req, Duration] | None],
        response_handler: Callable[[Res], None],
        *,
        name: str | None = None,
        limit: int = 8,
        resume: int = 0,
        calls: int = 8,
    ) -> None:
        """Registers side requests, whose answers help local with later messages.

        An answer may be a plan for what may happen, for example. It never becomes an output, and no
        output waits for it. Requests are gated and bounded like a cloud's.

        Args:
            handle: Makes the call: an ``async def`` of a request and its `Call`.
            message_handler: Gets each accepted message, and returns the request and the time that
                it may take, or None to make no request.
            response_handler: Gets each answer that comes in time.
            name: The name in counts; ``side-`` and a number from 1 by default.
            limit: The number of waiting requests at which the gate shuts (F2g).
            resume: The number of waiting requests at or below which the gate opens again; less than
                ``limit``.
            calls: The greatest number of calls under way. Further requests wait.

        Raises:
            ConfigError: if the operator has started, or an argument is of the wrong kind.
        """
        self._check_not_started("a side request")
        check_handle(handle)
        check_function(message_handler, "a message handler")
        check_response_handler(response_handler)
        check_count(resume, 0, "a resume")
        check_count(limit, 1, "a limit")
        check_count(calls, 1, "calls at once")
        name = f"side-{len(self._handlers.sides) + 1}" if name is None else name
        check_name(name, "a side request", self._names())
        self._handlers.sides.append(
            SideRequest(name, handle, message_handler, response_handler, Gate(limit, resume), calls)
        )

    def _check_not_started(self, what: str) -> None:
        if self._driver is not None:
            raise ConfigError(f"{what} was registered after the start; register it before")

    def _names(self) -> list[str]:
        """Returns the names that counts already use."""
        sides = [side.name for side in self._handlers.sides]
        return [self.name, *sides, *(it.cloud.name or "" for it in self._clouds)]
