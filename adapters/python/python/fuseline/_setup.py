"""What an operator of a pipeline registers beside its clouds."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Generic, TypeVar

from fuseline._drive import Driver
from fuseline._errors import ConfigError
from fuseline._fuseline import Gate
from fuseline._item import Call, Item
from fuseline._side import SideRequest
from fuseline._sources import OutputHandlers
from fuseline._state import CarriedState
from fuseline._wiring import (
    check_count,
    check_function,
    check_handle,
    check_name,
    check_response_handler,
)

if TYPE_CHECKING:
    from fuseline._judge import Duration

M = TypeVar("M")
V = TypeVar("V")
S = TypeVar("S")
Req = TypeVar("Req")
Res = TypeVar("Res")


class PipelineSetup(Generic[M, V]):
    """Substitutes, states and side requests of an `Operator`, registered before it starts."""

    _driver: Driver[M, V] | None

    def __init__(self, handlers: OutputHandlers) -> None:
        self._handlers = handlers

    def use_substitute(self, substitute: Callable[[Item[V]], V | None]) -> None:
        """Set what is sent for a message that is missed or refused: the last plan, a stop (E4).

        The item has it as its value and is marked; the ending and the trace stay as they are. A
        message with an end-to-end deadline is then missed early enough to leave the ``reserve`` to
        the operators downstream. The handler gets the item; None sends it without a value.
        """
        self._check_not_started("a substitute")
        check_function(substitute, "a substitute's handler")
        if self._handlers.substitute is not None:
            raise ConfigError("a second substitute; an operator has one handler for all")
        self._handlers.substitute = substitute

    def use_state(self, state: CarriedState[S], state_of: Callable[[V], S]) -> None:
        """Take over the state of each result that is sent, local's or a cloud's (E10)."""
        self._check_not_started("a state")
        if not isinstance(state, CarriedState):
            raise ConfigError(f"a state is a CarriedState, not {state!r}")
        check_function(state_of, "what reads a state")
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
        """Register side requests, for what helps local later, such as a plan for what may happen.

        The machine does not know of them: no output waits for an answer, and none becomes an
        output. The message handler looks at each message that was taken on; the response handler
        gets each answer that comes in time. They are gated and bounded as a cloud's requests are.
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
            raise ConfigError(f"{what} after the start; register it before")

    def _names(self) -> list[str]:
        raise NotImplementedError
