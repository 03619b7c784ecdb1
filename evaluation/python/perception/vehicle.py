"""A vehicle that detects people on board, and with two clouds behind recorded networks, live.

    python vehicle.py FRAMES MODELS [--commit RULE] [--frames N] [--rate HZ]
                      [--deadline SECONDS] [--start K] [--kill CLOUD SECONDS]
                      [--strip FILE] [--trace FILE]

The small network runs in the vehicle, the larger ones in processes of their own behind gRPC; JPEGs
travel. Prints a row of the table of table.py for this run, judges its trace, and draws a strip of
its outputs into the current folder.
"""

from __future__ import annotations

import argparse
import asyncio
import subprocess
import sys
from collections import Counter
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path

import fuseline
import numpy as np
from fuseline import Item, Local, Operator
from fuseline.grpc import Remote

from detections import KEPT, SOURCES, KeptDetections, load
from draw import DrawnOutput, draw, strip
from emulation import STARTS
from frames import decode, jpegs
from metrics import Boxes
from play import CLOUDS, DEADLINE, Playthrough, SentBoxes
from record import network
from servers import decode_boxes
from table import COMMITS, NO_BOXES, Scorer, print_table

#: Frames in the strip.
DRAWN = 12


def start_servers(models: Path, start: int) -> dict[str, subprocess.Popen[str]]:
    """Starts a process for each cloud."""
    program = Path(__file__).with_name("servers.py")
    return {
        cloud: subprocess.Popen(
            [sys.executable, str(program), cloud, str(models), str(start)],
            stdout=subprocess.PIPE,
            text=True,
        )
        for cloud in CLOUDS
    }


def url_of(cloud: str, server: subprocess.Popen[str]) -> str:
    """Returns the first line that a server prints."""
    assert server.stdout is not None
    if not (line := server.stdout.readline().strip()):
        raise OSError(f"the server of {cloud} ended before it listened")
    return line


class LiveRun:
    """One run, and what it sent."""

    def __init__(self, options: argparse.Namespace, kept: KeptDetections) -> None:
        self._options, self._kept = options, kept
        self._files = jpegs(options.frames_folder)[: options.frames]
        self._model = network(options.models, "local")
        self._model.detect(decode(self._files[0].read_bytes()))  # the first is slower
        self._bytes = 0
        self.items: list[Item[Boxes]] = []

    async def drive(self, servers: dict[str, subprocess.Popen[str]]) -> None:
        """Drives to the last frame."""
        remotes = [Remote(url_of(cloud, server)) for cloud, server in servers.items()]
        operator = Operator(
            Local.threads(self._detect, waiting=2, deadline=max(1.0, self._options.deadline)),
            name="camera",
            window=64,
            commit=self._options.commit,
            trace=self._options.trace,
        )
        for priority, (cloud, remote) in enumerate(zip(servers, remotes, strict=True), 1):
            print(f"{cloud}: {await remote.describe()}")
            operator.use_cloud(remote.infer, self._offer, decode_boxes, priority, name=cloud)
        async with operator:
            operator.feed(self._camera(servers))
            async for item in operator:
                self.items.append(item)
        for remote in remotes:
            await remote.close()

    def _detect(self, jpeg: bytes, _: int) -> Boxes:
        return self._model.detect(decode(jpeg))

    def _offer(self, jpeg: bytes, _: int) -> tuple[bytes, float]:
        self._bytes += len(jpeg)
        return jpeg, self._options.deadline

    async def _camera(self, servers: dict[str, subprocess.Popen[str]]) -> AsyncIterator[bytes]:
        loop = asyncio.get_running_loop()
        begin, rate = loop.time(), self._kept.rate
        victim, second = self._options.kill or ("", "inf")
        for number, file in enumerate(self._files):
            jpeg = file.read_bytes()
            await asyncio.sleep(max(0.0, begin + number / rate - loop.time()))
            if number / rate >= float(second) and servers[victim].poll() is None:
                print(f"{victim} is killed at frame {number}")
                servers[victim].kill()
                servers[victim].wait()
            yield jpeg

    def played(self) -> tuple[KeptDetections, Playthrough]:
        """Returns the run in the form that table.py scores."""
        found: dict[str, list[Boxes]] = {it: [NO_BOXES] * len(self._files) for it in SOURCES}
        outputs = []
        for item in self.items:
            if item.value is not None and item.source is not None:
                found[str(item.source)][item.timestamp] = item.value
                took = (item.decided - item.opened) / 1e9
                at = item.timestamp / self._kept.rate + took
                outputs.append(SentBoxes(at, item.timestamp, str(item.source)))
        count = len(self._files)
        kept = replace(
            self._kept,
            jpeg_bytes=self._kept.jpeg_bytes[:count],
            reference=self._kept.reference[:count],
            found=found,
        )
        return kept, Playthrough(sorted(outputs), self._bytes)

    def draw(self, path: Path) -> None:
        """Draws a strip of frames from all over the run."""
        outputs: dict[int, list[DrawnOutput]] = {}
        for item in self.items:
            if item.value is not None:
                drawn = DrawnOutput(str(item.source), item.value, item.latency)
                outputs.setdefault(item.timestamp, []).append(drawn)
        numbers = np.linspace(0, len(self._files) - 1, DRAWN).astype(int)
        images = [
            draw(decode(self._files[it].read_bytes()), int(it), outputs.get(int(it), []))
            for it in numbers
        ]
        strip(images, path)


def parse() -> argparse.Namespace:
    """Parses the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("frames_folder", type=Path, metavar="FRAMES")
    parser.add_argument("models", type=Path, metavar="MODELS")
    parser.add_argument("--commit", choices=COMMITS, default="progressive")
    parser.add_argument("--frames", type=int, default=140, metavar="N", help="the number of frames [140]")
    parser.add_argument("--rate", type=float, metavar="HZ", help="frames a second [the video's]")
    parser.add_argument(
        "--deadline", type=float, metavar="SECONDS", default=DEADLINE, help="of a cloud [0.5]"
    )
    parser.add_argument("--start", type=int, default=0, metavar="K", help="of the drives [0]")
    parser.add_argument("--kill", nargs=2, metavar=("CLOUD", "SECONDS"))
    parser.add_argument("--strip", type=Path, default=Path("perception.png"), metavar="FILE")
    parser.add_argument("--trace", type=Path, default=Path("perception.jsonl"), metavar="FILE")
    options = parser.parse_args()
    if options.rate is not None and not 0.1 <= options.rate <= 100:
        parser.error("--rate is from 0.1 to 100 Hz")
    if not 0.001 <= options.deadline <= 60:
        parser.error("--deadline is from 0.001 to 60 s")
    if options.frames < 1 or not 0 <= options.start < STARTS:
        parser.error(f"--frames is at least 1, --start from 0 to {STARTS - 1}")
    if options.kill and (options.kill[0] not in CLOUDS or not _is_number(options.kill[1])):
        parser.error(f"--kill takes {' or '.join(CLOUDS)} and seconds")
    if not jpegs(options.frames_folder):
        parser.error(f"{options.frames_folder}: no frames; `run` makes them")
    return options


def main() -> int:
    """Drives."""
    options = parse()
    kept, servers = load(KEPT), {}
    try:
        run = LiveRun(options, replace(kept, rate=options.rate or kept.rate))
        servers = start_servers(options.models, options.start)
        asyncio.run(run.drive(servers))
    except OSError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    finally:
        for server in servers.values():
            server.kill()
            server.wait()
    kept, played = run.played()
    scores = Scorer(kept, options.deadline).score(played)
    print_table({f"live, {options.commit}": [scores]})
    last = Counter(str(it.source) for it in run.items if it.last)
    print(f"last outputs: {dict(last)}, frames: {len(kept)}")
    run.draw(options.strip)
    print(f"drawn: {options.strip}")
    verdict = fuseline.check(options.trace)
    print(verdict)
    return 0 if verdict.conforms else 1


def _is_number(word: str) -> bool:
    try:
        return float(word) >= 0
    except ValueError:
        return False


if __name__ == "__main__":
    sys.exit(main())
