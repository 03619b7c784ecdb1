"""Carries the state of an operator, such as a tracker, along with its messages (E10)."""

from __future__ import annotations

import threading
from typing import Generic, TypeVar

S = TypeVar("S")


class CarriedState(Generic[S]):
    """Holds the state from which an operator computes its next message; any thread may use it.

    Local begins with `current` and gives what comes of it to `computed`; a message handler sends
    `current` along, and `Operator.use_state` takes over that of each result that is sent. The state
    of the latest message is kept, and of one message that of the result that was sent: no state
    goes back to an earlier message, and what was computed from an older state is not computed again
    (A55). It is handed on as it is: make another for a message instead of changing it.

    >>> tracks = CarriedState(["a van"])
    >>> tracks.computed(0, ["a van", "a shadow"])  # local's
    >>> tracks.sent(0, ["a van", "a bicycle"])  # a cloud's result for the same message was sent
    >>> tracks.current()
    ['a van', 'a bicycle']
    """

    def __init__(self, state: S) -> None:
        self._state = state
        #: Of which message it is, none being before all, and whether its result was sent.
        self._of = (-1, False)
        self._lock = threading.Lock()

    def current(self) -> S:
        """Returns the state to begin the next message with."""
        with self._lock:
            return self._state

    def computed(self, timestamp: int, state: S) -> None:
        """Takes the state that local computed for a message; its result may not be sent."""
        self._replace((timestamp, False), state)

    def sent(self, timestamp: int, state: S) -> None:
        """Takes the state of the result that was sent for a message."""
        self._replace((timestamp, True), state)

    def _replace(self, of: tuple[int, bool], state: S) -> None:
        with self._lock:
            # E10: the latest message's, and of one message that of the result that was sent.
            if self._of <= of:
                self._of, self._state = of, state
