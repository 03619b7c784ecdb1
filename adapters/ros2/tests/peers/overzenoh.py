"""Peers over Zenoh, with zenoh-ros2-sdk: the same calls as over DDS. What they send was serialized as for DDS."""

import os
import threading
import time
from dataclasses import dataclass

import zenoh
import zenoh_ros2_sdk.publisher
import zenoh_ros2_sdk.subscriber
from definitions import type_hash
from zenoh_ros2_sdk.keyexpr import endpoint_liveliness_keyexpr, topic_keyexpr
from zenoh_ros2_sdk.publisher import ROS2Publisher
from zenoh_ros2_sdk.qos import QosDurability, QosProfile, QosReliability
from zenoh_ros2_sdk.service_client import ROS2ServiceClient
from zenoh_ros2_sdk.session import ZenohSession
from zenoh_ros2_sdk.subscriber import ROS2Subscriber

CDR = zenoh.Encoding("application/cdr")
REPLY_S = 10.0
_one_at_a_time = threading.RLock()


def type_name(kind):
    """`package::msg::dds_::Name_` as `package/msg/Name`."""
    package, sort, _, name = kind.__idl_typename__.split("::")
    return f"{package}/{sort}/{name.removesuffix('_')}"


def quality(reliable=True, depth=1000, transient=False):
    reliability = QosReliability.RELIABLE if reliable else QosReliability.BEST_EFFORT
    durability = QosDurability.TRANSIENT_LOCAL if transient else QosDurability.VOLATILE
    return QosProfile(reliability=reliability, durability=durability, history_depth=depth)


def session():
    """Returns the only session of this process. Types are not registered in it: their bytes pass."""
    with _one_at_a_time:
        manager = ZenohSession.get_instance()
        manager.register_message_type = lambda *_: None
        return manager


def as_in_lyrical():
    """From now on ends of topics are as those that `rmw_zenoh` of ROS 2 Lyrical makes for a type with an unbounded `uint8[]`:
    their tokens say where its bytes may be, and publishers have only subscriptions to whom main memory is good enough."""
    for module in (zenoh_ros2_sdk.publisher, zenoh_ros2_sdk.subscriber):
        module.endpoint_liveliness_keyexpr = lambda end: endpoint_liveliness_keyexpr(end) + "/backends:cpu:"
    zenoh_ros2_sdk.publisher.topic_keyexpr = lambda *words: topic_keyexpr(*words) + "/_buf_cpu"


class Peers:
    """Finds the other ends of a topic, by their tokens: those with the same type."""

    def __init__(self, kind, end):
        self.there, end_of = set(), f"/{end.dds_type_name}/{end.type_hash}/"
        tokens = f"@ros2_lv/{end.domain_id}/*/*/*/{kind}/*/*/*/{end.topic.replace('/', '%')}/*/*/*/**"

        def reported(sample):
            token = str(sample.key_expr)
            if end_of in token:
                (self.there.discard if sample.kind == zenoh.SampleKind.DELETE else self.there.add)(token)

        self.tokens = end.session_mgr.liveliness.declare_subscriber(tokens, reported, history=True)


@dataclass(frozen=True)
class Seen:
    """Holds what a token names."""

    kind: str
    namespace: str
    node: str
    topic: str


def seen():
    """Watches what ROS's tools see. Returns a function that returns all that is there now."""
    tokens = set()

    def reported(sample):
        token = str(sample.key_expr)
        (tokens.discard if sample.kind == zenoh.SampleKind.DELETE else tokens.add)(token)

    manager = session()
    domain = os.environ["ROS_DOMAIN_ID"]
    manager.everything = manager.liveliness.declare_subscriber(f"@ros2_lv/{domain}/**", reported, history=True)

    def entity(token):
        parts = [part.replace("%", "/") for part in token.split("/")] + [""]
        return Seen(parts[5], parts[7], parts[8], parts[9])

    return lambda: {entity(token) for token in list(tokens)}


class Publisher:
    """Publishes to a topic."""

    def __init__(self, topic, kind, qos, until):
        self.topic, self.until, self.sent = topic, until, 0
        session()
        name = type_name(kind)
        self.end = ROS2Publisher(topic, name, type_hash=type_hash(name), qos=qos)
        self.peers = Peers("MS", self.end)

    def publish(self, message):
        self.publish_bytes(message.serialize())

    def publish_bytes(self, payload):
        self.sent += 1
        attachment = self.end._create_attachment(self.sent, time.time_ns())
        self.end.pub.put(payload, encoding=CDR, attachment=attachment)

    def matched(self):
        return len(self.peers.there)

    def until_matched(self, count=1):
        self.until(lambda: self.matched() == count, f"{count} matched subscriptions of {self.topic}")


class Received(ROS2Subscriber):
    """Hands on what comes as it came."""

    def _process_sample(self, sample):
        attachment = sample.attachment
        assert attachment is not None and len(attachment.to_bytes()) == 33, "a message without its attachment"
        self.callback(bytes(sample.payload.to_bytes()))


class Receiver:
    """Subscribes to a topic, read as `kind`: `hear` gets each message."""

    def __init__(self, topic, kind, qos, hear):
        session()
        name = type_name(kind)

        def came(payload):
            hear(kind.deserialize(payload), time.monotonic())

        self.end = Received(topic, name, came, type_hash=type_hash(name), qos=qos)
        self.peers = Peers("MP", self.end)


class Client:
    """A client of a service; `service` is its name without the slash."""

    def __init__(self, service, request, response):
        session()
        package, _, name = type_name(request).split("/")
        name = f"{package}/srv/{name.removesuffix('_Request')}"
        self.response, self.calls = response, 0
        self.end = ROS2ServiceClient(f"/{service}", name, request_definition="# as bytes", response_definition="# as bytes",
                                     type_hash=type_hash(name), timeout=REPLY_S)

    def call(self, request):
        # A service that is not there yet answers nothing.
        end = time.monotonic() + REPLY_S
        while time.monotonic() < end:
            self.calls += 1
            attachment = self.end._create_attachment(self.calls, time.time_ns())
            for reply in self.end.querier.get(payload=request.serialize(), encoding=CDR, attachment=attachment):
                assert reply.ok is not None, reply.err.payload.to_string()
                its = reply.ok.attachment.to_bytes()
                assert its[:8] == attachment[:8] and its[16:] == attachment[16:], "the answer to another request"
                return self.response.deserialize(bytes(reply.ok.payload.to_bytes()))
            time.sleep(0.05)
        raise AssertionError(f"no reply from {self.end.service_name}")
