"""Remote policies for robots: an action each tick, whatever the network and the server do.

`Always` stands where a policy stood: `infer` gives the remote policy's action if it is there by the
deadline, else one from on board. It has the methods of openpi's ``BasePolicy``; `openpi` and
`lerobot` connect to the policy servers of both.
"""

from __future__ import annotations

import itertools
import os
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias

from fuseline._blocking import BlockingOperator
from fuseline._chunks import Blend, ChunkPlan, fade
from fuseline._errors import ConfigError
from fuseline._item import Call, Item, StampedValue
from fuseline._local import Local
from fuseline._operator import Operator
from fuseline._remote import RemotePolicy, RemoteThread

if TYPE_CHECKING:
    from fuseline._judge import Duration

__all__ = ["Always", "Blend", "Chunk", "Hold", "RemotePolicy", "fade", "lerobot", "openpi"]

#: How many messages may be open at once.
WINDOW = 16


class OnBoardPolicy(Protocol):
    """A policy that computes on board."""

    def infer(self, obs: Any) -> Any:
        """An action for an observation."""


@dataclass(frozen=True)
class Hold:
    """On board the action sent last is held."""

    #: What is held before the first action was sent.
    first: Any


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


class Always:
    """A policy that has an action by its deadline at each tick.

    One call is under way at a time. One that is not answered within ``deadline`` + ``linger`` is
    ended with its connection, and the next one connects anew, so that a late reply is read by its
    own call and never acts.

    Args:
        remote: Connects to the remote policy, in a thread of its own: `openpi`, `lerobot`, or a
            function that returns a `RemotePolicy`.
        on_board: What acts when the remote policy does not: `Hold`, an object with ``infer``, or a
            function of the observation.
        deadline: How long the remote policy may take; by default three quarters of the period.
        chunk: How replies with the actions of several ticks are used. The age of what is sent is
            then bounded by it, and the deadline is for a chunk that is there already.
        period: The time from a tick to the next.
        linger: How long a call may go on after its deadline, without effect.
        trace: The file that the run is recorded to, for ``fuseline check``.
        name: The operator's name in logs and traces.

    Raises:
        ConfigError: if neither a deadline nor a period is given, or a chunk has no ticks.

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
        deadline: float | None = None,
        chunk: Chunk | None = None,
        period: float | None = None,
        linger: Duration = 1.0,
        trace: str | os.PathLike[str] | None = None,
        name: str = "policy",
    ) -> None:
        if deadline is None:
            if period is None:
                raise ConfigError("neither a deadline nor a period; give one")
            deadline = 0.75 * period
        self._deadline = deadline
        self._remote = RemoteThread(remote)
        self._last: Any = on_board.first if isinstance(on_board, Hold) else None
        #: What became of the last tick, for instance whose action it was.
        self.item: Item[Any] | None = None
        self._plan = None if chunk is None else ChunkPlan(self._remote, chunk)
        operator: Operator[Any, Any] = Operator(
            _local(self, on_board), name=name, window=WINDOW, trace=trace
        )
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
        """The action for an observation, at the latest at the deadline.

        Raises:
            RuntimeError: if there is none, for on board nothing came either.
        """
        t = self._operator.write(obs)
        while True:
            item = self._operator.read()
            if item is None:
                raise RuntimeError("the policy was closed")
            if item.timestamp == t:
                break
        self.item = item
        if item.source is None:
            raise RuntimeError(f"no action for tick {t}: {item.ending.name.lower()}")
        self._last = item.value
        return item.value

    def reset(self) -> None:
        """Forget the actions of chunks, as at the begin of an episode."""
        if self._plan is not None:
            self._plan.clear()

    def close(self) -> None:
        """End the remote call and the trace, unless that was done."""
        if self._is_closed:
            return
        self._is_closed = True
        if self._plan is not None:
            self._plan.close()
        self._remote.close()
        self._operator.__exit__(None, None, None)

    def __enter__(self) -> Always:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        where: TracebackType | None,
    ) -> None:
        self.close()

    def _offer(self, observation: Any, _: int) -> tuple[Any, float] | None:
        return (observation, self._deadline) if self._remote.is_ready() else None

    async def _call(self, observation: Any, _: Call) -> Any:
        return await self._remote.infer(observation)

    def _offer_planned(self, observation: Any, t: int) -> tuple[Any, float] | None:
        """Requests the next chunk if it is time, and the planned action if there is one."""
        assert self._plan is not None
        self._plan.request(observation, t)
        planned = self._plan.planned(t, self._last)
        return None if planned is None else (planned, self._deadline)

    async def _planned(self, planned: StampedValue[Any], _: Call) -> StampedValue[Any]:
        return planned


def _local(policy: Always, on_board: OnBoard) -> Local[Any, Any]:
    if isinstance(on_board, Hold):

        async def hold(_: Any, __: int) -> Any:
            return policy._last

        return Local.task(hold)
    compute = on_board if callable(on_board) else on_board.infer
    return Local.threads(lambda observation, _: compute(observation))


def openpi(host: str, port: int | None = None) -> Callable[[], RemotePolicy]:
    """Connects to a policy server of openpi, by the package ``openpi-client``."""

    class OpenpiRemote:
        def __init__(self) -> None:
            from openpi_client.websocket_client_policy import WebsocketClientPolicy

            self._policy = WebsocketClientPolicy(host, port)

        def infer(self, observation: Any) -> Any:
            return self._policy.infer(observation)

        def close(self) -> None:
            # Closing by the protocol would wait for the server, which may hang.
            self._policy._ws.socket.shutdown(socket.SHUT_RDWR)

    return OpenpiRemote


def lerobot(address: str, config: Any = None) -> Callable[[], RemotePolicy]:
    """Connects to a policy server of LeRobot, by the package ``lerobot``.

    A reply is a chunk: a list of its actions. Observations are dictionaries.

    Args:
        address: The server's host and port.
        config: A ``RemotePolicyConfig``, sent to each new connection; with None the server needs
            none.
    """
    # They rise from connection to connection, so that no reply is taken for another's.
    steps = itertools.count()

    class LerobotRemote:
        def __init__(self) -> None:
            import pickle

            import grpc
            from lerobot.async_inference.helpers import TimedObservation
            from lerobot.transport import services_pb2, services_pb2_grpc
            from lerobot.transport.utils import send_bytes_in_chunks

            self._pickle, self._observation = pickle, TimedObservation
            self._messages, self._in_chunks = services_pb2, send_bytes_in_chunks
            self._channel = grpc.insecure_channel(address)
            self._stub = services_pb2_grpc.AsyncInferenceStub(self._channel)
            self._stub.Ready(services_pb2.Empty())
            if config is not None:
                setup = services_pb2.PolicySetup(data=pickle.dumps(config))
                self._stub.SendPolicyInstructions(setup)

        def infer(self, observation: Any) -> Any:
            step = next(steps)
            timed = self._observation(
                timestamp=time.time(), observation=observation, timestep=step, must_go=True
            )
            data = self._pickle.dumps(timed)
            self._stub.SendObservations(
                self._in_chunks(data, self._messages.Observation, silent=True)
            )
            while True:
                reply = self._stub.GetActions(self._messages.Empty())
                actions = self._pickle.loads(reply.data) if reply.data else []
                # Without an observation a server answers with nothing.
                if actions and actions[0].get_timestep() == step:
                    return [action.get_action() for action in actions]

        def close(self) -> None:
            self._channel.close()

    return LerobotRemote
