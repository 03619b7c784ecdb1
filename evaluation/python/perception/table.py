"""Compares approaches on kept detections, over recorded networks from ten starts.

    python table.py [--detections FILE] [--starts N] [--speed-share SHARE]

AP50 and AP are by frame: the last output that was sent for it in time, and nothing if none was.
sAP is streaming: at the instant of each frame, the newest output sent by then; fsAP the same with
its boxes moved on at constant velocity. p50 and p99 are of a frame's first output.
"""

from __future__ import annotations

import argparse
import sys
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from detections import KEPT, SOURCES, KeptDetections, load
from emulation import STARTS
from forecast import Forecast
from metrics import BoxMatches, match, precision
from play import DEADLINE, KeptDrive, MeasuredPolicies, Playthrough

COMMITS = ("eager", "patient", "progressive")
NO_BOXES = np.zeros((0, 5))


@dataclass(frozen=True)
class Scores:
    """The outcome of an approach from one start; shares in percent, times in ms."""

    ap50: float
    ap: float
    sap50: float
    sap: float
    fsap50: float
    fsap: float
    on_time: float
    p50: float
    p99: float
    megabytes: float


class Scorer:
    """Scores outputs against the reference."""

    def __init__(self, kept: KeptDetections, deadline: float = DEADLINE) -> None:
        self._kept, self._deadline = kept, deadline
        self._known: dict[tuple[str, int, int], BoxMatches] = {}

    def score(self, played: Playthrough) -> Scores:
        """Returns all scores of a playthrough."""
        kept = self._kept
        in_time, first = self._by_frame(played)
        by_frame = precision(self._matches(in_time.get(k), k) for k in range(len(kept)))
        stream, forecasted = self._stream(played)
        streaming = precision(self._matches(it, k) for k, it in enumerate(stream))
        ahead = precision(map(match, forecasted, kept.reference))
        responses = np.array(list(first.values())) * 1e3
        return Scores(
            *by_frame,
            *streaming,
            *ahead,
            len(in_time) / len(kept) * 100,
            float(np.percentile(responses, 50)),
            float(np.percentile(responses, 99)),
            played.byte_count / 1e6,
        )

    def _by_frame(self, played: Playthrough) -> tuple[dict[int, tuple[str, int]], dict[int, float]]:
        """Returns the last output in time of each frame, and how long the first took."""
        last: dict[int, tuple[str, int]] = {}
        first: dict[int, float] = {}
        for it in played.outputs:
            took = it.at - it.frame / self._kept.rate
            first.setdefault(it.frame, took)
            if took <= self._deadline + 1e-6:
                last[it.frame] = (it.source, it.frame)
        return last, first

    def _stream(self, played: Playthrough) -> tuple[list[tuple[str, int] | None], list[np.ndarray]]:
        """Returns the newest output at each frame's instant, and its boxes moved on."""
        kept = self._kept
        newest: tuple[int, int] | None = None
        stream: list[tuple[str, int] | None] = []
        moved, forecast, at = [], Forecast(), 0
        for number in range(len(kept)):
            now = number / kept.rate
            while at < len(played.outputs) and played.outputs[at].at <= now + 1e-9:
                it = played.outputs[at]
                at += 1
                # An old frame's revision does not take a newer frame's place.
                if newest is None or (it.frame, SOURCES.index(it.source)) > newest:
                    newest = it.frame, SOURCES.index(it.source)
                    forecast.update(it.frame / kept.rate, kept.found[it.source][it.frame].tolist())
            stream.append(None if newest is None else (SOURCES[newest[1]], newest[0]))
            moved.append(np.array(forecast.boxes(now)).reshape(-1, 5))
        return stream, moved

    def _matches(self, boxes: tuple[str, int] | None, frame: int) -> BoxMatches:
        """Returns which of a source's boxes of one frame are right in another."""
        if boxes is None:
            return match(NO_BOXES, self._kept.reference[frame])
        source, of = boxes
        key = source, of, frame
        if key not in self._known:
            self._known[key] = match(self._kept.found[source][of], self._kept.reference[frame])
        return self._known[key]


def approaches(kept: KeptDetections) -> Iterable[tuple[str, Callable[[KeptDrive], Playthrough]]]:
    """Yields each approach with its name."""
    for source in SOURCES:
        yield f"{source} alone", lambda drive, source=source: drive.alone(source)  # type: ignore[misc]
    yield "first response", KeptDrive.first_response
    for name, policy in MeasuredPolicies(kept).named():
        for commit in COMMITS:
            yield (
                f"{commit}, {name}",
                lambda drive, commit=commit, policy=policy: drive.fused(commit, policy),  # type: ignore[misc]
            )


def compare(
    kept: KeptDetections, starts: int, names: Iterable[str] | None = None, speed_share: float = 1.0
) -> dict[str, list[Scores]]:
    """Returns the scores of each approach from each start."""
    scorer = Scorer(kept)
    wanted = None if names is None else set(names)
    return {
        name: [scorer.score(play(KeptDrive(kept, it, speed_share))) for it in range(starts)]
        for name, play in approaches(kept)
        if wanted is None or name in wanted
    }


def mean(scores: list[Scores], figure: str) -> float:
    """Returns a figure's mean over the starts."""
    return float(np.mean([getattr(it, figure) for it in scores]))


def least_gain(scores: list[Scores], against: list[Scores], figure: str) -> float:
    """Returns the least difference between a figure and another approach's, over the starts."""
    pairs = zip(scores, against, strict=True)
    return min(float(getattr(one, figure) - getattr(other, figure)) for one, other in pairs)


def print_table(rows: dict[str, list[Scores]]) -> None:
    """Prints the table in Markdown, with means over the starts."""
    heads = ["AP50", "AP", "sAP50", "sAP", "fsAP50", "fsAP", "on time", "p50", "p99", "sent"]
    local = rows.get("local alone")
    heads += ["least sAP50 over local", "least fsAP50 over local"] if local else []
    print(f"| approach | {' | '.join(heads)} |\n|{'---|' * (len(heads) + 1)}")
    for name, scores in rows.items():
        values = {it.name: mean(scores, it.name) for it in fields(Scores)}
        cells = [f"{values[it]:.1f}" for it in list(values)[:6]]
        cells += [
            f"{values['on_time']:.1f} %",
            f"{values['p50']:.0f} ms",
            f"{values['p99']:.0f} ms",
        ]
        cells.append(f"{values['megabytes']:.1f} MB")
        if local:
            gains = [least_gain(scores, local, it) for it in ("sap50", "fsap50")]
            cells += [f"{gain:+.1f}" for gain in gains]
        print(f"| {name} | {' | '.join(cells)} |")


def main() -> int:
    """Compares."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--detections", type=Path, default=KEPT, metavar="FILE")
    parser.add_argument("--starts", type=int, default=STARTS, metavar="N", help="[10]")
    parser.add_argument(
        "--speed-share",
        type=float,
        default=1.0,
        metavar="SHARE",
        help="of the boxes' speeds that Streaming learns [1]",
    )
    options = parser.parse_args()
    if options.starts < 1:
        parser.error(f"--starts {options.starts}: at least 1")
    if not 0.0 <= options.speed_share <= 1.0:
        parser.error(f"--speed-share {options.speed_share}: from 0 to 1")
    try:
        kept = load(options.detections)
    except (OSError, EOFError, ValueError, KeyError, zlib.error) as error:
        parser.error(f"{options.detections}: {error}")
    networks = ", ".join(f"{source} {network}" for source, network in kept.networks.items())
    print(f"{len(kept)} frames at {kept.rate:g} Hz, {options.starts} starts; {networks}\n")
    print_table(compare(kept, options.starts, speed_share=options.speed_share))
    return 0


if __name__ == "__main__":
    sys.exit(main())
