"""Operators in virtual time: the wheel's state machine decides, and nothing waits.

The rivals of fusion are here too, so that all see the same frames and responses.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol

from fuseline import Admitted, Cloud, Firing, Forwarded, Fusion, Refused, ns
from fuseline.deadline import End, Policy, Situation

#: The cloud's priority.
CLOUD = 1
#: Longer than any drive, in seconds.
FOREVER = 3600.0


@dataclass(frozen=True, order=True)
class Output:
    """An output of an operator for one frame."""

    at: int
    t: int
    #: 0 is local and 1 the cloud. None if the frame has no output.
    source: int | None = field(compare=False)


class VirtualOperator(Protocol):
    """Takes frames and gives outputs; instants and durations are nanoseconds."""

    def frame(self, at: int, local: int, cloud: int | None, situation: Situation) -> None:
        """Captures a frame, for which local and the cloud (if ever) have a result after this long.
        """

    def until(self, now: int) -> list[Output]:
        """Returns the outputs that left by now and were not taken yet."""


class Race:
    """Works without a machine: local alone, the cloud alone, or the first of them."""

    def __init__(self, choose: Callable[[int, int | None], tuple[int, int] | None]) -> None:
        self._choose, self._outputs, self._t = choose, list[Output](), 0

    def frame(self, at: int, local: int, cloud: int | None, situation: Situation) -> None:
        """See `VirtualOperator`."""
        if chosen := self._choose(local, cloud):
            response, source = chosen
            heapq.heappush(self._outputs, Output(at + response, self._t, source))
        self._t += 1

    def until(self, now: int) -> list[Output]:
        """See `VirtualOperator`."""
        taken = []
        while self._outputs and self._outputs[0].at <= now:
            taken.append(heapq.heappop(self._outputs))
        return taken


class Fused:
    """Local and one cloud, with the deadlines of a policy."""

    def __init__(self, policy: Policy, *, record: bool = False) -> None:
        self._machine = Fusion([Cloud(CLOUD, limit=1 << 20)], window=1024, record=record)
        self._policy = policy
        self._arrivals: list[tuple[int, int, int]] = []
        self._called: dict[int, int] = {}
        self._outputs: list[Output] = []
        self._t = 0

    def frame(self, at: int, local: int, cloud: int | None, situation: Situation) -> None:
        """See `VirtualOperator`."""
        self._pass(at)
        t, self._t = self._t, self._t + 1
        under_way = [ns(at - since) for since in self._called.values()]
        chosen = self._policy.decide(replace(situation, under_way=under_way), FOREVER)
        fired, opening = self._machine.open(at, t)
        self._take(fired)
        if isinstance(opening, Refused):
            raise RuntimeError(f"frame {t} was refused: {opening.why}")
        fired, admission = self._machine.offer(at, t, CLOUD, chosen.deadline)
        self._take(fired)
        if isinstance(admission, Admitted):
            self._called[t] = at
            if cloud is not None:
                heapq.heappush(self._arrivals, (at + cloud, t, CLOUD))
        heapq.heappush(self._arrivals, (at + local, t, 0))

    def until(self, now: int) -> list[Output]:
        """See `VirtualOperator`."""
        self._pass(now)
        taken, self._outputs = self._outputs, []
        return taken

    def trace(self) -> bytes:
        """Returns the record: the inputs and the machine's decisions."""
        return self._machine.take_trace()

    def _pass(self, now: int) -> None:
        while self._arrivals and self._arrivals[0][0] <= now:
            at, t, source = heapq.heappop(self._arrivals)
            self._serve(at)
            self._ended(t, source, at, End.ANSWERED)
            fired, outcome = self._machine.result(at, t, source)
            self._take(fired)
            if isinstance(outcome, Forwarded):
                self._forwarded(at, t, outcome)
        self._serve(now)

    def _serve(self, now: int) -> None:
        while (due := self._machine.next_due) is not None and due <= now:
            self._take(self._machine.tick(due))

    def _take(self, fired: tuple[Firing, ...]) -> None:
        for firing in fired:
            for source in firing.timers:
                self._ended(firing.t, source, firing.due, End.CENSORED)
            if isinstance(firing.outcome, Forwarded):
                self._forwarded(firing.due, firing.t, firing.outcome)

    def _forwarded(self, at: int, t: int, outcome: Forwarded) -> None:
        self._outputs.append(Output(at, t, outcome.by))
        for source in outcome.cancelled:
            self._ended(t, source, at, End.CENSORED)

    def _ended(self, t: int, source: int, at: int, end: End) -> None:
        """Reports to the policy, once, that a call of the cloud has ended."""
        if source == CLOUD and t in self._called:
            self._policy.ended(end, ns(at - self._called.pop(t)))
