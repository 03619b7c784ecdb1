#!/usr/bin/env python3
"""A fusion operator's decisions in plain Python: a template for an implementation of your own.

It answers what `fuseline drive` asks. From the repository:

    fuseline drive -- python3 traces/examples/arbiter.py

The rules are those of SPEC.md; each method names its own. Nothing here waits or reads a clock: the
instant comes with the input, and the answer is the whole effect.
"""

import heapq
import json
import sys

LOCAL = 0  # the priority of the computation on board, which every message gets
END = 2**64 - 1  # instants are unsigned 64 bit and do not wrap


class Gate:
    """Admission of one cloud's requests by the length of its queue (F2g)."""

    def __init__(self, limit, resume):
        self.limit, self.resume, self.is_open = limit, resume, True

    def admits(self, backlog):
        self.is_open = backlog < self.limit if self.is_open else backlog <= self.resume
        return self.is_open


class Message:
    """The four sets of one open timestamp."""

    def __init__(self):
        self.requested = {LOCAL}  # was asked for
        self.pending = {LOCAL}  # asked for; neither result nor failure nor timer has come
        self.armed = {}  # whose timer is live, with its due instant
        self.cached = set()  # whose result came in time and is held; progressive: was sent last
        self.values = {}  # what accepted results say of their values, by their sources


class Dropped(Exception):
    """A result or failure that is taken no notice of, and why."""


class Arbiter:
    """One operator. Every input is a method's arguments, every decision a line that it says."""

    def __init__(self, header):
        self.window = header["window"]
        self.eager = header.get("commit", "eager") == "eager"
        self.progressive = header.get("commit") == "progressive"
        self.gates = {
            cloud["p"]: Gate(cloud["limit"], cloud.get("resume", cloud["limit"] - 1))
            for cloud in header["clouds"]
        }
        self.now = 0  # the greatest instant seen
        self.newest = -1  # the greatest timestamp ever opened
        self.open = {}  # the open timestamps: t to Message
        self.value = {}  # what the last result says of its value
        self.timers = []  # a heap of (due, t, p); those that are not armed any more are skipped
        self.said = []

    # Inputs.

    def apply(self, event):
        """Applies one input and returns its decisions, in order."""
        self.said = []
        # F0: time does not go back, and whatever is due comes before the input.
        self.now = max(self.now, event["at"])
        self.expire()
        if event["ev"] == "open":
            self.opened(event["t"], event.get("deadline"))
        elif event["ev"] == "offer":
            self.offered(event["t"], event["p"], event["deadline"], event["backlog"])
        elif event["ev"] == "result":
            self.value = {key: event[key] for key in ("of", "for") if key in event}
            self.result(event["t"], event["p"])
        elif event["ev"] == "fail":
            self.failed(event["t"], event["p"])
        return self.said

    def opened(self, t, deadline):
        """F1: a message came. A deadline is how long local may take."""
        due = None if deadline is None else self.due(deadline)
        if why := self.refuses_open(t, due):
            self.say("refuse", t, why=why)
            return
        self.newest = max(self.newest, t)
        self.open[t] = Message()
        if due is not None:
            self.arm(t, LOCAL, due)

    def offered(self, t, p, deadline, backlog):
        """F2: the driver would ask cloud p, whose queue holds this many requests already."""
        due = self.due(deadline)
        if why := self.refuses_offer(t, p, due, backlog):
            self.say("refuse", t, p=p, why=why)
            return
        message = self.open[t]
        message.requested.add(p)
        message.pending.add(p)
        self.arm(t, p, due)
        self.say("request", t, p=p, due=due)

    def result(self, t, p):
        """F3: a source returned."""
        try:
            message = self.accepted(t, p)
        except Dropped as dropped:
            self.say("drop", t, p=p, why=str(dropped))
            return
        message.pending.discard(p)
        message.values[p] = self.value
        if self.progressive:
            self.send(t, message, p)
        elif self.is_outranked(p, message.pending):
            self.hold(t, message, p)
        else:
            self.forward(t, p)

    def failed(self, t, p):
        """F4: no result will come from p. This is no timer: it commits nothing by itself."""
        try:
            message = self.accepted(t, p)
        except Dropped as dropped:
            self.say("drop", t, p=p, why=str(dropped))
            return
        message.pending.discard(p)
        message.armed.pop(p, None)
        self.settle(t, by_timer=False)

    # Which reason holds first.

    def refuses_open(self, t, due):
        """F1."""
        if t <= self.newest:
            return "order"
        if len(self.open) >= self.window:
            return "full"
        if due is not None and due <= self.now:
            return "deadline"
        return None

    def refuses_offer(self, t, p, due, backlog):
        """F2. The gate is asked last, and only if nothing else refuses."""
        if p not in self.gates or t > self.newest:
            return "unknown"
        if t not in self.open:
            return "closed"
        message = self.open[t]
        if p in message.requested:
            return "duplicate"
        if self.is_outranked(p, message.cached):
            return "outranked"
        if due <= self.now:
            return "deadline"
        if not self.gates[p].admits(backlog):
            return "queue"
        return None

    def accepted(self, t, p):
        """F3, F4: the message that a result or a failure is for, unless it is dropped."""
        if (p != LOCAL and p not in self.gates) or t > self.newest:
            raise Dropped("unknown")
        if t not in self.open:
            raise Dropped("superseded")
        message = self.open[t]
        if self.progressive and self.is_outranked(p, message.cached):
            raise Dropped("superseded")
        if p not in message.requested:
            raise Dropped("unsolicited")
        if p in message.cached:
            raise Dropped("duplicate")
        if p not in message.pending:
            raise Dropped("late")
        return message

    # What follows.

    def is_due(self, due):
        """F0: the due instant itself is too late."""
        return due <= self.now

    def expire(self):
        """F5: serves what is due, by due instant, then timestamp; equal ones of one together."""
        while self.timers and self.is_due(self.timers[0][0]):
            due, t, _ = self.timers[0]
            fired = []
            while self.timers and self.timers[0][:2] == (due, t):
                p = heapq.heappop(self.timers)[2]
                message = self.open.get(t)
                if message and message.armed.get(p) == due:
                    del message.armed[p]
                    message.pending.discard(p)
                    self.say("timer", t, p=p)
                    fired.append(p)
            if fired:
                # Local's timer alone commits nothing.
                self.settle(t, by_timer=any(p != LOCAL for p in fired))

    def settle(self, t, by_timer):
        """F6: some requests were closed; commit, miss or wait. Progressive ends or waits (F9)."""
        message = self.open[t]
        if message.cached:
            best = self.best(message.cached)
            if self.is_outranked(best, message.pending) and not (self.eager and by_timer):
                return
            if self.progressive:
                self.end(t, best)
            else:
                self.forward(t, best)
        elif not message.pending:
            del self.open[t]
            self.say("miss", t)

    def hold(self, t, message, p):
        """F3: something better may still come. A held cloud's timer runs on under eager."""
        message.cached.add(p)
        if p == LOCAL or not self.eager:
            message.armed.pop(p, None)
        self.say("hold", t, p=p)

    def forward(self, t, p):
        """F7: one result goes, the timestamp is over, and so are the calls of clouds."""
        message = self.open.pop(t)
        self.emit(t, message, p)
        for cloud in sorted(message.pending - {LOCAL}):
            self.say("cancel", t, p=cloud)

    def send(self, t, message, p):
        """F9: one result goes at once, and what it outranks is not waited for any more."""
        message.cached = {p}
        self.emit(t, message, p)
        for worse in sorted(q for q in message.pending if q < p):
            message.pending.discard(worse)
            message.armed.pop(worse, None)
            if worse != LOCAL:
                self.say("cancel", t, p=worse)
        message.armed.pop(p, None)
        if not message.pending:
            self.end(t, p)

    def emit(self, t, message, p):
        """A46, A60: says of the value what the result that goes said."""
        self.say("emit", t, p=p, **message.values.get(p, {}))

    def end(self, t, p):
        """F9: nothing better can come than what was sent."""
        del self.open[t]
        self.say("final", t, p=p)

    def is_outranked(self, p, others):
        return any(q > p for q in others)

    def best(self, cached):
        return max(cached)

    def due(self, deadline):
        return min(self.now + deadline, END)

    def arm(self, t, p, due):
        self.open[t].armed[p] = due
        heapq.heappush(self.timers, (due, t, p))

    def say(self, ev, t, **more):
        self.said.append({"ev": ev, "at": self.now, "t": t, **more})


def serve(make):
    """Answers each line: a header starts afresh, an input is decided about, then `done`."""
    arbiter = None
    for line in sys.stdin:
        event = json.loads(line)
        if "fuseline" in event:
            arbiter, said = make(event), []
        else:
            said = arbiter.apply(event)
        # Whoever asks waits for the whole answer: flush it.
        print(*map(json.dumps, said), '{"ev":"done"}', sep="\n", flush=True)


if __name__ == "__main__":
    serve(Arbiter)
