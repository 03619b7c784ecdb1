"""A cloud in a process of its own: a network behind gRPC, and a recorded network before it.

    python servers.py CLOUD MODELS START

It prints its URL, and serves until it is killed. The recorded round trip is waited for here, half
of it before the network computes and half after; the JPEG's way through the host comes on top.
"""

from __future__ import annotations

import asyncio
import json
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from fuseline import Call
from fuseline.grpc import Description, Server

from emulation import network_from
from frames import decode
from metrics import Boxes
from models import network_name
from play import CLOUDS
from record import network


def encode(boxes: Boxes) -> bytes:
    """Returns the boxes as they travel."""
    return json.dumps(boxes.round(2).tolist()).encode()


def decode_boxes(reply: bytes) -> Boxes:
    """Reads the bytes that `encode` made."""
    return np.array(json.loads(reply), np.float64).reshape(-1, 5)


async def serve(cloud: str, models: Path, start: int) -> None:
    """Serves until the process ends."""
    model = network(models, cloud)
    model.detect(np.zeros((576, 768, 3), np.uint8))  # the first is slower
    # The worker computes one call at a time. It does not compute a call that was given up while it
    # waited.
    worker = ThreadPoolExecutor(1)

    def compute(jpeg: bytes) -> Boxes:
        return model.detect(decode(jpeg))

    async def infer(jpeg: bytes, _: Call) -> bytes:
        computed = asyncio.get_running_loop().run_in_executor(worker, compute, jpeg)
        return encode(await computed)

    behind = network_from(cloud, start).handle(infer)
    async with Server(behind, description=Description(network_name(cloud), drive=cloud)) as server:
        print(server.url, flush=True)
        await asyncio.Event().wait()


def main() -> int:
    """Serves."""
    if len(sys.argv) != 4 or sys.argv[1] not in CLOUDS or not sys.argv[3].isdigit():
        print(__doc__, file=sys.stderr)
        return 2
    asyncio.run(serve(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3])))
    return 0


if __name__ == "__main__":
    sys.exit(main())
