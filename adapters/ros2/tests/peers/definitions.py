"""The message and service types of ROS 2 that the tests use, as their packages define them, and their hashes by zenoh-ros2-sdk.

    PYTHONPATH=… python3 definitions.py     prints the hashes of those that the node serves and publishes itself
"""

import functools

from zenoh_ros2_sdk.utils import compute_service_type_hash, get_type_hash

MESSAGES = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec",
    "diagnostic_msgs/msg/DiagnosticArray": "std_msgs/Header header\nDiagnosticStatus[] status",
    "diagnostic_msgs/msg/DiagnosticStatus":
        "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\n"
        "byte level\nstring name\nstring message\nstring hardware_id\nKeyValue[] values",
    "diagnostic_msgs/msg/KeyValue": "string key\nstring value",
    "geometry_msgs/msg/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/PointStamped": "std_msgs/Header header\nPoint point",
    "geometry_msgs/msg/Pose": "Point position\nQuaternion orientation",
    "geometry_msgs/msg/PoseWithCovariance": "Pose pose\nfloat64[36] covariance",
    "geometry_msgs/msg/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1",
    "geometry_msgs/msg/Twist": "Vector3 linear\nVector3 angular",
    "geometry_msgs/msg/TwistWithCovariance": "Twist twist\nfloat64[36] covariance",
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "lifecycle_msgs/msg/State": "uint8 id\nstring label",
    "lifecycle_msgs/msg/Transition": "uint8 id\nstring label",
    "lifecycle_msgs/msg/TransitionDescription": "Transition transition\nState start_state\nState goal_state",
    "lifecycle_msgs/msg/TransitionEvent":
        "uint64 timestamp\nTransition transition\nState start_state\nState goal_state",
    "nav_msgs/msg/Odometry":
        "std_msgs/Header header\nstring child_frame_id\n"
        "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist",
    "rcl_interfaces/msg/FloatingPointRange": "float64 from_value\nfloat64 to_value\nfloat64 step",
    "rcl_interfaces/msg/IntegerRange": "int64 from_value\nint64 to_value\nuint64 step",
    "rcl_interfaces/msg/ListParametersResult": "string[] names\nstring[] prefixes",
    "rcl_interfaces/msg/Log":
        "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\nuint32 line",
    "rcl_interfaces/msg/Parameter": "string name\nParameterValue value",
    "rcl_interfaces/msg/ParameterDescriptor":
        "string name\nuint8 type\nstring description\nstring additional_constraints\nbool read_only false\n"
        "bool dynamic_typing false\nFloatingPointRange[<=1] floating_point_range\nIntegerRange[<=1] integer_range",
    "rcl_interfaces/msg/ParameterEvent":
        "builtin_interfaces/Time stamp\nstring node\nParameter[] new_parameters\nParameter[] changed_parameters\n"
        "Parameter[] deleted_parameters",
    "rcl_interfaces/msg/ParameterValue":
        "uint8 type\nbool bool_value\nint64 integer_value\nfloat64 double_value\nstring string_value\n"
        "byte[] byte_array_value\nbool[] bool_array_value\nint64[] integer_array_value\nfloat64[] double_array_value\n"
        "string[] string_array_value",
    "rcl_interfaces/msg/SetParametersResult": "bool successful\nstring reason",
    "rosgraph_msgs/msg/Clock": "builtin_interfaces/Time clock",
    "sensor_msgs/msg/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data",
    "sensor_msgs/msg/Image":
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data",
    "service_msgs/msg/ServiceEventInfo":
        "uint8 REQUEST_SENT=0\nuint8 REQUEST_RECEIVED=1\nuint8 RESPONSE_SENT=2\nuint8 RESPONSE_RECEIVED=3\n"
        "uint8 event_type\nbuiltin_interfaces/Time stamp\nchar[16] client_gid\nint64 sequence_number",
    "std_msgs/msg/Float64": "float64 data",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/msg/String": "string data",
}

SERVICES = {
    "lifecycle_msgs/srv/ChangeState": ("Transition transition", "bool success"),
    "lifecycle_msgs/srv/GetAvailableStates": ("# nothing", "State[] available_states"),
    "lifecycle_msgs/srv/GetAvailableTransitions": ("# nothing", "TransitionDescription[] available_transitions"),
    "lifecycle_msgs/srv/GetState": ("# nothing", "State current_state"),
    "rcl_interfaces/srv/DescribeParameters": ("string[] names", "ParameterDescriptor[] descriptors"),
    "rcl_interfaces/srv/GetParameterTypes": ("string[] names", "uint8[] types"),
    "rcl_interfaces/srv/GetParameters": ("string[] names", "ParameterValue[] values"),
    "rcl_interfaces/srv/ListParameters":
        ("uint64 DEPTH_RECURSIVE=0\nstring[] prefixes\nuint64 depth", "ListParametersResult result"),
    "rcl_interfaces/srv/SetParameters": ("Parameter[] parameters", "SetParametersResult[] results"),
    "rcl_interfaces/srv/SetParametersAtomically": ("Parameter[] parameters", "SetParametersResult result"),
}

# zenoh-ros2-sdk 0.1.8 reads a bounded sequence of messages, as in ParameterDescriptor, as an unbounded one. This is what
# rosidl makes of it in Jazzy.
KNOWN = {
    "rcl_interfaces/srv/DescribeParameters": "RIHS01_845b484d71eb0673dae682f2e3ba3c4851a65a3dcfb97bddd82c5b57e91e4cff",
}

OWN = ["diagnostic_msgs/msg/DiagnosticArray", "diagnostic_msgs/msg/DiagnosticStatus", "lifecycle_msgs/msg/TransitionEvent",
       "rcl_interfaces/msg/Log", "rcl_interfaces/msg/ParameterEvent", "rosgraph_msgs/msg/Clock", *sorted(SERVICES)]


@functools.cache
def type_hash(name):
    """The hash of a type, `package/msg/Name` or `package/srv/Name`."""
    if name in KNOWN:
        return KNOWN[name]
    if name in SERVICES:
        request, response = SERVICES[name]
        return compute_service_type_hash(name, request_definition=request, response_definition=response,
                                         dependencies=MESSAGES)
    return get_type_hash(name, MESSAGES[name], MESSAGES)


if __name__ == "__main__":
    for own in OWN:
        print(own, type_hash(own))
    print("std_msgs/msg/String", type_hash("std_msgs/msg/String"))
