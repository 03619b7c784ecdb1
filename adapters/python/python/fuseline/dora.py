"""Adds clouds to a dataflow of dora: the node forwards values unread, as the ROS 2 node does.

A detector that read ``camera/image`` now reads ``fusion/local_request``, and its copy in the cloud
reads ``fusion/west_request``. It sends its result with the metadata of the message that it read, as
dora's services do. The ``request_id`` in the metadata matches the result to its request.

    - id: fusion
      path: python
      args: -m fuseline.dora --cloud west=0.2 --cloud east=0.3 --trace run.jsonl
      inputs:
        input: camera/image
        local_result: detector/objects
        west_result: west/objects
        east_result: east/objects
      outputs: [output, missed, local_request, west_request, east_request]

Each input leads to one ``output``, with the input's metadata and the ``fuseline.source``, or to one
``missed``, with the ``fuseline.why``. While the input for a source's results is closed, that source
fails at once. The node answers all messages and ends when ``input`` is closed or the dataflow is
stopped.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import logging
import sys
import threading
from collections import Counter
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Literal, Protocol

from fuseline._errors import Closed, ConfigError, Full, TimeError
from fuseline._fuseline import nanoseconds
from fuseline._item import Call, Item, StampedValue
from fuseline._local import Local
from fuseline._operator import Operator

if TYPE_CHECKING:
    from fuseline._judge import Duration

__all__ = ["DoraNode", "FusionNode"]

_log = logging.getLogger("fuseline")
#: The thread that reads events may take this many seconds to see that the node has ended.
READ_TIMEOUT = 0.2


class DoraNode(Protocol):
    """Describes the part of `dora.Node` that is used here."""

    def next(self, timeout: float | None = None) -> dict[str, Any] | None:
        """Returns the next event: an error after the timeout, None after the last event."""

    def drain(self) -> list[dict[str, Any]] | None:
        """Returns the events that have arrived."""

    def node_config(self) -> dict[str, Any]:
        """Returns the node's part of the dataflow."""

    def send_output(
        self, output_id: str, data: Any, metadata: dict[str, Any] | None = None
    ) -> None:
        """Sends a value."""

    def send_service_request(
        self, output_id: str, data: Any, metadata: dict[str, Any] | None = None
    ) -> str:
        """Sends a request, and returns the id that its result will have."""


class DoraSource:
    """Keeps the requests to local or a cloud that wait for a result, by dora's id."""

    def __init__(self, node: DoraNode, name: str) -> None:
        self._node, self.name = node, name
        #: The futures of requests, each with its timestamp.
        self._waiting: dict[str, tuple[asyncio.Future[StampedValue[Any]], int]] = {}
        self._is_closed = False

    async def call(self, event: dict[str, Any], call: Call) -> StampedValue[Any]:
        """Requests a result from a cloud, as `compute` does."""
        return await self._answer(event, call.timestamp)

    async def compute(self, event: dict[str, Any], t: int) -> Any:
        """Requests a result for a message, and waits for it."""
        return (await self._answer(event, t)).value

    async def _answer(self, event: dict[str, Any], t: int) -> StampedValue[Any]:
        if self._is_closed:
            raise ConnectionError("its input is closed")
        metadata = {key: it for key, it in event["metadata"].items() if key != "request_id"}
        request = self._node.send_service_request(f"{self.name}_request", event["value"], metadata)
        answer: asyncio.Future[StampedValue[Any]] = asyncio.get_running_loop().create_future()
        self._waiting[request] = answer, t
        try:
            return await answer
        finally:
            del self._waiting[request]

    def take(self, event: dict[str, Any]) -> bool:
        """Accepts a result. Returns True if its request still waits."""
        self._is_closed = False
        answer, t = self._waiting.get(event["metadata"].get("request_id"), (None, 0))
        if answer is None or answer.done():
            return False
        answer.set_result(StampedValue(event["value"], t))
        return True

    def close(self) -> None:
        """Fails all requests, because no results come any more."""
        self._is_closed = True
        for answer, _ in self._waiting.values():
            if not answer.done():
                answer.set_exception(ConnectionError("its input was closed"))

    def reopen(self) -> None:
        """Notes that results may come again."""
        self._is_closed = False


class FusionNode:
    """Runs the node around an `Operator`.

    Args:
        node: A `dora.Node`, or an object with its methods.
        clouds: The deadline of each cloud by name, in rising priority.
        local_deadline: The time that local may take (F1). A later result counts as lost.
        calls: The greatest number of requests that each source has at once.
        window: The greatest number of messages that may be open at once. A further message is
            refused as ``full`` (F1).
        commit: Decides when a result is sent although a better one is pending (F6).
        trace: The file that the run is recorded to.
        clock: Returns whole nanoseconds that never go back; the monotonic clock by default.

    Raises:
        ConfigError: if the dataflow lacks one of the node's inputs or outputs, or there is no such
            operator.
        TimeError: if a duration is invalid.

    >>> class Node:  # stands for dora.Node, with a detector on board
    ...     def __init__(self):
    ...         frame = {"type": "INPUT", "id": "input", "value": "a frame", "metadata": {}}
    ...         self.events = [frame]
    ...     def node_config(self):
    ...         inputs = ["input", "local_result"]
    ...         return {"inputs": inputs, "outputs": ["output", "local_request"]}
    ...     def next(self, timeout=None):
    ...         return self.events.pop(0) if self.events else {"type": "STOP"}
    ...     def drain(self):
    ...         return []
    ...     def send_service_request(self, output_id, data, metadata=None):
    ...         result = {"type": "INPUT", "id": "local_result", "value": "a van"}
    ...         self.events.append(result | {"metadata": {"request_id": "1"}})
    ...         return "1"
    ...     def send_output(self, output_id, data, metadata=None):
    ...         print(output_id, data, metadata)
    >>> asyncio.run(FusionNode(Node(), {}).serve())
    output a van {'fuseline.source': 'local'}
    """

    def __init__(
        self,
        node: DoraNode,
        clouds: Mapping[str, Duration],
        *,
        local_deadline: Duration = 1.0,
        calls: int = 8,
        window: int = 16,
        commit: Literal["eager", "patient"] = "eager",
        trace: str | None = None,
        clock: Callable[[], int] | None = None,
    ) -> None:
        config = node.node_config()
        names = ["local", *clouds]
        for direction, needed in [
            ("inputs", ["input", *(f"{name}_result" for name in names)]),
            ("outputs", ["output", *(f"{name}_request" for name in names)]),
        ]:
            if missing := [it for it in needed if it not in config.get(direction, ())]:
                raise ConfigError(f"the node has no {', '.join(missing)} among its {direction}")
        self._node = node
        self._is_over = False
        self._says_missed = "missed" in config["outputs"]
        self._sources = {name: DoraSource(node, name) for name in names}
        #: Inputs, by their timestamp, until their item is sent.
        self._open: dict[int, dict[str, Any]] = {}
        #: The counts of results that no request waits for, and of inputs without room.
        self.dropped: Counter[str] = Counter()
        local = Local.task(
            self._sources["local"].compute,
            at_once=calls,
            deadline=local_deadline,
            may_lose_results=True,
        )
        times: dict[str, Any] = {} if clock is None else {"clock": clock}
        self.operator: Operator[dict[str, Any], Any] = Operator(
            local, name="fusion", window=window, commit=commit, trace=trace, **times
        )
        for priority, (name, deadline) in enumerate(clouds.items(), 1):
            self._use(name, deadline, priority, calls)

    def _use(self, name: str, deadline: Duration, priority: int, calls: int) -> None:
        within = nanoseconds(deadline)
        self.operator.use_cloud(
            self._sources[name].call,
            lambda event, _: (event, within),
            lambda answer: answer,
            priority,
            name=name,
            calls=calls,
        )

    async def serve(self) -> None:
        """Reads the node's events until ``input`` is closed, and sends the outputs."""
        async with self.operator:
            loop = asyncio.get_running_loop()
            reader = threading.Thread(target=self._read, args=[loop])
            reader.start()
            try:
                await self.send_items()
            finally:
                self._is_over = True
                await asyncio.to_thread(reader.join)

    async def send_items(self) -> None:
        """Sends the output of each input, until the operator ends."""
        async for item in self.operator:
            self._send(item)

    def take(self, event: dict[str, Any] | None) -> None:
        """Applies an event of dora, or None after the last one."""
        kind = "STOP" if event is None else event["type"]
        name = "" if event is None else str(event.get("id", ""))
        source = self._sources.get(name.removesuffix("_result"))
        if event is not None and kind == "INPUT" and name == "input":
            self._open_message(event)
        elif event is not None and kind == "INPUT" and source is not None:
            if not source.take(event):
                self.dropped[name] += 1
        elif kind == "STOP" or (kind == "INPUT_CLOSED" and name == "input"):
            self.operator.close()
            if event is None:
                for each in self._sources.values():
                    each.close()
        elif kind == "INPUT_CLOSED" and source is not None:
            _log.warning("fusion: the input %s is closed", name)
            source.close()
        elif kind == "INPUT_RECOVERED" and source is not None:
            source.reopen()

    def _open_message(self, event: dict[str, Any]) -> None:
        try:
            self._open[self.operator.write(event)] = event
        except (Closed, Full) as error:
            self.dropped["input"] += 1
            _log.warning("fusion: an input was not taken: %s", error)

    def _send(self, item: Item[Any]) -> None:
        metadata = self._open.pop(item.timestamp)["metadata"]
        if item.source is not None:
            self._node.send_output(
                "output", item.value, metadata | {"fuseline.source": item.source.name}
            )
        elif self._says_missed:
            why = {"fuseline.why": str(item.ending.value)}
            self._node.send_output("missed", b"", metadata | why)

    def _read(self, loop: asyncio.AbstractEventLoop) -> None:
        """Reads events in a thread, because dora's events wait for no loop."""
        event: dict[str, Any] | None = {}
        while event is not None and not self._is_over:
            event = self._node.next(timeout=READ_TIMEOUT)
            events: list[dict[str, Any] | None] = [event]
            if event is not None and event["type"] in ("INPUT_CLOSED", "STOP"):
                # Dora returns these before inputs that came earlier.
                given = [*(self._node.drain() or []), event]
                given.sort(key=lambda it: it["type"] != "INPUT")
                events = [*given]
            for each in events:
                loop.call_soon_threadsafe(self.take, each)


def _cloud(text: str) -> tuple[str, float]:
    name, _, seconds = text.partition("=")
    if name and name != "local":
        with contextlib.suppress(ValueError):
            return name, float(seconds)
    raise argparse.ArgumentTypeError(f"{text!r}: give NAME=SECONDS, and name no cloud local")


def main() -> int:
    """Runs a node with the options in the arguments."""
    parser = argparse.ArgumentParser("python -m fuseline.dora")
    parser.add_argument(
        "--cloud", type=_cloud, action="append", default=[], metavar="NAME=SECONDS",
        help="a cloud and its deadline; later clouds have higher priorities",
    )  # fmt: skip
    parser.add_argument("--local-deadline", type=float, default=1.0, metavar="SECONDS")
    parser.add_argument("--calls", type=int, default=8, help="requests of a source at once")
    parser.add_argument("--window", type=int, default=16, help="messages open at once")
    parser.add_argument("--commit", choices=["eager", "patient"], default="eager")
    parser.add_argument("--trace", metavar="FILE")
    args = parser.parse_args()
    try:
        import dora

        node: Any = dora.Node()  # its stubs lack some methods
    except (ImportError, RuntimeError) as error:
        parser.error(f"not in a dataflow of dora: {error}")
    try:
        fusion = FusionNode(
            node, dict(args.cloud), local_deadline=args.local_deadline, calls=args.calls,
            window=args.window, commit=args.commit, trace=args.trace,
        )  # fmt: skip
    except (ConfigError, TimeError) as error:
        parser.error(str(error))
    asyncio.run(fusion.serve())
    return 0


if __name__ == "__main__":
    sys.exit(main())
