"""Message types of ROS 2 as DDS sees them: what rosidl makes of the .msg files, with its mangled names."""

import struct
from dataclasses import dataclass, field

from cyclonedds.idl import IdlStruct
from cyclonedds.idl._support import Endianness
from cyclonedds.idl.types import array, byte, float64, int32, int64, sequence, uint8, uint32, uint64


class Message(IdlStruct):
    """A message that remembers the bytes it came in, its encapsulation included."""

    @classmethod
    def deserialize(cls, data, has_header=True, use_version_2=None):
        message = super().deserialize(data, has_header, use_version_2)
        message.payload = bytes(data)
        return message


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32

    @classmethod
    def at(cls, stamp):
        """The time of `stamp` nanoseconds."""
        return cls(stamp // 1_000_000_000, stamp % 1_000_000_000)

    @property
    def stamp(self):
        return self.sec * 1_000_000_000 + self.nanosec


@dataclass
class Clock(Message, typename="rosgraph_msgs::msg::dds_::Clock_"):
    clock: Time


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64
    y: float64
    z: float64


@dataclass
class PointStamped(Message, typename="geometry_msgs::msg::dds_::PointStamped_"):
    header: Header
    point: Point


@dataclass
class Image(Message, typename="sensor_msgs::msg::dds_::Image_"):
    header: Header
    height: uint32
    width: uint32
    encoding: str
    is_bigendian: uint8
    step: uint32
    data: sequence[uint8]

    # Python takes 30 ms for a megabyte each way: here it is serialized once, and of what comes the header is read.

    def serialize(self, buffer=None, endianness=None, use_version_2=None):
        if not hasattr(self, "payload"):
            self.payload = super().serialize(buffer, endianness, use_version_2)
        stamp = self.header.stamp
        self.payload = self.payload[:4] + struct.pack("<iI", stamp.sec, stamp.nanosec) + self.payload[12:]
        return self.payload

    @classmethod
    def deserialize(cls, data, has_header=True, use_version_2=None):
        header = Header.deserialize(data[:256])
        message = cls(header, 0, 0, "", 0, 0, b"")
        message.payload = data
        return message


@dataclass
class CompressedImage(Message, typename="sensor_msgs::msg::dds_::CompressedImage_"):
    header: Header
    format: str
    data: sequence[uint8]


@dataclass
class String(Message, typename="std_msgs::msg::dds_::String_"):
    data: str


@dataclass
class Float64(Message, typename="std_msgs::msg::dds_::Float64_"):
    data: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Point
    orientation: Quaternion


@dataclass
class PoseWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::PoseWithCovariance_"):
    pose: Pose
    covariance: array[float64, 36]


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector3
    angular: Vector3


@dataclass
class TwistWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::TwistWithCovariance_"):
    twist: Twist
    covariance: array[float64, 36]


@dataclass
class Odometry(Message, typename="nav_msgs::msg::dds_::Odometry_"):
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance

    @classmethod
    def at(cls, speed):
        """A vehicle that drives so fast, in m/s, somewhere."""
        pose = Pose(Point(1.0, 2.0, 3.0), Quaternion(0.0, 0.0, 0.0, 1.0))
        twist = Twist(Vector3(speed, 0.0, 0.0), Vector3(0.0, 0.0, 0.4))
        return cls(Header(Time.at(0), "odom"), "base_link", PoseWithCovariance(pose, [7.0] * 36),
                   TwistWithCovariance(twist, [9.0] * 36))


@dataclass
class KeyValue(IdlStruct, typename="diagnostic_msgs::msg::dds_::KeyValue_"):
    key: str
    value: str


@dataclass
class DiagnosticStatus(Message, typename="diagnostic_msgs::msg::dds_::DiagnosticStatus_"):
    level: byte
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]

    def __getitem__(self, key):
        return next((pair.value for pair in self.values if pair.key == key), None)


@dataclass
class DiagnosticArray(Message, typename="diagnostic_msgs::msg::dds_::DiagnosticArray_"):
    header: Header
    status: sequence[DiagnosticStatus]


@dataclass
class Log(Message, typename="rcl_interfaces::msg::dds_::Log_"):
    stamp: Time
    level: uint8
    name: str
    msg: str
    file: str
    function: str
    line: uint32


@dataclass
class Gid(IdlStruct, typename="rmw_dds_common::msg::dds_::Gid_"):
    data: array[uint8, 16]


@dataclass
class NodeEntitiesInfo(IdlStruct, typename="rmw_dds_common::msg::dds_::NodeEntitiesInfo_"):
    node_namespace: str
    node_name: str
    reader_gid_seq: sequence[Gid]
    writer_gid_seq: sequence[Gid]


@dataclass
class ParticipantEntitiesInfo(Message, typename="rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_"):
    gid: Gid
    node_entities_info_seq: sequence[NodeEntitiesInfo]


@dataclass
class ParameterValue(IdlStruct, typename="rcl_interfaces::msg::dds_::ParameterValue_"):
    type: uint8 = 0
    bool_value: bool = False
    integer_value: int64 = 0
    double_value: float64 = 0.0
    string_value: str = ""
    byte_array_value: sequence[byte] = field(default_factory=list)
    bool_array_value: sequence[bool] = field(default_factory=list)
    integer_array_value: sequence[int64] = field(default_factory=list)
    double_array_value: sequence[float64] = field(default_factory=list)
    string_array_value: sequence[str] = field(default_factory=list)

    @classmethod
    def of(cls, value):
        if isinstance(value, bool):
            return cls(type=1, bool_value=value)
        if isinstance(value, int):
            return cls(type=2, integer_value=value)
        return cls(type=3, double_value=value)


@dataclass
class Parameter(IdlStruct, typename="rcl_interfaces::msg::dds_::Parameter_"):
    name: str
    value: ParameterValue


@dataclass
class SetParametersResult(IdlStruct, typename="rcl_interfaces::msg::dds_::SetParametersResult_"):
    successful: bool
    reason: str


@dataclass
class SetParametersRequest(Message, typename="rcl_interfaces::srv::dds_::SetParameters_Request_"):
    parameters: sequence[Parameter]


@dataclass
class SetParametersResponse(Message, typename="rcl_interfaces::srv::dds_::SetParameters_Response_"):
    results: sequence[SetParametersResult]


@dataclass
class GetParametersRequest(Message, typename="rcl_interfaces::srv::dds_::GetParameters_Request_"):
    names: sequence[str]


@dataclass
class GetParametersResponse(Message, typename="rcl_interfaces::srv::dds_::GetParameters_Response_"):
    values: sequence[ParameterValue]


@dataclass
class ListParametersResult(IdlStruct, typename="rcl_interfaces::msg::dds_::ListParametersResult_"):
    names: sequence[str]
    prefixes: sequence[str]


@dataclass
class ListParametersRequest(Message, typename="rcl_interfaces::srv::dds_::ListParameters_Request_"):
    prefixes: sequence[str]
    depth: uint64


@dataclass
class ListParametersResponse(Message, typename="rcl_interfaces::srv::dds_::ListParameters_Response_"):
    result: ListParametersResult


@dataclass
class FloatingPointRange(IdlStruct, typename="rcl_interfaces::msg::dds_::FloatingPointRange_"):
    from_value: float64
    to_value: float64
    step: float64


@dataclass
class IntegerRange(IdlStruct, typename="rcl_interfaces::msg::dds_::IntegerRange_"):
    from_value: int64
    to_value: int64
    step: uint64


@dataclass
class ParameterDescriptor(IdlStruct, typename="rcl_interfaces::msg::dds_::ParameterDescriptor_"):
    name: str
    type: uint8
    description: str
    additional_constraints: str
    read_only: bool
    dynamic_typing: bool
    floating_point_range: sequence[FloatingPointRange]
    integer_range: sequence[IntegerRange]


@dataclass
class DescribeParametersRequest(Message, typename="rcl_interfaces::srv::dds_::DescribeParameters_Request_"):
    names: sequence[str]


@dataclass
class DescribeParametersResponse(Message, typename="rcl_interfaces::srv::dds_::DescribeParameters_Response_"):
    descriptors: sequence[ParameterDescriptor]


@dataclass
class State(IdlStruct, typename="lifecycle_msgs::msg::dds_::State_"):
    id: uint8
    label: str


@dataclass
class Transition(IdlStruct, typename="lifecycle_msgs::msg::dds_::Transition_"):
    id: uint8 = 0
    label: str = ""


@dataclass
class TransitionDescription(IdlStruct, typename="lifecycle_msgs::msg::dds_::TransitionDescription_"):
    transition: Transition
    start_state: State
    goal_state: State


@dataclass
class TransitionEvent(Message, typename="lifecycle_msgs::msg::dds_::TransitionEvent_"):
    timestamp: uint64
    transition: Transition
    start_state: State
    goal_state: State


@dataclass
class ChangeStateRequest(Message, typename="lifecycle_msgs::srv::dds_::ChangeState_Request_"):
    transition: Transition


@dataclass
class ChangeStateResponse(Message, typename="lifecycle_msgs::srv::dds_::ChangeState_Response_"):
    success: bool


# A request without members has one of a byte.
@dataclass
class GetStateRequest(Message, typename="lifecycle_msgs::srv::dds_::GetState_Request_"):
    structure_needs_at_least_one_member: uint8 = 0


@dataclass
class GetStateResponse(Message, typename="lifecycle_msgs::srv::dds_::GetState_Response_"):
    current_state: State


@dataclass
class GetAvailableStatesRequest(Message, typename="lifecycle_msgs::srv::dds_::GetAvailableStates_Request_"):
    structure_needs_at_least_one_member: uint8 = 0


@dataclass
class GetAvailableStatesResponse(Message, typename="lifecycle_msgs::srv::dds_::GetAvailableStates_Response_"):
    available_states: sequence[State]


@dataclass
class GetAvailableTransitionsRequest(Message, typename="lifecycle_msgs::srv::dds_::GetAvailableTransitions_Request_"):
    structure_needs_at_least_one_member: uint8 = 0


@dataclass
class GetAvailableTransitionsResponse(Message, typename="lifecycle_msgs::srv::dds_::GetAvailableTransitions_Response_"):
    available_transitions: sequence[TransitionDescription]


OK, WARN, ERROR = 0, 1, 2


def serialized(message, big=False):
    """The bytes of a message in either byte order, encapsulation included."""
    return message.serialize(endianness=Endianness.Big if big else Endianness.Little)


def carries(payload, message):
    """Returns whether a payload is exactly this message, apart from the padding to four bytes that DDS may add."""
    sent = message.serialize()
    padding = payload[len(sent):]
    return payload[:2] == sent[:2] and payload[4:len(sent)] == sent[4:] and len(padding) < 4 and not any(padding)


def bytes_as(kind, size):
    """A type with the name of `kind` that is `size` bytes and nothing else: what it carries need not be a `kind`."""

    @dataclass
    class Bytes(IdlStruct, typename=kind.__idl_typename__):
        data: array[uint8, size]

    return Bytes


def asked(stamp, plan):
    """An input: the plan in its frame says when each source answers, as in `local=0.02 west=0.1`."""
    return PointStamped(Header(Time.at(stamp), plan), Point(1.0, 2.0, 3.0))


def answered(source, stamp):
    """The result of `source` for the input of `stamp`: each source has its own, of its own length."""
    return PointStamped(Header(Time.at(stamp), f"answer of {source}"), Point(float(len(source)), 0.5, stamp % 977 / 7))
