"""Connects operators to clouds over gRPC: a handle for `Operator.use_cloud`, and a server.

Both speak ``fuseline.v1.Infer``, as Rust's operators and the command ``fuseline serve`` do. A
`Remote` connects to a cloud, and its method `Remote.infer` is the handle:

    async with Remote("https://west.example:50051", ca=ca, token="secret") as west:
        operator.use_cloud(west.infer, message_handler, response_handler, 1)

Payloads are bytes, encoded as operator and cloud agreed. The deadline and the lineage travel with
each call. `Remote.infer_stamped` also returns the message that the reply names.
"""

from __future__ import annotations

import asyncio
import hmac
import logging
import math
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any
from urllib.parse import urlsplit

from fuseline._errors import CallError, ConfigError, in_one_line
from fuseline._item import Call, Lineage, StampedValue
from fuseline._validation import ns
from fuseline._wiring import check_handle, check_read

try:
    import grpc
    from google.protobuf import empty_pb2

    from fuseline._infer import DESCRIPTION, MESSAGE_BYTES, REPLY, REQUEST, Description
except ImportError as error:
    raise ImportError(
        "fuseline.grpc needs grpcio and protobuf: pip install fuseline[grpc]"
    ) from error

__all__ = ["MESSAGE_BYTES", "Description", "Identity", "Remote", "Server", "Token"]

_SERVICE = "fuseline.v1.Infer"
_log = logging.getLogger("fuseline")


@dataclass(frozen=True)
class Identity:
    """Holds a certificate and its private key."""

    #: The certificate and the chain from it to the CA, in PEM.
    certificate: bytes
    #: The private key, in PEM.
    key: bytes

    def __repr__(self) -> str:
        return "Identity(…)"


class Token:
    """Holds a bearer token that can be replaced while connections or a server use it.

    Raises:
        ConfigError: if it is empty, or has characters other than visible ASCII.
    """

    def __init__(self, token: str) -> None:
        self.replace(token)

    def replace(self, token: str) -> None:
        """Replaces the token, for calls from now on."""
        if not token or not all("!" <= it <= "~" for it in token):
            raise ConfigError("a token must be one or more visible ASCII characters")
        self._header = f"Bearer {token}"

    def __repr__(self) -> str:
        return "Token(…)"

    def _is_shown(self, metadata: Any) -> bool | None:
        """Returns True if a call shows this token, and None if it shows none."""
        for key, value in metadata or ():
            if key == "authorization":
                shown = value if isinstance(value, bytes) else value.encode()
                # The comparison takes equally long wherever the texts differ.
                return hmac.compare_digest(shown, self._header.encode())
        return None


class Remote:
    """Calls a cloud over gRPC, and keeps the connection to it.

    It connects when it is first used, and again after it was lost. If it cannot connect, or the
    connection breaks, calls fail at once (F4).

    Args:
        url: ``https://host:port``, or ``http://host:port`` without TLS.
        ca: The certificates of the CAs that may have signed the server's certificate, in PEM.
            Needed with https; the system's CAs are not used.
        identity: The client's own certificate, for servers that ask for one (mutual TLS).
        server_name: The name that the server's certificate must be for; by default the URL's host.
        token: The token that each call carries, as ``authorization: Bearer …``.

    Raises:
        ConfigError: if these settings cannot work. If the server does not answer, the calls fail.
    """

    def __init__(
        self,
        url: str,
        *,
        ca: bytes | None = None,
        identity: Identity | None = None,
        server_name: str | None = None,
        token: Token | str | None = None,
    ) -> None:
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname or not _port(parts):
            raise ConfigError(
                f"the cloud's URL {url!r}; it must be http://host:port or https://host:port"
            )
        is_secure = parts.scheme == "https"
        if is_secure and ca is None:
            raise ConfigError(
                "an https URL needs the certificate of the CA that signed the server's certificate"
            )
        if not is_secure and (ca is not None or identity is not None):
            raise ConfigError("certificates need an https URL, but this one is http")
        #: The URL.
        self.url = url
        self._token = Token(token) if isinstance(token, str) else token
        if self._token is not None and not is_secure:
            _log.warning("anybody on the way can read the token, because %s is not https", url)
        self._target = parts.netloc
        self._credentials = (ca, identity) if is_secure else None
        self._server_name = server_name
        self._channel: Any = None

    def __repr__(self) -> str:
        return f"Remote({self.url!r})"

    async def __aenter__(self) -> Remote:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        where: TracebackType | None,
    ) -> None:
        await self.close()

    async def infer(self, payload: bytes, call: Call) -> bytes:
        """Asks the cloud to compute a message. This is the handle for `Operator.use_cloud`.

        Raises:
            CallError: if the cloud or the connection to it fails, or the deadline passes.
        """
        return (await self.infer_stamped(payload, call)).value

    async def infer_stamped(self, payload: bytes, call: Call) -> StampedValue[bytes]:
        """Computes a message. Returns a `StampedValue` with the messages that the reply names.

        Raises:
            CallError: if the cloud or the connection to it fails, or the deadline passes.
        """
        request = REQUEST(timestamp=call.timestamp, payload=payload)
        lineage = call.lineage
        if lineage is not None:
            age = None if call.age is None else round(call.age * 1e9)
            fields = {
                "origin": lineage.origin,
                "seq": lineage.seq,
                "age_ns": age,
                "within_ns": lineage.within,
            }
            for name, value in fields.items():
                if value is not None:
                    setattr(request.lineage, name, value)
        reply = await self._call("Infer", request, REPLY, call.deadline)
        return StampedValue(bytes(reply.payload), *_given(reply, "of", "meant_for"))

    async def describe(self, deadline: float = 5.0) -> Description | None:
        """Returns the cloud's description of what it serves, or None if it has none.

        Raises:
            CallError: if the cloud or the connection to it fails, or the seconds pass.
        """
        try:
            reply = await self._call("Describe", empty_pb2.Empty(), DESCRIPTION, deadline)
        except CallError as error:
            cause = error.__cause__
            if isinstance(cause, grpc.RpcError) and cause.code() is grpc.StatusCode.UNIMPLEMENTED:
                return None
            raise
        runtime_ms, ap = _given(reply, "runtime_ms", "ap")
        return Description(reply.model, runtime_ms, ap, reply.drive, reply.emulated)

    async def close(self) -> None:
        """Ends the connection."""
        channel, self._channel = self._channel, None
        if channel is not None:
            await channel.close()

    async def _call(self, method: str, request: Any, reply: Any, deadline: float) -> Any:
        if self._channel is None:
            self._channel = self._connect()
        ask = self._channel.unary_unary(
            f"/{_SERVICE}/{method}",
            request_serializer=type(request).SerializeToString,
            response_deserializer=reply.FromString,
        )
        token = self._token
        metadata = None if token is None else (("authorization", token._header),)
        timeout = None if math.isinf(deadline) else deadline
        try:
            return await ask(request, timeout=timeout, metadata=metadata)
        except grpc.RpcError as error:
            raise CallError(_plain(error)) from error

    def _connect(self) -> Any:
        options: list[tuple[str, int | str]] = [
            ("grpc.max_send_message_length", MESSAGE_BYTES),
            ("grpc.max_receive_message_length", MESSAGE_BYTES),
            # A cloud that returns is asked again soon. Local does not wait for it meanwhile.
            ("grpc.initial_reconnect_backoff_ms", 100),
            ("grpc.min_reconnect_backoff_ms", 1000),
            ("grpc.max_reconnect_backoff_ms", 1000),
            ("grpc.keepalive_time_ms", 5000),
            ("grpc.keepalive_timeout_ms", 2000),
        ]
        if self._credentials is None:
            return grpc.aio.insecure_channel(self._target, options)
        ca, identity = self._credentials
        pair = (None, None) if identity is None else (identity.key, identity.certificate)
        if self._server_name is not None:
            options.append(("grpc.ssl_target_name_override", self._server_name))
        credentials = grpc.ssl_channel_credentials(ca, *pair)
        return grpc.aio.secure_channel(self._target, credentials, options)


class Server:
    """Serves ``fuseline.v1.Infer``: the cloud's side.

    Use it as a context manager, or call `start` and `stop`. When the caller gives up or its
    deadline passes, the computation is cancelled. An exception becomes the caller's failure, with
    its text.

    Args:
        infer: Computes a message: an ``async def`` of the payload and its `Call`. The call's
            deadline is the time left in seconds, or infinite if the caller set none. Its lineage is
            the request's, with the capture on this host's ``time.monotonic_ns``; the time on the
            way is not known. It may return a `StampedValue` to name the message that the reply was
            computed from.
        address: ``host:port``; port 0 chooses one, see `address`.
        identity: The server's certificate; with it, the server speaks TLS.
        client_ca: The certificates of the CAs that may have signed a client's certificate, in PEM
            (mutual TLS).
        token: The token that each call must carry.
        description: The description of what the server serves, for clients that ask.
        calls: The greatest number of calls under way. A further call is refused.

    Raises:
        ConfigError: if ``client_ca`` is given without ``identity``.

    >>> import asyncio
    >>> from fuseline import Operator
    >>> async def upper(payload, call):  # the cloud's computation
    ...     return payload.upper()
    >>> async def main():
    ...     async with Server(upper) as server, Remote(server.url) as west:
    ...         operator = Operator(lambda text, t: text)
    ...         send = lambda text, t: (text.encode(), 5.0)
    ...         operator.use_cloud(west.infer, send, bytes.decode, 1)
    ...         async with operator:
    ...             operator.feed(["hello"])
    ...             return [item.value async for item in operator]
    >>> asyncio.run(main())
    ['HELLO']
    """

    def __init__(
        self,
        infer: Callable[[bytes, Call], Awaitable[bytes | StampedValue[bytes]]],
        address: str = "127.0.0.1:0",
        *,
        identity: Identity | None = None,
        client_ca: bytes | None = None,
        token: Token | str | None = None,
        description: Description | None = None,
        calls: int = 64,
    ) -> None:
        if client_ca is not None and identity is None:
            raise ConfigError(
                "a server that asks for clients' certificates needs a certificate and a key of its "
                "own"
            )
        check_handle(infer)
        if not isinstance(address, str):
            raise ConfigError(f"an address of {address!r}; it must be a text such as '127.0.0.1:0'")
        self._infer = infer
        self._wanted = address
        self._identity, self._client_ca = identity, client_ca
        self._token = Token(token) if isinstance(token, str) else token
        self._description = description
        self._calls = calls
        self._server: Any = None
        #: The address at which it listens, once it does: ``host:port``.
        self.address = address

    @property
    def url(self) -> str:
        """Returns the server's URL, for `Remote`."""
        return f"{'http' if self._identity is None else 'https'}://{self.address}"

    async def start(self) -> None:
        """Listens for calls.

        Raises:
            OSError: if the address cannot be listened on.
            ConfigError: if the certificate or the key cannot be used.
        """
        options = [
            ("grpc.max_send_message_length", MESSAGE_BYTES),
            ("grpc.max_receive_message_length", MESSAGE_BYTES),
            ("grpc.so_reuseport", 0),
            # Operators ping a silent connection every 5 s.
            ("grpc.http2.min_ping_interval_without_data_ms", 2000),
        ]
        server = grpc.aio.server(options=options, maximum_concurrent_rpcs=self._calls)
        handlers = {
            "Infer": grpc.unary_unary_rpc_method_handler(
                self._computes, REQUEST.FromString, REPLY.SerializeToString
            ),
            "Describe": grpc.unary_unary_rpc_method_handler(
                self._describes, empty_pb2.Empty.FromString, DESCRIPTION.SerializeToString
            ),
        }
        handler = grpc.method_handlers_generic_handler(_SERVICE, handlers)
        server.add_generic_rpc_handlers((handler,))
        try:
            port = self._bind(server)
        except RuntimeError as error:
            if self._identity is not None and self._is_free(options):
                raise ConfigError("the server's certificate or key cannot be used") from error
            raise OSError(
                f"the server cannot listen on {self._wanted}; choose an address of this host and "
                "a free port"
            ) from error
        if port == 0:
            raise ConfigError("the server's certificate or key cannot be used")
        await server.start()
        self._server = server
        self.address = f"{self._wanted.rpartition(':')[0]}:{port}"

    async def stop(self, grace: float = 0.0) -> None:
        """Accepts no new calls, and gives those under way ``grace`` seconds to end."""
        server, self._server = self._server, None
        if server is not None:
            await server.stop(grace)

    async def __aenter__(self) -> Server:
        await self.start()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        where: TracebackType | None,
    ) -> None:
        await self.stop()

    def _bind(self, server: Any) -> int:
        if self._identity is None:
            return int(server.add_insecure_port(self._wanted))
        credentials = grpc.ssl_server_credentials(
            [(self._identity.key, self._identity.certificate)],
            self._client_ca,
            self._client_ca is not None,
        )
        return int(server.add_secure_port(self._wanted, credentials))

    def _is_free(self, options: Any) -> bool:
        """Returns True if the server can listen on the address."""
        try:
            return bool(grpc.aio.server(options=options).add_insecure_port(self._wanted))
        except RuntimeError:
            return False

    async def _computes(self, request: Any, context: Any) -> Any:
        await self._admit(context)
        left = context.time_remaining()
        call = Call(request.timestamp, math.inf if left is None else left, *_lineage(request))
        try:
            value = await self._infer(request.payload, call)
            check_read(value, "infer of the server")
            if isinstance(value, StampedValue):
                return REPLY(payload=value.value, of=value.of, meant_for=value.meant_for)
            return REPLY(payload=value)
        except asyncio.CancelledError:
            raise
        except Exception as error:
            why = in_one_line(error)[:200]
            _log.warning("message %d was not computed: %s", request.timestamp, why)
        return await context.abort(grpc.StatusCode.INTERNAL, why)

    async def _describes(self, _: Any, context: Any) -> Any:
        await self._admit(context)
        description = self._description
        if description is None:
            why = "the server does not say what it serves"
            return await context.abort(grpc.StatusCode.UNIMPLEMENTED, why)
        given = {name: value for name, value in vars(description).items() if value is not None}
        return DESCRIPTION(**given)

    async def _admit(self, context: Any) -> None:
        """Refuses a call that does not show the token (D12)."""
        if self._token is None:
            return
        shown = self._token._is_shown(context.invocation_metadata())
        if not shown:
            why = "a bearer token is needed" if shown is None else "the bearer token is wrong"
            await context.abort(grpc.StatusCode.UNAUTHENTICATED, why)


def _lineage(request: Any) -> tuple[Lineage | None, float | None]:
    """Returns a request's lineage, and its age in seconds as the request states it."""
    if not request.HasField("lineage"):
        return None, None
    names = "origin", "seq", "age_ns", "within_ns"
    origin, seq, age, within = _given(request.lineage, *names)
    captured = None if age is None else time.monotonic_ns() - age
    lineage = Lineage(
        origin,
        None if origin is None else seq,
        captured,
        None if within is None else ns(within),
    )
    return lineage, None if age is None else age / 1e9


def _given(message: Any, *names: str) -> list[Any]:
    """Returns these fields of a message. A field that it lacks is None."""
    return [getattr(message, name) if message.HasField(name) else None for name in names]


def _port(parts: Any) -> int | None:
    try:
        port: int | None = parts.port
    except ValueError:
        return None
    return port


def _plain(error: Any) -> str:
    """Returns in a few plain words why a call failed."""
    details = " ".join((error.details() or "").split())
    if "onnection refused" in details:
        return "connection refused"
    if error.code() is grpc.StatusCode.DEADLINE_EXCEEDED:
        return "no answer in time"
    if any(it in details for it in ("Socket closed", "onnection reset", "GOAWAY", "Broken pipe")):
        return "the connection broke"
    if "Ssl handshake failed" in details or "SSL_ERROR" in details or "ertificate" in details:
        return f"no TLS connection: {details}"[:200]
    return details[:200] or str(error.code().name).lower()
