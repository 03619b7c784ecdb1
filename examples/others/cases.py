"""The runs of the gallery: whom they drive, through what, and which promises break there."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

#: Delays of replies in milliseconds: slow, stalled, failing, too late, reordered, and one whose hedge is quick.
HOSTILE = [5, 5, [300, 5], 5, None, 5, "fail", 300, [60, 5], 5, 5, 5]
#: The last messages find the server killed.
KILLED: dict[str, Any] = {"delays": HOSTILE, "kill_at": 10}
#: Something computes for 350 ms where the operator runs, while a call is under way that ends too late.
BLOCKED = {"delays": [5, 5, 300, 5, 5], "block_at": 2, "block": 350, "period": 600}
#: A server that is now and then slow or does not answer; always.py also kills, restarts and stops it.
HARMED: dict[str, Any] = {
    "delays": [5] * 18 + ["fail", 5, 40, None, 5, 5, 8, 5, 5, 5, 60],
    "repeats": True,
    "period": 33,
    "chunk": 20,
    "ticks": 1000,
}
#: One stalls between two that come, then several in a row.
DORA = [5, 5, 60, None, 5, 5, 5, None, None, None, None, 5, 5, 5]
#: The first chunk takes as long as 21 steps, in which the arm has no action and stands still.
SPLICED = {"delays": [690, 100], "period": 33, "chunk": 30, "ticks": 90}
CHUNKS = {"delays": [40, 60, 80, 110], "period": 33, "chunk": 10}


@dataclass(frozen=True)
class Case:
    """One run of a third party's software."""

    name: str
    #: The harness's language (wheel: Python with the wheel of Fuseline), its program and mode.
    language: str
    harness: str
    scenario: dict[str, Any]
    #: The rules and promises that break: each of them, and none but these and `may_break`.
    breaks: frozenset[str] = frozenset()
    may_break: frozenset[str] = frozenset()
    #: Further keys of the trace's header, `max_age` and `name` of its cloud.
    header: dict[str, Any] = field(default_factory=dict)
    options: tuple[str, ...] = ("--ended",)


def broken(*rules: str) -> frozenset[str]:
    """Rules and promises."""
    return frozenset(rules)


NO_LOCAL = {"local": "none"}
CASES = [
    Case(
        "erdos",
        "rust",
        "erdos deadline",
        {"delays": [5, None, 60, None, None, 5, 90], "period": 150},
    ),
    Case("erdos-overlapping", "rust", "erdos deadline", {"delays": [None] * 8}, broken("P5")),
    Case("tower-resilience", "rust", "hedge tower", KILLED),
    Case("tower-resilience-blocked", "rust", "hedge tower", BLOCKED, broken("P2"), broken("J2")),
    Case(
        "tower-limit-1",
        "rust",
        "hedge tower-queue",
        {"delays": [None] * 6},
        broken("J2"),
        broken("P4", "P5"),
    ),
    Case("seatbelt", "rust", "hedge seatbelt", KILLED),
    Case("seatbelt-blocked", "rust", "hedge seatbelt", BLOCKED, broken("P2"), broken("J2")),
    Case("cockatiel", "js", "fallbacks.mjs cockatiel-aggressive", KILLED),
    Case(
        "cockatiel-cooperative",
        "js",
        "fallbacks.mjs cockatiel-cooperative",
        {"delays": HOSTILE},
        broken("P2", "P5"),
    ),
    Case("cockatiel-blocked", "js", "fallbacks.mjs cockatiel-aggressive", BLOCKED, broken("P2")),
    Case("opossum", "js", "fallbacks.mjs opossum", KILLED),
    Case("opossum-blocked", "js", "fallbacks.mjs opossum", BLOCKED, broken("P2")),
    Case("grpc-js", "js", "hedged.mjs hedging", KILLED),
    Case("grpc-js-blocked", "js", "hedged.mjs hedging", BLOCKED, broken("P4")),
    Case(
        "openpi-client",
        "python",
        "openpi_policy.py plain",
        {"delays": [5, 5, 300, 5, None]},
        broken("P2", "P7"),
        header=NO_LOCAL,
    ),
    Case(
        "openpi-client-timeout",
        "python",
        "openpi_policy.py timeout",
        {"delays": [5, 5, 170, 5, 5], "period": 120},
        broken("D2"),
    ),
    Case(
        "lerobot-steps",
        "python",
        "lerobot_client.py steps",
        {**CHUNKS, "bus": 10, "ticks": 200},
        broken("P1"),
        header={**NO_LOCAL, "max_age": 9},
        options=(),
    ),
    Case(
        "lerobot-stopped",
        "python",
        "lerobot_client.py ticks",
        {**CHUNKS, "bus": 2, "ticks": 60, "kill_at": 30, "signal": 19},
        broken("J1"),
        header=NO_LOCAL,
        options=("--period", "33ms"),
    ),
    Case(
        "lerobot-rtc",
        "python",
        "lerobot_rtc.py released",
        SPLICED,
        broken("D18"),
        header={**NO_LOCAL, "max_age": 30},
    ),
    Case(
        "lerobot-rtc-mended",
        "python",
        "lerobot_rtc.py mended",
        SPLICED,
        header={**NO_LOCAL, "max_age": 30},
        # The arm acts at once, and what an action is meant for does not depend on instants.
        options=("--ended", "--accept", "blurred,coarse"),
    ),
    Case("positronic", "python", "positronic_session.py hold", {"delays": HOSTILE, "period": 120}),
    Case(
        "positronic-reopened", "python", "positronic_session.py reopen", {**KILLED, "period": 120}
    ),
    Case(
        "dora-rs",
        "python",
        "dora_fallback.py checked",
        {"delays": DORA},
        broken("F3"),
        # A daemon and two processes are late one after the other where a host is busy.
        broken("P3", "P4", "P5"),
    ),
    Case(
        "dora-rs-default",
        "python",
        "dora_fallback.py default",
        {"delays": DORA},
        broken("P5"),
        broken("P4"),
    ),
    Case("tenacity", "python", "tenacity_retry.py retry", {"delays": HOSTILE}, broken("P2", "P5")),
    Case("tenacity-timeout", "python", "tenacity_retry.py timeout", KILLED),
    Case(
        "grpc-js-spans",
        "js",
        "spans.cjs hedging",
        KILLED,
        header={"name": "grpc.infer.Model/Infer"},
    ),
    Case("always-openpi", "wheel", "always.py openpi", HARMED),
    Case("always-lerobot", "wheel", "always.py lerobot", HARMED),
]
