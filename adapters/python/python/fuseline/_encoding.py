"""Requests that are encoded in a thread, once for all clouds of a message that share them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from fuseline._threads import DaemonThreads


class EncodedRequest:
    """What a message handler returned; it is encoded once the first call needs it."""

    __slots__ = ("_encode", "_future", "_is_shared", "_raw")

    def __init__(self, encode: Callable[[Any], Any], raw: Any) -> None:
        self._encode, self._raw = encode, raw
        self._future: asyncio.Future[Any] | None = None
        self._is_shared = False

    def is_of(self, encode: Callable[[Any], Any], raw: Any) -> bool:
        """Whether another cloud's would be the same."""
        return self._raw is raw and bool(self._encode == encode)

    def share(self) -> EncodedRequest:
        """This one, for another cloud too."""
        self._is_shared = True
        return self

    def give_up(self, threads: DaemonThreads) -> bool:
        """Another thread takes the place of the one that encodes; whether that is so."""
        return self._future is not None and threads.replace(self._future)

    async def get(self, threads: DaemonThreads) -> Any:
        """The request, encoded by these threads unless another call began that."""
        if self._future is None:
            self._future = threads.run(self._raw)
        # What others may wait for does not end with this call.
        return await (asyncio.shield(self._future) if self._is_shared else self._future)
