"""Tests the machine: its answers, and the arguments and configurations that it refuses."""

from __future__ import annotations

import copy
import pickle
from datetime import timedelta
from typing import Any

import fuseline
import pytest
from conftest import CORPUS
from fuseline import (
    Accepted,
    Cloud,
    Fusion,
    OfferRefusal,
    OpenRefusal,
    Refused,
    ns,
)

END = 2**64 - 1


def test_what_would_be_refused_is_foreseen_and_nothing_changes() -> None:
    fusion = Fusion([Cloud(1, limit=2, resume=0), Cloud(2)], record=True)
    assert fusion.foresee(5, 1) is OfferRefusal.UNKNOWN
    fusion.open(0, 5)
    before = fusion.take_trace()
    assert before
    assert fusion.foresee(4, 1) is OfferRefusal.CLOSED
    assert fusion.foresee(5, 0) is OfferRefusal.UNKNOWN
    assert fusion.foresee(5, 1, 1) is None
    assert fusion.foresee(5, 1, 2) is OfferRefusal.QUEUE
    assert fusion.foresee(5, 1, 1) is None
    assert fusion.take_trace() == b""
    fusion.offer(0, 5, 2, ns(10))
    fusion.offer(0, 5, 1, ns(10))
    assert fusion.foresee(5, 1) is OfferRefusal.DUPLICATE


@pytest.mark.parametrize(
    ("duration", "nanos"),
    [
        (0, 0),
        (ns(1), 1),
        (ns(2**63 + 1), 2**63 + 1),
        (ns(END), END),
        (0.5, 500_000_000),
        (1e-9, 1),
        (1.4e-9, 1),
        (0.3017, 301_700_000),
        (float("inf"), END),
        (1e30, END),
        (timedelta(milliseconds=33), 33_000_000),
        (timedelta(microseconds=1), 1_000),
        (timedelta.max, END),
    ],
)
def test_durations_are_nanoseconds_seconds_or_timedeltas(duration: Any, nanos: int) -> None:
    assert fuseline.nanoseconds(duration) == nanos
    fusion = Fusion()
    opening = fusion.open(0, 1, duration)[1]
    assert opening == (Accepted() if nanos else Refused(OpenRefusal.DEADLINE))
    assert fusion.next_due == (nanos or None)


@pytest.mark.parametrize(
    ("duration", "error"),
    [
        (-1, TypeError),
        (float("nan"), fuseline.TimeError),
        (timedelta(microseconds=-1), fuseline.TimeError),
        (True, TypeError),
        (None, TypeError),
    ],
)
def test_what_is_no_duration_is_refused(duration: Any, error: type[Exception]) -> None:
    with pytest.raises(error):
        fuseline.nanoseconds(duration)


@pytest.mark.parametrize("instant", [0.5, True, "0", None, timedelta(1)])
def test_instants_are_whole_nanoseconds_alone(instant: Any) -> None:
    with pytest.raises(TypeError, match="nanoseconds"):
        Fusion().tick(instant)
    with pytest.raises(fuseline.TimeError):
        Fusion().tick(-1)


def test_what_stands_for_an_int_is_an_instant() -> None:
    class Index:
        def __index__(self) -> int:
            return 12

    fusion = Fusion()
    fusion.tick(Index())
    assert fusion.now == 12


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"window": 0}, "a window of 0; it must be from 1 to 1024"),
        ({"window": 1025}, "a window of 1025; it must be from 1 to 1024"),
        ({"window": 10**9}, "a window of 1000000000; it must be from 1 to 1024"),
        ({"window": -1}, "a window of -1; it must be from 1 to 1024"),
        ({"commit": "lazy"}, "a commit rule lazy; it must be eager, patient or progressive"),
        ({"clouds": [Cloud(0)]}, "a cloud with priority 0; it must be from 1 to 65535"),
        ({"clouds": [Cloud(65536)]}, "a cloud with priority 65536; it must be from 1 to 65535"),
        ({"clouds": [Cloud(1), Cloud(1)]}, "two clouds with priority 1"),
        ({"clouds": [Cloud(1, limit=0)]}, "cloud 1: its gate must resume below its limit"),
        ({"clouds": [Cloud(1, 2, 2)]}, "cloud 1: its gate must resume below its limit"),
        ({"clouds": [Cloud(p) for p in range(1, 17)]}, "16 clouds; there can be at most 15"),
    ],
)
def test_a_configuration_that_no_machine_has_is_refused(
    arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(fuseline.ConfigError) as error:
        Fusion(**arguments)
    assert str(error.value) == message


def test_a_header_makes_the_machine_and_is_given_back() -> None:
    cloud = '{"p":3,"limit":2,"resume":0}'
    line = f'{{"fuseline":1,"operator":"lane","window":4,"commit":"patient","clouds":[{cloud}]}}'
    for given in (line, line + "\n", line.encode()):
        assert Fusion.from_header(given).header == line
    with pytest.raises(fuseline.ConfigError, match="column 2"):
        Fusion.from_header("{window}")
    with pytest.raises(fuseline.ConfigError, match="this line is an event"):
        Fusion.from_header('{"ev":"tick","at":0}')


def test_it_is_shown_with_what_matters() -> None:
    fusion = Fusion([Cloud(2)], operator="lane")
    fusion.open(5, 1, ns(10))
    shown = 'Fusion("lane", clouds=[2], window=16, commit=eager, open=1, now=5, next_due=15)'
    assert repr(fusion) == shown
    assert 1 in fusion
    assert 2 not in fusion
    assert "1" not in fusion
    assert fusion.due(1, 0) == 15
    assert fusion.due(1, 2) is None
    assert fusion.newest == 1
    assert Fusion()  # true although nothing is open


@pytest.mark.parametrize("how", [pickle.dumps, copy.copy, copy.deepcopy])
def test_it_is_not_pickled_or_copied_and_says_why(how: Any) -> None:
    with pytest.raises(TypeError, match="two of them would answer for one operator"):
        how(Fusion())


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.stem)
def test_what_it_records_is_the_conforming_trace(path: Any) -> None:
    trace = fuseline.Trace(path)
    fusion = Fusion.from_header(path.read_bytes().splitlines()[0], record=True)
    recorded = b""
    line: Any
    for line in trace.lines:
        match line.ev:
            case "open":
                fusion.open(line.at, line.t, None if line.deadline is None else ns(line.deadline))
            case "offer":
                fusion.offer(line.at, line.t, line.p, ns(line.deadline), line.backlog)
            case "result":
                fusion.result(line.at, line.t, line.p)
            case "fail":
                fusion.fail(line.at, line.t, line.p)
            case "tick":
                fusion.tick(line.at)
        recorded += fusion.take_trace()
    assert [line[1:] for line in fuseline.Trace(recorded).lines] == [
        line[1:] for line in trace.lines
    ]
    assert not fuseline.check(recorded).violations


def test_a_machine_that_records_nothing_has_no_trace() -> None:
    with pytest.raises(fuseline.ConfigError, match="record=True"):
        Fusion().take_trace()
