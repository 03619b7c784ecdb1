"""Tests that the timeline shows each message once, by the lines of its trace."""

from __future__ import annotations

import random
from collections import defaultdict
from typing import Any

import pytest
from fuseline import Cloud, Fusion, Line, Trace, check, ns

pytest.importorskip("matplotlib")
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.pyplot import close, subplots

PRIORITIES = (2, 3, 9)
#: The colours of local and the clouds by priority. `NOTHING` marks a missing result or source.
COLOURS = ("#e69f00", "#0072b2", "#009e73", "#cc79a7")
NOTHING = "#b2182b"


def random_trace(chance: random.Random, commit: Any) -> Trace:
    """Returns a run with refusals, misses, timers, failures and messages that stay open."""
    clouds = [Cloud(p, limit=3, name=None if p == 3 else f"cloud {p}") for p in PRIORITIES]
    fusion = Fusion(clouds, window=4, commit=commit, operator="lanes", record=True)
    now = t = 0
    for _ in range(120):
        now += chance.choice([0, 1_000_000, 7_000_000, 40_000_000])
        kind = chance.random()
        if kind < 0.3:
            t += 1
            fusion.open(now, t, ns(50_000_000) if chance.random() < 0.5 else None)
            for p in PRIORITIES:
                if chance.random() < 0.7:
                    fusion.offer(now, t, p, ns(chance.choice([30, 60, 90]) * 1_000_000))
        elif kind < 0.8:
            of, p = max(t - chance.randrange(5), 0), chance.choice((0, *PRIORITIES))
            (fusion.fail if chance.random() < 0.3 else fusion.result)(now, of, p)
        else:
            fusion.tick(now)
    trace = fusion.take_trace()
    assert not check(trace).violations
    return Trace(trace)


def account(lines: list[Line], commit: str) -> tuple[Any, Any, Any]:
    """Returns the outputs, the waits in vain and the misses, from each message's lines."""
    went: dict[int, list[tuple[float, float]]] = defaultdict(list)
    waits, missed = [], []
    stories: dict[int, list[Line]] = defaultdict(list)
    for line in lines:
        if line.t is not None:
            stories[line.t].append(line)
    for story in stories.values():
        opened = next((it.at for it in story if it.ev == "open"), None)
        if opened is None:
            continue
        after = {(it.p, it.ev): it.at for it in story}
        waits += [
            (opened / 1e9, (it.at - after[it.p, "request"]) / 1e6)
            for it in story
            if it.ev in ("timer", "cancel") and it.p != 0
        ]
        emits = [it for it in story if it.ev == "emit"]
        if any(it.ev == "miss" or (it.ev == "refuse" and it.p is None) for it in story):
            missed.append(opened / 1e9)
        elif any(it.ev == "final" for it in story) or (emits and commit != "progressive"):
            last = emits[-1]
            assert last.p is not None
            went[last.p].append((opened / 1e9, (last.at - opened) / 1e6))
    return went, sorted(waits), sorted(missed)


@pytest.mark.parametrize("commit", ["eager", "patient", "progressive"])
@pytest.mark.parametrize("seed", range(4))
def test_a_timeline_is_an_account_of_its_trace(commit: str, seed: int) -> None:
    trace = random_trace(random.Random(seed), commit)
    went, waits, missed = account(trace.lines, commit)
    assert went and waits and missed
    axes: Any = trace.timeline()
    try:
        shown = list(axes.collections)
        names = {0: "local", 2: "cloud 2", 3: "cloud-3", 9: "cloud 9"}
        labels = [f"waited for in vain ({len(waits)})"]
        labels += [f"{names[p]} ({len(went[p])})" for p in sorted(went)]
        labels += [f"nothing ({len(missed)})"]
        assert [it.get_label() for it in shown] == labels
        legend = axes.get_legend()
        assert legend is not None and [it.get_text() for it in legend.get_texts()] == labels
        lines = shown[0]
        assert isinstance(lines, LineCollection)
        segments = sorted(tuple(map(tuple, it)) for it in lines.get_segments())
        assert segments == [((x, 0.0), (x, y)) for x, y in waits]
        colours = dict(zip((0, *PRIORITIES), COLOURS, strict=True))
        for p, points in zip(sorted(went), shown[1:-1], strict=True):
            assert points_of(points) == sorted(went[p])
            assert to_hex(points.get_facecolor()[0]) == colours[p]
        assert points_of(shown[-1]) == [(x, 0.0) for x in missed]
        assert to_hex(shown[-1].get_facecolor()[0]) == NOTHING
        assert axes.get_title(loc="left") == "lanes"
        assert axes.get_ylim()[0] == 0
        assert axes.get_xlabel().endswith(", s") and axes.get_ylabel().endswith(", ms")
        assert not axes.spines["top"].get_visible()
    finally:
        close(axes.figure)


def points_of(points: Any) -> list[tuple[float, float]]:
    return sorted((float(x), float(y)) for x, y in points.get_offsets())


def test_a_timeline_of_little_has_what_there_is() -> None:
    header = b'{"fuseline":1,"window":1,"clouds":[{"p":1,"limit":9}]}\n'
    figure, given = subplots()
    assert Trace(header, name="empty.jsonl").timeline(given) is given
    assert (given.get_title(loc="left"), list(given.collections)) == ("empty.jsonl", [])
    assert given.get_legend() is None
    other, axes = subplots()
    points: Any
    # A source that is not in the header has the colour for errors.
    strange = b'{"ev":"open","at":0,"t":1}\n{"ev":"emit","at":5000000,"t":1,"p":7}\n'
    Trace(header + strange).timeline(axes)
    (points,) = axes.collections
    assert points.get_label() == "cloud-7 (1)"
    assert points_of(points) == [(0.0, 5.0)]
    assert to_hex(points.get_facecolor()[0]) == NOTHING
    close(figure)
    close(other)
