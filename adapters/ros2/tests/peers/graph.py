"""The graph around the node: its peers are cyclonedds, or zenoh-ros2-sdk where MIDDLEWARE says zenoh; on the loopback alone,
waited for and never slept for."""

import functools
import os
import threading
import time
from dataclasses import dataclass

from cyclonedds.core import InstanceState, Policy, Qos, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

# A peer that is killed is missed after its lease.
LEASE_S = 3
CAP_S = 15.0
os.environ["CYCLONEDDS_URI"] = f"""<CycloneDDS xmlns="https://cdds.io/config"><Domain Id="any">
<General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>9</MaxAutoParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers><LeaseDuration>{LEASE_S}s</LeaseDuration></Discovery>
</Domain></CycloneDDS>"""


def until(holds, what, cap=CAP_S):
    """Waits until `holds()` is true and returns what it returned; fails after `cap` seconds, and says `what`."""
    end = time.monotonic() + cap
    while not (value := holds()):
        assert time.monotonic() < end, f"not within {cap:g} s: {what() if callable(what) else what}"
        time.sleep(0.005)
    return value


def again(act, holds, what):
    """Does `act` five times a second until `holds()`: a peer that has not met the sender yet misses the first."""
    def acted():
        act()
        end = time.monotonic() + 0.2
        while time.monotonic() < end:
            if holds():
                return True
            time.sleep(0.005)
        return False
    until(acted, what)


def is_over_zenoh():
    return os.environ.get("MIDDLEWARE") == "zenoh"


if is_over_zenoh():
    import overzenoh


def quality(reliable=True, depth=1000, transient=False):
    if is_over_zenoh():
        return overzenoh.quality(reliable, depth, transient)
    reliability = Policy.Reliability.Reliable(duration(seconds=1)) if reliable else Policy.Reliability.BestEffort
    durability = Policy.Durability.TransientLocal if transient else Policy.Durability.Volatile
    return Qos(reliability, Policy.History.KeepLast(depth), durability)


@dataclass
class Heard:
    at: float
    message: object


class Publisher:
    """Publishes to a topic."""

    def __init__(self, participant, topic, kind, qos):
        self.topic = topic
        self.writer = DataWriter(participant, Topic(participant, "rt" + topic, kind), qos=qos)

    def publish(self, message):
        self.writer.write(message)

    def matched(self):
        return len(self.writer.get_matched_subscriptions())

    def until_matched(self, count=1):
        until(lambda: self.matched() == count, f"{count} matched subscriptions of {self.topic}")


class Subscription:
    """Subscribes to a topic; each message goes to `then(message, at)` and is kept if `keep` is set."""

    def __init__(self, topic, kind, qos, then=None, keep=True):
        self.topic, self.then, self.keep = topic, then, keep
        self.heard = []
        self.count = 0
        receiver = overzenoh.Receiver if is_over_zenoh() else Receiver
        self.receiver = receiver(topic, kind, qos, self.hear)

    def hear(self, message, at):
        if self.keep:
            self.heard.append(Heard(at, message))
        self.count += 1
        if self.then:
            self.then(message, at)

    def matched(self):
        return len(self.receiver.peers.there) if is_over_zenoh() else self.receiver.matched()

    def until_matched(self, count=1):
        until(lambda: self.matched() == count, f"{count} matched publications of {self.topic}")

    def until_heard(self, count, cap=CAP_S):
        until(lambda: self.count >= count, lambda: f"{count} messages on {self.topic}, heard {self.count}", cap)


class Receiver:
    """Subscribes to a topic over DDS: `hear` gets each message."""

    def __init__(self, topic, kind, qos, hear):
        self.hear = hear
        # One topic of ROS 2 has no slash at its beginning, and none of the prefix that others have in DDS.
        name = "rt" + topic if topic.startswith("/") else topic
        self.reader = DataReader(participant(), Topic(participant(), name, kind), qos=qos)
        self.waits = WaitSet(participant())
        self.any = ReadCondition(self.reader, ViewState.Any | InstanceState.Any | SampleState.NotRead)
        self.waits.attach(self.any)
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self):
        while True:
            self.waits.wait(duration(seconds=1))
            for message in self.reader.take(N=64):
                # A writer that went away comes as a sample without data.
                if message.sample_info.valid_data:
                    self.hear(message, time.monotonic())

    def matched(self):
        return len(self.reader.get_matched_publications())


@functools.cache
def participant():
    """Returns the only participant of this process. Processes of ROS 2 have one each."""
    return DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))


def publishes(topic, kind, qos=None):
    if is_over_zenoh():
        return overzenoh.Publisher(topic, kind, qos or quality(), until)
    return Publisher(participant(), topic, kind, qos or quality())


def subscribes(topic, kind, qos=None, then=None, keep=True):
    return Subscription(topic, kind, qos or quality(), then, keep)
