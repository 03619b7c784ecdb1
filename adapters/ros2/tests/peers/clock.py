"""The wall clock of the node steps while it runs, as NTP or a person sets it; its monotonic clock does not."""

import os
import time

from bench import Skipped
from faults import Stream, firewall
from forwarding import PERIOD_S, check
from graph import is_over_zenoh, quality, until
from messages import (
    ERROR,
    OK,
    WARN,
    CompressedImage,
    GetParametersRequest,
    GetParametersResponse,
    Header,
    Parameter,
    ParameterValue,
    PointStamped,
    SetParametersRequest,
    SetParametersResponse,
    Time,
)
from node import parameters
from roles import Camera, Listener, Model, ready

HOUR_S = 3600
# After a step back the node joins its domain again: for this long at most nothing comes over best effort.
GAP_S = 1.0
# Peers hear nothing of others for so long: longer than the node once waited until they have met it.
DEAF_S = 8
# A second step comes so soon after the second participant that no peer has announced itself.
STEP_S = 0.3
# The size of an input that is sent in fragments.
FRAGMENTED = bytes(20_000)
FRAGMENTED_DEPTH = 128
STEPPED_BACK, JOINED_AGAIN = "the wall clock stepped back", "joined the domain again"
RELIABLE = {topic: {"subscription": {"reliability": "reliable"}} for topic in ("/input", "/local/output", "/west/output")}


def stands_off(listener, node, seconds):
    """Moves the node's clock, and waits until what the node says bears the time."""
    node.wall_clock(seconds)

    def is_told():
        reported = listener.diagnostics.heard[-1].message.header.stamp.sec
        return abs(reported - time.time() - seconds) < HOUR_S / 2

    until(is_told, f"a stamp {seconds} s off")


def a_wall_clock_that_steps_costs_no_input_and_no_result_of_reliable_topics(bench):
    node = bench.node(parameters(["west"], window=64, west={"in_flight": 64}, qos_overrides=RELIABLE), wall_clock=True)
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    run = []
    for seconds in (-HOUR_S, 0, HOUR_S, 0):
        stands_off(listener, node, seconds)
        for plan, *expected in (("local=0.02 west=0.1", "west", "F3"), ("local=0.02", "local", "F5")) * 10:
            run.append((expected, *camera.ask(plan)))
            time.sleep(PERIOD_S)
        listener.until_answered(stamp for _, stamp, _ in run)
    listener.until_health("fusion", {OK})
    assert node.ends() == 0
    for expected, stamp, at in run:
        check(listener, stamp, at, *expected)
    if is_over_zenoh():
        return
    # DDS wants the times of one writer in order, and readers that keep few drop what is older than those.
    sent = [heard.message.sample_info.source_timestamp for heard in listener.results.heard]
    assert sent == sorted(sent), "the source timestamps of outputs go back"


def best_effort_is_received_again_soon_after_the_wall_clock_stepped_back(bench):
    node = bench.node(parameters(["west"], window=64, west={"in_flight": 64}), wall_clock=True)
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    lost = 0
    for _ in range(3):
        node.wall_clock(-HOUR_S)
        stepped_at = time.monotonic()
        run = []
        while time.monotonic() < stepped_at + 3 * GAP_S:
            run.append(camera.ask("local=0.02 west=0.1"))
            time.sleep(PERIOD_S)
        after_gap = [(stamp, at) for stamp, at in run if at > stepped_at + GAP_S]
        listener.until_answered(stamp for stamp, _ in after_gap)
        for stamp, at in after_gap:
            check(listener, stamp, at, "west", "F3")
        results = [len(listener.of(stamp)) for stamp, _ in run]
        assert max(results) == 1, "two results for one input"
        lost += results.count(0)
        stands_off(listener, node, 0)
    listener.until_health("fusion", {OK})
    assert node.ends() == 0
    print(f"{lost} inputs without a result after 3 steps back")


def own_discovery_ports():
    """The ports at which the peers of this process hear of others: DDS gives them even numbers, and samples odd ones."""
    names = {os.readlink(f"/proc/self/fd/{number}") for number in os.listdir("/proc/self/fd")
             if os.path.exists(f"/proc/self/fd/{number}")}
    with open("/proc/self/net/udp") as sockets:
        rows = [line.split() for line in sockets.readlines()[1:]]
    ports = {int(row[1].split(":")[1], 16) for row in rows if f"socket:[{row[9]}]" in names}
    return {port for port in ports if port % 2 == 0 and 7400 <= port < 32768}


class FragmentedCamera(Camera):
    """A camera whose inputs are fragmented, and that keeps as many of them as D13 allows."""

    def __init__(self):
        super().__init__(kind=CompressedImage, qos=quality(depth=FRAGMENTED_DEPTH))

    def ask(self, plan, stamp=None):
        stamp = self.next_stamp() if stamp is None else stamp
        at = time.monotonic()
        self.output.publish(CompressedImage(Header(Time.at(stamp), plan), "", FRAGMENTED))
        return stamp, at


def keeps_reliable_topics(bench, drops, steps=1, camera_kind=Camera, kind=PointStamped, **settings):
    """A stream over reliable topics goes on while the clock steps back and packets to the peers' discovery are dropped."""
    if is_over_zenoh():
        raise Skipped("a session of Zenoh does not depend on the wall clock")
    usual = {"window": 1024, "local": {"deadline": 5.0, "in_flight": 1024}, "qos_overrides": RELIABLE}
    node = bench.node(parameters(**usual | settings), wall_clock=True)
    camera, listener, local = camera_kind(), Listener(), Model("local", kind=kind)
    ready(camera, listener, local)
    # Its process is not this one.
    bench.model_process("other")
    stream = Stream(camera, "local=0.02")
    until(lambda: len(stream.run) > FRAGMENTED_DEPTH, "some inputs")
    ports = ", ".join(map(str, own_discovery_ports()))
    rules = "".join(f"add rule inet late arrives udp dport {{ {ports} }} {drop}\n" for drop in drops)
    firewall(f"add table inet late\nadd chain inet late arrives {{ type filter hook input priority 0; }}\n{rules}")
    for step in range(1, steps + 1):
        node.wall_clock(-step * HOUR_S)
        until(lambda count=step: node.log().count(STEPPED_BACK) == count, "a step back that is noticed")
        if step < steps:
            # The second participant has heard the other process, and no longer hears this one.
            until(lambda: node.participants() == 2, "a second participant")
            time.sleep(STEP_S)
    time.sleep(DEAF_S if drops else 0)
    firewall("delete table inet late")
    until(lambda: JOINED_AGAIN in node.log() and node.participants() == 1, "one participant again", cap=45)
    more = len(stream.run) + 50
    until(lambda: len(stream.run) > more, "some more inputs")
    stream.end()
    listener.until_answered(stamp for stamp, _ in stream.run)
    assert node.ends() == 0
    assert all(len(listener.of(stamp)) == 1 for stamp, _ in stream.run), "two results for one input"
    print(f"{len(stream.run)} inputs")


def second_step_while_rejoining_costs_nothing(bench):
    keeps_reliable_topics(bench, ["drop"], steps=2)


def fragmented_inputs_outlast_a_step_back(bench):
    keeps_reliable_topics(bench, [], camera_kind=FragmentedCamera, kind=CompressedImage,
                          input={"type": "sensor_msgs/msg/CompressedImage"})


def late_announcement_costs_reliable_topics_nothing(bench):
    # It is announced in vain, and again ten seconds later.
    keeps_reliable_topics(bench, ["drop"])


def late_endpoints_cost_reliable_topics_nothing(bench):
    # What announces endpoints, by its writer: after INFO_TS, or when it is sent again after INFO_DST and INFO_TS.
    keeps_reliable_topics(bench, [f"@th,{at},32 {writer} drop" for at in (416, 544) for writer in (0x3c2, 0x4c2)])


def a_peer_that_comes_after_the_wall_clock_stepped_back_is_met_missed_and_met_again(bench):
    node = bench.node(parameters(["west"]), wall_clock=True)
    camera, listener, local = Camera(), Listener(), Model("local")
    ready(camera, listener, local)
    stands_off(listener, node, -HOUR_S)
    for _ in range(2):
        # A process of its own is a participant of its own.
        west = bench.model_process("west")
        listener.until_health("west", {OK})
        stamp, at = camera.ask("local=0.02 west=0.1")
        listener.until_answered([stamp])
        check(listener, stamp, at, "west", "F3")
        west.kill()
        west.wait()
        listener.until_health("west", {WARN, ERROR})
    assert node.ends() == 0


def a_client_that_comes_after_the_wall_clock_stepped_back_is_answered(bench):
    node = bench.node(parameters(), wall_clock=True)
    camera, listener, local = Camera(), Listener(), Model("local")
    ready(camera, listener, local)
    setting = bench.client("fuseline/set_parameters", SetParametersRequest, SetParametersResponse)
    setting.call(SetParametersRequest([Parameter("deadline", ParameterValue.of(0.3))]))
    stands_off(listener, node, -HOUR_S)
    reading = bench.client("fuseline/get_parameters", GetParametersRequest, GetParametersResponse, is_new=True)
    (deadline,) = reading.call(GetParametersRequest(["deadline"])).values
    assert deadline.double_value == 0.3
    again = setting.call(SetParametersRequest([Parameter("deadline", ParameterValue.of(0.4))]))
    assert [result.successful for result in again.results] == [True]
    assert node.ends() == 0


def requests_while_the_domain_is_joined_again_are_answered_once_and_what_they_set_holds(bench):
    if is_over_zenoh():
        raise Skipped("a session of Zenoh does not depend on the wall clock")
    node = bench.node(parameters(), wall_clock=True)
    camera, listener, local = Camera(), Listener(), Model("local")
    ready(camera, listener, local)
    setting = bench.client("fuseline/set_parameters", SetParametersRequest, SetParametersResponse)
    node.wall_clock(-HOUR_S)
    until(lambda: STEPPED_BACK in node.log(), "a step back that is noticed")
    # There is no /clock: simulated time stands at its beginning.
    setting.call(SetParametersRequest([Parameter("use_sim_time", ParameterValue.of(True))]))
    count = 1
    while JOINED_AGAIN not in node.log():
        setting.call(SetParametersRequest([Parameter("deadline", ParameterValue.of(0.3))]))
        count += 1
    received = listener.diagnostics.count
    listener.diagnostics.until_heard(received + 2)
    assert listener.diagnostics.heard[-1].message.header.stamp.sec == 0, "the time of day after use_sim_time was set"
    assert len(setting.peer.heard[setting.hears]) == count, "a request was answered twice"
    assert node.ends() == 0
