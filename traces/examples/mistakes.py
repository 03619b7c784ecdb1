#!/usr/bin/env python3
"""The arbiter with one mistake that people really make, to see how it is found.

    fuseline drive -- python3 traces/examples/mistakes.py --mistake first-response-wins
    python3 traces/examples/mistakes.py --list
"""

import argparse

from arbiter import END, LOCAL, Arbiter, serve


class FirstResponseWins(Arbiter):
    """Whatever comes first is forwarded."""

    def is_outranked(self, p, others):
        return False


class AnyThenLocal(Arbiter):
    """Waits for any one cloud, and then takes local all the same."""

    def best(self, cached):
        return min(cached)

    def result(self, t, p):
        message = self.open.get(t)
        if p != LOCAL and message and LOCAL in message.cached and p in message.pending:
            message.pending.discard(p)
            self.forward(t, LOCAL)
        else:
            super().result(t, p)


class LowestNumberWins(Arbiter):
    """Takes priority 1 for the best cloud."""

    def is_outranked(self, p, others):
        return any(q > p if p == LOCAL else LOCAL < q < p for q in others)

    def best(self, cached):
        return min(cached, key=lambda p: (p == LOCAL, p))


class OneDeadline(Arbiter):
    """One timer for all clouds of a message, at the earliest of their due instants."""

    def arm(self, t, p, due):
        armed = self.open[t].armed
        if p != LOCAL:
            due = min([due, *(armed[q] for q in armed if q != LOCAL)])
            for q in [q for q in armed if q != LOCAL]:
                super().arm(t, q, due)
        super().arm(t, p, due)


class DeadlineIsTheEnd(Arbiter):
    """Gives a message up when its clouds' deadlines have passed, although local still computes."""

    def settle(self, t, by_timer):
        message = self.open[t]
        if by_timer and not message.cached and message.pending == {LOCAL}:
            message.pending.clear()
        super().settle(t, by_timer)


class InTimeAtDue(Arbiter):
    """Takes what comes exactly at its due instant."""

    def is_due(self, due):
        return due < self.now


class ForwardsTwice(Arbiter):
    """Looks a message up before the timers are served, so that its result goes a second time."""

    def apply(self, event):
        before = self.open.get(event.get("t")) if event["ev"] == "result" else None
        said = super().apply(event)
        if before and said[-1].get("why") == "superseded":
            said[-1] = {"ev": "emit", "at": self.now, "t": event["t"], "p": event["p"]}
        return said


class OnlyTheBestTimer(Arbiter):
    """Declares eager and is patient: waits while anything better is pending, whoever's timer fires."""

    def settle(self, t, by_timer):
        super().settle(t, False)


class HeldTimerDisarmed(Arbiter):
    """Disarms the timer of a result that is held, also under eager."""

    def hold(self, t, message, p):
        message.armed.pop(p, None)
        super().hold(t, message, p)


class LateRevives(Arbiter):
    """Takes a late result if its message is still open."""

    def result(self, t, p):
        message = self.open.get(t)
        if message and p in message.requested - message.cached:
            message.pending.add(p)
        super().result(t, p)


class NoHysteresis(Arbiter):
    """Opens a shut gate as soon as the queue is below the limit again."""

    def __init__(self, header):
        super().__init__(header)
        for gate in self.gates.values():
            gate.resume = gate.limit - 1


class FailureIsAResult(Arbiter):
    """Takes an error for an answer."""

    def failed(self, t, p):
        self.result(t, p)


class LocalNotKept(Arbiter):
    """Throws local's result away once a cloud was asked, for the cloud's will be better."""

    def hold(self, t, message, p):
        if p == LOCAL:
            message.armed.pop(p, None)
            self.say("drop", t, p=p, why="superseded")
        else:
            super().hold(t, message, p)


class Reopens(Arbiter):
    """Refuses only what is open now, so that a message that is over begins again."""

    def refuses_open(self, t, due):
        why = super().refuses_open(t, due)
        return None if why == "order" and t not in self.open else why


class CancelsLocal(Arbiter):
    """Ends with a message whatever still works on it, the computation on board too."""

    def forward(self, t, p):
        local = LOCAL in self.open[t].pending
        super().forward(t, p)
        if local:
            self.say("cancel", t, p=LOCAL)


class ClockGoesBack(Arbiter):
    """Takes each input's instant as it comes."""

    def apply(self, event):
        self.now = 0
        return super().apply(event)


class GateFirst(Arbiter):
    """Asks the gate before anything else, so that offers refused for other reasons move it."""

    def refuses_offer(self, t, p, due, backlog):
        if p in self.gates:
            self.gates[p].admits(backlog)
        return super().refuses_offer(t, p, due, backlog)


class UnboundedWindow(Arbiter):
    """Takes every message, however many are open."""

    def refuses_open(self, t, due):
        why = super().refuses_open(t, due)
        return None if why == "full" else why


class FirstOutputEnds(Arbiter):
    """Under progressive, ends a message with its first output."""

    def send(self, t, message, p):
        message.pending.clear()
        super().send(t, message, p)


class CopiesTheCall(Arbiter):
    """Says that each value is meant for its message, whatever the reply says."""

    def emit(self, t, message, p):
        message.values[p] = message.values.get(p, {}) | {"for": t}
        super().emit(t, message, p)


class SplicesChunks(Arbiter):
    """Sends the action that is meant for the next message."""

    def emit(self, t, message, p):
        said = message.values.get(p, {})
        if "for" in said:
            message.values[p] = said | {"for": min(said["for"] + 1, END)}
        super().emit(t, message, p)


MISTAKES = {
    "first-response-wins": FirstResponseWins,
    "any-then-local": AnyThenLocal,
    "lowest-number-wins": LowestNumberWins,
    "one-deadline": OneDeadline,
    "deadline-is-the-end": DeadlineIsTheEnd,
    "in-time-at-due": InTimeAtDue,
    "forwards-twice": ForwardsTwice,
    "only-the-best-timer": OnlyTheBestTimer,
    "held-timer-disarmed": HeldTimerDisarmed,
    "late-revives": LateRevives,
    "no-hysteresis": NoHysteresis,
    "failure-is-a-result": FailureIsAResult,
    "local-not-kept": LocalNotKept,
    "reopens": Reopens,
    "cancels-local": CancelsLocal,
    "clock-goes-back": ClockGoesBack,
    "gate-first": GateFirst,
    "unbounded-window": UnboundedWindow,
    "first-output-ends": FirstOutputEnds,
    "copies-the-call": CopiesTheCall,
    "splices-chunks": SplicesChunks,
}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--mistake", choices=MISTAKES)
    which.add_argument("--list", action="store_true", help="name the mistakes and what each is")
    asked = parser.parse_args()
    if asked.list:
        for name, mistake in MISTAKES.items():
            print(f"{name:<20} {mistake.__doc__}")
    else:
        serve(MISTAKES[asked.mistake])
