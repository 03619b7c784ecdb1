"""The paper's planner: it brakes once three consecutive frames, in any order, report an obstacle."""

from __future__ import annotations


class Planner:
    """Counts frames, not arrivals."""

    def __init__(self, wanted: int = 3) -> None:
        self._wanted, self._reports = wanted, dict[int, bool]()

    def take(self, t: int, reports: bool) -> bool:
        """Takes the output of frame `t` and returns whether the planner now decides to brake."""
        self._reports[t] = reports
        if not reports:
            return False
        row = 1
        for step in (-1, 1):
            at = t + step
            while self._reports.get(at, False):
                row, at = row + 1, at + step
        return row >= self._wanted
