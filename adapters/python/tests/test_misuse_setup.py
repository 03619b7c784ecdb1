"""Tests misuse in an operator's parts and in where it runs. See test_misuse.py."""

from __future__ import annotations

import asyncio
import os
from pathlib import Path
from typing import Any

import pytest
from conftest import Run
from fuseline import BlockingOperator, Call, ConfigError, Join, Local, Operator, check
from fuseline.robot import Always, Hold, lerobot, openpi
from misuse import ask, cloud_refused, echo, misuse, operator_of, played, refused


async def without_call(request: Any) -> Any:
    return request


@misuse("gives a function that takes other arguments", "`ConfigError`: what it is called with")
def test_function_of_other_arguments() -> None:
    refused(r"called with \(message, timestamp\)", lambda: operator_of(lambda message: message))
    three: Any = lambda message, t, x: x  # noqa: E731
    refused("missing", lambda: operator_of(Local.threads(three)))
    cloud_refused(r"a handle is called with \(request, call\)", without_call, ask, str, 1)
    cloud_refused("a message handler", echo, lambda message: (message, 0.1), str, 1)
    cloud_refused("a response handler", echo, ask, lambda response, t: response, 1)


@misuse("gives a policy on board that takes other arguments", "`ConfigError`")
def test_on_board_of_other_arguments() -> None:
    remote: Any = object
    on_board: Any = lambda: 0.0  # noqa: E731
    refused("called with", lambda: Always(remote, on_board, deadline=0.1))


@misuse("gives a robot's policy a deadline in milliseconds", "`ConfigError`: divide by 1000")
def test_robot_deadline_in_milliseconds() -> None:
    remote: Any = object
    refused("milliseconds", lambda: Always(remote, Hold(0.0), deadline=300.0))


@misuse("records to a file that is there and is no trace", "`ConfigError`; the file stays")
def test_trace_that_would_overwrite(tmp_path: Path) -> None:
    file = tmp_path / "weights.bin"
    file.write_bytes(b"\x00 no trace")

    async def main(trace: Path) -> None:
        async with operator_of(trace=trace) as operator:
            operator.feed(["a"])
            assert [item.value async for item in operator] == ["a on board"]

    with pytest.raises(ConfigError, match="would overwrite a file that is not a trace"):
        asyncio.run(main(file))
    assert file.read_bytes() == b"\x00 no trace"
    # An empty file and an earlier trace are overwritten.
    trace = tmp_path / "run.jsonl"
    trace.touch()
    for _ in range(2):
        asyncio.run(main(trace))
        assert check(trace).conforms


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")
@misuse("uses an operator in a process that was forked", "`RuntimeError`; no message is taken")
def test_fork_of_an_operator() -> None:
    def forked(operator: Operator[Any, Any]) -> int:
        child = os.fork()
        if child == 0:
            try:
                operator.write("a")
            except RuntimeError as error:
                os._exit(7 if "forked" in str(error) else 1)
            os._exit(0)
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])

    async def main() -> int:
        async with operator_of() as operator:
            code = forked(operator)
            operator.write("b")
            item = await operator.read(5.0)
            assert item is not None and item.value == "b on board"
            return code

    assert asyncio.run(main()) == 7


@misuse("feeds an operator with its own items", "`ConfigError`: read them")
def test_feed_of_its_own_items() -> None:
    async def main() -> None:
        operator: Operator[Any, Any] = operator_of()
        async with operator:
            refused("its own items", lambda: operator.feed(operator))

    asyncio.run(main())


@misuse("returns `NotImplemented`", "a failure, with the remedy")
def test_not_implemented_for_a_value(run: Run[Any]) -> None:
    async def handle(request: Any, call: Call) -> Any:
        return NotImplemented

    (item,), _ = played(run, lambda it, _: it.use_cloud(handle, ask, lambda r: r, 1))
    assert item.value == "a on board"
    assert "raise NotImplementedError" in item.failures[0].why


@misuse("gives a name with a line break", "`ConfigError`")
@pytest.mark.parametrize(
    "name", ["west\n", "left\r\nright", "a\tb", "lane\u2028keeper", "\x1b[31m"]
)
def test_name_with_a_line_break(name: str) -> None:
    words = "line break or another control character"
    refused(words, lambda: operator_of(name=name))
    cloud_refused(words, echo, ask, str, 1, name=name)
    refused(words, lambda: operator_of().use_side_request(echo, ask, print, name=name))
    refused(words, lambda: Join(name=name))
    refused(words, lambda: Join().aligned(name))
    assert operator_of(name="Spur\u00a0Süd 🚗").name == "Spur\u00a0Süd 🚗"


@misuse("uses a `BlockingOperator` in a running event loop", "logged once: what it holds up")
def test_blocking_operator_in_a_loop(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> list[Any]:
        with BlockingOperator(operator_of(name="lane")) as operator:
            for message in range(3):
                operator.write(message)
            return [item.value for _ in range(3) if (item := operator.read(5.0)) is not None]

    assert asyncio.run(main()) == [f"{n} on board" for n in range(3)]
    (record,) = [it for it in caplog.messages if "running event loop" in it]
    assert record.startswith("lane: ") and "`async with`" in record
    with BlockingOperator(operator_of()) as operator:
        operator.close()
    assert len([it for it in caplog.messages if "running event loop" in it]) == 1


@pytest.mark.parametrize("name", ["window", "commit", "greatest_deadline", "trace"])
@misuse("sets an argument of the constructor afterwards", "`AttributeError`: it has no effect then")
def test_argument_that_is_set_later(name: str) -> None:
    operator = operator_of()
    with pytest.raises(AttributeError, match=f"{name} is given when the Operator is made"):
        setattr(operator, name, 4)
    assert not hasattr(operator, name)


@misuse("asks whether a verdict is true", "`TypeError`: `conforms`")
def test_verdict_for_a_bool() -> None:
    verdict = check(b'{"fuseline":1,"window":16,"clouds":[]}\n')
    with pytest.raises(TypeError, match="conforms"):
        assert verdict


@pytest.mark.parametrize("port", ["8000", 0, 80000, True])
@misuse("gives a policy server a port that is none", "`ConfigError`, with the range")
def test_port_that_is_none(port: Any) -> None:
    refused("from 1 to 65535", lambda: openpi("gpu-server", port))


@misuse("gives a policy server an address with a port that is none", "`ConfigError`")
def test_address_of_no_port() -> None:
    for port in (0, 65536):
        refused("from 1 to 65535", lambda port=port: lerobot(f"gpu-server:{port}"))  # type: ignore[misc]
    assert callable(lerobot("gpu-server:65535"))


@pytest.mark.parametrize("host", ["", "http://gpu-server", None])
@misuse("gives a policy server a host that is none", "`ConfigError`, with an example")
def test_host_that_is_none(host: Any) -> None:
    refused("a host of", lambda: openpi(host, 8000))
    refused("give host and port", lambda: lerobot(host))


@pytest.mark.parametrize("address", ["gpu-server", "gpu-server:", "gpu-server:http", ":8080"])
@misuse("gives a policy server an address without a port", "`ConfigError`, with an example")
def test_address_without_a_port(address: str) -> None:
    refused("give host and port", lambda: lerobot(address))
