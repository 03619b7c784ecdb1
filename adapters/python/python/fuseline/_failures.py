"""Counts and logs the failed calls to a policy, and hands them to a callback."""

from __future__ import annotations

import logging
from collections import Counter, deque
from collections.abc import Callable
from typing import Any

from fuseline._counts import OTHER_REASONS
from fuseline._item import Ending, Failure, Item, Source

#: The number of the latest reasons for failures that are counted separately.
REASONS = 8

#: The number of ticks over which the time between two ticks is measured.
RATE_TICKS = 50

#: The keys by which calls to the remote policy are counted.
CALL_KEYS = (
    ("remote", "call", "answered"),
    ("remote", "call", "failed"),
    ("remote", "call failed because", OTHER_REASONS),
)

LOCAL, REMOTE = Source(0, "local"), Source(1, "remote")

_log = logging.getLogger("fuseline")


class PolicyFailures:
    """Counts and logs how calls ended, and hands failures to a callback."""

    def __init__(self, name: str, on_failure: Callable[[Failure], None] | None) -> None:
        self.counts: Counter[tuple[str, str, str]] = Counter()
        self._name, self._on_failure = name, on_failure
        self._fresh: deque[Failure] = deque(maxlen=64)
        #: The reasons that are counted separately. The most recent one is the last.
        self._reasons: list[str] = []
        #: The number of calls that have failed since one was answered.
        self._in_a_row = 0

    def ended(self, why: str | None) -> None:
        """Notes that a call to the remote policy has ended. With a reason, it has failed."""
        if why is None:
            if self._in_a_row:
                _log.info("%s: the remote policy answers again", self._name)
            self._in_a_row = 0
            self.counts["remote", "call", "answered"] += 1
            return
        self._in_a_row += 1
        self.counts["remote", "call", "failed"] += 1
        if why in self._reasons:
            self._reasons.remove(why)
        elif len(self._reasons) == REASONS:
            before = ("remote", "call failed because", self._reasons.pop(0))
            self.counts["remote", "call failed because", OTHER_REASONS] += self.counts.pop(before)
        self._reasons.append(why)
        self.counts["remote", "call failed because", why] += 1
        self._fresh.append(Failure(REMOTE, why))
        # Logs the first failure, and then each time that their number doubles.
        if self._in_a_row & (self._in_a_row - 1) == 0:
            _log.warning(
                "%s: a call to the remote policy failed, %d in a row: %s",
                self._name,
                self._in_a_row,
                why,
            )

    def of_item(self, item: Item[Any], deadline: float) -> None:
        """Notes that the policy on board failed or came too late in this tick."""
        failed = [it for it in item.failures if it.source.priority == 0]
        if not failed and item.ending is Ending.MISSED:
            failed = [Failure(LOCAL, f"no action on board within {deadline:g} s")]
        self._fresh.extend(failed)

    def report(self) -> None:
        """Hands each failure to the callback."""
        while self._fresh:
            failure = self._fresh.popleft()
            try:
                if self._on_failure is not None:
                    self._on_failure(failure)
            except Exception:
                _log.exception("%s: on_failure failed", self._name)


class TickRate:
    """Reports once if ticks come much faster or slower than their period.

    Ages of chunks are counted in ticks, so a wrong period makes them wrong.
    """

    def __init__(self, period: float, name: str) -> None:
        self._period, self._name = period, name
        self._count, self._first, self._before = 0, 0.0, 0.0

    def tick(self, now: float) -> float:
        """Notes a tick at this instant, in seconds. Returns the periods since the last tick."""
        if self._count == 0:
            self._first = self._before = now
        gap, self._before = (now - self._before) / self._period, now
        self._count += 1
        if self._count == RATE_TICKS + 1:
            self._check_rate(now)
        return gap

    def _check_rate(self, now: float) -> None:
        mean = (now - self._first) / RATE_TICKS
        if not self._period / 2 <= mean <= self._period * 2:
            _log.warning(
                "%s: a tick comes every %.3g s, and the period is %.3g s: give the period at which "
                "infer is called",
                self._name,
                mean,
                self._period,
            )
