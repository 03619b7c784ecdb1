"""A link with limits, between those who connect to it and the router of Zenoh.

    python3 link.py BITS_PER_SECOND     SIGUSR1 lets it carry nothing for three seconds
"""

import asyncio
import signal
import sys
import time

PORT, ROUTER = 7448, 7447
HOLE_S = 3.0
CHUNK = 1024


class Link:
    def __init__(self, bits):
        self.bits, self.dark_until = bits, 0.0

    def goes_dark(self):
        self.dark_until = time.monotonic() + HOLE_S

    async def carry(self, reader, writer):
        """One way of a connection."""
        try:
            while chunk := await reader.read(CHUNK):
                await asyncio.sleep(len(chunk) * 8 / self.bits)
                while (left := self.dark_until - time.monotonic()) > 0:
                    await asyncio.sleep(left)
                writer.write(chunk)
                await writer.drain()
        except ConnectionError:
            pass
        finally:
            writer.close()

    async def joins(self, reader, writer):
        try:
            there = await asyncio.open_connection("127.0.0.1", ROUTER)
        except ConnectionError:
            writer.close()
            return
        await asyncio.gather(self.carry(reader, there[1]), self.carry(there[0], writer))


async def main():
    link = Link(float(sys.argv[1]))
    asyncio.get_running_loop().add_signal_handler(signal.SIGUSR1, link.goes_dark)
    server = await asyncio.start_server(link.joins, "127.0.0.1", PORT)
    print("ready", flush=True)
    await server.serve_forever()


if __name__ == "__main__":
    asyncio.run(main())
