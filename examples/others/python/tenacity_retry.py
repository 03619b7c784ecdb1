"""A call retried by tenacity until a delay is over, then the result on board.

    python tenacity_retry.py retry|timeout FOLDER SCENARIO

`timeout` gives each attempt the rest of the time by asyncio.timeout, which tenacity leaves to its user.
"""

from __future__ import annotations

import asyncio
import os
import sys

from facts import Facts, Scenario, Server
from tenacity import AsyncRetrying, stop_after_delay

mode, folder, scenario = sys.argv[1], sys.argv[2], Scenario(sys.argv[3])
server = Server("lines", folder, scenario)
record = Facts(folder, "robot")
LIMIT = scenario.deadline / 1e9


async def attempt(t: int, number: int) -> int:
    """One attempt; its result is the source's priority."""
    record("request", t, p=1, deadline=scenario.deadline, **{"try": number})
    try:
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        try:
            writer.write(f"{t} {number}\n".encode())
            if not await reader.readline():
                raise ConnectionError
            return 1
        finally:
            writer.close()
    except OSError:
        record("fail", t, p=1, **{"try": number})
        raise


async def message(t: int) -> None:
    """One message: local's result is there at once, the cloud's may be better."""
    await asyncio.sleep(t * scenario.period / 1e3)
    if t == scenario.kill_at:
        server.signal(scenario.signal)
    record("open", t)
    record("result", t, p=0)
    due = asyncio.get_running_loop().time() + LIMIT
    tries = AsyncRetrying(stop=stop_after_delay(LIMIT), retry_error_callback=lambda _: 0)
    number = -1

    async def once() -> int:
        nonlocal number
        number += 1
        await asyncio.sleep(0.01 * number)
        if mode == "retry":
            return await attempt(t, number)
        async with asyncio.timeout_at(due):
            return await attempt(t, number)

    record("emit", t, p=await tries(once))


async def main() -> None:
    """All messages, and a second more."""
    tasks = [asyncio.create_task(message(t)) for t in range(len(scenario.delays))]
    await asyncio.wait(tasks, timeout=len(tasks) * scenario.period / 1e3 + 1)
    record("tick")
    server.end()
    os._exit(0)


asyncio.run(main())
