"""Connects to the policy servers of openpi and LeRobot."""

from __future__ import annotations

import contextlib
import itertools
import socket
import time
from collections.abc import Callable
from typing import Any

from fuseline._errors import ConfigError
from fuseline._remote import RemotePolicy


def openpi(host: str, port: int | None = None) -> Callable[[], RemotePolicy]:
    """Connects to a policy server of openpi, by the package ``openpi-client``.

    Raises:
        ConfigError: if the host or the port cannot be one.
    """
    if not isinstance(host, str) or not host or host.startswith("http"):
        raise ConfigError(f"a host of {host!r}; give a name such as 'gpu-server', or ws://…")
    if port is not None:
        _check_port(port, "a port of")

    class OpenpiRemote:
        def __init__(self) -> None:
            try:
                from openpi_client.websocket_client_policy import WebsocketClientPolicy
            except ModuleNotFoundError as error:
                raise ImportError(f"openpi needs the package openpi-client: {error}") from error

            self._policy = WebsocketClientPolicy(host, port)

        def infer(self, observation: Any) -> Any:
            return self._policy.infer(observation)

        def close(self) -> None:
            # Closing with the protocol's handshake would wait for the server, which may hang. A
            # connection that the server has ended cannot be shut down any more.
            with contextlib.suppress(OSError):
                self._policy._ws.socket.shutdown(socket.SHUT_RDWR)

    return OpenpiRemote


def lerobot(address: str, config: Any = None) -> Callable[[], RemotePolicy]:
    """Connects to a policy server of LeRobot, by the package ``lerobot``.

    A reply is a chunk: a list of its actions. Observations are dictionaries.

    Args:
        address: The server's host and port.
        config: A ``RemotePolicyConfig``, sent to each new connection; with None the server needs
            none.

    Raises:
        ConfigError: if the address has no host or no port.
    """
    if not isinstance(address, str) or not address.startswith("unix:"):
        _check_address(address)
    # Steps keep rising across connections, so that no reply is mistaken for another call's.
    steps = itertools.count()

    class LerobotRemote:
        def __init__(self) -> None:
            import pickle

            try:
                import grpc
                from lerobot.async_inference.helpers import TimedObservation
                from lerobot.transport import services_pb2, services_pb2_grpc
                from lerobot.transport.utils import send_bytes_in_chunks
            except ModuleNotFoundError as error:
                raise ImportError(
                    f"lerobot needs fuseline[grpc] and the package lerobot: {error}"
                ) from error

            self._pickle, self._observation = pickle, TimedObservation
            self._messages, self._in_chunks = services_pb2, send_bytes_in_chunks
            self._channel = grpc.insecure_channel(address)
            self._stub = services_pb2_grpc.AsyncInferenceStub(self._channel)
            self._stub.Ready(services_pb2.Empty())
            if config is not None:
                setup = services_pb2.PolicySetup(data=pickle.dumps(config))
                self._stub.SendPolicyInstructions(setup)

        def infer(self, observation: Any) -> Any:
            step = next(steps)
            timed = self._observation(
                timestamp=time.time(), observation=observation, timestep=step, must_go=True
            )
            data = self._pickle.dumps(timed)
            self._stub.SendObservations(
                self._in_chunks(data, self._messages.Observation, silent=True)
            )
            while True:
                reply = self._stub.GetActions(self._messages.Empty())
                actions = self._pickle.loads(reply.data) if reply.data else []
                # A server that gets no observation answers with nothing.
                meant_for = [action.get_timestep() for action in actions]
                if not meant_for or meant_for[0] != step:
                    continue
                if meant_for != list(range(step, step + len(actions))):
                    raise ValueError(
                        f"the chunk is for the steps {meant_for}, which are not consecutive"
                    )
                return [action.get_action() for action in actions]

        def close(self) -> None:
            self._channel.close()

    return LerobotRemote


def _check_address(address: Any) -> None:
    host, _, port = address.rpartition(":") if isinstance(address, str) else ("", "", "")
    if not host or host.startswith("http") or not port.isdecimal():
        raise ConfigError(f"an address of {address!r}; give host and port, as 'gpu-server:8080'")
    _check_port(int(port), f"the port of {address!r}:")


def _check_port(port: Any, what: str) -> None:
    if not isinstance(port, int) or isinstance(port, bool) or not 1 <= port <= 65535:
        raise ConfigError(f"{what} {port!r}; it must be an int from 1 to 65535")
