"""The recorded networks between vehicle and clouds, from ten places of each drive."""

from __future__ import annotations

import statistics
import sys
from bisect import bisect_right
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / "worlds"))

from network import Network, load

#: West is behind 5G with outages of seconds, east behind LTE on a highway.
NETWORKS = {
    "west": load("cicv5g", "rural_n8_v10", "rtt_ms"),
    "east": load("vnperf", "highway", "sprint_rtt_ms"),
}
#: Where a drive is begun, and how much later for each start, in seconds.
OFFSETS = {"west": (0.0, 11.0), "east": (150.0, 290.0)}
STARTS = 10


def typical_delay(cloud: str) -> float:
    """The median round trip, in seconds, while there is a network."""
    return statistics.median(it for it in NETWORKS[cloud].round_trips if it is not None)


def delay(cloud: str, start: int, seconds: float) -> float:
    """The round trip of what is sent so long after a start, in seconds."""
    first, step = OFFSETS[cloud]
    return delay_at(NETWORKS[cloud], first + start * step + seconds)


def delay_at(network: Network, at: float) -> float:
    """The round trip of what is sent at a place of a drive, in seconds.

    While the network was unavailable a message waits until it is there again.
    """
    at %= network.length
    index = bisect_right(network.sent, at) - 1
    waited, rows = 0.0, len(network.sent)
    while (round_trip := network.round_trips[index]) is None:
        following = (index + 1) % rows
        waited += (network.sent[following] if following else network.length) - at
        index, at = following, network.sent[following]
    return waited + round_trip
