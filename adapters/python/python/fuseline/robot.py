"""Gives a robot an action at each tick, whatever the network and the server do.

`Always` replaces a policy: `infer` returns the remote policy's action if it comes by the deadline,
and otherwise an action from on board. It has the methods of openpi's ``BasePolicy``. `openpi` and
`lerobot` connect to the policy servers of these projects.
"""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import os
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias

from fuseline._actions import ArrayKinds, Form, check_form, form_of
from fuseline._blocking import BlockingOperator
from fuseline._chunks import Blend, ChunkPlan, actions_of, fade
from fuseline._counts import Counts
from fuseline._errors import CallError, ConfigError, in_one_line
from fuseline._failures import CALL_KEYS, PolicyFailures, TickRate
from fuseline._fuseline import nanoseconds
from fuseline._item import Call, Failure, Item, StampedValue
from fuseline._local import Local
from fuseline._operator import Operator
from fuseline._recording import GRACE
from fuseline._remote import RemotePolicy, RemoteThread, check_connects
from fuseline._servers import lerobot, openpi
from fuseline._snapshot import snapshot
from fuseline._validation import ns
from fuseline._wiring import check_function, check_takes, check_value, fix_arguments

if TYPE_CHECKING:
    from fuseline._judge import Duration

__all__ = ["Always", "Blend", "Chunk", "Hold", "RemotePolicy", "fade", "lerobot", "openpi"]

#: The number of messages that may be open at once.
WINDOW = 16
#: The longest time from a tick to the next, in seconds; more is a rate that was meant in hertz.
LONGEST_PERIOD = 2.0
#: The longest deadline of an operator, in seconds.
LONGEST_DEADLINE = 60.0


class OnBoardPolicy(Protocol):
    """A policy that computes on board."""

    def infer(self, obs: Any) -> Any:
        """Returns an action for an observation."""


@dataclass(frozen=True)
class Hold:
    """Repeats the last action on board."""

    #: The action to send before any other was sent.
    first: Any

    def __post_init__(self) -> None:
        if callable(self.first):
            raise ConfigError(
                f"Hold has {self.first!r}, which can be called; give a policy as on_board itself, "
                "without Hold"
            )
        try:
            form_of(self.first, "the held action")
        except CallError as error:
            raise ConfigError(f"{error}; give the first action that may be sent") from error


OnBoard: TypeAlias = Hold | OnBoardPolicy | Callable[[Any], Any]


@dataclass(frozen=True)
class Chunk:
    """Configures a remote policy that replies with the actions of several ticks."""

    #: The number of ticks from one request to the next, unless a request is under way.
    every: int
    #: The number of ticks after its observation for which an action may be sent.
    max_age: int
    #: Splits a reply into actions; by default the items of a list, or of arrays along their first
    #: dimension.
    split: Callable[[Any], Sequence[Any]] | None = None
    #: ``executed`` skips a chunk's actions for ticks that have passed, so each action is sent at
    #: the tick that it was computed for. With ``none`` a chunk begins with its first action when it
    #: comes.
    skip: Literal["executed", "none"] = "executed"
    #: Blends the first actions of a chunk with the previous ones: see `fade`.
    blend: Blend | None = None
    #: The time that a chunk may take before its call is ended and the connection replaced.
    within: Duration = 1.0


@fix_arguments
class Always:
    """Returns an action by its deadline at each tick, from the remote policy or from on board.

    One call is under way at a time. A call without a reply within ``deadline`` + ``linger`` is
    ended together with its connection, and the next call connects again. So no later call can read
    a late reply.

    A reply must have the form of an action from on board, with finite numbers. Otherwise the call
    has failed. If the policy on board has no action by the deadline, the last action is repeated.
    Each failure is counted in `counts` and passed to ``on_failure``.

    Args:
        remote: Connects to the remote policy, in a thread of its own: `openpi`, `lerobot`, or a
            function that returns a `RemotePolicy`.
        on_board: Returns an action if the remote policy does not: `Hold`, an object with ``infer``,
            or a function of the observation.
        deadline: The time that the remote policy and the policy on board may take; three quarters
            of the period by default.
        chunk: Configures the use of replies with the actions of several ticks. It then bounds the
            age of actions, and the deadline applies to actions of a chunk that has arrived.
        period: The time from one tick to the next, in seconds, not a rate in hertz.
        linger: The time that a call may continue after its deadline. Its reply then has no effect.
        trace: The file that the run is recorded to, for ``fuseline check``.
        name: The operator's name in logs and traces.
        on_failure: Called by `infer`, before it returns, with each `Failure` since the last tick,
            of the remote policy or of the policy on board. An exception that it raises is logged.

    Raises:
        ConfigError: if neither a deadline nor a period is given, or the deadline is above the
            period. Also if the period is longer than two seconds, or a chunk has no ticks.

    >>> class Server:
    ...     def infer(self, observation):
    ...         return {"actions": observation["t"]}
    ...     def close(self):
    ...         pass
    >>> with Always(Server, Hold({"actions": 0}), deadline=5.0) as policy:
    ...     policy.infer({"t": 7})
    {'actions': 7}
    """

    def __init__(
        self,
        remote: Callable[[], RemotePolicy],
        on_board: OnBoard,
        *,
        deadline: Duration | None = None,
        chunk: Chunk | None = None,
        period: Duration | None = None,
        linger: Duration = 1.0,
        trace: str | os.PathLike[str] | None = None,
        name: str = "policy",
        on_failure: Callable[[Failure], None] | None = None,
    ) -> None:
        check_connects(remote)
        if on_failure is not None:
            check_function(on_failure, "on_failure")
        self._deadline = _deadline_of(deadline, period)
        self._linger = nanoseconds(linger) / 1e9
        self._failures = PolicyFailures(name, on_failure)
        self._last: Any = on_board.first if isinstance(on_board, Hold) else None
        #: The form of an action on board, once that is known.
        self._like = _held_form(on_board)
        self._is_guessed = False
        self._kinds = ArrayKinds()
        if isinstance(on_board, Hold):
            self._kinds.learn(on_board.first)
        self._remote = RemoteThread(remote, self._read(chunk), name)
        #: The item of the last tick, with the source of its action.
        self.item: Item[Any] | None = None
        self._plan = (
            None
            if chunk is None
            else ChunkPlan(self._remote, chunk, self._failures.ended, self._check)
        )
        self._rate = None if period is None else TickRate(nanoseconds(period) / 1e9, name)
        self._turn = threading.Lock()
        #: The threads that this one waits for, or that wait for this one.
        self._inside: set[int] = set()
        operator: Operator[Any, Any] = Operator(
            self._local(on_board), name=name, window=WINDOW, trace=trace
        )
        operator.use_substitute(lambda _: snapshot(self._last))
        if self._plan is None:
            operator.use_cloud(
                self._call,
                self._offer,
                lambda action: action,
                1,
                name="remote",
                calls=1,
                linger=linger,
            )
        else:
            operator.use_cloud(
                self._planned,
                self._offer_planned,
                lambda action: action,
                1,
                name="remote",
                max_age=self._plan.chunk.max_age,
            )
        self._operator = BlockingOperator(operator).__enter__()
        self._is_closed = False

    def infer(self, obs: Any) -> Any:
        """Returns the action for an observation by the deadline.

        Several threads may call it; each tick waits for the one before.

        Raises:
            RuntimeError: if no action came by the deadline, and none was sent before that could be
                repeated. If a policy on board loads slowly, call it once before the first tick.
        """
        if threading.get_ident() in self._inside:
            raise RuntimeError("infer was called in the policy on board, or in on_failure")
        with self._turn:
            if self._is_closed:
                raise ConfigError("the policy was closed and does not run; make another")
            if self._rate is not None:
                gap = self._rate.tick(time.monotonic())
                if self._plan is not None:
                    self._plan.check_gap(gap)
            return self._tick(obs)

    def reset(self) -> None:
        """Forgets the actions of chunks, as at the start of an episode."""
        if self._plan is not None:
            self._plan.clear()

    @property
    def counts(self) -> Counter[tuple[str, str, str]]:
        """Returns the counts of the operator and of the calls so far.

        ``counts["remote", "call", "answered"]`` and ``"failed"`` count the calls to the remote
        policy, and ``counts["remote", "call failed because", why]`` has the last eight reasons.
        ``counts[name, "message", "missed"]`` counts the ticks for which nothing came.
        """
        of_operator = self._operator.operator.counts
        counts = Counts(of_operator + self._failures.counts, of_operator.known)
        counts.know(CALL_KEYS)
        return counts

    def close(self) -> None:
        """Ends the remote call and the trace. Later calls of it do nothing."""
        if self._is_closed:
            return
        self._is_closed = True
        if self._plan is not None:
            self._plan.close()
        self._remote.close()
        self._operator.__exit__(None, None, None)
        self._remote.wait(GRACE)

    def __enter__(self) -> Always:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        where: TracebackType | None,
    ) -> None:
        self.close()

    @contextlib.contextmanager
    def _within(self) -> Iterator[None]:
        """Marks code that must not wait for a tick."""
        self._inside.add(threading.get_ident())
        try:
            yield
        finally:
            self._inside.discard(threading.get_ident())

    def _tick(self, obs: Any) -> Any:
        t = self._operator.write(obs)
        while True:
            item = self._operator.read()
            if item is None:
                raise RuntimeError("the policy was closed")
            if item.timestamp == t:
                break
        self.item = item
        self._failures.of_item(item, self._deadline)
        with self._within():
            self._failures.report()
        if item.source is None and item.substitute is None:
            whys = [f"{it.source}: {it.why}" for it in item.failures if it.source.priority == 0]
            why = ", ".join(whys) or f"on board took longer than {self._deadline:g} s"
            raise RuntimeError(
                f"no action for tick {t}: {item.ending.name.lower()}; {why}; no action was sent "
                "before that could be held: call the policy on board once before, or give Hold"
            )
        # The caller may change the action.
        self._last = snapshot(item.value)
        return item.value

    def _local(self, on_board: OnBoard) -> Local[Any, Any]:
        if isinstance(on_board, Hold):

            async def hold(_: Any, __: int) -> Any:
                return snapshot(self._last)

            return Local.task(hold)
        if inspect.isclass(on_board):
            raise ConfigError(
                f"the class {on_board.__name__} for a policy on board; give an instance"
            )
        compute: Any = getattr(on_board, "infer", on_board)
        check_function(compute, "a policy on board")
        check_takes(compute, "a policy on board", "observation")

        def act(observation: Any, _: int) -> Any:
            with self._within():
                action = compute(observation)
            check_value(action, "the policy on board", "make it a plain function")
            form = form_of(action, "the action on board")
            if self._like is None or self._is_guessed:
                self._is_guessed, self._like = False, form
                self._kinds.learn(action)
            else:
                check_form(action, self._like, "the action on board now")
            return action

        # If several observations wait for a slow policy, the latest one counts.
        return Local.threads(act, deadline=ns(round(self._deadline * 1e9)), waiting=1)

    def _check(self, action: Any, where: str = "the action") -> None:
        check_form(action, self._like, where)
        self._kinds.check(action)
        if self._like is None:
            # Until the policy on board has acted, the first action sets the form.
            self._is_guessed, self._like = True, form_of(action)

    def _read(self, chunk: Chunk | None) -> Callable[[Any], Any]:
        """Returns the function that makes and checks the actions of a reply."""

        def one(reply: Any) -> Any:
            self._check(reply)
            # The policy may use its buffer again.
            return snapshot(reply)

        if chunk is None:
            return one
        return lambda reply: snapshot(actions_of(reply, chunk, self._check))

    def _offer(self, observation: Any, _: int) -> tuple[Any, float] | None:
        return (observation, self._deadline) if self._remote.is_ready() else None

    async def _call(self, observation: Any, call: Call) -> Any:
        left = max(call.deadline - self._linger, 0.0)
        try:
            action = await self._remote.infer(observation, replace(call, deadline=left))
        except asyncio.CancelledError:
            if not self._is_closed:
                self._failures.ended(f"no reply within {self._deadline + self._linger:g} s")
            raise
        except Exception as error:
            self._failures.ended(in_one_line(error))
            raise
        self._failures.ended(None)
        return action

    def _offer_planned(self, observation: Any, t: int) -> tuple[Any, float] | None:
        """Requests the next chunk if it is time, and returns the planned action if there is one."""
        assert self._plan is not None
        self._plan.request(observation, t)
        try:
            planned: Any = self._plan.planned(t, self._last)
        except Exception as error:
            planned = CallError(f"the blended action: {in_one_line(error)}")
            self._failures.ended(str(planned))
        if planned is None and self._plan.why is not None:
            planned = CallError(self._plan.why)
        return None if planned is None else (planned, self._deadline)

    async def _planned(self, planned: StampedValue[Any] | CallError, _: Call) -> StampedValue[Any]:
        if isinstance(planned, CallError):
            raise planned
        return planned


def _held_form(on_board: OnBoard) -> Form | None:
    """Returns the form of an action that is held, or None for a single number."""
    form = form_of(on_board.first) if isinstance(on_board, Hold) else None
    return None if form == () else form


def _deadline_of(deadline: Duration | None, period: Duration | None) -> float:
    """Returns the deadline in seconds."""
    tick = None if period is None else nanoseconds(period) / 1e9
    if tick is not None and not 0 < tick <= LONGEST_PERIOD:
        raise ConfigError(
            f"a period of {tick} s; it is the time from a tick to the next, at most "
            f"{LONGEST_PERIOD} s: for 30 Hz give 1 / 30"
        )
    if deadline is None:
        if tick is None:
            raise ConfigError("neither a deadline nor a period is given; give one")
        return 0.75 * tick
    given = nanoseconds(deadline) / 1e9
    if given == 0:
        raise ConfigError("a deadline of 0 leaves no time for an action; give a longer one")
    if given > LONGEST_DEADLINE:
        raise ConfigError(
            f"a deadline of {given} s; at most {LONGEST_DEADLINE} s may be waited, so nothing "
            "would be requested: for milliseconds divide by 1000"
        )
    if tick is not None and given > tick:
        raise ConfigError(
            f"a deadline of {given} s is above the period of {tick} s: each tick would be late"
        )
    return given
