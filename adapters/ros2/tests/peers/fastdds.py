"""A peer in Fast DDS, told what to do line by line: `fastdds.cpp` says how. Payloads are bytes, encapsulation included."""

import subprocess
import threading

from graph import until


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

    def tell(self, *words):
        self.process.stdin.write(" ".join(words) + "\n")
        self.process.stdin.flush()

    def publishes(self, topic, kind):
        self.tell("writer", topic, kind.__idl_typename__)

    def subscribes(self, topic, kind, then=None):
        self.heard[topic] = []
        if then:
            self.then[topic] = then
        self.tell("reader", topic, kind.__idl_typename__)

    def publish(self, topic, payload):
        self.tell("write", topic, payload.hex())

    def until_matched(self, *topics):
        for topic in topics:
            until(lambda topic=topic: self.matches.get(topic), f"Fast DDS: {topic} matched")

    def close(self):
        self.process.stdin.close()
        self.process.wait(timeout=10)


def later(after, what):
    """Does `what` after so many seconds."""
    timer = threading.Timer(after, what)
    timer.daemon = True
    timer.start()
