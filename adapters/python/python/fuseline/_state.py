"""Carries the state of an operator, such as a tracker, along with its messages (E10)."""

from __future__ import annotations

import threading
from typing import Generic, TypeVar

S = TypeVar("S")


class CarriedState(Generic[S]):
    """Holds the state from which an operator computes its next message, for any thread.

    Local begins with `current` and passes the state after its computation to `computed`. A message
    handler sends `current` along to the cloud, and `Operator.use_state` takes over the state of
    each result that is sent. The state of the latest message is kept. Among the states of one
    message, the state of the result that was sent is kept. The state never goes back to an earlier
    message, and nothing is computed again because an older state was used (A55). States are not
    copied, so make a new one for each message instead of changing it.

    >>> tracks = CarriedState(["a van"])
    >>> tracks.computed(0, ["a van", "a shadow"])  # local's
    >>> tracks.sent(0, ["a van", "a bicycle"])  # a cloud's result for the same message was sent
    >>> tracks.current()
    ['a van', 'a bicycle']
    """

    def __init__(self, state: S) -> None:
        self._state = state
        #: The message of the state, which is -1 before the first one, and True if its result was
        #: sent.
        self._of = (-1, False)
        self._lock = threading.Lock()

    def current(self) -> S:
        """Returns the state with which to begin the next message."""
        with self._lock:
            return self._state

    def computed(self, timestamp: int, state: S) -> None:
        """Notes the state that local computed for a message. Its result may not be sent."""
        self._replace((timestamp, False), state)

    def sent(self, timestamp: int, state: S) -> None:
        """Notes the state of the result that was sent for a message."""
        self._replace((timestamp, True), state)

    def _replace(self, of: tuple[int, bool], state: S) -> None:
        with self._lock:
            # The state of the latest message is kept. For the same message, the sent result's state
            # wins (E10).
            if self._of <= of:
                self._of, self._state = of, state
