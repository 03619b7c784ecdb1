"""Declares the compiled part of the package."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import timedelta
from os import PathLike
from typing import Any, BinaryIO, Literal, NoReturn, Protocol, SupportsIndex, TypeAlias, final

from fuseline._item import Item, Lineage
from fuseline._validation import (
    Admission,
    Cloud,
    Commit,
    Firing,
    OfferRefusal,
    Opening,
    Outcome,
    ns,
)

__all__ = [
    "Aligner",
    "Calls",
    "Counting",
    "Drive",
    "Engine",
    "Expected",
    "Fusion",
    "Gate",
    "Guard",
    "Latency",
    "Observations",
    "Reorderer",
    "check",
    "check_linger",
    "compare_responses",
    "compare_trace",
    "drives",
    "loss",
    "nanoseconds",
    "read",
    "replay",
    "report",
    "survey",
]

_Duration: TypeAlias = float | timedelta | ns
_Traced: TypeAlias = bytes | str | PathLike[str] | BinaryIO | Iterable[bytes] | Iterable[str]
_Slack: TypeAlias = tuple[_Duration, _Duration] | None
_Figure: TypeAlias = float | tuple[float, float]
_Time: TypeAlias = _Duration | tuple[_Duration, _Duration]
_Violation: TypeAlias = tuple[int, int | None, str, str, str, str, int | None, list[str]]
_Doubt: TypeAlias = tuple[str, int, str, int | None]
_Verdict: TypeAlias = tuple[str, bool, int, int, list[_Violation], int, list[_Doubt], str | None]
_Row: TypeAlias = tuple[
    int,
    str,
    int,
    tuple[int | None, int | None, int | None, int | None, int | None],
    str | None,
    tuple[
        int | None,
        int | None,
        int | None,
        int | None,
        int | None,
        str | None,
        int | None,
        list[str] | None,
    ]
    | None,
]
_Lineage: TypeAlias = tuple[str | None, int | None, int | None, _Duration | None, list[str]]
_Captured: TypeAlias = tuple[str | None, int | None, int | None, int | None, list[str]]
_Tolerances: TypeAlias = Sequence[tuple[str, _Duration]]
_Survey: TypeAlias = tuple[
    str | None,
    _Verdict,
    tuple[int, int, int, int, list[tuple[int, str, int, int]]],
]
_Chosen: TypeAlias = tuple[int, str, int | None, float | None]
_Seen: TypeAlias = tuple[int, bool, int]

_PolicyRow: TypeAlias = tuple[
    str,
    tuple[float, float] | None,
    tuple[int, int],
    list[tuple[Literal["exactly", "at least", "never"], int] | None],
]

class _Situation(Protocol):
    @property
    def speed(self) -> _Figure: ...
    @property
    def reveal(self) -> float | None: ...
    @property
    def under_way(self) -> Sequence[_Duration]: ...

class _Hazard(Protocol):
    @property
    def range_local(self) -> _Figure: ...
    @property
    def range_cloud(self) -> _Figure: ...
    @property
    def weight(self) -> float: ...

class _Parameters(Protocol):
    @property
    def deceleration(self) -> _Figure: ...
    @property
    def brake_delay(self) -> _Time: ...
    @property
    def frames(self) -> int: ...
    @property
    def period_local(self) -> _Time: ...
    @property
    def period_cloud(self) -> _Time: ...
    @property
    def local_response(self) -> _Time: ...
    @property
    def lateness(self) -> _Duration: ...
    @property
    def margin(self) -> float: ...
    @property
    def hazards(self) -> Sequence[_Hazard]: ...

class _Impact(Protocol):
    @property
    def vehicle(self) -> _Parameters: ...

class _Accuracy(Protocol):
    @property
    def local(self) -> float: ...
    @property
    def cloud(self) -> float: ...
    @property
    def price_per_ms(self) -> float: ...

class _Detector(Protocol):
    @property
    def accuracy(self) -> float: ...
    @property
    def overlap(self) -> float: ...

class _Stream(Protocol):
    @property
    def local(self) -> _Detector: ...
    @property
    def cloud(self) -> _Detector: ...
    @property
    def period(self) -> _Duration: ...

_Function: TypeAlias = Callable[[Any, Literal["local", "cloud"], ns], float]

@final
class Fusion:
    def __new__(
        cls,
        clouds: Sequence[Cloud] = (),
        *,
        window: int = 16,
        commit: Commit | Literal["eager", "patient", "progressive"] = "eager",
        operator: str | None = None,
        record: bool = False,
    ) -> Fusion: ...
    @staticmethod
    def from_header(line: bytes | str, *, record: bool = False) -> Fusion: ...
    def open(
        self, now: SupportsIndex, t: SupportsIndex, deadline: _Duration | None = None
    ) -> tuple[tuple[Firing, ...], Opening]: ...
    def offer(
        self,
        now: SupportsIndex,
        t: SupportsIndex,
        p: SupportsIndex,
        deadline: _Duration,
        backlog: SupportsIndex = 0,
    ) -> tuple[tuple[Firing, ...], Admission]: ...
    def result(
        self, now: SupportsIndex, t: SupportsIndex, p: SupportsIndex
    ) -> tuple[tuple[Firing, ...], Outcome]: ...
    def fail(
        self, now: SupportsIndex, t: SupportsIndex, p: SupportsIndex
    ) -> tuple[tuple[Firing, ...], Outcome]: ...
    def tick(self, now: SupportsIndex) -> tuple[Firing, ...]: ...
    def foresee(
        self, t: SupportsIndex, p: SupportsIndex, backlog: SupportsIndex = 0
    ) -> OfferRefusal | None: ...
    def due(self, t: SupportsIndex, p: SupportsIndex) -> int | None: ...
    def take_trace(self) -> bytes: ...
    @property
    def next_due(self) -> int | None: ...
    @property
    def now(self) -> int: ...
    @property
    def newest(self) -> int | None: ...
    @property
    def commit(self) -> str: ...
    @property
    def header(self) -> str: ...
    def __len__(self) -> int: ...
    def __bool__(self) -> bool: ...
    def __contains__(self, t: object, /) -> bool: ...
    def __reduce__(self) -> NoReturn: ...

@final
class Engine:
    def __new__(
        cls,
        clouds: Sequence[Cloud],
        bounds: Sequence[tuple[int, int, _Duration, Any]],
        local: tuple[int, int | None, bool, bool, int],
        window: int,
        commit: Commit | Literal["eager", "patient", "progressive"],
        operator: str,
        trace: str | PathLike[str] | None,
        reserve: Sequence[Latency],
        latency: Latency | None,
        has_substitutes: bool,
        lag_warning: _Duration,
        greatest_deadline: _Duration,
    ) -> Engine: ...
    def set_situation(self, situation: _Situation) -> None: ...
    def end(self, at: int) -> None: ...
    @property
    def counting(self) -> Counting: ...
    @property
    def is_recording(self) -> bool: ...
    def finish(self) -> None: ...

@final
class Counting:
    def counts(self) -> list[tuple[tuple[str, str, str], int]]: ...
    def deadlines(self) -> list[tuple[str, int, str]]: ...
    def handler_failed(self, p: int | None) -> None: ...
    def check_handler_time(self, p: int | None, lasted: int) -> None: ...
    @property
    def greatest_lag(self) -> int: ...
    @property
    def recording_error(self) -> str | None: ...

@final
class Calls:
    def __new__(
        cls,
        engine: Engine,
        driver: Any,
        clock: Callable[[], int],
        longest_step: int,
        counting: Counting,
        local_deadline: _Duration | None,
        sources: Sequence[
            tuple[int, Any, int, Callable[..., Any], Callable[[Any], Any] | None, bool, str, bool]
        ],
        create_task: Callable[..., Any],
        output: Callable[[Item[Any]], None],
        acted: Callable[[], None],
        waiting: list[Any],
        lineages: dict[int, Lineage],
        states: list[Any],
        handles_items: bool,
    ) -> Calls: ...
    def now(self) -> int: ...
    def open(
        self,
        at: int,
        t: int,
        job: Any,
        offers: Iterator[tuple[int, Any, _Duration]],
        lineage: _Lineage | None,
    ) -> None: ...
    def came(self, p: int, t: int, value: Any) -> None: ...
    def fail(self, at: int, t: int, p: int, why: str) -> None: ...
    def wake_up(self) -> None: ...
    def close(self) -> None: ...
    def stop(self) -> bool: ...
    def has_room(self, window: int) -> bool: ...
    @property
    def start(self) -> int: ...
    @property
    def is_over(self) -> bool: ...
    @property
    def is_idle(self) -> bool: ...

@final
class Aligner:
    def __new__(
        cls,
        names: Sequence[str],
        wait: _Duration,
        window: int,
        now: int,
        latest: Sequence[tuple[str, _Duration, bool]] = ...,
    ) -> Aligner: ...
    def arrive(
        self,
        at: int,
        index: int,
        key: int | None,
        lineage: _Captured | None,
        value: tuple[Any] | None,
        is_last: bool,
    ) -> str | None: ...
    def set_latest(self, at: int, index: int, lineage: _Captured | None, value: Any) -> None: ...
    def end(self, at: int, index: int) -> None: ...
    def set_reserve(self, latencies: Sequence[Latency]) -> None: ...
    def tick(self, at: int) -> None: ...
    def next_set(
        self, at: int
    ) -> tuple[int, dict[str, Any], list[str], str, _Captured | None] | None: ...
    @property
    def next_due(self) -> int | None: ...
    @property
    def is_over(self) -> bool: ...

@final
class Reorderer:
    def __new__(cls, wait: _Duration, reserve: _Duration, now: int) -> Reorderer: ...
    def arrive(
        self, at: int, timestamp: int, is_last: bool, lineage: _Captured | None, item: Any
    ) -> None: ...
    def tick(self, at: int) -> None: ...
    def end(self) -> None: ...
    def next_ready(self) -> tuple[str, Any, tuple[int, int] | None] | None: ...
    @property
    def next_due(self) -> int | None: ...

@final
class Gate:
    def __new__(cls, limit: SupportsIndex, resume: SupportsIndex) -> Gate: ...
    def admits(self, backlog: int) -> bool: ...

@final
class Latency:
    @staticmethod
    def stated(latency: _Duration, with_clouds: _Duration | None = None) -> Latency: ...
    @staticmethod
    def measured(percent: int, at_first: _Duration) -> Latency: ...
    def record(self, latency: _Duration) -> None: ...
    def record_local(self, latency: _Duration) -> None: ...
    @property
    def on_board(self) -> ns: ...
    @property
    def with_clouds(self) -> ns: ...

@final
class Guard:
    def __new__(cls, vehicle: _Parameters) -> Guard: ...
    def judge(self, known: _Situation) -> tuple[float, float, int, int]: ...
    def decide(self, known: _Situation, cap: _Duration) -> _Chosen: ...

@final
class Expected:
    def __new__(
        cls,
        loss: _Impact | _Accuracy | _Stream | _Function,
        local_response: _Time,
        probe_every: int | None,
    ) -> Expected: ...
    def decide(self, known: _Situation, cap: _Duration) -> _Chosen: ...
    def ended(self, end: str, age: _Duration) -> None: ...
    def moved(self, speeds: Sequence[float]) -> None: ...
    def observations(self) -> list[_Seen]: ...

@final
class Observations:
    def __new__(cls) -> Observations: ...
    def add(self, end: str, age: _Duration) -> None: ...
    def sorted(self) -> list[_Seen]: ...
    def survival(self, under_way: Sequence[_Duration]) -> list[tuple[int, float, float]]: ...

def check_linger(name: str, policy: Any, linger: _Duration) -> None: ...
def nanoseconds(duration: _Duration, /) -> ns: ...
def check(
    trace: _Traced,
    name: str | None,
    slack: _Slack,
    tolerances: _Tolerances,
    ended: bool,
    period: _Duration | None,
) -> _Verdict: ...
def read(trace: _Traced, name: str | None) -> tuple[str, str, list[_Row]]: ...
def replay(trace: _Traced, name: str | None) -> bytes: ...
def report(
    traces: Sequence[tuple[_Traced, str | None]], slack: _Slack, tolerances: _Tolerances
) -> tuple[list[_Verdict], bytes]: ...
def survey(trace: _Traced, name: str | None, slack: _Slack) -> _Survey: ...
def loss(
    loss: _Impact | _Accuracy | _Stream, known: _Situation, source: str, response: _Duration
) -> float: ...

@final
class Drive:
    def __new__(cls, name: str) -> Drive: ...
    @property
    def name(self) -> str: ...
    @property
    def length(self) -> int: ...
    def samples(self) -> list[tuple[int, int | None]]: ...
    def round_trip(self, at: _Duration) -> int | None: ...

def drives() -> list[str]: ...
def compare_trace(
    trace: _Traced, name: str | None, deadline: _Duration, accuracies: Sequence[tuple[str, float]]
) -> list[_PolicyRow]: ...
def compare_responses(
    sources: Sequence[tuple[str, int, float | None]],
    messages: Sequence[Sequence[_Duration | None]],
    deadline: _Duration,
) -> list[_PolicyRow]: ...
