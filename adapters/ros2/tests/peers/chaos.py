"""Breaks what is between the node and a cloud behind gRPC: processes, packets, names, certificates, clocks; and disks."""

import os
import random
import signal
import subprocess
import time

from bench import Skipped
from certificates import Ca
from clock import HOUR_S, RELIABLE, stands_off
from faults import Stream, firewall
from graph import is_over_zenoh, until
from messages import ERROR, OK, WARN, answered
from node import parameters
from roles import Camera, Listener, Model, ready

NAME, PORT = "west.test", 7000
# A host that is busy with other work stands still for up to a second now and then; a result then comes in time all the same.
DEADLINE_S = 1.5
# More than the inputs of a deadline.
WINDOW = 128
# Numbers that no model looks at: with them fifty requests a second are 2 Mbit/s.
PADDING = " padding=0." + "0" * 5000
USUAL = "local=0.02 west=0.05" + PADDING
CHAIN = """
add table inet chaos
add chain inet chaos arrives { type filter hook input priority 0; }
"""


def packets(verdict):
    """Returns two steps: apply a verdict to packets to and from the cloud, and lift it."""
    rules = [f"add rule inet chaos arrives tcp {way} {PORT} {verdict}" for way in ("dport", "sport")]
    return lambda field: firewall("\n".join(rules)), lambda field: firewall("flush chain inet chaos arrives")


def plan(plan):
    """Returns two steps: change how long the cloud takes, and restore it."""
    return lambda field: field.asks(plan + PADDING), lambda field: field.asks(USUAL)


def wall_clock(seconds):
    """Returns two steps: move the node's wall clock, and move it back. Both wait until the node's stamps show it."""
    return (lambda field: stands_off(field.listener, field.node, seconds),
            lambda field: stands_off(field.listener, field.node, 0))


# What breaks it and what mends it, and whether no result of the cloud comes in time meanwhile (None: some come).
HARMS = {
    "kill": (lambda field: field.kills(), lambda field: field.starts(), True),
    "stop": (lambda field: os.kill(field.cloud.pid, signal.SIGSTOP), lambda field: os.kill(field.cloud.pid, signal.SIGCONT), True),
    # Resets themselves must come through.
    "reset": (*packets("tcp flags & rst != rst reject with tcp reset"), True),
    "black hole": (*packets("drop"), True),
    # TCP makes up for fewer losses within the deadline.
    "loss": (*packets("numgen random mod 100 < 40 drop"), None),
    "slow": (*packets("limit rate over 125 kbytes/second drop"), None),
    "latency": (*plan("local=0.02 west=1.9"), True),
    "step": (*plan("local=0.02 west=0.15"), False),
    "name gone": (lambda field: field.restarts(named=False), lambda field: field.is_named(), True),
    "expired": (lambda field: field.restarts("expired"), lambda field: field.restarts(), True),
    "clock back": (*wall_clock(-HOUR_S), False),
    "clock ahead": (*wall_clock(HOUR_S), False),
}
# A server that falls silent is pinged after 5 s and given up after 2 more.
LASTS_S = {"black hole": 9.0}
# What `/diagnostics` must have among the reasons why calls failed.
REASONS = {"expired": "certificate expired"}


class Field:
    """The cloud, its name and its certificates, and the node that asks it."""

    def __init__(self, bench):
        if is_over_zenoh():
            raise Skipped("behind gRPC it is the same over Zenoh")
        self.bench, self.folder = bench, bench.folder
        self.hosts = self.folder / "hosts"
        self.is_named()
        mount("--bind", self.hosts, "/etc/hosts")
        firewall(CHAIN)
        ca = Ca(self.folder, bench.programs["clock"])
        for who, name, days in (("good", NAME, 20), ("expired", NAME, 5), ("robot", "robot", 20)):
            ca.signs(who, name, days)
        self.starts()
        files = {"ca": "ca.pem", "certificate": "robot.pem", "key": "robot.key"}
        grpc = {"url": f"https://{NAME}:{PORT}"} | {key: str(self.folder / file) for key, file in files.items()}
        # What is lost over best effort while the clock steps back is another matter.
        reliable = {topic: RELIABLE[topic] for topic in ("/input", "/local/output")}
        self.node = bench.node(parameters(["west"], deadline=DEADLINE_S, window=WINDOW, west={"in_flight": WINDOW, "grpc": grpc},
                                          qos_overrides=reliable), wall_clock=True)
        self.camera, self.listener, self.local = Camera(), Listener(), Model("local")
        ready(self.camera, self.listener, self.local)
        self.stream = Stream(self.camera, USUAL)

    def starts(self, certificate="good"):
        self.cloud = self.bench.starts("cloud.py", "west", str(PORT), str(self.folder), certificate,
                                       environment={"GRPC_VERBOSITY": "NONE"})

    def kills(self):
        self.cloud.kill()
        self.cloud.wait()

    def restarts(self, certificate="good", named=True):
        self.kills()
        self.is_named(named)
        self.starts(certificate)

    def is_named(self, named=True):
        self.hosts.write_text("127.0.0.1 localhost\n" + f"127.0.0.1 {NAME}\n" * named)

    def asks(self, plan):
        self.stream.plan = plan

    def sources(self, since):
        """Returns the sources of the results that came, from this status on."""
        return [heard.message["source"] for heard in list(self.listener.status.heard)[since:]]

    def breaks(self, harm):
        """Breaks it for a while, and mends it. Returns the seconds until the cloud's results are back."""
        strike, repair, is_silent = HARMS[harm]
        listener, end = self.listener, time.monotonic() + LASTS_S.get(harm, 2.0)
        strike(self)
        if is_silent:
            until(lambda: self.sources(-20) == ["local"] * 20, f"local's results under {harm}")
            listener.until_health("west", {WARN, ERROR})
        elif is_silent is None:
            since = len(listener.status.heard)
            until(lambda: "local" in self.sources(since), f"a result of local under {harm}")
        since = len(listener.status.heard)
        time.sleep(max(end - time.monotonic(), 0.0))
        meanwhile = self.sources(since)
        if reason := REASONS.get(harm):
            until(lambda: reason in str(listener.health("west")), lambda: f"{reason}: {listener.health('west')}")
        repair(self)
        back = time.monotonic()
        until(lambda: self.sources(-20) == ["west"] * 20, f"west's results after {harm}", cap=20)
        took = time.monotonic() - back
        listener.until_health("west", {OK})
        assert not (is_silent and "west" in meanwhile), f"west's results under {harm}"
        assert is_silent is not False or "local" not in meanwhile, f"local's results under {harm}"
        return took


def mount(*words):
    """Mounts something in the mounts of this test alone."""
    if not os.environ.get("IS_ALONE"):
        raise Skipped("the mounts are not the test's own")
    done = subprocess.run(["mount", *map(str, words)], capture_output=True, text=True)
    if done.returncode:
        raise Skipped(f"nothing can be mounted here: {done.stderr}")


def whatever_breaks_on_the_way_to_a_cloud_behind_grpc_costs_no_input_its_one_answer(bench):
    seed = int(os.environ.get("SEED", random.randrange(2**32)))
    harms = sorted(HARMS)
    random.Random(seed).shuffle(harms)
    # Before anything breaks, so that a run that fails can be repeated with SEED.
    print(f"seed {seed}: {', '.join(harms)}", flush=True)
    field = Field(bench)
    until(lambda: field.sources(-20) == ["west"] * 20, "west's results")
    back = {harm: field.breaks(harm) for harm in harms}
    field.stream.end()
    run, listener, node = field.stream.run, field.listener, field.node
    listener.until_answered(stamp for stamp, _ in run)
    assert node.ends() == 0
    for stamp, at in run:
        (result,), (status,) = listener.of(stamp), listener.status_of(stamp)
        assert result.message.payload == answered(status["source"], stamp).serialize(), "not the bytes that were sent"
        assert result.at - at < DEADLINE_S + 3.0, f"{status['source']} after {result.at - at:.3f} s"
    reported = ", ".join(f"{harm} {took:.1f}" for harm, took in back.items())
    print(f"{len(run)} inputs, {bench.judge(node)} judged; seconds until west was reported back: {reported}")


def a_disk_that_fills_ends_the_recording_and_costs_no_input_its_answer(bench):
    disk = bench.folder / "disk"
    disk.mkdir()
    mount("-t", "tmpfs", "-o", "size=48k", "tmpfs", disk)
    try:
        node = bench.node(parameters(trace={"file": str(disk / "trace.jsonl")}))
        camera, listener, local = Camera(), Listener(), Model("local")
        ready(camera, listener, local)
        stream = Stream(camera, "local=0.02")
        until(lambda: "the recording has ended" in str(listener.health("fusion")), "the diagnostics to report it", cap=60)
        more = len(stream.run) + 50
        until(lambda: len(stream.run) > more, "some more inputs")
        stream.end()
        listener.until_answered(stamp for stamp, _ in stream.run)
        node.ends()
        assert all(len(listener.of(stamp)) == 1 == len(listener.status_of(stamp)) for stamp, _ in stream.run)
        judged = bench.judge(node)
        assert 0 < judged < len(stream.run), f"{judged} judged of {len(stream.run)} inputs"
        print(f"{len(stream.run)} inputs, {judged} recorded; exit {node.code}; {listener.health('fusion').message}")
        bench.nodes.remove(node)
    finally:
        subprocess.run(["umount", "--lazy", str(disk)], check=True)
