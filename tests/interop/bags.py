"""Converts recordings that `rosbags` and Protobuf's own library wrote, and judges the trace: bags.py FUSELINE.

The recordings have three frames, at 1 s, 2 s and 3 s. The cloud's second result is late and is sent all the same.
"""

import importlib
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from google.protobuf.duration_pb2 import Duration
from google.protobuf.timestamp_pb2 import Timestamp
from grpc_tools import protoc
from mcap_protobuf.writer import Writer as ProtobufWriter
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

FUSELINE = sys.argv[1]
SECOND, MS = 10**9, 10**6
EVENTS = [  # ms after the frame's capture, of the late frame if it differs, topic, kind, source
    (1, 1, "/camera", "CAME", ""),
    (2, 2, "/west/request", "SENT", "west"),
    (50, 260, "/west/objects", "DONE", "west"),
    (51, 261, "/objects", "OUT", "west"),
    (90, 90, "/local/objects", "DONE", "local"),
]
ROWS = sorted(
    (frame * SECOND + (late if frame == 2 else ms) * MS, frame, topic, kind, source)
    for frame in (1, 2, 3)
    for ms, late, topic, kind, source in EVENTS
)
PROTO = """syntax = "proto3";
import "google/protobuf/timestamp.proto";
import "google/protobuf/duration.proto";
enum Kind { NONE = 0; CAME = 1; SENT = 2; DONE = 3; OUT = 4; }
message Event {
  google.protobuf.Timestamp stamp = 1;
  uint64 frame = 2;
  Kind kind = 3;
  string source = 4;
  google.protobuf.Duration budget = 5;
}
"""
store = get_typestore(Stores.ROS2_HUMBLE)
store.register(get_types_from_msg("std_msgs/Header header\nrobot_msgs/Box[] boxes\nstring source", "robot_msgs/msg/Objects"))
store.register(get_types_from_msg("string label\nfloat64[4] corners", "robot_msgs/msg/Box"))
KINDS = ("robot_msgs/msg/Box", "robot_msgs/msg/Objects", "std_msgs/msg/Header", "builtin_interfaces/msg/Time", "sensor_msgs/msg/Image")
Box, Objects, Header, Time, Image = (store.types[kind] for kind in KINDS)


def message(topic, frame, source):
    header = Header(Time(frame, 0), "front")
    if topic == "/camera":
        return Image(header, 2, 3, "mono8", 0, 3, np.arange(6, dtype=np.uint8))
    return Objects(header, [Box(label, np.ones(4)) for label in ("car", "dog")], source)


def write_bag(path, plugin):
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        connections = {}
        for at, frame, topic, _, source in ROWS:
            what = message(topic, frame, source)
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, what.__msgtype__, typestore=store)
            writer.write(connections[topic], at, store.serialize_cdr(what, what.__msgtype__))


def write_protobuf(work):
    (work / "robot.proto").write_text(PROTO)
    wellknown = Path(protoc.__file__).parent / "_proto"
    assert protoc.main(["protoc", f"-I{work}", f"-I{wellknown}", f"--python_out={work}", "robot.proto"]) == 0
    sys.path.append(str(work))
    Event = importlib.import_module("robot_pb2").Event
    with (work / "protobuf.mcap").open("wb") as out, ProtobufWriter(out) as writer:
        for at, frame, _, kind, source in ROWS:
            said = Event(stamp=Timestamp(seconds=at // SECOND, nanos=at % SECOND), frame=frame * SECOND, kind=kind, source=source)
            if kind == "SENT":
                said.budget.CopyFrom(Duration(nanos=200 * MS))
            writer.write_message("/log", said, log_time=at, publish_time=at)


def convert(work, *arguments):
    command = [FUSELINE, "convert", "--header", work / "header.jsonl", *arguments]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout


with tempfile.TemporaryDirectory() as folder:
    work = Path(folder)
    header = {"fuseline": 1, "window": 16, "clouds": [{"p": 1, "name": "west", "limit": 31}]}
    (work / "header.jsonl").write_text(json.dumps(header) + "\n")
    write_bag(work / "db3", StoragePlugin.SQLITE3)
    write_bag(work / "mcap", StoragePlugin.MCAP)
    write_protobuf(work)
    topics = "open=/camera,west.request=/west/request,west.result=/west/objects,local.result=/local/objects,emit=/objects"
    columns = ("--column", "t=header.stamp,p=source,deadline=200ms")
    traces = [convert(work, "--topic", topics, *columns, next(work.glob(bag))) for bag in ("db3/*.db3", "mcap/*.mcap")]
    columns = ("--column", "at=stamp,t=frame,ev=kind,p=source,deadline=budget")
    events = ("--event", "CAME=open,SENT=request,DONE=result,OUT=emit")
    traces.append(convert(work, "--topic", "/log", *columns, *events, work / "protobuf.mcap"))
    assert traces[0] == traces[1] == traces[2], traces
    judge = [FUSELINE, "check", "--observed", "--tolerance", "1ms", "--lateness", "5ms", "-"]
    verdict = subprocess.run(judge, input=traces[0], stdout=subprocess.PIPE)
    printed = verdict.stdout.decode()
    assert verdict.returncode == 1, printed
    assert "timestamp 2000000000 breaks" in printed, printed
    assert "1 violation), 3 timestamps judged in 16 lines" in printed, printed
print("a database, an MCAP file and Protobuf are one trace: 3 frames, 1 violation")
