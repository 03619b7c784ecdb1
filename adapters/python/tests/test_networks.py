"""Tests recorded networks in front of calls and servers, and rival policies."""

from __future__ import annotations

import asyncio
import math
import pickle
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from conftest import Run, serving
from fuseline import Call, Item, Local, Operator
from fuseline.networks import (
    DRIVES,
    Drive,
    Quantile,
    RecordedNetwork,
    Responses,
    compare,
    compare_responses,
)
from fuseline.testing import VirtualLoop
from operator_support import MS, ask, items_of, local_after

GAP = "second,rtt_ms\n10,100\n11,-1\n12,-1\n13,50\n14,-1\n"


@pytest.fixture
def gap(tmp_path: Path) -> Path:
    path = tmp_path / "gap.csv"
    path.write_text(GAP)
    return path


def test_drives_are_those_of_the_command_and_files(gap: Path) -> None:
    assert len(DRIVES) == 8
    for name in DRIVES:
        network = ":sprint" if name.startswith("vnperf") else ""
        assert Drive(name + network).length > 50
    drive = Drive(gap)
    assert drive.length == 5.0
    assert drive.samples == [(0.0, 0.1), (1.0, None), (2.0, None), (3.0, 0.05), (4.0, None)]
    assert [drive.round_trip(at) for at in (0.999, 1.0, 2.9, 4.4)] == [0.1, 2.05, 0.15, 0.7]
    assert Drive("vnperf/highway:wifi").round_trip(12.345) is None
    assert pickle.loads(pickle.dumps(drive)).round_trip(1.0) == 2.05


def test_what_is_no_drive_is_refused_with_its_place(tmp_path: Path) -> None:
    bad = tmp_path / "bad.csv"
    bad.write_text("sent_ms,rtt_ms\n0,1\n50,x\n")
    with pytest.raises(ValueError, match=r'bad\.csv:3: rtt_ms is "x"'):
        Drive(bad)
    with pytest.raises(ValueError, match="has several networks"):
        Drive("vnperf/highway")


def test_calls_take_the_round_trip_of_their_moment(run: Run[list[Item[Any]]], gap: Path) -> None:
    lefts = []

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        async def cloud(t: int, call: Call) -> str:
            lefts.append(round(call.deadline, 3))
            await asyncio.sleep(10 * MS)
            if t == 1:
                raise OSError("gone")
            return f"cloud's of {t}"

        operator: Operator[int, Any] = Operator(
            Local.task(local_after(3.0), at_once=3, deadline=4.0),
            clock=loop.time_ns,
            commit="patient",
        )
        operator.use_cloud(RecordedNetwork(gap).handle(cloud), ask(2.5), str, 1)

        async def camera() -> AsyncIterator[int]:
            for t in range(3):
                yield t
                await asyncio.sleep(0.5)

        return await items_of(operator, camera())

    items = sorted(run(main), key=lambda it: it.timestamp)
    assert [round(it.latency, 3) for it in items] == [0.11, 3.0, 2.06]
    assert [it.value for it in items] == ["cloud's of 0", "1 on board", "cloud's of 2"]
    assert items[1].failures and "gone" in items[1].failures[0].why
    assert lefts == [2.45, 2.45, 1.475]


def test_a_networks_time_begins_with_its_first_call_or_when_one_says(
    run: Run[Any], gap: Path
) -> None:
    async def main(loop: VirtualLoop) -> list[list[float | None]]:
        drive = Drive(gap)
        networks = [RecordedNetwork(drive), RecordedNetwork(gap), RecordedNetwork(drive, start=2.5)]
        assert networks[0].drive is drive
        networks[0].begin()
        trips = []
        for _ in range(3):
            await asyncio.sleep(0.75)
            networks[0].begin()
            trips.append([network.round_trip() for network in networks])
        return trips

    trips = run(main)
    assert trips == [
        [0.1, 0.1, pytest.approx(0.55)],
        [pytest.approx(1.55), 0.1, 0.05],
        [pytest.approx(0.8), pytest.approx(1.55), pytest.approx(1.1)],
    ]


@pytest.mark.parametrize("fails", [False, True])
def test_a_reply_and_an_error_take_the_way_back(run: Run[Any], gap: Path, fails: bool) -> None:
    async def main(loop: VirtualLoop) -> list[float]:
        at: list[float] = []

        async def cloud(request: int, call: Call) -> int:
            at.append(loop.time() - 1000)
            if fails:
                raise OSError("gone")
            return request

        handle = RecordedNetwork(gap).handle(cloud)
        try:
            assert await handle(7, Call(0, 1.0)) == 7
        except OSError:
            assert fails
        return [*at, loop.time() - 1000]

    assert run(main) == pytest.approx([0.05, 0.1])


def test_a_call_without_a_network_waits_until_it_is_cancelled(run: Run[list[Item[Any]]]) -> None:
    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        async def cloud(t: int, call: Call) -> str:
            raise AssertionError("it is never reached")

        operator: Operator[int, Any] = Operator(local_after(0.1), clock=loop.time_ns)
        network = RecordedNetwork("vnperf/highway:wifi")
        operator.use_cloud(network.handle(cloud), ask(0.5), str, 1)
        return await items_of(operator, [0])

    items = run(main)
    assert [(it.value, round(it.latency, 3)) for it in items] == [("0 on board", 0.5)]
    assert not items[0].failures


def test_rival_policies_over_responses() -> None:
    local = Responses([0.3, 0.31, 0.3], 0, accuracy=40.0)
    west = Responses([0.15, 9.0, None], 1, accuracy=44.0)
    east = Responses([0.17, None, 0.6], 2, accuracy=52.0)
    scores = {
        it.policy: it
        for it in compare_responses({"east": east, "local": local, "west": west}, deadline=0.5)
    }
    assert list(scores) == [
        "local only",
        "cloud only: west",
        "cloud only: east",
        "first response wins",
        "progressive",
    ]
    assert scores["local only"].in_time == (3, 3)
    assert scores["cloud only: east"].in_time == (1, 1)
    assert scores["cloud only: east"].p99 == Quantile(math.inf)
    first, progressive = scores["first response wins"], scores["progressive"]
    assert first.accuracy == pytest.approx((124 / 3, 124 / 3))
    assert progressive.accuracy == pytest.approx((44.0, 44.0))
    assert first.p50 == progressive.p50 == Quantile(0.3)
    nothing = compare_responses({"local": Responses([], 0)}, deadline=0.5)
    assert nothing[0].p50 is None and nothing[0].in_time == (0, 0)


def test_rival_policies_over_a_trace(run: Run[Any], tmp_path: Path) -> None:
    trace = tmp_path / "trace.jsonl"

    async def main(loop: VirtualLoop) -> None:
        async def cloud(t: int, call: Call) -> str:
            await asyncio.sleep(150 * MS if t == 0 else 900 * MS)
            return "cloud's"

        operator: Operator[int, Any] = Operator(
            local_after(50 * MS), clock=loop.time_ns, commit="patient", trace=trace
        )
        operator.use_cloud(cloud, ask(0.5), str, 1, name="west")
        await items_of(operator, range(2))

    run(main)
    scores = compare(trace, deadline=0.5, accuracies={"local": 40.0, "west": 50.0})
    by_name = {it.policy: it for it in scores}
    # The second call was ended at its deadline, because its result would have come later.
    assert by_name["fusion"].in_time == (2, 2)
    assert by_name["fusion"].accuracy == (45.0, 45.0)
    assert by_name["local only"].accuracy == (40.0, 40.0)
    assert by_name["cloud only: west"].in_time == (1, 1)
    assert by_name["cloud only: west"].p99 == Quantile(0.5, is_bound=True)
    assert compare(trace, deadline=0.5)[0].accuracy is None


def test_command_puts_a_network_before_a_server(command: str, tmp_path: Path) -> None:
    grpc = pytest.importorskip("grpc")
    drive = tmp_path / "drive.csv"
    drive.write_text("sent_ms,rtt_ms\n0,100\n600000,100\n")
    seen: dict[str, Any] = {}
    hangs, ended = asyncio.Event(), asyncio.Event()

    async def unary(request: bytes, context: Any) -> bytes:
        seen.update(context.invocation_metadata(), left=context.time_remaining())
        if request == b"hang":
            hangs.set()
            try:
                await asyncio.sleep(600)
            finally:
                ended.set()
        if request == b"refuse":
            context.set_trailing_metadata((("why", "night"),))
            await context.abort(grpc.StatusCode.NOT_FOUND, "no frame")
        return request[::-1]

    async def stream(requests: AsyncIterator[bytes], context: Any) -> AsyncIterator[bytes]:
        async for request in requests:
            yield request * 2

    async def main() -> None:
        handlers = {
            "Unary": grpc.unary_unary_rpc_method_handler(unary),
            "Stream": grpc.stream_stream_rpc_method_handler(stream),
        }
        server = grpc.aio.server()
        server.add_generic_rpc_handlers((grpc.method_handlers_generic_handler("any.S", handlers),))
        port = server.add_insecure_port("127.0.0.1:0")
        await server.start()
        forward = ("--forward", f"http://127.0.0.1:{port}", "--drive", str(drive))
        with serving(command, *forward) as url:
            async with grpc.aio.insecure_channel(url.removeprefix("http://")) as channel:
                await check(channel)
        await server.stop(None)

    async def check(channel: Any) -> None:
        call = channel.unary_unary("/any.S/Unary")
        loop = asyncio.get_running_loop()
        began = loop.time()
        assert await call(b"\xff\x00", metadata=(("x", "1"),), timeout=60) == b"\x00\xff"
        assert loop.time() - began >= 0.1
        assert seen["x"] == "1" and 30 < seen["left"] <= 60
        with pytest.raises(grpc.aio.AioRpcError) as raised:
            await call(b"refuse", timeout=60)
        error = raised.value
        assert (error.code(), error.details()) == (grpc.StatusCode.NOT_FOUND, "no frame")
        assert dict(error.trailing_metadata())["why"] == "night"
        hanging = asyncio.ensure_future(call(b"hang", timeout=60))
        await asyncio.wait_for(hangs.wait(), 60)
        hanging.cancel()
        await asyncio.wait_for(ended.wait(), 60)
        both = channel.stream_stream("/any.S/Stream")()
        for frame in (b"a", bytes(300_000)):
            await both.write(frame)
            assert await both.read() == frame * 2
        await both.done_writing()
        assert await both.read() == grpc.aio.EOF
        with pytest.raises(grpc.aio.AioRpcError) as raised:
            await channel.unary_unary("/any.S/Other")(b"", timeout=60)
        assert raised.value.code() == grpc.StatusCode.UNIMPLEMENTED

    asyncio.run(main())
