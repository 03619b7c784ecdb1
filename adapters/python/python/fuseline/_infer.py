"""Defines the messages of ``fuseline.v1.Infer``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

#: The most bytes of an encoded message.
MESSAGE_BYTES = 32 * 1024 * 1024


@dataclass(frozen=True)
class Description:
    """Describes the model that a cloud serves, as the cloud states it."""

    #: The model's name, for people; empty if it has none.
    model: str = ""
    #: The model's usual runtime, in milliseconds.
    runtime_ms: float | None = None
    #: Its box AP on COCO, 0 to 100.
    ap: float | None = None
    #: The recorded drive whose round trips are added to each reply; empty if there is none.
    drive: str = ""
    #: True if the cloud only waits as long as the model would take.
    emulated: bool = False


def _messages() -> tuple[Any, Any, Any]:
    """Makes the request, reply and description of ``fuseline.proto`` without generated code.

    A test compares them with the project's file.
    """
    field = descriptor_pb2.FieldDescriptorProto
    kinds = {
        "uint64": field.TYPE_UINT64,
        "bytes": field.TYPE_BYTES,
        "string": field.TYPE_STRING,
        "double": field.TYPE_DOUBLE,
        "bool": field.TYPE_BOOL,
    }
    file = descriptor_pb2.FileDescriptorProto(
        name="fuseline.proto", package="fuseline.v1", syntax="proto3"
    )
    messages = {
        "Request": ["uint64 timestamp", "bytes payload", "Lineage lineage"],
        "Reply": ["bytes payload", "optional uint64 of", "optional uint64 meant_for"],
        "Lineage": [
            "optional string origin",
            "optional uint64 seq",
            "optional uint64 age_ns",
            "optional uint64 within_ns",
        ],
        "Description": [
            "string model",
            "optional double runtime_ms",
            "optional double ap",
            "string drive",
            "bool emulated",
        ],
    }
    for name, fields in messages.items():
        message = file.message_type.add(name=name)
        for number, text in enumerate(fields, 1):
            *optional, kind, called = text.split()
            added = message.field.add(
                name=called,
                number=number,
                type=kinds.get(kind, field.TYPE_MESSAGE),
                type_name=None if kind in kinds else f".fuseline.v1.{kind}",
                label=field.LABEL_OPTIONAL,
                json_name=None,
            )
            if optional:
                added.proto3_optional = True
                added.oneof_index = len(message.oneof_decl)
                message.oneof_decl.add(name=f"_{called}")
    # The pool is private, because other packages may have generated code from the same file.
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    wanted = ("Request", "Reply", "Description")
    made = (pool.FindMessageTypeByName(f"fuseline.v1.{name}") for name in wanted)
    request, reply, description = map(message_factory.GetMessageClass, made)
    return request, reply, description


REQUEST, REPLY, DESCRIPTION = _messages()
