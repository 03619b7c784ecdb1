"""Encodes requests in threads, once for all clouds that share a message's request."""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from fuseline._errors import CallError
from fuseline._fuseline import Counting
from fuseline._item import Call
from fuseline._sources import RegisteredCloud, response_of
from fuseline._threads import DaemonThreads
from fuseline._wiring import check_read

_log = logging.getLogger("fuseline")

#: The number of a cloud's encodings past their deadlines at which no other encoding begins.
HUNG_ENCODERS = 16


class EncodedRequest:
    """Holds a message handler's request, and encodes it when the first call needs it."""

    __slots__ = ("_encode", "_future", "_is_shared", "_raw")

    def __init__(self, encode: Callable[[Any], Any], raw: Any) -> None:
        self._encode, self._raw = encode, raw
        self._future: asyncio.Future[Any] | None = None
        self._is_shared = False

    def is_of(self, encode: Callable[[Any], Any], raw: Any) -> bool:
        """Returns True if another cloud's request would be the same."""
        return self._raw is raw and bool(self._encode == encode)

    def share(self) -> EncodedRequest:
        """Returns this request for another cloud too."""
        self._is_shared = True
        return self

    def give_up(self, threads: DaemonThreads) -> bool:
        """Replaces the thread that encodes. Returns True if it was replaced."""
        return self._future is not None and threads.replace(self._future)

    async def get(self, threads: DaemonThreads) -> Any:
        """Returns the encoded request. These threads encode it unless another call did."""
        if self._future is None:
            self._future = threads.run(self._raw)
        # Other calls may wait for a shared future, so it must not be cancelled with this call.
        return await (asyncio.shield(self._future) if self._is_shared else self._future)


class Encoder:
    """Encodes one cloud's requests in threads, and makes its calls with them."""

    def __init__(
        self,
        operator: str,
        cloud: RegisteredCloud,
        encode: Callable[[Any], Any],
        counting: Counting,
        clock: Callable[[], int],
    ) -> None:
        self._operator, self._cloud = operator, cloud
        self._counting, self._read_clock = counting, clock
        threads = min(cloud.calls, os.cpu_count() or 1)
        self._threads = DaemonThreads(partial(_same, encode), threads, "fuseline-encode")

    def stop(self) -> None:
        """Ends the threads."""
        self._threads.stop()

    async def call(self, request: EncodedRequest, call: Call) -> Any:
        """Encodes a request, calls the cloud within the time left, and returns its result.

        Raises:
            CallError: if too many encodings hang.
        """
        begin = self._read_clock()
        if self._threads.hung_len() >= HUNG_ENCODERS:
            raise CallError(
                f"{HUNG_ENCODERS} encodings have not ended; no other begins until one of them ends"
            )
        try:
            encoded = await request.get(self._threads)
        except asyncio.CancelledError:
            if (self._read_clock() - begin) / 1e9 >= call.deadline:
                self._replace_hung(request)
            raise
        check_read(encoded, "encode")
        took = (self._read_clock() - begin) / 1e9
        call = replace(call, deadline=max(call.deadline - took, 0.0))
        return await response_of(self._cloud, self._cloud.handle(encoded, call))

    def _replace_hung(self, request: EncodedRequest) -> None:
        """Replaces a thread that encodes past its deadline."""
        hung = self._threads.hung_len()
        if not request.give_up(self._threads):
            return
        self._counting.handler_failed(self._cloud.cloud.p)
        if hung & (hung + 1) == 0:
            _log.warning(
                "%s: encode of %s has not ended by its deadline: another thread takes its place; "
                "%d encodings in all have not ended",
                self._operator,
                self._cloud.cloud.name,
                hung + 1,
            )


def share_encoded(
    encode: Callable[[Any], Any], raw: Any, encoded: list[EncodedRequest]
) -> EncodedRequest:
    """Returns another cloud's request for the message if it is the same, or a new one."""
    for other in encoded:
        if other.is_of(encode, raw):
            return other.share()
    encoded.append(EncodedRequest(encode, raw))
    return encoded[-1]


def _same(encode: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Returns the function itself. Encoding keeps no state, so all threads share one function."""
    return encode
