"""Tests clouds over gRPC in both directions, also with the Rust command at the other end."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import fuseline
import grpc
import pytest
import trustme
from conftest import ROOT, serving
from fuseline import Call, CallError, Item, Lineage, Local, Operator, StampedValue
from fuseline._infer import DESCRIPTION, REPLY, REQUEST
from fuseline.grpc import Description, Identity, Remote, Server, Token

DAY = 86_400.0


async def upper(payload: bytes, call: Call) -> bytes:
    return payload.upper()


def call(deadline: float = DAY) -> Call:
    return Call(7, deadline)


def run(main: Callable[[], Coroutine[Any, Any, Any]]) -> Any:
    return asyncio.run(main())


class Certificates:
    """Holds a CA, a server's and a client's certificate, and another CA that nobody trusts."""

    def __init__(self) -> None:
        self._ca, self._other = trustme.CA(), trustme.CA()
        self.ca = self._ca.cert_pem.bytes()
        self.stranger = self._other.cert_pem.bytes()
        self.server = self._issue(self._ca, "127.0.0.1", "localhost")
        self.client = self._issue(self._ca, "operator.example")
        self.forged = self._issue(self._other, "operator.example")

    @staticmethod
    def _issue(ca: trustme.CA, *names: str) -> Identity:
        made = ca.issue_cert(*names)
        chain = b"".join(it.bytes() for it in made.cert_chain_pems)
        return Identity(chain, made.private_key_pem.bytes())


@pytest.fixture(scope="module")
def certificates() -> Certificates:
    return Certificates()


def test_a_payload_goes_there_and_back_with_its_timestamp() -> None:
    seen: list[Call] = []

    async def infer(payload: bytes, call: Call) -> bytes:
        seen.append(call)
        return payload[::-1]

    async def main() -> None:
        async with Server(infer) as server, Remote(server.url) as remote:
            for payload in (b"", b"abc", bytes(20_000_000)):
                assert await remote.infer(payload, call()) == payload[::-1]
            assert await remote.infer(b"x", Call(2**64 - 1, float("inf"))) == b"x"
            assert await remote.infer_stamped(b"x", call()) == StampedValue(b"x", None)
            assert await remote.describe() is None

    run(main)
    assert [it.timestamp for it in seen] == [7, 7, 7, 2**64 - 1, 7]
    # The deadline travels with the call, and gRPC rounds its third digit up. A call without one has
    # none.
    assert DAY - 60 < seen[0].deadline < 1.01 * DAY
    assert seen[3].deadline == float("inf")


def test_what_is_served_is_described() -> None:
    for description in (Description(), Description("DINO", 35.5, 0.0, "a drive", True)):

        async def main(description: Description = description) -> None:
            async with (
                Server(upper, description=description) as server,
                Remote(server.url) as remote,
            ):
                assert await remote.describe() == description

        run(main)


def test_a_call_that_is_given_up_is_cancelled_at_the_server() -> None:
    async def main() -> None:
        begun, ended = asyncio.Event(), asyncio.Event()

        async def infer(payload: bytes, call: Call) -> bytes:
            begun.set()
            try:
                await asyncio.sleep(DAY)
            finally:
                ended.set()
            return payload

        async with Server(infer) as server, Remote(server.url) as remote:
            inferring = asyncio.create_task(remote.infer(b"x", call()))
            await begun.wait()
            inferring.cancel()
            await ended.wait()
            begun.clear()
            ended.clear()
            with pytest.raises(CallError, match=r"^no answer in time$"):
                await remote.infer(b"x", call(0.05))
            await ended.wait()

    run(main)


def test_a_server_that_is_gone_is_reported_and_reached_again() -> None:
    async def main() -> None:
        server = Server(upper)
        await server.start()
        async with Remote(server.url) as remote:
            assert await remote.infer(b"x", call()) == b"X"
            await server.stop()
            with pytest.raises(CallError, match=r"^(connection refused|the connection broke)$"):
                await remote.infer(b"x", call())
            again = Server(upper, server.address)
            await again.start()
            while True:
                try:
                    assert await remote.infer(b"x", call()) == b"X"
                    break
                except CallError:
                    await asyncio.sleep(0.05)
            await again.stop()

    run(main)


def test_whoever_is_not_trusted_is_not_served(certificates: Certificates) -> None:
    it = certificates

    async def main() -> None:
        whole: Any = {"ca": it.ca, "identity": it.client, "token": "secret"}
        async with Server(upper, identity=it.server, client_ca=it.ca, token="secret") as server:
            assert server.url.startswith("https://")
            async with Remote(server.url, **whole) as remote:
                assert await remote.infer(b"x", call()) == b"X"
            for other, message in [
                ({"token": None}, "^a bearer token is needed$"),
                ({"token": "secrets"}, "^the bearer token is wrong$"),
                ({"identity": None}, "."),
                ({"identity": it.forged}, "."),
                ({"ca": it.stranger}, "."),
                ({"server_name": "east.example"}, "."),
            ]:
                async with Remote(server.url, **(whole | other)) as remote:
                    with pytest.raises(CallError, match=message):
                        await remote.infer(b"x", call(2.0))
                    with pytest.raises(CallError):
                        await remote.describe(2.0)
            plain = server.url.replace("https", "http")
            async with Remote(plain) as remote:
                with pytest.raises(CallError):
                    await remote.infer(b"x", call(2.0))

    run(main)


def test_a_token_that_can_be_read_on_the_way_is_reported(caplog: pytest.LogCaptureFixture) -> None:
    Remote("https://west:1", ca=b"", token="secret")
    Remote("http://west:1")
    assert not caplog.records
    Remote("http://west:1", token=Token("secret"))
    assert [it.getMessage() for it in caplog.records] == [
        "anybody on the way can read the token, because http://west:1 is not https"
    ]


def test_a_server_that_is_away_describes_nothing_and_a_connection_is_ended() -> None:
    async def main() -> None:
        server = Server(upper, description=Description("DINO"))
        assert server.address == "127.0.0.1:0"
        await server.start()
        host, _, port = server.address.partition(":")
        assert host == "127.0.0.1" and int(port) > 0
        remote = Remote(server.url)
        async with remote:
            assert (await remote.describe() or Description()).model == "DINO"
            channel = remote._channel
        assert remote._channel is None
        assert channel.get_state() is grpc.ChannelConnectivity.SHUTDOWN
        # The remote connects again when it is used again.
        assert await remote.infer(b"x", call()) == b"X"
        await server.stop()
        await server.stop()
        with pytest.raises(CallError, match=r"^(connection refused|the connection broke)$"):
            await remote.describe(5.0)
        await remote.close()
        await remote.close()

    run(main)


def test_calls_under_way_get_the_grace_and_no_more() -> None:
    async def main() -> None:
        begun, go_on = asyncio.Event(), asyncio.Event()

        async def infer(payload: bytes, call: Call) -> bytes:
            begun.set()
            await go_on.wait()
            return payload

        for grace, answered in ((60.0, True), (0.0, False)):
            server = Server(infer)
            await server.start()
            async with Remote(server.url) as remote:
                calling = asyncio.create_task(remote.infer(b"x", call()))
                await begun.wait()
                stopping = asyncio.create_task(server.stop(grace))
                if answered:
                    await asyncio.sleep(0.01)
                    go_on.set()
                    assert await calling == b"x"
                else:
                    with pytest.raises(CallError):
                        await calling
                await stopping
            begun.clear()
            go_on.clear()

    run(main)


def test_an_error_of_the_cloud_is_reported_in_its_words(caplog: pytest.LogCaptureFixture) -> None:
    async def infer(payload: bytes, call: Call) -> bytes:
        raise OSError("no\nmodel")

    async def main() -> None:
        async with Server(infer) as server, Remote(server.url) as remote:
            with pytest.raises(CallError, match=r"^no model$"):
                await remote.infer(b"x", call())

    run(main)
    assert "message 7 was not computed: no model" in caplog.text


@pytest.mark.parametrize(
    "lineage",
    [
        Lineage(),
        Lineage("camera"),
        Lineage("camera", 5),
        Lineage(within=0.25),
        Lineage("camera", 2**64 - 1, within=1.5),
    ],
)
@pytest.mark.parametrize("age", [None, 0.0, 0.5])
def test_each_part_of_a_lineage_comes_as_it_was_sent(lineage: Lineage, age: float | None) -> None:
    seen: list[Call] = []

    async def infer(payload: bytes, call: Call) -> StampedValue[bytes]:
        seen.append(call)
        return StampedValue(payload, 3, 7)

    async def main() -> None:
        async with Server(infer) as server, Remote(server.url) as remote:
            stamped = await remote.infer_stamped(b"x", Call(7, DAY, lineage, age))
            assert stamped == StampedValue(b"x", 3, 7)

    run(main)
    (came,) = seen
    if lineage == Lineage() and age is None:
        assert (came.lineage, came.age) == (None, None)
        return
    assert came.lineage is not None
    own = came.lineage.origin, came.lineage.seq, came.lineage.within
    assert own == (lineage.origin, lineage.seq, lineage.within)
    assert came.age == age
    assert (came.lineage.captured is None) == (age is None)
    if age is not None:
        since = (time.monotonic_ns() - (came.lineage.captured or 0)) / 1e9
        assert age <= since < age + 60.0


def test_request_without_lineage_keeps_its_bytes() -> None:
    assert REQUEST(timestamp=7, payload=b"x").SerializeToString() == bytes([8, 7, 18, 1]) + b"x"
    assert REPLY(payload=b"y").SerializeToString() == bytes([10, 1]) + b"y"
    assert not REPLY.FromString(bytes([10, 1]) + b"y").HasField("of")


def test_a_token_can_be_replaced_while_it_is_used() -> None:
    token = Token("old")
    assert "old" not in repr(token)

    async def main() -> None:
        async with Server(upper, token=token) as server, Remote(server.url, token="new") as remote:
            with pytest.raises(CallError, match="wrong"):
                await remote.infer(b"x", call())
            token.replace("new")
            assert await remote.infer(b"x", call()) == b"X"

    run(main)


def test_a_certificate_that_cannot_be_used_is_reported(certificates: Certificates) -> None:
    broken = Identity(certificates.server.certificate, b"no key")
    assert "no key" not in repr(broken)

    async def main() -> None:
        with pytest.raises(fuseline.ConfigError, match="certificate or key cannot be used"):
            await Server(upper, identity=broken).start()

    run(main)


def test_an_address_that_is_taken_is_reported(certificates: Certificates) -> None:
    async def main() -> None:
        with socket.socket() as taken:
            taken.bind(("127.0.0.1", 0))
            taken.listen()
            address = f"127.0.0.1:{taken.getsockname()[1]}"
            with pytest.raises(OSError, match=f"cannot listen on {address}"):
                await Server(upper, address).start()
            # The error must name the address, not the certificate.
            with pytest.raises(OSError, match=f"cannot listen on {address}"):
                await Server(upper, address, identity=certificates.server).start()
        async with Server(upper) as server:
            with pytest.raises(OSError, match="cannot listen on"):
                await Server(upper, server.address).start()

    run(main)


def test_more_calls_than_allowed_are_refused() -> None:
    async def main() -> None:
        begun = asyncio.Event()

        async def infer(payload: bytes, call: Call) -> bytes:
            begun.set()
            await asyncio.sleep(DAY)
            return payload

        async with Server(infer, calls=1) as server, Remote(server.url) as remote:
            one = asyncio.create_task(remote.infer(b"x", call()))
            await begun.wait()
            with pytest.raises(CallError):
                await remote.infer(b"x", call())
            one.cancel()

    run(main)


def test_the_messages_are_those_of_the_projects_file(tmp_path: Path) -> None:
    from google.protobuf import descriptor_pb2
    from grpc_tools import protoc

    folder = ROOT / "adapters/tokio/proto"
    out = tmp_path / "set"
    assert protoc.main(["", f"-I{folder}", f"--descriptor_set_out={out}", "fuseline.proto"]) == 0
    (file,) = descriptor_pb2.FileDescriptorSet.FromString(out.read_bytes()).file
    theirs = {message.name: message for message in file.message_type}
    assert file.package == "fuseline.v1"
    assert [method.name for method in file.service[0].method] == ["Infer", "Describe"]
    for made in (REQUEST, REPLY, DESCRIPTION):
        ours = descriptor_pb2.DescriptorProto()
        made.DESCRIPTOR.CopyToProto(ours)
        for message in (ours, theirs[ours.name]):
            for field in message.field:
                field.ClearField("json_name")
        assert ours == theirs[ours.name]


@asynccontextmanager
async def operating(remote: Remote, trace: Path) -> AsyncIterator[Operator[bytes, bytes]]:
    async def local(message: bytes, t: int) -> bytes:
        await asyncio.sleep(DAY)
        return b""

    on_board: Local[bytes, bytes] = Local.task(local, at_once=16, deadline=60.0)
    operator: Operator[bytes, bytes] = Operator(on_board, trace=trace)

    def response_handler(reply: bytes) -> bytes:
        return reply

    operator.use_cloud(remote.infer, lambda m, t: (m, 30.0), response_handler, 1, name="rust")
    async with operator:
        yield operator


@pytest.mark.parametrize("is_secure", [False, True])
def test_rust_serves_an_operator_of_python(
    command: str, tmp_path: Path, certificates: Certificates, is_secure: bool
) -> None:
    files = {}
    for name, text in [
        ("cert", certificates.server.certificate),
        ("key", certificates.server.key),
        ("client-ca", certificates.ca),
        ("token-file", b"secret"),
    ]:
        files[name] = tmp_path / name
        files[name].write_bytes(text)
    arguments = [it for name, path in files.items() for it in (f"--{name}", str(path))]
    settings: Any = {"ca": certificates.ca, "identity": certificates.client, "token": "secret"}

    async def main(url: str) -> list[Item[bytes]]:
        async with Remote(url, **(settings if is_secure else {})) as remote:
            description = await remote.describe()
            assert description is not None
            assert (description.model, description.emulated) == ("DINO-SWIN-Tiny on A100", True)
            async with operating(remote, tmp_path / "trace.jsonl") as operator:
                operator.feed([b"frame"] * 5)
                return [item async for item in operator]

    chosen = ["--model", "DINO-SWIN-Tiny@a100", *(arguments if is_secure else [])]
    with serving(command, *chosen) as url:
        items = asyncio.run(main(url))
    assert [str(item.source) for item in items] == ["rust"] * 5
    assert all(item.value for item in items)
    assert not fuseline.check(tmp_path / "trace.jsonl").violations


def test_python_serves_an_operator_of_rust(
    command: str, tmp_path: Path, certificates: Certificates
) -> None:
    """Runs `fuseline run` with a cloud in Python, over mutual TLS and with a token."""
    left: list[float] = []

    async def infer(payload: bytes, call: Call) -> bytes:
        left.append(call.deadline)
        return b"boxes"

    files = {
        "ca": certificates.ca,
        "cert": certificates.client.certificate,
        "key": certificates.client.key,
        "token": b"secret",
    }
    for name, text in files.items():
        (tmp_path / name).write_bytes(text)
    trace = tmp_path / "trace.jsonl"

    async def main() -> None:
        description = Description("python", 1.0, 60.0)
        async with Server(
            infer,
            identity=certificates.server,
            client_ca=certificates.ca,
            token="secret",
            description=description,
        ) as server:
            keys = ",".join(f"{name}={tmp_path / name}" for name in files)
            cloud = f"name=python,priority=1,url={server.url},{keys}"
            words = ["run", "--for", "1s", "--deadline", "20s", "--policy", "constant"]
            more = ["--window", "64", "--cloud", cloud, "--trace", str(trace)]
            process = await asyncio.create_subprocess_exec(
                command, *words, *more, stdout=asyncio.subprocess.PIPE
            )
            output, _ = await process.communicate()
            assert process.returncode == 0, output.decode()

    asyncio.run(main())
    assert left
    assert all(0 < it <= 20 for it in left)
    verdict = fuseline.check(trace)
    assert not verdict.violations
    read = fuseline.Trace(trace)
    assert read.header["clouds"][0]["name"] == "python"
    emitted = [line.p for line in read.lines if line.ev == "emit"]
    assert 1 in emitted
