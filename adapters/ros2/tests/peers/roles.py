"""The peers of a test: a camera, the models that answer it, and a listener on the output."""

import heapq
import threading
import time

from graph import publishes, subscribes, until
from messages import OK, DiagnosticArray, DiagnosticStatus, PointStamped, answered, asked

FIRST_STAMP = 1_700_000_000_999_999_000
PERIOD_NS = 33_333_333


def plan_of(frame_id):
    """`local=0.02 west=0.1` as a dictionary; who is not named does not answer."""
    return {name: float(after) for name, after in (part.split("=") for part in frame_id.split())}


class Camera:
    """Publishes inputs, each with the next stamp unless one is given."""

    def __init__(self, topic="/input", kind=PointStamped, qos=None):
        self.output = publishes(topic, kind, qos)
        self.stamp = FIRST_STAMP

    def next_stamp(self):
        self.stamp += PERIOD_NS
        return self.stamp

    def ask(self, plan, stamp=None):
        """Publishes one input that is answered as `plan` says; returns its stamp and the instant of asking."""
        stamp = self.next_stamp() if stamp is None else stamp
        message = asked(stamp, plan)
        at = time.monotonic()
        self.output.publish(message)
        return stamp, at


class Model:
    """Local or a cloud: takes `<topic>/input` and answers on `<topic>/output` when the input's plan says."""

    def __init__(self, source, topic=None, kind=PointStamped, plan=plan_of, qos=None, answer=answered,
                 result=PointStamped, keep_bytes=None):
        self.keep_bytes = keep_bytes
        self.source, self.plan, self.answer = source, plan, answer
        self.asked, self.sent = [], []
        self.due = []
        self.turn = threading.Condition()
        topic = topic or f"/{source}"
        self.output = publishes(f"{topic}/output", result, qos)
        self.input = subscribes(f"{topic}/input", kind, qos, then=self.take, keep=False)
        threading.Thread(target=self.serve, daemon=True).start()

    def take(self, message, at):
        stamp = message.header.stamp.stamp
        after = self.plan(message.header.frame_id).get(self.source)
        with self.turn:
            self.asked.append((stamp, message.payload[:self.keep_bytes]))
            if after is not None:
                heapq.heappush(self.due, (at + after, stamp))
                self.turn.notify()

    def serve(self):
        while True:
            with self.turn:
                while not self.due or self.due[0][0] > time.monotonic():
                    self.turn.wait(self.due[0][0] - time.monotonic() if self.due else None)
                _, stamp = heapq.heappop(self.due)
            self.output.publish(self.answer(self.source, stamp))
            self.sent.append(stamp)

    def asked_for(self, stamp):
        """The payloads of the inputs of one stamp."""
        with self.turn:
            return [payload for asked, payload in self.asked if asked == stamp]

    def until_matched(self):
        self.output.until_matched()
        self.input.until_matched()


class Listener:
    """Hears what the node of this namespace and name says: its results, its status, the diagnostics."""

    def __init__(self, namespace="", node="fuseline", kind=PointStamped, qos=None, output=None):
        self.node = f"{namespace}/{node}"
        self.results = subscribes(output or f"{namespace}/output", kind, qos)
        self.status = subscribes(f"{self.node}/status", DiagnosticStatus)
        self.diagnostics = subscribes("/diagnostics", DiagnosticArray)

    def until_matched(self):
        self.results.until_matched()
        self.status.until_matched()

    def of(self, stamp):
        """The results of one stamp."""
        return [heard for heard in list(self.results.heard) if heard.message.header.stamp.stamp == stamp]

    def status_of(self, stamp):
        """The status messages of one stamp."""
        return [heard.message for heard in list(self.status.heard) if heard.message["key"] == str(stamp)]

    def until_answered(self, stamps, cap=15.0):
        """Waits until each of these stamps has a result and a status, which come on two topics."""
        stamps = set(stamps)
        keys = set(map(str, stamps))

        def without_result():
            return stamps - {heard.message.header.stamp.stamp for heard in list(self.results.heard)}

        def without_status():
            return keys - {heard.message["key"] for heard in list(self.status.heard)}

        until(lambda: not without_result(), lambda: f"a result for each input; none for {sorted(without_result())}; of those "
              f"without a status are {sorted(without_status())}", cap)
        until(lambda: not without_status(), lambda: f"a status for each input; none for {sorted(without_status())}", cap)

    def health(self, part):
        """The newest of the diagnostics about `part` of the node: `fusion`, `local` or a cloud."""
        for heard in reversed(list(self.diagnostics.heard)):
            for status in heard.message.status:
                if status.name.lstrip("/") == f"{self.node}: {part}".lstrip("/"):
                    return status
        return None

    def until_health(self, part, levels, cap=15.0):
        """Waits for diagnostics about `part` with one of `levels`."""
        def reached():
            status = self.health(part)
            return status if status and status.level in levels else None
        return until(reached, lambda: f"{part} at level {levels}, last {self.health(part)}", cap)

    def counted(self, what, part="fusion"):
        """A count in the newest diagnostics about `part`, over all its kinds."""
        status = self.health(part)
        return sum(int(pair.value) for pair in status.values if pair.key.split()[0] == what) if status else 0

    def until_counted(self, what, count, part="fusion"):
        until(lambda: self.counted(what, part) == count, lambda: f"{count} {what} of {part}, last {self.health(part)}")


def ready(camera, listener, *models, levels=(OK,)):
    """Waits until an input goes all the way: to each model and back with the result of the last, who is the best."""
    camera.output.until_matched()
    listener.until_matched()
    for model in models:
        model.until_matched()
        listener.until_health(model.source, levels)
    plan = " ".join(f"{model.source}=0" for model in models)

    def gone_through():
        stamp, _ = camera.ask(plan)
        best = models[-1].answer(models[-1].source, stamp).serialize()
        end = time.monotonic() + 1
        while time.monotonic() < end:
            if any(heard.message.payload == best for heard in listener.of(stamp)) and listener.status_of(stamp):
                return True
            time.sleep(0.005)
        return False

    until(gone_through, "an input that went all the way")
