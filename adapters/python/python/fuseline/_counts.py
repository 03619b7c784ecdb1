"""Counts events by keys, and recognizes misspelt keys."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from difflib import get_close_matches
from typing import TypeVar

K = TypeVar("K", bound="tuple[str, ...]")

#: Counts the reasons that are not counted separately. A key with any other reason is not a mistake.
OTHER_REASONS = "other reasons"


class Counts(Counter[K]):
    """Counts what happened. A key that nothing is ever counted by raises `KeyError`.

    A `Counter` alone would take a misspelt key for a count of 0.

    Args:
        counts: The counts so far.
        known: All keys that something may be counted by. Without it, any key may be asked for.

    >>> Counts({("west", "result", "held"): 2}, [("west", "result", "forwarded")])[
    ...     "west", "result", "forwarded"
    ... ]
    0
    """

    def __init__(
        self, counts: Iterable[K] | dict[K, int] = (), known: Iterable[K] | None = None
    ) -> None:
        super().__init__(counts)
        self.known = None if known is None else set(known)

    def know(self, keys: Iterable[K]) -> None:
        """Adds keys that something may be counted by."""
        self.known = (self.known or set()).union(keys)

    def __missing__(self, key: K) -> int:
        if self.known is None or key in self.known:
            return 0
        if isinstance(key, tuple) and (*key[:-1], OTHER_REASONS) in self.known:
            return 0
        names = {str(it): it for it in self.known}
        nearest = get_close_matches(str(key), names, 1, 0.0)
        hint = f"; the nearest is {nearest[0]}" if nearest else ""
        raise KeyError(f"there is no count {key!r}{hint}")
