"""Recorded networks: round trips of a moving vehicle by the moment of sending."""

from __future__ import annotations

import csv
from bisect import bisect_right
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
DRIVES = ROOT / "testkit/data"
#: The columns of `testkit/data`, except a wifi that was hardly ever there.
NETWORKS = (
    *(("cicv5g", name, "rtt_ms") for name in (
        "arterial_n78_v80", "rural_n8_v0", "rural_n8_v10", "strong_to_weak_n8_v30",
        "urban_n78_v40", "weak_to_strong_n8_v50",
    )),
    *(("vnperf", name, f"{carrier}_rtt_ms")
      for name in ("downtown", "highway") for carrier in ("verizon", "sprint")),
)  # fmt: skip


@dataclass(frozen=True)
class Network:
    """One column of one recorded drive. A drive that is over starts again."""

    name: str
    #: Seconds from the first row.
    sent: tuple[float, ...]
    #: Seconds; None where the network was unavailable.
    round_trips: tuple[float | None, ...]

    @property
    def length(self) -> float:
        """The seconds until it starts again. The last row lasts as long as the row before it."""
        return 2 * self.sent[-1] - self.sent[-2]

    def round_trip(self, at: float) -> float | None:
        """Returns the round trip of a message sent this many seconds after the drive's start."""
        return self.round_trips[bisect_right(self.sent, at % self.length) - 1]


def load(folder: str, name: str, column: str) -> Network:
    """Loads one column of one file of `testkit/data`."""
    sent, round_trips = [], []
    with (DRIVES / folder / f"{name}.csv").open(newline="") as text:
        for row in csv.DictReader(text):
            sent.append(float(row["second"]) if "second" in row else float(row["sent_ms"]) / 1e3)
            value = float(row[column])
            round_trips.append(value / 1e3 if value >= 0 else None)
    return Network(
        f"{folder}/{name}:{column.removesuffix('_rtt_ms')}", tuple(sent), tuple(round_trips)
    )


def load_all() -> list[Network]:
    """Returns the ten columns that `fuseline scenario networks` uses."""
    return [load(*network) for network in NETWORKS]
