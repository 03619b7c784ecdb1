#!/usr/bin/env python3
"""A fusion operator of several threads that records what it does, for the judge of observed traces.

A thread for each cloud, one for local and one for the timers share one operator, by real clocks:

    python3 traces/examples/threaded.py > threaded.jsonl
    fuseline check --observed --tolerance 1ms --lateness 20ms threaded.jsonl

With --racy, a thread looks whether a timestamp is open and acts later, as such code is often
written. A barrier holds that window open, so that a result and a timer pass it together each time.

Only facts are recorded: open, request, result, fail, emit and miss, and last a tick: when the run
ended. Had the operator hung before, the judge would see by it what was overdue. A request bears its
deadline, which counts from its own instant.
"""

import argparse
import json
import queue
import random
import threading
import time

LOCAL = 0
MS = 1_000_000
# How long each source takes, in milliseconds, from the shortest to the longest.
TAKES = {LOCAL: (3, 15), 1: (5, 35), 2: (8, 42)}
# How long each cloud may take. Some results come too late.
DEADLINES = {1: 40 * MS, 2: 30 * MS}
PERIOD = 12 * MS
FAILURES = 0.1  # so large a share of all calls fails


class Message:
    """One open timestamp."""

    def __init__(self):
        self.pending = {LOCAL}  # asked for; neither result nor failure nor timer has come
        self.due = {}  # whose timer is live
        self.cached = set()  # whose result is held


class Operator:
    """Decides under one lock, so that looking and acting are one step. Eager, as SPEC.md has it."""

    def __init__(self):
        self.start = time.monotonic_ns()
        self.lock = threading.Lock()
        self.open = {}
        self.lines = []

    def now(self):
        return time.monotonic_ns() - self.start

    def record(self, ev, t, **more):
        self.lines.append({"ev": ev, "at": self.now(), "t": t, **more})

    def message(self, t):
        """F1, F2: a message comes, and each cloud is asked about it."""
        with self.lock:
            message = self.open[t] = Message()
            self.record("open", t)
            for p, deadline in DEADLINES.items():
                message.pending.add(p)
                message.due[p] = self.now() + deadline
                self.record("request", t, p=p, deadline=deadline)

    def arrived(self, t, p, is_failure):
        """F3, F4: a result or a failure. What is due comes first (F0)."""
        with self.lock:
            self.record("fail" if is_failure else "result", t, p=p)
            self.expire(t, self.now())
            message = self.open.get(t)
            if message is None or p not in message.pending:
                return  # superseded or late
            message.pending.discard(p)
            if is_failure:
                message.due.pop(p, None)
                self.settle(t, message, by_timer=False)
            elif any(q > p for q in message.pending):
                message.cached.add(p)
            else:
                self.forward(t, p)

    def tick(self):
        """F5: serves what is due."""
        with self.lock:
            for t in sorted(self.open):
                self.expire(t, self.now())

    def expire(self, t, now):
        """F5 for one timestamp, due instant by due instant."""
        while message := self.open.get(t):
            due = min(message.due.values(), default=None)
            if due is None or due > now:
                return
            for p in [p for p in message.due if message.due[p] == due]:
                del message.due[p]
                message.pending.discard(p)
            self.settle(t, message, by_timer=True)

    def settle(self, t, message, by_timer):
        """F6: the first timer that finds results available commits the best of them."""
        if message.cached:
            best = max(message.cached)
            if by_timer or not any(q > best for q in message.pending):
                self.forward(t, best)
        elif not message.pending:
            del self.open[t]
            self.record("miss", t)

    def forward(self, t, p):
        """F7."""
        del self.open[t]
        self.record("emit", t, p=p)


class RacyOperator(Operator):
    """Looks under the lock, and acts under it later: in between, the other side looks as well."""

    def __init__(self):
        super().__init__()
        # For every fifth message the best cloud's result and its timer meet in the window.
        self.windows = {t: threading.Barrier(2) for t in range(0, 1000, 5)}

    def arrived(self, t, p, is_failure):
        if t not in self.windows or p == LOCAL:
            super().arrived(t, p, is_failure and t not in self.windows)
        elif p == max(DEADLINES):
            with self.lock:
                self.record("result", t, p=p)
                is_open = t in self.open
            self.act(t, p, is_open)
        # The other cloud's calls get lost, so that nothing else ends these messages.

    def tick(self):
        super().tick()
        for t in self.windows:
            with self.lock:
                message = self.open.get(t)
                is_due = message is not None and message.due[max(DEADLINES)] <= self.now()
                best = max(message.cached, default=None) if is_due else None
            if best is not None:
                self.act(t, best, True)

    def expire(self, t, now):
        if t not in self.windows:
            super().expire(t, now)

    def act(self, t, p, is_open):
        if is_open:
            self.windows[t].wait(timeout=10)
            with self.lock:
                self.open.pop(t, None)
                self.record("emit", t, p=p)


def source(operator, p, calls):
    """Answers calls one after the other, each when it is ready; none ends it."""
    while (call := calls.get()) is not None:
        t, ready, is_failure = call
        time.sleep(max(0, ready - operator.now()) / 1e9)
        operator.arrived(t, p, is_failure)


def timers(operator, over):
    """Serves the timers every millisecond."""
    while not over.wait(0.001):
        operator.tick()


def run(operator, messages, chance):
    """Sends the messages, one a period, and waits until all are over."""
    calls = {p: queue.Queue() for p in TAKES}
    over = threading.Event()
    threads = [threading.Thread(target=source, args=(operator, p, calls[p])) for p in calls]
    threads.append(threading.Thread(target=timers, args=(operator, over)))
    for thread in threads:
        thread.start()
    for t in range(messages):
        time.sleep(max(0, t * PERIOD - operator.now()) / 1e9)
        operator.message(t)
        for p, (shortest, longest) in TAKES.items():
            ready = operator.now() + int(chance.uniform(shortest, longest) * MS)
            calls[p].put((t, ready, chance.random() < FAILURES))
    for p in calls:
        calls[p].put(None)
    for thread in threads[:-1]:
        thread.join()
    while operator.open:
        time.sleep(0.001)
    over.set()
    threads[-1].join()
    operator.lines.append({"ev": "tick", "at": operator.now()})


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--racy", action="store_true", help="look first and act later")
    parser.add_argument("--messages", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    operator = RacyOperator() if asked.racy else Operator()
    run(operator, asked.messages, random.Random(asked.seed))
    clouds = [{"p": p, "limit": 1000} for p in DEADLINES]
    header = {"fuseline": 1, "operator": "threaded", "window": 1024, "commit": "eager", "clouds": clouds}
    for line in [header, *operator.lines]:
        print(json.dumps(line, separators=(",", ":")))


if __name__ == "__main__":
    main()
