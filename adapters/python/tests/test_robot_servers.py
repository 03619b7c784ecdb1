"""Tests the connections to openpi's and LeRobot's servers, with stand-ins for their packages."""

from __future__ import annotations

import pickle
import socket
import sys
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType, SimpleNamespace
from typing import Any

import grpc
import pytest
from fuseline.robot import lerobot, openpi

Modules = Callable[..., None]


@pytest.fixture
def modules(monkeypatch: pytest.MonkeyPatch) -> Modules:
    """Puts modules and their packages where an import finds them."""

    def put(**contents: dict[str, Any]) -> None:
        for name, content in contents.items():
            parts = name.split("__")
            for end in range(1, len(parts) + 1):
                whole = ".".join(parts[:end])
                if whole not in sys.modules or end == len(parts):
                    monkeypatch.setitem(sys.modules, whole, ModuleType(whole))
            sys.modules[".".join(parts)].__dict__.update(content)

    return put


def test_a_connection_of_openpi_ends_at_once_though_its_server_hangs(modules: Modules) -> None:
    ours, theirs = socket.socketpair()
    connected: list[tuple[str, int | None]] = []

    class WebsocketClientPolicy:
        def __init__(self, host: str, port: int | None) -> None:
            connected.append((host, port))
            self._ws = SimpleNamespace(socket=ours)

        def infer(self, observation: Any) -> Any:
            return {"actions": observation}

    modules(openpi_client__websocket_client_policy={"WebsocketClientPolicy": WebsocketClientPolicy})
    connect = openpi("west", 8000)
    assert not connected, "before the first call"
    policy = connect()
    assert connected == [("west", 8000)]
    assert policy.infer([1.0]) == {"actions": [1.0]}
    theirs.settimeout(30)
    policy.close()
    assert theirs.recv(1) == b"", "the connection is open"
    ours.close()
    # The server may have ended the connection.
    policy.close()
    theirs.close()


@dataclass
class TimedObservation:
    timestamp: float
    observation: Any
    timestep: int
    must_go: bool


@dataclass
class TimedAction:
    timestep: int
    action: Any

    def get_timestep(self) -> int:
        return self.timestep

    def get_action(self) -> Any:
        return self.action


class LerobotServer:
    """Answers each observation with nothing, then with an earlier chunk, and then with its own."""

    def __init__(self, channel: LerobotChannel) -> None:
        self.calls, self.replies = channel.calls, list[bytes]()

    def Ready(self, empty: Any) -> None:  # noqa: N802
        self.calls.append(("ready", empty))

    def SendPolicyInstructions(self, setup: SimpleNamespace) -> None:  # noqa: N802
        self.calls.append(("policy", pickle.loads(setup.data)))

    def SendObservations(self, sent: list[bytes]) -> None:  # noqa: N802
        observation = pickle.loads(b"".join(sent))
        assert observation.must_go
        self.calls.append(("observation", (observation.timestep, observation.observation)))
        step = observation.timestep
        for steps in ([], [step - 1, step], [step, step + 1]):
            chunk = [TimedAction(it, f"{observation.observation} at {it}") for it in steps]
            self.replies.append(pickle.dumps(chunk) if chunk else b"")
        self.replies.append(b"one too many")

    def GetActions(self, empty: Any) -> SimpleNamespace:  # noqa: N802
        assert empty == "empty"
        return SimpleNamespace(data=self.replies.pop(0))


class LerobotChannel:
    def __init__(self, address: str) -> None:
        self.address, self.is_closed = address, False
        self.calls: list[tuple[str, Any]] = []

    def close(self) -> None:
        self.is_closed = True


def in_chunks(data: bytes, message: Any, *, silent: bool) -> list[bytes]:
    assert (message, silent) == ("observation", True)
    return [data[:10], data[10:]]


@pytest.mark.parametrize("config", [None, {"policy": "act"}])
def test_a_reply_of_lerobot_is_the_chunk_of_its_own_observation(
    modules: Modules, monkeypatch: pytest.MonkeyPatch, config: Any
) -> None:
    channels: list[LerobotChannel] = []

    def channel(address: str) -> LerobotChannel:
        channels.append(LerobotChannel(address))
        return channels[-1]

    monkeypatch.setattr(grpc, "insecure_channel", channel)
    pb2 = {"Empty": lambda: "empty", "PolicySetup": SimpleNamespace, "Observation": "observation"}
    modules(
        lerobot__async_inference__helpers={"TimedObservation": TimedObservation},
        lerobot__transport={},
        lerobot__transport__services_pb2=pb2,
        lerobot__transport__services_pb2_grpc={"AsyncInferenceStub": LerobotServer},
        lerobot__transport__utils={"send_bytes_in_chunks": in_chunks},
    )
    transport: Any = sys.modules["lerobot.transport"]
    transport.services_pb2 = sys.modules["lerobot.transport.services_pb2"]
    transport.services_pb2_grpc = sys.modules["lerobot.transport.services_pb2_grpc"]
    connect = lerobot("west:8080", config)
    first = connect()
    assert first.infer("a") == ["a at 0", "a at 1"]
    first.close()
    # Steps rise from connection to connection.
    second = connect()
    assert second.infer("b") == ["b at 1", "b at 2"]
    assert [(it.address, it.is_closed) for it in channels] == [
        ("west:8080", True),
        ("west:8080", False),
    ]
    set_up = [("ready", "empty")] + ([] if config is None else [("policy", config)])
    assert channels[0].calls == [*set_up, ("observation", (0, "a"))]
    assert channels[1].calls == [*set_up, ("observation", (1, "b"))]
