"""Deadlines that a policy chooses, by the speed that a peer publishes."""

import threading
import time

from forwarding import LATENESS_S
from graph import publishes, until
from messages import OK, WARN, Float64, Odometry, answered
from node import parameters
from roles import Camera, Listener, Model, ready

# What the guard allows the vehicle of its defaults, and why: without a speed no more than local takes.
ALLOWED = {
    18.0: (0.6506, "local-stops"),
    20.0: (0.3117, "local-stops"),
    22.0: (0.9192, "cloud-alone"),
    None: (0.3017, "unsure"),
}
NS = 1_000_000_000


class Vehicle:
    """Publishes its speed twenty times a second; none is nothing at all."""

    def __init__(self, topic, kind):
        self.output, self.kind = publishes(topic, kind), kind
        self.speed = None
        threading.Thread(target=self.drive, daemon=True).start()

    def drive(self):
        while True:
            if (speed := self.speed) is not None:
                self.output.publish(Odometry.at(speed) if self.kind is Odometry else Float64(speed))
            time.sleep(0.05)


def near(seconds, expected):
    return abs(float(seconds) - expected) < 0.0001


def the_guard_decides_by_the_speed_that_a_peer_publishes(bench):
    for kind in (Odometry, Float64):
        name = kind.__name__.lower()
        types = {Odometry: "nav_msgs/msg/Odometry", Float64: "std_msgs/msg/Float64"}
        speed = {"speed_topic": "speed", "speed_type": types[kind]}
        settings = parameters(["west"], deadline=2.0, window=64, policy="guard")
        # Its parameters are below a name that has a value, too: dots say that.
        settings |= {f"policy.{part}": value for part, value in speed.items()}
        node = bench.node(settings, ["-r", f"__ns:=/{name}"], name=name)
        camera, listener = Camera(f"/{name}/input"), Listener(f"/{name}")
        local, west = Model("local", f"/{name}/local"), Model("west", f"/{name}/west")
        vehicle = Vehicle(f"/{name}/speed", kind)
        ready(camera, listener, local, west)
        vehicle.output.until_matched()
        run = []

        def in_force(speed, run=run, camera=camera, listener=listener):
            """Requests until the diagnostics report what holds at this speed; returns whether they do."""
            deadline, why = ALLOWED[speed]
            run.append((speed, *camera.ask("local=0.02")))
            time.sleep(0.1)
            west, fusion = listener.health("west"), listener.health("fusion")
            is_told = (fusion.level, "no speed" in fusion.message) == ((WARN, True) if speed is None else (OK, False))
            return is_told and west["deadline_why"] == why and near(west["deadline_s"], deadline)

        firsts = {}
        # Backwards it is as fast.
        for speed in (18.0, 20.0, 22.0, -18.0, None, 20.0):
            vehicle.speed = speed
            known = None if speed is None else abs(speed)
            until(lambda known=known: in_force(known),
                  lambda: f"{ALLOWED[known]}, last {listener.health('west')} and {listener.health('fusion')}")
            # What is asked now has it for sure; the next speed waits until the cloud has the request, for topics keep
            # no order among each other.
            stamp, at = camera.ask("local=0.02")
            firsts[stamp, at] = known
            until(lambda stamp=stamp: west.asked_for(stamp), "a request at this speed")
        listener.until_answered([stamp for _, stamp, _ in run] + [stamp for stamp, _ in firsts])
        assert node.ends() == 0
        for (stamp, at), speed in firsts.items():
            (deadline, _), (result,), (status,) = ALLOWED[speed], listener.of(stamp), listener.status_of(stamp)
            assert result.message.payload == answered("local", stamp).serialize()
            assert (status["source"], status["rule"]) == ("local", "F5"), status
            assert deadline - 0.0001 <= result.at - at < deadline + LATENESS_S, f"{result.at - at:.3f} s at {speed} m/s"
            # The request bore it.
            (offer,) = node.events("offer", t=int(status["timestamp"]))
            assert near(offer["deadline"] / NS, deadline), (offer, speed)
        offered = {round(line["deadline"] / NS, 4) for line in node.events("offer")}
        assert offered == {deadline for deadline, _ in ALLOWED.values()}, offered
        print(f"{types[kind]}: {bench.judge(node)} timestamps judged, deadlines {sorted(offered)}")
