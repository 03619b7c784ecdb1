"""Tests lineages: where a message comes from, an output's age, and its value's message."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path
from typing import Any

import fuseline
import pytest
from conftest import Run
from fuseline import (
    Call,
    Item,
    Lineage,
    Operator,
    StampedValue,
    Trace,
    check,
    check_observed,
    ns,
    report,
)
from fuseline.testing import VirtualLoop

MS = 0.001


def opened(path: Path) -> list[tuple[int | None, ...]]:
    """Returns for each open its instant in ms, `seq`, `age` and `within` in ms."""

    def ms(nanos: int | None) -> int | None:
        return None if nanos is None else nanos // 1_000_000

    return [
        (ms(it.at), it.seq, ms(it.age), ms(it.within))
        for it in Trace(path).lines
        if it.ev == "open"
    ]


def test_the_last_output_of_a_chain_knows_what_it_comes_from_and_how_old_it_is(
    run: Run[Any], tmp_path: Path
) -> None:
    traces = [tmp_path / "detector.jsonl", tmp_path / "tracker.jsonl"]

    async def detect(frame: str, t: int) -> str:
        # The first frame takes longer than the second.
        await asyncio.sleep((0.06, 0.01, 0.02)[t])
        return f"boxes of {frame}"

    async def track(boxes: str, t: int) -> str:
        await asyncio.sleep(0.02)
        return f"tracks of {boxes}"

    async def main(loop: VirtualLoop) -> list[Item[str]]:
        detector = Operator(
            fuseline.Local.task(detect, at_once=9), clock=loop.time_ns, trace=traces[0]
        )
        tracker = Operator(
            fuseline.Local.task(track, at_once=9), clock=loop.time_ns, trace=traces[1]
        )
        async with tracker, detector:
            await asyncio.sleep(0.1)
            captured = loop.time_ns() - 30_000_000
            for seq in (40, 41):
                lineage = Lineage("camera/front", seq, captured, within=0.5)
                detector.write(f"frame {seq}", lineage)
            detector.write("a frame from nowhere")
            detector.close()
            async for item in detector:
                tracker.write(item.value or "nothing", item.lineage)
            tracker.close()
            return [item async for item in tracker]

    items = run(main)
    seen = [
        (it.value, it.lineage and it.lineage.seq, None if it.age is None else round(it.age, 9))
        for it in items
    ]
    assert seen == [
        ("tracks of boxes of frame 41", 41, 0.06),
        ("tracks of boxes of a frame from nowhere", None, None),
        ("tracks of boxes of frame 40", 40, 0.11),
    ]
    assert opened(traces[0]) == [(100, 40, 30, 500), (100, 41, 30, 500), (100, None, None, None)]
    assert opened(traces[1]) == [(110, 41, 40, 500), (120, None, None, None), (160, 40, 90, 500)]
    for path in traces:
        assert not check(path).violations
        assert fuseline.replay(path) == path.read_bytes()
    # Messages that were answered leave nothing behind (D8).
    first = next(it for it in Trace(traces[0]).lines if it.ev == "open")
    assert (first.origin, first.of, first.attempt) == ("camera/front", None, None)


def test_value_for_another_message_is_a_failure(run: Run[Any], tmp_path: Path) -> None:
    """A value that is meant for another message is a failure (D18)."""
    path = tmp_path / "trace.jsonl"

    async def policy(message: int, call: Call) -> int:
        return (0, 1, 5)[message]

    async def local(message: int, t: int) -> str:
        return "on board"

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[int, Any] = Operator(local, clock=loop.time_ns, trace=path)
        operator.use_cloud(
            policy,
            lambda message, t: (message, 0.1),
            lambda tick: StampedValue(f"for {tick}", None, tick),
            1,
        )
        async with operator:
            operator.feed(range(3))
            return [item async for item in operator]

    items = run(main)
    assert [it.value for it in items] == ["for 0", "for 1", "on board"]
    assert [it.why for it in items[2].failures] == ["the value is meant for message 5"]
    emits = [it.meant_for for it in Trace(path).lines if it.ev == "emit"]
    assert emits == [0, 1, None] and not check(path).violations


def test_a_lineage_that_makes_no_sense_is_refused() -> None:
    with pytest.raises(ValueError, match="without an origin"):
        Lineage(seq=1)
    with pytest.raises(TypeError, match="ns"):
        Lineage("camera", within=5)
    assert Lineage("camera", within=0.5).within == ns(500_000_000)
    assert Lineage(captured=5) == Lineage(None, None, 5)


def test_the_further_keys_are_fields_of_lines_and_columns_of_their_table() -> None:
    pytest.importorskip("pyarrow")
    trace = b"""{"fuseline":1,"window":16,"local":"none","clouds":[{"p":1,"limit":31,"max_age":3}]}
{"ev":"open","at":9,"t":1,"within":50,"age":7,"origin":"camera","seq":41,"missing":["right"]}
{"ev":"request","at":9,"t":1,"p":1,"due":500,"try":2}
{"ev":"result","at":499,"t":1,"p":1,"of":0,"for":1,"try":2}
{"ev":"emit","at":499,"t":1,"p":1,"of":0,"for":1}
"""
    read = Trace(trace)
    assert (read.header["local"], read.header["clouds"][0]["max_age"]) == ("none", 3)
    table = read.to_arrow()
    table.validate(full=True)
    columns = {name: table.column(name).to_pylist() for name in table.column_names[-8:]}
    assert columns == {
        "of": [None, None, 0, 0],
        "meant_for": [None, None, 1, 1],
        "attempt": [None, 2, 2, None],
        "within": [50, None, None, None],
        "age": [7, None, None, None],
        "origin": ["camera", None, None, None],
        "seq": [41, None, None, None],
        "missing": [["right"], None, None, None],
    }


def test_single_sources_may_have_tolerances_of_their_own(tmp_path: Path) -> None:
    trace = b"""{"fuseline":1,"window":16,"clouds":[{"p":1,"name":"west","limit":31}]}
{"ev":"open","at":0,"t":1}
{"ev":"request","at":0,"t":1,"p":1,"due":500}
{"ev":"emit","at":501,"t":1,"p":1}
{"ev":"result","at":505,"t":1,"p":1}
"""
    own: dict[str, Any] = {"tolerance": ns(0), "lateness": ns(1)}
    assert not check_observed(trace, **own).conforms
    assert not check_observed(trace, **own, tolerances={"west": ns(5)}).violations
    assert check_observed(trace, **own, tolerances={"local": ns(5)}).violations
    page = tmp_path / "page.html"
    (verdict,) = report(trace, page=page, tolerances={"west": ns(5)}, **own)
    assert not verdict.violations
    with pytest.raises(ValueError, match=r'"east"; the header has local, west'):
        check_observed(trace, **own, tolerances={"east": ns(5)})
    with pytest.raises(ValueError, match="for all other sources"):
        report(trace, page=page, tolerances={"west": ns(5)})


def test_lineage_goes_with_the_request_and_of_comes_with_the_reply() -> None:
    grpc = pytest.importorskip("fuseline.grpc")
    seen: list[Call] = []

    async def infer(payload: bytes, call: Call) -> Any:
        seen.append(call)
        return StampedValue(b"boxes", 3, 7) if call.lineage else b"boxes"

    async def main() -> tuple[Any, ...]:
        async with grpc.Server(infer) as server, grpc.Remote(server.url) as remote:
            lineage = Lineage("camera", 0, time.monotonic_ns(), within=0.5)
            stamped = await remote.infer_stamped(b"", Call(7, 60.0, lineage, 0.25))
            plain = await remote.infer_stamped(b"", Call(8, 60.0))
            return stamped, plain, await remote.infer(b"", Call(9, 60.0))

    assert asyncio.run(main()) == (
        StampedValue(b"boxes", 3, 7),
        StampedValue(b"boxes", None),
        b"boxes",
    )
    first, second, _ = seen
    assert first.lineage is not None
    assert (first.lineage.origin, first.lineage.seq, first.age) == ("camera", 0, 0.25)
    assert first.lineage.within == ns(500_000_000)
    since = time.monotonic_ns() - (first.lineage.captured or 0)
    assert 250_000_000 <= since < 60_000_000_000
    assert (second.lineage, second.age) == (None, None)


def test_a_request_without_lineage_is_that_of_before() -> None:
    pytest.importorskip("fuseline.grpc")
    from fuseline._infer import REPLY, REQUEST

    assert REQUEST(timestamp=7, payload=b"x").SerializeToString() == bytes([8, 7, 18, 1]) + b"x"
    assert REPLY(payload=b"y").SerializeToString() == bytes([10, 1]) + b"y"
    assert not REPLY.FromString(bytes([10, 1]) + b"y").HasField("of")
