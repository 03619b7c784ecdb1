"""A server whose replies come as late as the scenario says: python server.py KIND FOLDER SCENARIO PORT.

It prints its port, and records each result when it is on its way.
"""

from __future__ import annotations

import pickle
import queue
import socket
import sys
import threading
import time
from concurrent import futures
from typing import Any

from facts import Facts, Scenario

kind, folder, scenario = sys.argv[1], sys.argv[2], Scenario(sys.argv[3])
port = int(sys.argv[4]) if len(sys.argv) > 4 else 0
record = Facts(folder, f"server-{time.monotonic_ns()}")


def delay(t: int, attempt: int = 0) -> Any:
    """Returns the delay of a message's attempt: seconds, None for never, "fail"."""
    t = t % len(scenario.delays) if scenario.repeats else t
    planned = scenario.delays[t] if 0 <= t < len(scenario.delays) else 1
    if isinstance(planned, list):
        planned = planned[min(attempt, len(planned) - 1)]
    return planned / 1e3 if isinstance(planned, (int, float)) else planned


def lines() -> None:
    """A line `t attempt` is answered with the same line."""

    def serve(client: socket.socket) -> None:
        with client, client.makefile("rw") as stream:
            for line in stream:
                t, attempt = map(int, line.split())
                seconds = delay(t, attempt)
                if seconds == "fail":
                    return
                time.sleep(60 if seconds is None else seconds)
                stream.write(line)
                stream.flush()
                record("result", t, p=1, of=t, **{"try": attempt})

    listener = socket.create_server(("127.0.0.1", port), backlog=64)
    print(listener.getsockname()[1], flush=True)
    while True:
        threading.Thread(target=serve, args=(listener.accept()[0],), daemon=True).start()


def openpi() -> None:
    """A policy server of openpi; like the real one it answers observations in their order."""
    from openpi_client import msgpack_numpy
    from websockets.sync.server import serve

    def handle(client: Any) -> None:
        client.send(msgpack_numpy.packb({}))
        for raw in client:
            t = int(msgpack_numpy.unpackb(raw)["t"])
            seconds = delay(t)
            if seconds == "fail":
                return
            time.sleep(60 if seconds is None else seconds)
            client.send(msgpack_numpy.packb({"of": t}))
            record("result", t, p=1, of=t)

    with serve(handle, "127.0.0.1", port, compression=None) as server:
        print(server.socket.getsockname()[1], flush=True)
        server.serve_forever()


def positronic() -> None:
    """An inference server of positronic, version 3 of its protocol."""
    from positronic_model_server import serialization
    from websockets.sync.server import serve

    def handle(client: Any) -> None:
        ready = {"status": "ready", "meta": {}, "protocol_version": 3, "session_id": "s"}
        client.send(serialization.serialise(ready))
        for raw in client:
            message = serialization.deserialise(raw)
            if "observation" not in message:
                client.send(raw)
                continue
            t = int(message["observation"]["t"])
            seconds = delay(t)
            if seconds == "fail":
                return
            time.sleep(60 if seconds is None else seconds)
            client.send(serialization.serialise({"result": {"of": t}}))
            record("result", t, p=1, of=t)

    with serve(handle, "127.0.0.1", port, compression=None) as server:
        print(server.socket.getsockname()[1], flush=True)
        server.serve_forever()


def lerobot() -> None:
    """A policy server of LeRobot; the scenario's delays are those of the chunks."""
    import grpc
    import stubs
    from lerobot.async_inference.helpers import TimedAction
    from lerobot.transport import services_pb2, services_pb2_grpc
    from lerobot.transport.utils import receive_bytes_in_chunks

    class Policy(services_pb2_grpc.AsyncInferenceServicer):  # type: ignore[misc]
        def __init__(self) -> None:
            self.observations: queue.Queue[Any] = queue.Queue(maxsize=1)
            self.chunks = 0

        def Ready(self, request: Any, context: Any) -> Any:
            return services_pb2.Empty()

        def SendPolicyInstructions(self, request: Any, context: Any) -> Any:
            return services_pb2.Empty()

        def SendObservations(self, parts: Any, context: Any) -> Any:
            data = receive_bytes_in_chunks(parts, None, threading.Event(), "")
            while not self.observations.empty():
                self.observations.get()
            self.observations.put(pickle.loads(data))
            return services_pb2.Empty()

        def GetActions(self, request: Any, context: Any) -> Any:
            try:
                first = self.observations.get(timeout=2).get_timestep()
            except queue.Empty:
                return services_pb2.Empty()
            seconds = delay(self.chunks % len(scenario.delays))
            self.chunks += 1
            time.sleep(60 if seconds is None else seconds)
            actions = [
                TimedAction(timestamp=0, timestep=t, action=stubs.Tensor([first, t]))
                for t in range(first, first + scenario.chunk)
            ]
            return services_pb2.Actions(data=pickle.dumps(actions))

    server = grpc.server(futures.ThreadPoolExecutor(8))
    services_pb2_grpc.add_AsyncInferenceServicer_to_server(Policy(), server)
    print(server.add_insecure_port(f"127.0.0.1:{port}"), flush=True)
    server.start()
    server.wait_for_termination()


{"lines": lines, "openpi": openpi, "positronic": positronic, "lerobot": lerobot}[kind]()
