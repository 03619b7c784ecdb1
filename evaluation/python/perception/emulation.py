"""The recorded networks between vehicle and clouds, from ten places of each drive."""

from __future__ import annotations

import statistics

from fuseline.networks import Drive, RecordedNetwork

#: West is behind 5G with outages of seconds, east behind LTE on a highway.
NETWORKS = {"west": Drive("cicv5g/rural_n8_v10"), "east": Drive("vnperf/highway:sprint")}
#: The start of a drive, and the step from one start to the next, in seconds.
OFFSETS = {"west": (0.0, 11.0), "east": (150.0, 290.0)}
STARTS = 10


def typical_delay(cloud: str) -> float:
    """Returns the median round trip, in seconds, while there is a network."""
    return statistics.median(trip for _, trip in NETWORKS[cloud].samples if trip is not None)


def delay(cloud: str, start: int, seconds: float) -> float:
    """Returns the round trip of a message that is sent this long after a start, in seconds."""
    first, step = OFFSETS[cloud]
    trip = NETWORKS[cloud].round_trip(first + start * step + seconds)
    assert trip is not None, "neither drive is without a network for ever"
    return trip


def network_from(cloud: str, start: int) -> RecordedNetwork:
    """Returns a cloud's network from a start on."""
    first, step = OFFSETS[cloud]
    return RecordedNetwork(NETWORKS[cloud], first + start * step)
