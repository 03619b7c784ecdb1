"""A peer in Fast DDS that takes commands line by line, as `fastdds.cpp` says; payloads include their encapsulation."""

import subprocess
import threading

from graph import until
from messages import PointStamped, answered, serialized
from roles import plan_of


class FastDds:
    """The peer as a process of its own."""

    def __init__(self, program):
        self.matches, self.heard, self.then = {}, {}, {}
        self.process = subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self):
        for line in self.process.stdout:
            event, topic, rest = line.split()
            if event == "matched":
                self.matches[topic] = int(rest)
                continue
            payload = bytes.fromhex(rest)
            self.heard[topic].append(payload)
            if topic in self.then:
                self.then[topic](payload)

    def command(self, *words):
        self.process.stdin.write(" ".join(words) + "\n")
        self.process.stdin.flush()

    def publishes(self, topic, kind):
        self.command("writer", topic, kind.__idl_typename__)

    def subscribes(self, topic, kind, then=None):
        self.heard[topic] = []
        if then:
            self.then[topic] = then
        self.command("reader", topic, kind.__idl_typename__)

    def publish(self, topic, payload):
        self.command("write", topic, payload.hex())

    def until_matched(self, *topics):
        for topic in topics:
            until(lambda topic=topic: self.matches.get(topic), f"Fast DDS: {topic} matched")

    def close(self):
        self.process.stdin.close()
        self.process.wait(timeout=10)


class FastModel:
    """A model as those of cyclonedds are, whose answers are big-endian where `is_big` of the stamp says so."""

    answer = staticmethod(answered)

    def __init__(self, peer, source, is_big):
        self.peer, self.source, self.is_big = peer, source, is_big
        peer.publishes(f"/{source}/output", PointStamped)
        peer.subscribes(f"/{source}/input", PointStamped, then=self.take)

    def take(self, payload):
        header = PointStamped.deserialize(payload).header
        stamp = header.stamp.stamp
        after = plan_of(header.frame_id).get(self.source)
        if after is not None:
            made = serialized(answered(self.source, stamp), big=self.is_big(stamp))
            threading.Timer(after, self.peer.publish, [f"/{self.source}/output", made]).start()

    def until_matched(self):
        self.peer.until_matched(f"/{self.source}/output", f"/{self.source}/input")


class Client:
    """A client of a service, as `rmw_fastrtps` is one; `service` is its name without the slash."""

    def __init__(self, peer, service, request, response):
        self.peer, self.response = peer, response
        self.asks, self.hears = f"rq/{service}Request", f"rr/{service}Reply"
        peer.publishes(self.asks, request)
        peer.subscribes(self.hears, response)
        peer.until_matched(self.asks, self.hears)

    def call(self, request):
        before = len(self.peer.heard[self.hears])
        self.peer.publish(self.asks, serialized(request))
        until(lambda: len(self.peer.heard[self.hears]) > before, f"a reply on {self.hears}")
        return self.response.deserialize(self.peer.heard[self.hears][-1])
