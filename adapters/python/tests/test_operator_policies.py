"""Tests the asyncio operator's counts, policies, load and configuration in virtual time."""

from __future__ import annotations

import asyncio
import gc
import weakref
from pathlib import Path
from typing import Any

import fuseline
import pytest
from conftest import Run
from fuseline import (
    Call,
    Item,
    Local,
    Operator,
    Trace,
)
from fuseline.deadline import (
    Accuracy,
    BoxDetector,
    Case,
    Chosen,
    Constant,
    End,
    Expected,
    Guard,
    Reason,
    Situation,
    Streaming,
)
from fuseline.testing import VirtualLoop
from operator_support import MS, after, ask, items_of, local_after


def test_the_deadline_in_force_is_the_policys_under_its_cap(run: Run[Any], tmp_path: Path) -> None:
    trace = tmp_path / "trace.jsonl"

    class Long:
        def decide(self, situation: Situation, cap: Any) -> Chosen:
            return Chosen(cap + 7, Reason.GUARD, Case.UNSURE)

        def ended(self, end: End, age: Any) -> None: ...

    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(local_after(0), clock=loop.time_ns, trace=trace)
        guard = Guard()
        operator.use_cloud(after(0), ask(0.1), str, 1, name="long", policy=Long())
        operator.use_cloud(after(0), ask(0.2), str, 2, name="plain")
        operator.use_cloud(after(0), ask(9.0), str, 3, name="safe", policy=guard)
        operator.use_cloud(after(0), ask(9.0), str, 4, policy=guard.cap(Constant(0.4)))
        operator.use_situation(lambda message, t: Situation(speed=11.0))
        assert operator.deadlines == {}
        async with operator:
            operator.write("a")
        safe = guard.judge(Situation(speed=11.0)).deadline
        assert operator.deadlines == {
            "long": (100_000_000, "unsure"),
            "plain": (200_000_000, "offered"),
            "safe": (safe, "local-stops"),
            "cloud-4": (400_000_000, "constant"),
        }

    run(main)
    dues = {line.p: line.due for line in Trace(trace).lines if line.ev == "request"}
    assert (dues[1], dues[4]) == (100_000_000, 400_000_000)


@pytest.mark.parametrize("wrong", [RuntimeError("no idea"), None, 250, Chosen(-1, Reason.CAP)])  # type: ignore[arg-type]
def test_a_policy_that_fails_asks_for_nothing(
    run: Run[Any], caplog: pytest.LogCaptureFixture, wrong: Any
) -> None:
    class Failing:
        def decide(self, situation: Situation, cap: Any) -> Any:
            if isinstance(wrong, Exception):
                raise wrong
            return wrong

        def ended(self, end: End, age: Any) -> None:
            raise LookupError("who ended?")

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[Any, Any] = Operator(local_after(20 * MS), clock=loop.time_ns)
        operator.use_cloud(after(0), ask(1.0), str, 1, policy=Guard().cap(Failing()))
        operator.use_cloud(after(0), ask(10 * MS), str, 2, policy=Constant(1.0))
        items = await items_of(operator, ["a"])
        assert operator.counts["cloud-1", "request", "admitted"] == 0
        assert operator.counts["cloud-2", "request", "admitted"] == 1
        return items

    (item,) = run(main)
    assert item.value == "a"
    assert caplog.text.count("a policy failed\n") == 1
    assert "no request is sent (timestamp=0, source=cloud-1)" in caplog.text


def test_no_handler_or_policy_can_enter_the_engine_while_it_decides(
    run: Run[Any], caplog: pytest.LogCaptureFixture
) -> None:
    tried: list[str] = []

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[Any, Any] = Operator(local_after(0), clock=loop.time_ns)

        def enter() -> None:
            assert operator._driver is not None
            with pytest.raises(RuntimeError, match="the operator decides about a message"):
                operator._driver._calls.wake_up()
            with pytest.raises(RuntimeError, match="a handler must not write"):
                operator.write("b")
            tried.append(repr(operator.counts))

        class Entering:
            def decide(self, situation: Situation, cap: Any) -> Chosen:
                enter()
                return Chosen(cap, Reason.CAP)

            def ended(self, end: End, age: Any) -> None:
                assert operator.counts

        def handler(message: Any, t: int) -> Any:
            enter()
            return message, 1.0

        operator.use_cloud(after(0), handler, str, 1, policy=Entering())
        return await items_of(operator, ["a"])

    (item,) = run(main)
    assert (item.value, len(tried)) == ("a", 2)
    assert not caplog.records


def test_an_interrupt_in_a_policy_or_handler_is_no_failure_of_it(run: Run[Any]) -> None:
    class Interrupted:
        def decide(self, situation: Situation, cap: Any) -> Any:
            raise KeyboardInterrupt

        def ended(self, end: End, age: Any) -> None: ...

    def handler(message: Any, t: int) -> Any:
        raise KeyboardInterrupt

    async def main(loop: VirtualLoop, handler: Any, policy: Any) -> None:
        operator: Operator[Any, Any] = Operator(local_after(0), clock=loop.time_ns)
        operator.use_cloud(after(0), handler, str, 1, policy=policy)
        async with operator:
            with pytest.raises(KeyboardInterrupt):
                operator.write("a")
            operator.stop()

    run(lambda loop: main(loop, ask(1.0), Interrupted()))
    run(lambda loop: main(loop, handler, None))


def test_an_operator_that_has_ended_is_let_go(run: Run[Any], tmp_path: Path) -> None:
    async def main(loop: VirtualLoop) -> weakref.ref[Any]:
        operator: Operator[Any, Any] = Operator(
            local_after(0), clock=loop.time_ns, trace=tmp_path / "trace.jsonl"
        )

        def policy(situation: Situation, cap: Any) -> Any:
            return cap if operator.counts else 0.0

        operator.use_cloud(after(0), ask(1.0), str, 1, policy=policy)
        async with operator:
            operator.write("a")
        return weakref.ref(operator)

    operator = run(main)
    gc.collect()
    assert operator() is None


def test_a_policy_learns_how_each_call_ended_and_chooses(run: Run[Any]) -> None:
    reported: list[tuple[End, int]] = []
    asks: list[tuple[int, list[int]]] = []

    class Policy:
        def decide(self, situation: Situation, cap: Any) -> Any:
            asks.append((cap, list(situation.under_way)))  # type: ignore[arg-type]
            return Constant(30 * MS).decide(situation, cap)

        def ended(self, end: End, age: Any) -> None:
            reported.append((end, age))

    async def handle(request: int, call: Call) -> Any:
        await asyncio.sleep([10, 20, 100][request] * MS)
        if request == 1:
            raise OSError("broke")

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[Any, Any] = Operator(
            Local.task(local_after(0), at_once=3), clock=loop.time_ns
        )
        operator.use_cloud(handle, ask(1.0), str, 1, policy=Policy())
        return await items_of(operator, [0, 1, 2])

    run(main)
    assert reported == [(End.ANSWERED, 10**7), (End.FAILED, 2 * 10**7), (End.CENSORED, 3 * 10**7)]
    assert asks == [(10**9, []), (10**9, [0]), (10**9, [0, 0])]


def test_a_guard_and_what_is_worth_it_decide_in_an_operator(run: Run[Any]) -> None:
    guard = Guard()
    expected = Expected(Accuracy(local=42.0, cloud=50.0, price_per_ms=0.01), 0.05, probe_every=16)

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[Any, Any] = Operator(
            Local.task(local_after(50 * MS), at_once=99), clock=loop.time_ns, window=99
        )
        operator.use_situation(lambda message, t: Situation(speed=11.0))
        operator.use_cloud(after(120 * MS), ask(2.0), str, 1, calls=99, policy=guard.cap(expected))

        async def camera() -> Any:
            for message in range(40):
                yield message
                await asyncio.sleep(0.5)

        return await items_of(operator, camera())

    items = run(main)
    assert {str(item.source) for item in items} == {"cloud-1"}
    assert {it.response for it in expected.observations()} == {120_000_000}
    assert len(expected.observations()) == 40
    assert expected.decide(Situation(), 2.0).deadline == 120_000_001


def test_refuses_policy_without_probes_or_linger() -> None:
    class OwnExpected(Expected):
        """Might override the decision."""

    accuracy = Accuracy(local=42.0, cloud=50.0, price_per_ms=0.01)
    expected, own = Expected(accuracy, 0.05, None), OwnExpected(accuracy, 0.05, None)
    probing = Expected(accuracy, 0.05)
    detector = BoxDetector(70.0, 0.7)
    streaming = Streaming(detector, detector, 0.1, local_response=0.05, probe_every=None)
    capped = (Constant(0.5).cap(expected), expected.cap(Constant(0.5)), Constant(0.5).cap(own))
    for policy in (expected, streaming, own, *capped):
        operator: Operator[Any, Any] = Operator(local_after(0))
        with pytest.raises(fuseline.ConfigError, match=r"policy of west neither probes.*linger"):
            operator.use_cloud(after(0), ask(1.0), str, 1, name="west", policy=policy)
        operator.use_cloud(after(0), ask(1.0), str, 1, name="west", policy=policy, linger=1.0)
        operator.use_cloud(after(0), ask(1.0), str, 2, name="east", policy=probing)
