"""Tests dora's node, with a node that a test plays and in a dataflow of dora's own daemon."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from queue import Empty, SimpleQueue
from types import SimpleNamespace
from typing import Any

import fuseline
import pytest
from conftest import Run
from fuseline import ConfigError, dora
from fuseline.dora import FusionNode
from fuseline.testing import VirtualLoop

#: Returns the seconds after which a source answers a value, or None if it never does.
Plan = dict[str, Callable[[int], float | None]]
INPUTS = ["input", "local_result", "west_result"]
OUTPUTS = ["output", "missed", "local_request", "west_request"]


class PlayedNode:
    """Passes requests to sources that answer as planned, and stores all other outputs."""

    def __init__(self, loop: VirtualLoop, plan: Plan, outputs: list[str]) -> None:
        self.loop, self.plan, self.outputs = loop, plan, outputs
        self.sent: list[tuple[str, Any, dict[str, Any]]] = []
        self.requests = 0
        self.fusion: FusionNode

    def node_config(self) -> dict[str, Any]:
        return {"inputs": dict.fromkeys(INPUTS), "outputs": self.outputs}

    def next(self, timeout: float | None = None) -> dict[str, Any] | None:
        raise AssertionError("events are taken by hand")

    def drain(self) -> list[dict[str, Any]] | None:
        raise AssertionError("events are taken by hand")

    def send_output(
        self, output_id: str, data: Any, metadata: dict[str, Any] | None = None
    ) -> None:
        self.sent.append((output_id, data, metadata or {}))

    def send_service_request(
        self, output_id: str, data: Any, metadata: dict[str, Any] | None = None
    ) -> str:
        self.requests += 1
        metadata = (metadata or {}) | {"request_id": str(self.requests)}
        source = output_id.removesuffix("_request")
        after = self.plan[source](data)
        if after is not None:
            result = {"type": "INPUT", "id": f"{source}_result", "metadata": metadata}
            event = result | {"value": f"{data} by {source}"}
            self.loop.call_later(after, self.fusion.take, event)
        return str(self.requests)


def play(
    run: Run[Any],
    plan: Plan,
    steps: list[dict[str, Any] | None],
    at: list[int] | None = None,
    *,
    outputs: list[str] = OUTPUTS,
    **options: Any,
) -> PlayedNode:
    """Plays the steps at these seconds, by default one a second."""
    clouds = {name: 0.5 for name in plan if name != "local"}

    async def main(loop: VirtualLoop) -> PlayedNode:
        node = PlayedNode(loop, plan, outputs)
        node.fusion = FusionNode(node, clouds, clock=loop.time_ns, **options)
        async with node.fusion.operator:
            for after, step in zip(at or range(len(steps)), steps, strict=True):
                loop.call_later(after, node.fusion.take, step)
            await node.fusion.send_items()
        return node

    played: PlayedNode = run(main)
    nothing_waits(played.fusion)
    return played


def nothing_waits(fusion: FusionNode) -> None:
    """Checks that every accepted input was answered (D8)."""
    assert not fusion._open
    assert not any(source._waiting for source in fusion._sources.values())


def frame(value: int) -> dict[str, Any]:
    metadata = {"seq": value, "request_id": "the camera's own"}
    return {"type": "INPUT", "id": "input", "value": value, "metadata": metadata}


def test_each_input_has_the_best_result_that_is_in_time(run: Run[Any], tmp_path: Path) -> None:
    trace = tmp_path / "run.jsonl"
    late = {0: 0.4, 1: 0.7, 2: None}
    plan: Plan = {"local": lambda _: 0.1, "west": late.__getitem__}
    node = play(run, plan, [frame(0), frame(1), frame(2), None], trace=str(trace))
    own = {"request_id": "the camera's own"}
    assert node.sent == [
        ("output", "0 by west", own | {"seq": 0, "fuseline.source": "west"}),
        ("output", "1 by local", own | {"seq": 1, "fuseline.source": "local"}),
        ("output", "2 by local", own | {"seq": 2, "fuseline.source": "local"}),
    ]
    assert node.fusion.dropped == {"west_result": 1}, "the late one was not counted"
    verdict = fuseline.check(trace)
    assert not verdict.violations and verdict.judged == 3


def test_a_source_whose_input_is_closed_fails_at_once_until_it_is_back(run: Run[Any]) -> None:
    closed = {"type": "INPUT_CLOSED", "id": "west_result"}
    back = {"type": "INPUT_RECOVERED", "id": "west_result"}
    plan: Plan = {"local": lambda _: None, "west": lambda value: 0.1 if value == 2 else None}
    node = play(run, plan, [closed, frame(1), back, frame(2), None])
    ids = [(output, metadata["seq"]) for output, _, metadata in node.sent]
    assert ids == [("missed", 1), ("output", 2)]
    assert node.fusion.operator.counts["west", "request", "admitted"] == 2
    assert node.requests == 3, "one was sent to a closed input"


def test_what_waits_when_its_input_is_closed_fails_at_once(run: Run[Any]) -> None:
    plan: Plan = {"local": lambda _: 0.6, "west": lambda value: 0.1 if value == 2 else None}

    async def main(loop: VirtualLoop) -> list[tuple[Any, float]]:
        node = PlayedNode(loop, plan, OUTPUTS)
        node.fusion = FusionNode(node, {"west": 0.9}, clock=loop.time_ns)
        closed = {"type": "INPUT_CLOSED", "id": "west_result"}
        steps = [(0.0, frame(1)), (0.2, closed), (2.0, frame(2)), (3.0, None)]
        took = []
        async with node.fusion.operator:
            for after, step in steps:
                loop.call_later(after, node.fusion.take, step)
            async for item in node.fusion.operator:
                took.append((str(item.source), round(item.latency, 3)))
                node.fusion._send(item)
        nothing_waits(node.fusion)
        # A result that comes although its input was closed opens the input again.
        assert node.requests == 3
        return took

    assert run(main) == [("local", 0.6), ("local", 0.6)]


def test_what_waits_when_the_dataflow_ends_is_missed_at_once(
    run: Run[Any], caplog: pytest.LogCaptureFixture
) -> None:
    async def main(loop: VirtualLoop) -> float:
        plan: Plan = {"local": lambda _: None, "west": lambda _: None}
        node = PlayedNode(loop, plan, OUTPUTS)
        node.fusion = FusionNode(node, {"west": 0.9}, clock=loop.time_ns)
        async with node.fusion.operator:
            loop.call_later(0.0, node.fusion.take, frame(1))
            loop.call_later(0.2, node.fusion.take, None)
            loop.call_later(0.2, node.fusion.take, frame(2))
            item = await anext(node.fusion.operator)
            node.fusion._send(item)
        nothing_waits(node.fusion)
        assert node.fusion.dropped == {"input": 1}
        return item.latency

    assert run(main) == pytest.approx(0.2)
    assert "an input was not taken" in caplog.text


def test_results_of_no_request_are_dropped(run: Run[Any]) -> None:
    stray = {"type": "INPUT", "id": "west_result", "value": 9, "metadata": {"request_id": "7"}}
    plan: Plan = {"local": lambda _: 0.1, "west": lambda _: None}
    node = play(run, plan, [stray, stray | {"metadata": {}}, frame(0), None])
    assert node.fusion.dropped == {"west_result": 2}
    assert [data for _, data, _ in node.sent] == ["0 by local"]


def test_inputs_are_answered_after_some_found_no_room(run: Run[Any]) -> None:
    """Each input is answered, missed or counted as dropped (D8)."""

    plan: Plan = {"local": lambda _: 0.1, "west": lambda _: None}
    node = play(run, plan, [*map(frame, range(41)), None], at=[*[0] * 40, 10, 20])
    assert node.fusion.dropped == {"input": 8}
    missed = [metadata for output, _, metadata in node.sent if output == "missed"]
    assert [it["seq"] for it in missed] == list(range(16, 32))
    assert {it["fuseline.why"] for it in missed} == {"refused"}
    outputs = [value for output, value, _ in node.sent if output == "output"]
    assert sorted(outputs) == sorted(f"{value} by local" for value in [*range(16), 40])


def test_events_of_no_concern_change_nothing(
    run: Run[Any], caplog: pytest.LogCaptureFixture
) -> None:
    """Sends events of unknown inputs, of an unknown kind, and of its own input's recovery."""
    kinds = ("INPUT", "INPUT_CLOSED", "INPUT_RECOVERED", "STOPPED", "ERROR")
    other = [{"type": kind, "id": "lidar_result", "value": 0, "metadata": {}} for kind in kinds]
    own = [{"type": kind, "id": "input"} for kind in ("INPUT_RECOVERED", "ERROR")]
    closed = {"type": "INPUT_CLOSED", "id": "west_result"}
    error: dict[str, Any] = {
        "type": "ERROR",
        "id": "west_result",
        "value": 9,
        "metadata": {"request_id": "1"},
    }
    plan: Plan = {"local": lambda _: 0.1, "west": lambda _: 0.2}
    stop = {"type": "STOP", "id": "a signal"}
    steps: list[dict[str, Any] | None] = [
        *other,
        *own,
        {"type": "ERROR"},
        frame(1),
        error,
        closed,
        frame(2),
        stop,
    ]
    node = play(run, plan, steps)
    assert [(value, it["seq"]) for _, value, it in node.sent] == [
        ("1 by west", 1),
        ("2 by local", 2),
    ]
    assert not node.fusion.dropped
    said = [it.getMessage() for it in caplog.records]
    assert [it for it in said if "input" in it and "why=" not in it] == [
        "fusion: the input west_result is closed"
    ]


def test_node_without_missed_output_sends_nothing(run: Run[Any]) -> None:
    outputs = ["output", "local_request"]
    steps = [frame(1), None]
    node = play(run, {"local": lambda _: None}, steps, outputs=outputs, local_deadline=0.5)
    assert node.sent == []
    assert node.fusion.operator.counts["fusion", "message", "missed"] == 1


class QueuedNode(PlayedNode):
    """Queues its events, as dora does. Each source answers at once."""

    def __init__(self, events: list[dict[str, Any]]) -> None:
        self.events: SimpleQueue[dict[str, Any]] = SimpleQueue()
        for event in events:
            self.events.put(event)
        self.outputs, self.sent, self.requests = OUTPUTS, [], 0

    def next(self, timeout: float | None = None) -> dict[str, Any] | None:
        try:
            return self.events.get(timeout=timeout)
        except Empty:
            return {"type": "ERROR", "error": "nothing came"}

    def drain(self) -> list[dict[str, Any]] | None:
        return [self.events.get() for _ in range(self.events.qsize())] or None

    def send_service_request(
        self, output_id: str, data: Any, metadata: dict[str, Any] | None = None
    ) -> str:
        self.requests += 1
        metadata = (metadata or {}) | {"request_id": str(self.requests)}
        result = f"{output_id.removesuffix('_request')}_result"
        self.events.put({"type": "INPUT", "id": result, "metadata": metadata, "value": data})
        return str(self.requests)


def test_what_came_before_the_end_is_answered_and_the_reader_ends_with_the_node() -> None:
    # Dora reports the end of an input before earlier events.
    events = [frame(0), {"type": "INPUT_CLOSED", "id": "input"}, frame(1), frame(2)]
    node = QueuedNode(events)
    threads = threading.active_count()

    async def main() -> None:
        await asyncio.wait_for(node.fusion.serve(), 60)

    node.fusion = FusionNode(node, {"west": 30.0}, local_deadline=30.0)
    asyncio.run(main())
    nothing_waits(node.fusion)
    assert sorted((output, value) for output, value, _ in node.sent) == [
        ("output", value) for value in range(3)
    ]
    assert not node.fusion.dropped["input"]
    assert threading.active_count() == threads


def test_a_node_that_is_given_nothing_ends_with_its_input() -> None:
    node = QueuedNode([{"type": "INPUT_CLOSED", "id": "input"}])
    node.fusion = FusionNode(node, {"west": 30.0})
    asyncio.run(asyncio.wait_for(node.fusion.serve(), 60))
    assert (node.sent, node.requests) == ([], 0)


def test_a_dataflow_without_the_nodes_inputs_is_refused(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> None:
        node = PlayedNode(loop, {}, ["output"])
        with pytest.raises(ConfigError, match="no local_request, west_request among its outputs"):
            FusionNode(node, {"west": 0.5})

    run(main)


NODES = """
import json, sys
import pyarrow as pa
from dora import Node

node, kind = Node(), sys.argv[1]


def outputs(count, sunk):
    for _ in range(count):
        # Until the node of fusion is gone, or has been silent for longer than any deadline.
        while (event := node.next(timeout=10)) is not None and event["type"] != "INPUT":
            if event["type"] == "ERROR":
                sys.exit("nothing for 10 seconds")
        if event is None:
            sys.exit("the inputs are closed")
        row = [event["id"], event["value"].to_pylist(), event["metadata"]["seq"]]
        print(json.dumps([*row, event["metadata"].get("fuseline.source")]), file=sunk, flush=True)


if kind == "camera":
    with open("sunk.jsonl", "w") as sunk:
        for seq in range(12):
            node.send_output("image", pa.array([seq]), {"seq": seq})
            outputs(1 if seq in (0, 3, 6) else 0, sunk)
        outputs(9, sunk)
else:
    for event in node:
        # The cloud answers every third message; at the ninth it is gone, and what waited fails.
        value = event["value"].to_pylist()[0] if event["type"] == "INPUT" else -1
        if kind == "west" and value == 9:
            sys.exit(0)
        if value >= 0 and (kind == "local" or value % 3 == 0):
            node.send_output("result", pa.array([f"{value} by {kind}"]), event["metadata"])
"""

DATAFLOW = """
nodes:
  - {id: camera, path: PYTHON, args: nodes.py camera, outputs: [image],
     inputs: {output: fusion/output, missed: fusion/missed}}
  - id: fusion
    path: PYTHON
    args: -m fuseline.dora --cloud west=4 --local-deadline 4 --trace run.jsonl
    inputs:
      input: {source: camera/image, queue_size: 16}
      local_result: {source: detector/result, queue_size: 16}
      west_result: {source: west/result, queue_size: 16}
    outputs: [output, missed, local_request, west_request]
  - {id: detector, path: PYTHON, args: nodes.py local, outputs: [result],
     inputs: {image: {source: fusion/local_request, queue_size: 16}}}
  - {id: west, path: PYTHON, args: nodes.py west, outputs: [result],
     inputs: {image: {source: fusion/west_request, queue_size: 16}}}
"""


def sunk_in_a_dataflow(dora: Path, folder: Path) -> list[Any]:
    """Plays one run and checks each part. Returns the camera's outputs by message."""
    folder.mkdir()
    (folder / "nodes.py").write_text(NODES)
    (folder / "flow.yml").write_text(DATAFLOW.replace("PYTHON", sys.executable))
    done = subprocess.run(
        [dora, "run", "flow.yml"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (folder / "run.jsonl").exists(), done.stdout + done.stderr
    verdict = fuseline.check(folder / "run.jsonl")
    # A busy host may be late, but no message ends twice or gets another message's result.
    assert {it.rule for it in verdict.violations} <= {"P3", "P4"}, str(verdict)
    sunk = [json.loads(line) for line in (folder / "sunk.jsonl").read_text().splitlines()]
    sunk.sort(key=lambda row: row[2])
    assert len({row[2] for row in sunk}) == len(sunk), "a message had two items"
    for output, values, seq, who in sunk:
        if output == "missed":
            assert (values, who) == ([], None)
        else:
            assert (output, values) == ("output", [f"{seq} by {who}"])
            assert who == "local" or (who == "west" and seq in (0, 3, 6))
    return sunk


def test_in_a_dataflow_of_doras_daemon_each_input_has_one_output(tmp_path: Path) -> None:
    pytest.importorskip("dora", reason="no package dora-rs")
    dora = Path(sys.executable).with_name("dora")
    if not dora.exists():
        pytest.skip("no package dora-rs-cli")
    by = ["west" if seq in (0, 3, 6) else "local" for seq in range(12)]
    expected = [["output", [f"{seq} by {who}"], seq, who] for seq, who in enumerate(by)]
    # Dora itself loses some values while nodes start on a busy host, so one whole run of five is
    # enough.
    runs = (sunk_in_a_dataflow(dora, tmp_path / str(attempt)) for attempt in range(5))
    incomplete = []
    for sunk in runs:
        if sunk == expected:
            return
        incomplete.append(sunk)
    pytest.fail(f"no run of five was whole: {incomplete}")


def main_of(
    monkeypatch: pytest.MonkeyPatch, *options: str, node: Any = None
) -> tuple[int | str | None, QueuedNode]:
    """Runs the program with dora's package replaced. Returns how it ended, and its node."""
    node = QueuedNode([frame(0), {"type": "INPUT_CLOSED", "id": "input"}]) if node is None else node
    monkeypatch.setitem(sys.modules, "dora", SimpleNamespace(Node=lambda: node))
    monkeypatch.setattr(sys, "argv", ["fuseline.dora", *options])
    try:
        return dora.main(), node
    except SystemExit as end:
        return end.code, node


def test_its_options_are_those_of_the_node(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    class TwoClouds(QueuedNode):
        def node_config(self) -> dict[str, Any]:
            return {
                "inputs": ["input", "local_result", "west_result", "east_result"],
                "outputs": ["output", "local_request", "west_request", "east_request"],
            }

    traces = []
    clouds = ["--cloud", "west=20.5", "--cloud", "east=30"]
    for options in (
        clouds,
        [*clouds, "--local-deadline", "25", "--calls", "3", "--window", "5", "--commit", "patient"],
    ):
        trace = str(tmp_path / "run.jsonl")
        node = TwoClouds([frame(0), {"type": "INPUT_CLOSED", "id": "input"}])
        assert main_of(monkeypatch, *options, "--trace", trace, node=node) == (0, node)
        assert [it[0] for it in node.sent] == ["output"]
        traces.append(fuseline.Trace(trace))
    headers = [it.header for it in traces]
    assert [(it["window"], it["commit"]) for it in headers] == [(16, "eager"), (5, "patient")]
    gates = [[(it["p"], it["name"], it["limit"]) for it in header["clouds"]] for header in headers]
    assert gates == [[(1, "west", it), (2, "east", it)] for it in (8, 3)]
    deadlines = [
        {(it.p or 0): it.deadline for it in trace.lines if it.ev in ("open", "offer")}
        for trace in traces
    ]
    assert deadlines == [
        {0: local * 10**9, 1: 20_500_000_000, 2: 30_000_000_000} for local in (1, 25)
    ]


@pytest.mark.parametrize("cloud", ["west", "=0.5", "local=0.5", "west=soon", "west="])
def test_a_cloud_that_is_none_is_refused_with_its_words(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], cloud: str
) -> None:
    assert main_of(monkeypatch, "--cloud", cloud)[0] == 2
    assert f"argument --cloud: '{cloud}': give NAME=SECONDS, and name no" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("cloud", "words"),
    [
        ("east=0.5", "the node has no east_result among its inputs"),
        ("west=-1", "a duration of -1 s; it must be 0 or more"),
        ("west=nan", "a duration of NaN s; it must be 0 or more"),
    ],
)
def test_a_cloud_that_the_node_cannot_have_is_refused_by_the_program(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], cloud: str, words: str
) -> None:
    code, node = main_of(monkeypatch, "--cloud", cloud)
    assert (code, node.sent) == (2, [])
    assert f"error: {words}" in capsys.readouterr().err


def test_outside_a_dataflow_it_says_so() -> None:
    command = [sys.executable, "-m", "fuseline.dora", "--cloud", "west=0.5"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert "not in a dataflow of dora" in done.stderr
    done = subprocess.run(
        [*command[:-1], "west"], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 2
    assert "west" in done.stderr
