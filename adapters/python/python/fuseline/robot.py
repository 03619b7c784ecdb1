"""Remote policies for robots: an action each tick, whatever the network and the server do.

`Always` stands where a policy stood: `infer` gives the remote policy's action if it is there by the
deadline, else one from on board. It has the methods of openpi's ``BasePolicy``; `openpi` and
`lerobot` connect to the policy servers of both.
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
from fuseline._errors import CallError, ConfigError, in_one_line
from fuseline._failures import PolicyFailures, TickRate
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

#: How many messages may be open at once.
WINDOW = 16
#: The longest time from a tick to the next, in seconds; more is a rate that was meant in hertz.
LONGEST_PERIOD = 2.0
#: The longest deadline of an operator, in seconds.
LONGEST_DEADLINE = 60.0


class OnBoardPolicy(Protocol):
    """A policy that computes on board."""

    def infer(self, obs: Any) -> Any:
        """An action for an observation."""


@dataclass(frozen=True)
class Hold:
    """On board the action sent last is held."""

    #: What is held before the first action was sent.
    first: Any

    def __post_init__(self) -> None:
        if callable(self.first):
            raise ConfigError(
                f"to hold {self.first!r}; a policy is given as on_board itself, without Hold"
            )
        try:
            form_of(self.first, "what is held")
        except CallError as error:
            raise ConfigError(f"{error}; give the first action that may be sent") from error


OnBoard: TypeAlias = Hold | OnBoardPolicy | Callable[[Any], Any]


@dataclass(frozen=True)
class Chunk:
    """The remote policy answers with the actions of several ticks."""

    #: The next chunk is requested every so many ticks, unless a request is under way.
    every: int
    #: How many ticks after its observation an action may still be sent.
    max_age: int
    #: The actions of a reply; by default those of a list, or of arrays by their first dimension.
    split: Callable[[Any], Sequence[Any]] | None = None
    #: Whether a chunk's actions for ticks that have passed are skipped, so that each is sent at the
    #: tick that it was computed for; else a chunk begins with its first action when it comes.
    skip: Literal["executed", "none"] = "executed"
    #: How the first actions of a chunk follow those before: see `fade`.
    blend: Blend | None = None
    #: How long a chunk may take, before its call is ended and the connection made anew.
    within: Duration = 1.0


@fix_arguments
class Always:
    """A policy that has an action by its deadline at each tick.

    One call is under way at a time. One that is not answered within ``deadline`` + ``linger`` is
    ended with its connection, and the next one connects anew, so that a late reply is read by its
    own call and never acts.

    A reply acts only if it has the form of an action on board, with numbers that are finite; else
    the call has failed. An action on board that is not there by the deadline is replaced by the
    action that was sent last. Each failure is counted in `counts` and given to ``on_failure``.

    Args:
        remote: Connects to the remote policy, in a thread of its own: `openpi`, `lerobot`, or a
            function that returns a `RemotePolicy`.
        on_board: What acts when the remote policy does not: `Hold`, an object with ``infer``, or a
            function of the observation.
        deadline: How long the remote policy may take, and the one on board; by default three
            quarters of the period.
        chunk: How replies with the actions of several ticks are used. The age of what is sent is
            then bounded by it, and the deadline is for a chunk that is there already.
        period: The time from a tick to the next, in seconds; not a rate in hertz.
        linger: How long a call may go on after its deadline, without effect.
        trace: The file that the run is recorded to, for ``fuseline check``.
        name: The operator's name in logs and traces.
        on_failure: Called in `infer`, before it returns, with each `Failure` since the last tick:
            of a call to the remote policy, or of the policy on board. What it raises is logged.

    Raises:
        ConfigError: if neither a deadline nor a period is given, the deadline is above the period,
            the period is longer than two seconds, or a chunk has no ticks.

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
            check_function(on_failure, "what is called on failures")
        self._deadline = _deadline_of(deadline, period)
        self._linger = nanoseconds(linger) / 1e9
        self._failures = PolicyFailures(name, on_failure)
        self._last: Any = on_board.first if isinstance(on_board, Hold) else None
        #: What an action on board is made of, once that is known.
        self._like = _held_form(on_board)
        self._is_guessed = False
        self._kinds = ArrayKinds()
        if isinstance(on_board, Hold):
            self._kinds.learn(on_board.first)
        self._remote = RemoteThread(remote, self._read(chunk), name)
        #: What became of the last tick, for instance whose action it was.
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
        """Returns the action for an observation, at the latest at the deadline.

        Several threads may call it; each tick waits for the one before.

        Raises:
            RuntimeError: if there is none: on board nothing came by the deadline, and no action was
                sent before that could be held. Call a policy that loads slowly once before.
        """
        if threading.get_ident() in self._inside:
            raise RuntimeError("infer in the policy on board, or in what is called on failures")
        with self._turn:
            if self._is_closed:
                raise ConfigError("the policy was closed, and does not run any more; make another")
            if self._rate is not None:
                self._rate.tick(time.monotonic())
            return self._tick(obs)

    def reset(self) -> None:
        """Forget the actions of chunks, as at the begin of an episode."""
        if self._plan is not None:
            self._plan.clear()

    @property
    def counts(self) -> Counter[tuple[str, str, str]]:
        """What happened so far: the counts of the operator, and what became of the calls.

        ``counts["remote", "call", "answered"]`` and ``"failed"`` are the calls to the remote
        policy, and ``counts["remote", "call failed because", why]`` has the last eight reasons.
        ``counts[name, "message", "missed"]`` are the ticks for which nothing came.
        """
        return self._operator.operator.counts + self._failures.counts

    def close(self) -> None:
        """End the remote call and the trace, unless that was done."""
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
        """What runs here must not wait for a tick."""
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
        # Whoever gets the action may change it.
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

        # Of several observations that wait for a slow policy the latest one counts.
        return Local.threads(act, deadline=ns(round(self._deadline * 1e9)), waiting=1)

    def _check(self, action: Any, where: str = "the action") -> None:
        check_form(action, self._like, where)
        self._kinds.check(action)
        if self._like is None:
            # Until the policy on board has acted, its actions are as the first one.
            self._is_guessed, self._like = True, form_of(action)

    def _read(self, chunk: Chunk | None) -> Callable[[Any], Any]:
        """What makes actions of a reply, and checks them, in the remote policy's thread."""

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
        """Requests the next chunk if it is time, and the planned action if there is one."""
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
    """Returns what an action that is held is made of; a number alone may stand for any action."""
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
            raise ConfigError("neither a deadline nor a period; give one")
        return 0.75 * tick
    given = nanoseconds(deadline) / 1e9
    if given == 0:
        raise ConfigError("a deadline of 0; no action could be there by then")
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
