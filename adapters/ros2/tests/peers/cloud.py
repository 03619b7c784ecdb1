"""A cloud behind gRPC in a process of its own, so that it can be killed: another maker's server (grpcio), which lets in who has a
certificate of the CA, and answers when the input's plan says.

    python3 cloud.py SOURCE PORT FOLDER CERTIFICATE
"""

import asyncio
import sys
from pathlib import Path

import grpc

from messages import PointStamped, answered
from roles import plan_of


def varint(data, at):
    """A number of Protocol Buffers, and where the next thing begins."""
    value = shift = 0
    while data[at] & 0x80:
        value |= (data[at] & 0x7F) << shift
        at, shift = at + 1, shift + 7
    return value | data[at] << shift, at + 1


def payload_of(request):
    """Field 2 of a `fuseline.v1.Request`; field 1 is the timestamp."""
    at = 0
    while at < len(request):
        tag, at = varint(request, at)
        value, at = varint(request, at)
        if tag == 2 << 3 | 2:
            return request[at:at + value]
    return b""


def reply(payload):
    """A `fuseline.v1.Reply`; the payload is shorter than 128 bytes."""
    return bytes((1 << 3 | 2, len(payload))) + payload


async def serve(source, port, folder, certificate):
    async def infer(request, _context):
        header = PointStamped.deserialize(payload_of(request)).header
        await asyncio.sleep(plan_of(header.frame_id)[source])
        return reply(answered(source, header.stamp.stamp).serialize())

    key, chain, ca = ((Path(folder) / name).read_bytes() for name in (f"{certificate}.key", f"{certificate}.pem", "ca.pem"))
    server = grpc.aio.server()
    # Without types: bytes come and go.
    calls = {"Infer": grpc.unary_unary_rpc_method_handler(infer)}
    server.add_generic_rpc_handlers([grpc.method_handlers_generic_handler("fuseline.v1.Infer", calls)])
    server.add_secure_port(f"127.0.0.1:{port}", grpc.ssl_server_credentials([(key, chain)], ca, require_client_auth=True))
    await server.start()
    print("ready", flush=True)
    await server.wait_for_termination()


if __name__ == "__main__":
    asyncio.run(serve(*sys.argv[1:]))
