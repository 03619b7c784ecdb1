"""Tests misuse of traces, processes, encoders and a program's end. See test_misuse.py."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from fuseline import BlockingOperator, ConfigError, Ending, Local, Operator, TraceError, check
from misuse import ask, echo, misuse, on_board, operator_of, refused


def ended(code: str, *arguments: str, timeout: float = 60.0) -> subprocess.CompletedProcess[str]:
    """Runs a program in a process of its own. Returns how it ended."""
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )


# Traces.


@pytest.mark.parametrize("link", [False, True])
@misuse("records two operators to one file", "`ConfigError`; the first goes on, and its trace")
def test_one_trace_twice(tmp_path: Path, link: bool) -> None:
    trace = tmp_path / "run.jsonl"
    other = tmp_path / "link.jsonl"
    other.symlink_to(trace)

    async def main() -> None:
        async with operator_of(trace=trace) as operator:
            with pytest.raises(ConfigError, match="written by another operator"):
                await operator_of(trace=other if link else trace).start()
            operator.feed(range(50))
            assert len([item async for item in operator]) == 50
        # Once the operator has ended, another one may overwrite its trace.
        async with operator_of(trace=trace) as operator:
            operator.write(1)
            await operator.read()

    asyncio.run(main())
    assert check(trace).judged == 1


@misuse("records to a file that another program records to", "`ConfigError`")
def test_trace_of_another_program(tmp_path: Path) -> None:
    trace = tmp_path / "run.jsonl"
    code = """
import sys
from fuseline import BlockingOperator, Operator
with BlockingOperator(Operator(lambda m, t: m, trace=sys.argv[1])):
    print("starts", flush=True)
    sys.stdin.read()
"""
    command = [sys.executable, "-c", code, str(trace)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdin is not None
        assert other.stdout.readline() == b"starts\n"
        refused(
            "another operator",
            lambda: BlockingOperator(operator_of(trace=trace)).__enter__(),
        )
        other.stdin.close()
    assert not check(trace).violations


def test_no_trace_is_left_of_an_operator_that_is_none(tmp_path: Path) -> None:
    trace = tmp_path / "run.jsonl"
    operator = operator_of(trace=trace)
    operator.use_cloud(echo, ask, str, 1, limit=2, resume=2)
    refused("resume below", BlockingOperator(operator).__enter__)
    assert not trace.exists()
    for path in (tmp_path, tmp_path / "nowhere" / "run.jsonl"):
        refused("directory", BlockingOperator(operator_of(trace=path)).__enter__, OSError)


@pytest.mark.parametrize("replaced", [False, True])
@misuse(
    "removes or replaces the trace's file", "`recording_error` at once; `TraceError` at the end"
)
def test_trace_that_is_removed(tmp_path: Path, replaced: bool) -> None:
    trace = tmp_path / "run.jsonl"

    async def main() -> None:
        async with operator_of(trace=trace) as operator:
            assert operator.recording_error is None
            trace.rename(tmp_path / "rotated.jsonl")
            if replaced:
                trace.write_text("")
            operator.write(1)
            await operator.read()
            assert "while it was written" in str(operator.recording_error)
            operator.close()

    with pytest.raises(TraceError, match="replaced" if replaced else "removed"):
        asyncio.run(main())


UNCLOSED = {
    "blocking": """
import sys
from fuseline import BlockingOperator, Operator
operator = BlockingOperator(Operator(lambda m, t: m, trace=sys.argv[1])).__enter__()
for n in range(40):
    operator.write(n); operator.read()
""",
    "asyncio": """
import asyncio, sys
from fuseline import Operator
async def main():
    global operator
    operator = Operator(lambda m, t: m, trace=sys.argv[1])
    await operator.start()
    for n in range(40):
        operator.write(n); await operator.read()
asyncio.run(main())
""",
    "robot": """
import sys
from fuseline.robot import Always, Hold
def refuses(): raise ConnectionRefusedError
policy = Always(refuses, Hold(0.0), deadline=0.5, trace=sys.argv[1])
for n in range(40): policy.infer(n)
sys.exit("an error")
""",
    "fork": """
import os, sys
from fuseline import BlockingOperator, Operator
operator = BlockingOperator(Operator(lambda m, t: m, trace=sys.argv[1])).__enter__()
for n in range(40):
    if n == 20 and os.fork() == 0: sys.exit(0)
    operator.write(n); operator.read()
os.wait()
""",
}


@pytest.mark.parametrize("program", UNCLOSED)
@misuse("ends the program without `close`", "the trace has each message; logged")
def test_program_that_ends_without_close(tmp_path: Path, program: str) -> None:
    trace = tmp_path / "run.jsonl"
    end = ended(UNCLOSED[program], str(trace))
    verdict = check(trace)
    assert (verdict.conforms, verdict.judged) == (True, 40), end.stderr
    assert "the operator was not closed: its trace ends here" in end.stderr


# Processes.


PROGRAM = """
import asyncio, sys, time
from fuseline import Local, Operator
def hangs(message, t):
    time.sleep(3600)
async def main():
    operator = Operator(Local.processes(hangs, deadline=0.2))
    if sys.argv[1] == "block":
        async with operator:
            operator.write(1)
            print((await operator.read()).ending.name)
    else:
        await operator.start()
        operator.write(1)
        print((await operator.read()).ending.name)
"""
GUARD = 'if __name__ == "__main__":\n    asyncio.run(main())\n'


@pytest.mark.parametrize("end", ["block", "no block"])
@misuse("computes in a process that hangs", "missed; the program ends, and the process with it")
def test_process_that_hangs(tmp_path: Path, end: str) -> None:
    script = tmp_path / "program.py"
    script.write_text(PROGRAM + GUARD)
    begin = time.monotonic()
    run = subprocess.run(
        [sys.executable, str(script), end], capture_output=True, text=True, timeout=30, check=False
    )
    assert run.stdout == "MISSED\n", run.stderr
    assert time.monotonic() - begin < 30


@misuse("starts processes in a script without its guard", "`ConfigError`: `__main__`")
def test_script_without_its_guard(tmp_path: Path) -> None:
    script = tmp_path / "program.py"
    script.write_text(PROGRAM + "asyncio.run(main())\n")
    run = subprocess.run(
        [sys.executable, str(script), "block"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert run.returncode == 1
    assert 'must begin with `if __name__ == "__main__":`' in run.stderr


@misuse("gives `Local.processes` what has no name", "`ConfigError`: a function of a module")
def test_lambda_for_a_process() -> None:
    operator = operator_of(Local.processes(lambda message, t: message))
    refused("a function of a module", BlockingOperator(operator).__enter__)


class Unpicklable(Exception):
    """Takes more arguments than it stores, so it cannot be unpickled."""

    def __init__(self, first: str, second: str) -> None:
        super().__init__(first + second)


def fails(message: str, t: int) -> Any:
    if message == "error":
        raise Unpicklable("no ", "camera")
    if message == "result":
        return threading.Lock()
    if message == "exit":
        sys.exit("no licence")
    if message == "dies":
        os._exit(3)
    return message


@misuse("raises or returns in a process what cannot be sent", "a failure; it computes on")
def test_process_that_cannot_answer() -> None:
    words = {
        "error": "no camera",
        "result": "the result cannot be sent",
        "exit": "no licence",
        "dies": "its process died with code 3",
    }
    with BlockingOperator(operator_of(Local.processes(fails, deadline=30.0))) as operator:
        for message, why in words.items():
            operator.write(message)
            item = operator.read(60)
            assert item is not None
            assert item.ending is Ending.MISSED
            assert why in item.failures[0].why
            operator.write("a")
            item = operator.read(60)
            assert item is not None
            assert item.value == "a"
        operator.write(threading.Lock())
        item = operator.read(60)
        assert item is not None
        assert "pickle" in item.failures[0].why


# Encoders.


@misuse("encodes with a function that hangs", "logged and counted; other threads encode on")
def test_encode_that_hangs(caplog: pytest.LogCaptureFixture) -> None:
    go_on = threading.Event()

    def encode(message: int) -> int:
        if message < 8:
            go_on.wait(60)
        return message

    async def handle(request: int, call: Any) -> str:
        return f"{request} in the cloud"

    async def main() -> Any:
        operator: Operator[int, Any] = Operator(on_board)
        operator.use_cloud(handle, ask, str, 1, encode=encode, name="west")
        async with operator:
            value: Any = None
            for message in range(12):
                operator.write(message)
                item = await operator.read()
                value = item and item.value
            go_on.set()
            return value, operator.counts["west", "handler", "failed"]

    assert asyncio.run(main()) == ("11 in the cloud", 8)
    assert "encode of west has not ended by its deadline" in caplog.text


@misuse("encodes with a function that always hangs", "a failure at once, with the reason")
def test_encode_that_always_hangs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fuseline._encoding.HUNG_ENCODERS", 3)
    go_on = threading.Event()

    def encode(message: int) -> int:
        go_on.wait(60)
        return message

    async def handle(request: int, call: Any) -> int:
        return request

    async def main() -> Any:
        operator: Operator[int, Any] = Operator(on_board)
        operator.use_cloud(handle, lambda m, t: (m, 0.02), str, 1, encode=encode)
        async with operator:
            for message in range(5):
                operator.write(message)
                item = await operator.read()
            go_on.set()
            return item

    item = asyncio.run(main())
    assert "3 encodings have not ended" in item.failures[0].why


@misuse("forgets the `return` of what encodes", "a failure, with the remedy")
def test_encode_without_return() -> None:
    async def handle(request: int, call: Any) -> int:
        return request

    async def main() -> Any:
        operator: Operator[int, Any] = Operator(on_board)
        operator.use_cloud(handle, ask, str, 1, encode=lambda message: None)
        async with operator:
            operator.write(1)
            return await operator.read()

    item = asyncio.run(main())
    assert item.value == "1 on board"
    assert "add the return" in item.failures[0].why


# Servers.


@misuse("forgets the `return` of what a gRPC server computes with", "the call fails; logged")
def test_server_without_return(caplog: pytest.LogCaptureFixture) -> None:
    grpc = pytest.importorskip("fuseline.grpc")

    async def infer(payload: bytes, call: Any) -> Any:
        payload.upper()

    async def main() -> Any:
        operator: Operator[int, Any] = Operator(on_board)
        async with grpc.Server(infer) as server:
            remote = grpc.Remote(f"http://{server.address}")
            operator.use_cloud(remote.infer, lambda m, t: (b"a", 5.0), bytes, 1)
            async with operator:
                operator.write(1)
                item = await operator.read()
            await remote.close()
            return item

    item = asyncio.run(main())
    assert item.value == "1 on board"
    assert "add the return" in caplog.text


@pytest.mark.parametrize("of", [{"infer": len}, {"address": on_board}])
@misuse("gives a gRPC server a plain function, or no address", "`ConfigError`")
def test_server_of_a_plain_function(of: dict[str, Any]) -> None:
    grpc = pytest.importorskip("fuseline.grpc")

    def plain(payload: bytes, call: Any) -> bytes:
        return payload

    async def infer(payload: bytes, call: Any) -> bytes:
        return payload

    made = {"infer": plain} if "infer" in of else {"infer": infer, **of}
    refused("async def|an address", lambda: grpc.Server(**made))
