"""Breaks things around the node, which must go on."""

import os
import signal
import subprocess
import threading
import time

from bench import Skipped
from forwarding import check
from graph import again, is_over_zenoh, publishes, quality, subscribes, until
from messages import ERROR, OK, WARN, Header, Image, Point, PointStamped, String, Time, answered, bytes_as
from node import POINTS, parameters
from roles import Camera, Listener, Model, ready

PERIOD_S = 0.02


class Stream:
    """A camera that goes on by itself, fifty times a second, until it is ended."""

    def __init__(self, camera, plan):
        self.camera, self.plan, self.run = camera, plan, []
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self.go, daemon=True)
        self.thread.start()

    def go(self):
        while not self.ended.wait(PERIOD_S):
            self.run.append(self.camera.ask(self.plan))

    def end(self):
        self.ended.set()
        self.thread.join()


def a_killed_cloud_is_replaced_by_local_and_taken_again_when_it_returns(bench):
    node = bench.node(parameters(["west"], deadline=0.5, window=64, west={"in_flight": 64}))
    camera, listener, local = Camera(), Listener(), Model("local")
    # What it subscribes to must go on for the others when it is dead.
    west = bench.model_process("west", "/output", "/local/input")
    listener.until_health("west", {OK})
    ready(camera, listener, local)
    stream = Stream(camera, "local=0.02 west=0.05")

    def has(source, rule, count=5):
        """Returns whether the last statuses are of this source by this rule."""
        last = [heard.message for heard in list(listener.status.heard)[-count:]]
        return all((status["source"], status["rule"]) == (source, rule) for status in last)

    until(lambda: has("west", "F3"), "west's results")
    os.kill(west.pid, signal.SIGKILL)
    killed = time.monotonic()
    # Over DDS its lease must end first; Zenoh's router reports at once that its connection is gone.
    if not is_over_zenoh():
        until(lambda: has("local", "F5"), "local's results at the deadline")
    fell_back = time.monotonic() - killed
    listener.until_health("west", {WARN, ERROR})
    # It is asked no more, and local's result leaves the moment it arrives.
    until(lambda: has("local", "F3"), "local's results at once", cap=30)
    gone = time.monotonic() - killed
    listener.until_health("west", {ERROR})
    asked = listener.counted("requests", "west")
    until(lambda: has("local", "F3", count=10), "local's results at once")
    assert listener.counted("requests", "west") == asked, "a cloud that is gone was asked"
    bench.model_process("west")
    until(lambda: has("west", "F3"), "west's results again", cap=30)
    listener.until_health("west", {OK})
    listener.until_health("fusion", {OK})
    stream.end()
    listener.until_answered(stamp for stamp, _ in stream.run)
    assert node.ends() == 0
    for stamp, at in stream.run:
        (result,) = listener.of(stamp)
        source = listener.status_of(stamp)[0]["source"]
        assert result.message.payload == answered(source, stamp).serialize()
        assert result.at - at < 0.5 + 3
    print(f"{len(stream.run)} inputs; fell back after {fell_back:.1f} s, asked no more after {gone:.1f} s")


def a_cloud_that_hangs_for_a_while_is_heard_again_when_it_goes_on(bench):
    node = bench.node(parameters(["west"], deadline=0.3, window=64, west={"in_flight": 64}))
    camera, listener, local = Camera(), Listener(), Model("local")
    west = bench.model_process("west")
    ready(camera, listener, local)
    stream = Stream(camera, "local=0.02 west=0.05")

    def last_is(source):
        return [heard.message["source"] for heard in list(listener.status.heard)[-20:]] == [source] * 20

    until(lambda: last_is("west"), "west's results")
    os.kill(west.pid, signal.SIGSTOP)
    until(lambda: last_is("local"), "local's results")
    listener.until_health("west", {WARN, ERROR})
    os.kill(west.pid, signal.SIGCONT)
    until(lambda: last_is("west"), "west's results again")
    listener.until_health("west", {OK})
    stream.end()
    listener.until_answered(stamp for stamp, _ in stream.run)
    assert node.ends() == 0
    assert all(len(listener.of(stamp)) == 1 for stamp, _ in stream.run)
    drops = node.events("drop", p=1)
    assert drops and {line["why"] for line in drops} <= {"late", "superseded"}, drops
    print(f"{len(stream.run)} inputs, {len(drops)} late results dropped")


# What a user has who sets no more than must be set: local may have four messages at once.
USUAL_LOCAL = {"deadline": 1.0}


def until_local_answers(camera, listener):
    """Inputs that no cloud answers: first one that local does, then each of twenty."""
    def is_answered():
        stamp, _ = camera.ask("local=0.02")
        (status,) = until(lambda: listener.status_of(stamp), "a status")
        # While the window is full of what local lost, messages are refused.
        return status["source"] == "local"

    until(is_answered, "an input that local answers")
    run = []
    for _ in range(20):
        run.append(camera.ask("local=0.02")[0])
        time.sleep(PERIOD_S)
    listener.until_answered(run)
    assert [listener.status_of(stamp)[0]["source"] for stamp in run] == ["local"] * 20


def results_of_local_that_are_lost_take_none_of_its_places(bench):
    node = bench.node(parameters(["west"], deadline=0.3, local=USUAL_LOCAL))
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    # Local does not answer, which is what a lost request or result looks like.
    lost = [camera.ask("west=0.02")[0] for _ in range(8)]
    listener.until_answered(lost)
    until_local_answers(camera, listener)
    assert node.ends() == 0


def a_local_that_is_killed_is_asked_again_when_it_returns(bench):
    node = bench.node(parameters(deadline=0.3, local=USUAL_LOCAL))
    camera, listener = Camera(), Listener()
    process = bench.model_process("local")
    listener.until_health("local", {OK})
    camera.output.until_matched()
    listener.until_matched()
    stream = Stream(camera, "local=0.02")
    until(lambda: len(listener.results.heard) > 20, "results of local")
    os.kill(process.pid, signal.SIGKILL)
    time.sleep(1)
    bench.model_process("local")
    stream.end()
    until_local_answers(camera, listener)
    assert node.ends() == 0


def inputs_that_come_no_longer_from_a_publisher_that_is_there_are_told(bench):
    """misuse: the camera stops or is gone | WARN in `/diagnostics` after ten usual gaps, or after `input.silence`"""
    node = bench.node(parameters(input=POINTS | {"silence": 0.5}))
    camera, listener, local = Camera(), Listener(), Model("local")
    ready(camera, listener, local)
    # Not the warning from before the first message, which may still be the newest.
    words = "nothing came on /input"
    until(lambda: words in listener.health("fusion").message, lambda: f"{words}, last {listener.health('fusion')}")
    assert listener.health("fusion").level == WARN, listener.health("fusion")
    stream = Stream(camera, "local=0")
    listener.until_health("fusion", {OK})
    stream.end()
    assert node.ends() == 0


def inputs_may_rest_as_long_as_their_parameter_says(bench):
    # Twenty times as long as they may by default.
    node = bench.node(parameters(input=POINTS | {"silence": 40.0}))
    camera, listener, local = Camera(), Listener(), Model("local")
    ready(camera, listener, local)
    # After 40 messages the node has forgotten the gaps at the start.
    for _ in range(40):
        camera.ask("local=0")
        time.sleep(PERIOD_S)
    listener.until_health("fusion", {OK})
    heard = len(listener.diagnostics.heard)
    listener.diagnostics.until_heard(heard + 20)
    assert listener.health("fusion").level == OK, listener.health("fusion")
    assert node.ends() == 0


def a_peer_with_another_type_name_does_not_match(bench):
    """misuse: a camera or a model of another type | WARN in `/diagnostics` with the type; its messages are not read"""
    node = bench.node(parameters(["west"]))
    output = subscribes("/output", String)
    asked = subscribes("/west/input", String)
    image = publishes("/input", Image)
    camera, listener, local = Camera(), Listener(), Model("local")
    ready(camera, listener, local)
    image.publish(Image(Header(Time.at(1), "local=0"), 1, 1, "mono8", 0, 1, b"1"))
    stamps = [camera.ask("local=0 west=0")[0] for _ in range(8)]
    listener.until_answered(stamps)
    listener.until_counted("messages", len(listener.status.heard))
    assert image.matched() == output.matched() == asked.matched() == 0
    assert output.count == asked.count == 0
    assert listener.counted("requests", "west") == 0, "a cloud of another type was asked"
    assert String.__idl_typename__ in str(listener.health("west")), "the diagnostics do not name the other type"
    west = Model("west")
    ready(camera, listener, local, west, levels=(OK, WARN))
    stamp, at = camera.ask("local=0 west=0.05")
    listener.until_answered([stamp])
    assert node.ends() == 0
    check(listener, stamp, at, "west", "F3")
    assert not listener.status_of(1)


def garbage_on_every_topic_is_counted_and_does_no_harm(bench):
    """misuse: bytes that are no message, on every topic | they are counted, `/diagnostics` warns, and the node goes on"""
    node = bench.node(parameters(["west"], deadline_topic="deadline"))
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    broken = {"/input": "fusion", "/local/output": "local", "/west/output": "west"}
    for topic, part in broken.items():
        for size in (1, 4):
            kind = bytes_as(PointStamped, size)
            short = publishes(topic, kind)
            short.until_matched()
            counted = listener.counted("malformed", part)
            again(lambda: short.publish(kind(b"\xff" * size)), lambda: listener.counted("malformed", part) > counted,
                  f"{size} bytes on {topic} counted as malformed")
        # A time of more than a second's nanoseconds.
        publisher = publishes(topic, PointStamped)
        publisher.until_matched()
        counted = listener.counted("malformed", part)
        odd = PointStamped(Header(Time(1, 1_000_000_000), "local=0 west=0"), Point(0, 0, 0))
        again(lambda: publisher.publish(odd), lambda: listener.counted("malformed", part) > counted,
              f"a wrong time on {topic} counted as malformed")
    # What has a key and nothing else is taken for a message: nobody looks further.
    kind = bytes_as(PointStamped, 8)
    publisher = publishes("/input", kind)
    publisher.until_matched()
    bare = Time.at(4_000_000_005)
    again(lambda: publisher.publish(kind(bare.serialize()[4:])), lambda: listener.status_of(4_000_000_005),
          "a status of the input that is a key alone")
    stamp, at = camera.ask("local=0.02 west=0.05")
    listener.until_answered([stamp])
    assert node.ends() == 0
    check(listener, stamp, at, "west", "F3")


class RawOverZenoh:
    """Publishes bytes as they are, as Fast DDS does."""

    def publishes(self, topic, kind):
        vars(self)[topic] = publishes(topic, kind)

    def publish(self, topic, payload):
        vars(self)[topic].publish_bytes(payload)

    def until_matched(self, *topics):
        for topic in topics:
            vars(self)[topic].until_matched()


def other_encapsulations_are_counted_and_do_no_harm(bench):
    peer = RawOverZenoh() if is_over_zenoh() else bench.fast_dds()
    node = bench.node(parameters(["west"]))
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    broken = {"/input": "fusion", "/local/output": "local", "/west/output": "west"}
    for topic in broken:
        peer.publishes(topic, PointStamped)
    peer.until_matched(*broken)
    ready(camera, listener, local, west)
    good = answered("west", 5).serialize()
    for topic, part in broken.items():
        for head in ("0002", "0003", "0006", "0007", "000a", "000b", "00ff", "ffff"):
            counted = listener.counted("malformed", part)
            payload = bytes.fromhex(head) + good[2:]
            again(lambda: peer.publish(topic, payload), lambda: listener.counted("malformed", part) > counted,
                  f"encapsulation {head} on {topic} counted as malformed")
        # Less than an encapsulation header is not a sample that DDS could give us.
        for payload in (b"", b"\x00", b"\x00\x01", b"\x00\x01\x00", b"\x00\x00\x00\x00"):
            peer.publish(topic, payload)
    stamp, at = camera.ask("local=0.02 west=0.05")
    listener.until_answered([stamp])
    assert node.ends() == 0
    check(listener, stamp, at, "west", "F3")


def peers_whose_quality_of_service_does_not_fit_are_reported(bench):
    """misuse: quality of service that does not fit | `/diagnostics` name the policy and the topic"""
    if is_over_zenoh():
        raise Skipped("over Zenoh any qualities of service fit each other")
    overrides = {"/input": {"subscription": {"reliability": "reliable"}},
                 "/output": {"publisher": {"reliability": "best_effort"}}}
    node = bench.node(parameters(["west"], qos_overrides=overrides))
    camera, listener = Camera(), Listener(qos=quality(reliable=False))
    local, west = Model("local"), Model("west")
    ready(camera, listener, local, west)
    demanding = subscribes("/output", PointStamped, quality(reliable=True))
    careless = publishes("/input", PointStamped, quality(reliable=False))
    for topic in ("/output", "/input"):
        until(lambda: any(topic in line and "RELIABILITY" in line.upper() for line in node.log().splitlines()),
              f"a line of the log about {topic}")
        until(lambda: any(topic in str(status) and "RELIABILITY" in str(status).upper()
                          for heard in list(listener.diagnostics.heard)[-2:] for status in heard.message.status
                          if status.level != OK), f"diagnostics about {topic}")
    stamp, at = camera.ask("local=0.02 west=0.05")
    listener.until_answered([stamp])
    assert demanding.matched() == careless.matched() == demanding.count == 0
    assert node.ends() == 0
    check(listener, stamp, at, "west", "F3")


LOSES = """
add table inet loss
add chain inet loss arrives {{ type filter hook input priority 0; }}
add rule inet loss arrives meta l4proto {} numgen random mod 100 < 20 drop
"""


def firewall(rules):
    """Sets rules of nftables in the test's own network, and in no other."""
    with open("/proc/self/net/dev") as devices:
        names = [line.split(":")[0].strip() for line in devices if ":" in line]
    if names != ["lo"]:
        raise Skipped("the network is not the test's own")
    try:
        done = subprocess.run(["nft", "-f", "-"], input=rules, capture_output=True, text=True)
    except FileNotFoundError:
        raise Skipped("no nft (package nftables)") from None
    if done.returncode:
        raise Skipped(f"no packet can be lost here: {done.stderr}")


def a_network_that_loses_one_packet_in_five_costs_no_input_its_one_answer(bench):
    node = bench.node(parameters(["west"], deadline=0.3, window=64, west={"in_flight": 64}))
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    stream = Stream(camera, "local=0.02 west=0.05")
    firewall(LOSES.format("tcp" if is_over_zenoh() else "udp"))
    time.sleep(5)
    until(lambda: any(heard.message["source"] == "local" for heard in list(listener.status.heard)), "a result that is lost", cap=60)
    firewall("delete table inet loss")
    lossy = len(stream.run)

    def is_well():
        # Of inputs that were asked since: while a connection waits for what it lost, nothing is heard at all.
        since = {str(stamp) for stamp, _ in stream.run[lossy:]}
        last = [heard.message for heard in list(listener.status.heard)[-20:]]
        return len(last) == 20 and all(status["source"] == "west" and status["key"] in since for status in last)

    until(is_well, "west's results again")
    stream.end()
    listener.until_answered([stream.run[-1][0]])
    assert node.ends() == 0
    # Over best effort an input may be lost on its way; one that was taken on may not.
    taken = [line["t"] for line in node.events("open")]
    reported = [heard.message["key"] for heard in listener.status.heard]
    assert len(reported) == len(set(reported)) == len(taken), (len(reported), len(set(reported)), len(taken))
    sources = [listener.status_of(stamp)[0].message for stamp, _ in stream.run if listener.status_of(stamp)]
    assert all(len(listener.of(stamp)) <= 1 for stamp, _ in stream.run)
    by_local = [heard for heard in listener.status.heard if heard.message["source"] == "local"]
    print(f"{len(stream.run)} inputs, {lossy} of them while packets were lost: {len(taken)} taken on, "
          f"{len(by_local)} answered by local, {sources.count('missed')} missed")
