"""Holds the items of an operator that wait to be read."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

from fuseline._item import Item
from fuseline._loop import ReaderList, WaiterList

V = TypeVar("V")


class Output(Generic[V]):
    """Holds items until they are read, with the tasks that wait for an item or for room.

    Args:
        limit: The number of waiting items at which no further message is accepted.
        name: The operator's name.
    """

    def __init__(self, limit: int, name: str) -> None:
        self.items: deque[Item[V]] = deque()
        self.limit = limit
        self.readers, self.writers = ReaderList(name), WaiterList()
        #: The number of items that were read.
        self.read_count = 0
        #: True if the operator's block has ended while messages are fed.
        self.is_ending = False

    def put(self, item: Item[V]) -> None:
        """Adds an item. It replaces an earlier item of its message that was not read."""
        if item.revision > 0:
            for place, earlier in enumerate(self.items):
                if earlier.timestamp == item.timestamp:
                    # Nobody has read the earlier item, and nobody needs it any more (F9, D8).
                    item._takes_the_place_of(earlier)
                    del self.items[place]
                    break
        self.items.append(item)
        if self.readers.waiters:
            self.readers.wake()
        elif self.is_ending and self.writers.waiters:
            # A task that feeds messages may have to give up.
            self.writers.wake()

    def take(self) -> Item[V]:
        """Removes and returns the oldest item, and wakes the writers if there is room again."""
        item = self.items.popleft()
        self.read_count += 1
        if self.writers.waiters and len(self.items) < self.limit:
            self.writers.wake()
        return item

    def give_back(self, item: Item[V]) -> None:
        """Puts an item back that was taken for a reader who did not get it."""
        self.items.appendleft(item)
        self.read_count -= 1
        self.readers.wake()
