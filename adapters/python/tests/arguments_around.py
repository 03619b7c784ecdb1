"""Lists the arguments that the parts around operators accept and refuse, for `test_arguments`."""

from __future__ import annotations

import functools
from collections.abc import AsyncIterator
from typing import Any

from arguments import (
    DRIVE,
    DURATION,
    RESERVE,
    SKIPPED,
    TRACE,
    Arguments,
    PlainObject,
    SilentSubscriber,
    but_none,
    count,
    echo,
    function,
    method,
    plain,
)
from fuseline import (
    ConfigError,
    Items,
    Join,
    Lineage,
    check_observed,
)
from fuseline import report as report_page
from fuseline.fleet import judge
from fuseline.grpc import Identity, Remote, Server, Token
from fuseline.networks import Drive, RecordedNetwork, Responses, compare, compare_responses
from fuseline.robot import Always, Chunk, Hold, fade
from fuseline.ros import TimeSynchronizer


def joined() -> Join:
    join = Join()
    join.aligned("left")
    join.latest("place", 1.0)
    return join


async def of_items() -> AsyncIterator[Any]:
    nothing: list[Any] = []
    for item in nothing:
        yield item


def reader() -> Items[Any]:
    return Items(of_items())


def always(**of: Any) -> None:
    Always(**of).close()


def chunked(**of: Any) -> None:
    always(remote=PlainObject, on_board=Hold(0), period=0.1, chunk=Chunk(**of))


def synchronizer(**of: Any) -> TimeSynchronizer:
    return TimeSynchronizer(None, **of)


def responses(seconds: list[Any], priority: int) -> Responses:
    return Responses(seconds, priority)


LOCAL = responses([0.1], 0)
CASES_AROUND: dict[str, Arguments] = {
    "Join": Arguments(
        Join,
        {},
        {
            "wait": DURATION,
            "window": count("a window"),
            "reserve": RESERVE,
            "output_len": count("an output_len"),
            "clock": function("a clock"),
        },
        {"window": [1], "output_len": [1], "wait": [0.0]},
        free="name",
    ),
    "Join.aligned": Arguments(
        method(joined, "aligned"),
        {"name": "right"},
        {
            "name": [("left", ConfigError, "two inputs are named 'left'; give each its own name")],
            "key": but_none(function("a key")),
        },
        {"key": [None, plain]},
        of=Join.aligned,
    ),
    "Join.items": Arguments(
        method(joined, "items"),
        {"name": "right", "items": of_items()},
        {"name": [("left", ConfigError, "two inputs are named 'left'")]},
        free="items",
        of=Join.items,
    ),
    "Join.latest": Arguments(
        method(joined, "latest"),
        {"name": "speed", "max_age": 1.0},
        {"name": [("left", ConfigError, "two inputs are named 'left'")], "max_age": DURATION},
        free="items",
        of=Join.latest,
    ),
    "Join.origin_of": Arguments(
        method(joined, "origin_of"),
        {"latest": "place"},
        {
            "latest": [
                (
                    it,
                    ConfigError,
                    f"{it!r} is not a latest-value input of this join; name one that is",
                )
                for it in ("left", "elsewhere")
            ]
        },
        of=Join.origin_of,
    ),
    "Join.on_drop": Arguments(
        method(joined, "on_drop"),
        {"on_drop": plain},
        {"on_drop": function("on_drop")},
        of=Join.on_drop,
    ),
    "Items": Arguments(
        Items,
        {"source": of_items(), "output_len": 2},
        {"output_len": count("an output_len")},
        {"output_len": [1]},
        free="source",
    ),
    "Items.in_order": Arguments(
        method(reader, "in_order"),
        {"wait": 0.1},
        {
            "wait": DURATION,
            "reserve": DURATION,
            "report": but_none(function("a report")),
            "clock": function("a clock"),
        },
        {"report": [None, plain]},
        of=Items.in_order,
    ),
    "Lineage": Arguments(
        Lineage,
        {"origin": "camera", "seq": 7},
        {
            "origin": [
                (
                    None,
                    ValueError,
                    "a seq is given without an origin; name the stream that it counts in",
                )
            ],
            "captured": [(1.5, TypeError, "captured at 1.5; give nanoseconds, as monotonic_ns()")],
            "within": DURATION,
        },
        {"seq": [None], "captured": [None, 0], "within": [None, 0.0]},
        free="seq missing",
    ),
    "TimeSynchronizer": Arguments(
        synchronizer,
        {"subscribers": {"left": SilentSubscriber()}, "wait": 0.1},
        {
            "subscribers": [({}, ConfigError, "a synchronizer of no topics; give at least one")],
            "wait": DURATION,
            "window": count("a window"),
            "key": but_none(function("a key")),
        },
        {"window": [1], "key": [None]},
        free="node clock timer",
        of=TimeSynchronizer,
    ),
    "TimeSynchronizer.registerCallback": Arguments(
        method(
            lambda: synchronizer(subscribers={"left": SilentSubscriber()}, wait=0.1),
            "registerCallback",
        ),
        {"callback": plain},
        {"callback": function("a callback")},
        of=TimeSynchronizer.registerCallback,
    ),
    "TimeSynchronizer.on_drop": Arguments(
        method(lambda: synchronizer(subscribers={"left": SilentSubscriber()}, wait=0.1), "on_drop"),
        {"on_drop": plain},
        {"on_drop": function("on_drop")},
        of=TimeSynchronizer.on_drop,
    ),
    "Always": Arguments(
        always,
        {"remote": PlainObject, "on_board": Hold(0), "period": 0.1},
        {
            "remote": [(None, ConfigError, "as a function that connects, not as None")],
            "period": [
                (None, ConfigError, "neither a deadline nor a period is given; give one"),
                (30.0, ConfigError, "for 30 Hz give 1 / 30"),
                *DURATION,
            ],
            "deadline": [(0.2, ConfigError, "above the period"), *DURATION],
            "linger": DURATION,
            "on_failure": but_none(function("on_failure")),
        },
        {"on_board": [lambda observation: observation], "deadline": [0.1], "period": [2.0]},
        free="on_board chunk trace name",
        of=Always,
    ),
    "Chunk": Arguments(
        chunked,
        {"every": 1, "max_age": 1},
        {
            "every": count("ticks between chunks"),
            "max_age": count("a max_age", 0),
            "skip": [("all", ConfigError, SKIPPED)],
            "within": DURATION,
        },
        {"max_age": [1], "skip": ["executed", "none"]},
        free="split blend",
        of=Chunk,
    ),
    "fade": Arguments(fade, {"ticks": 1}, {"ticks": count("a fade's ticks")}, free="max_jump"),
    "Token": Arguments(
        Token,
        {"token": "secret"},
        {"token": [(it, ConfigError, "visible ASCII") for it in ("", "a b", "é", "a\x7f", " ")]},
        {"token": ["!", "~"]},
    ),
    "Remote": Arguments(
        Remote,
        {"url": "https://west:1", "ca": b""},
        {
            "url": [
                *(
                    (it, ConfigError, f"the cloud's URL {it!r}; it must be http://host:port or")
                    for it in ("ftp://west:1", "http://:1", "http://west", "http://west:99999")
                ),
                ("http://west:1", ConfigError, "certificates need an https URL"),
            ],
            "ca": [(None, ConfigError, "an https URL needs the certificate of the CA")],
            "token": [("", ConfigError, "visible ASCII")],
        },
        free="identity server_name",
    ),
    "Remote, without TLS": Arguments(
        functools.partial(Remote, "http://west:1"),
        {},
        {
            "ca": [(b"", ConfigError, "certificates need an https URL, but this one is http")],
            "identity": [(Identity(b"", b""), ConfigError, "certificates need an https URL")],
        },
        free="server_name token",
    ),
    "Server": Arguments(
        Server,
        {"infer": echo},
        {
            "client_ca": [(b"", ConfigError, "needs a certificate and a key of its own")],
            "token": [("", ConfigError, "visible ASCII")],
        },
        free="infer address identity description calls",
    ),
    "RecordedNetwork": Arguments(
        RecordedNetwork,
        {"drive": DRIVE},
        {
            "drive": [("nowhere", OSError, "nowhere")],
            "start": [
                *DURATION,
                (
                    Drive(DRIVE).length,
                    ValueError,
                    f"is beyond {DRIVE}, which lasts {Drive(DRIVE).length:g} s",
                ),
            ],
        },
        {"start": [Drive(DRIVE).length - 0.001]},
    ),
    "compare": Arguments(
        compare,
        {"trace": TRACE, "deadline": 0.5},
        {
            "deadline": DURATION,
            "accuracies": [({"east": 1.0}, ValueError, "east")],
            "trace": [(b"", ValueError, "<bytes>")],
        },
        {"accuracies": [None, {}, {"west": 0.5}]},
        free="name",
    ),
    "compare_responses": Arguments(
        compare_responses,
        {"sources": {"local": LOCAL}, "deadline": 0.5},
        {
            "sources": [
                ({}, ValueError, "no source of priority 0, which is local"),
                ({"west": responses([0.1], 1)}, ValueError, "no source of priority 0"),
                (
                    {"local": LOCAL, "west": responses([0.1], 3), "east": responses([0.1], 3)},
                    ValueError,
                    "priorities [0, 3, 3]; give each source its own, up to 65535",
                ),
                (
                    {"local": LOCAL, "west": responses([0.1], 65536)},
                    ValueError,
                    "priorities [0, 65536]; give each source its own, up to 65535",
                ),
                (
                    {"local": LOCAL, "west": responses([], 1)},
                    ValueError,
                    "sources with responses for different numbers of messages",
                ),
            ],
            "deadline": DURATION,
        },
        {"sources": [{"local": LOCAL, "west": responses([None], 65535)}]},
    ),
    "check_observed": Arguments(
        check_observed,
        {"trace": TRACE, "tolerance": 0.1, "lateness": 0.1},
        {
            "tolerance": DURATION,
            "lateness": DURATION,
            "tolerances": [({"east": 0.1}, ValueError, "east")],
            "period": DURATION,
            "accept": [(["coarser"], ValueError, "coarser")],
        },
        {"tolerances": [None, {"west": 0.1}], "period": [None], "accept": [["coarse"]]},
        free="trace name ended",
    ),
    "report": Arguments(
        lambda traces, **of: report_page(*traces, page="/nowhere/page.html", **of),
        {},
        {
            "traces": [
                ([], ValueError, "report takes at least one trace"),
                ([["a"], TRACE], ValueError, "a list of paths stands for all traces"),
                ([TRACE], OSError, "/nowhere/page.html"),
            ],
        },
        free="page names tolerance lateness tolerances",
        of=report_page,
    ),
    "report, of one": Arguments(
        lambda **of: report_page(TRACE, page="/dev/null/page.html", **of),
        {},
        {
            "names": [(["a", "b"], ValueError, "there are 1 traces and 2 names")],
            "tolerance": [(0.1, ValueError, "tolerance and lateness go together")],
            "lateness": [(0.1, ValueError, "tolerance and lateness go together")],
            "tolerances": [({"west": 0.1}, ValueError, "need a tolerance for all other sources")],
        },
        free="traces page",
        of=report_page,
    ),
    "fleet.judge": Arguments(
        judge,
        {"path": "nowhere"},
        {
            "tolerance": [(0.1, ValueError, "tolerance and lateness go together")],
            "lateness": [(0.1, ValueError, "tolerance and lateness go together")],
            "accept": [(["coarser"], ValueError, "coarser")],
        },
        {"accept": [["coarse"]]},
        free="path drive open",
    ),
}
