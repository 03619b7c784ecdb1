"""Tests which result leaves, and when."""

import json
import time

from bench import Skipped
from fastdds import FastModel
from graph import again, publishes, subscribes, until
from messages import (
    OK,
    WARN,
    CompressedImage,
    Float64,
    Header,
    PointStamped,
    Time,
    answered,
    asked,
    carries,
    serialized,
)
from node import parameters
from roles import PERIOD_NS, Camera, Listener, Model, ready

DEADLINE_S = 1.0
# On a machine with other things to do.
LATENESS_S = 3.0
PERIOD_S = 1 / 30


def check(listener, stamp, at, source, rule, deadline=DEADLINE_S):
    """One result for this stamp: the bytes of `source`, in time, and a status that says why."""
    results, states = listener.of(stamp), listener.status_of(stamp)
    assert len(results) == 1, f"{len(results)} results for one input"
    assert results[0].message.payload == answered(source, stamp).serialize(), "not the bytes that were sent"
    waited = results[0].at - at
    assert waited < deadline + LATENESS_S, f"{source} after {waited:.3f} s"
    if rule == "F5":
        assert waited >= deadline, f"{source} by a timer after {waited:.3f} s, the deadline is {deadline} s"
    assert len(states) == 1, f"{len(states)} statuses for one input"
    assert (states[0].level, states[0]["source"], states[0]["rule"]) == (OK, source, rule), states[0]


def is_big(stamp):
    """Every other answer of west in Fast DDS is big-endian."""
    return stamp // PERIOD_NS % 2 == 1


def the_best_result_available_by_the_deadline_is_sent_once_byte_for_byte(bench):
    plans = {
        "local=0.01 west=0.03 east=0.06": ("east", "F3"),
        "local=0.10 west=0.06 east=0.03": ("east", "F3"),
        "local=0.01 west=0.03": ("west", "F5"),
        "local=0.01": ("local", "F5"),
        "local=0.01 west=0.03 east=1.30": ("west", "F5"),
    }
    wide = {"in_flight": 64}
    node = bench.node(parameters(["west", "east"], window=64, west=wide, east=wide))
    camera, listener = Camera(), Listener()
    models = [Model(source) for source in ("local", "west", "east")]
    ready(camera, listener, *models)
    run = []
    for plan in list(plans) * 6:
        run.append((plan, *camera.ask(plan)))
        time.sleep(PERIOD_S)
    listener.until_answered(stamp for _, stamp, _ in run)
    time.sleep(DEADLINE_S)
    assert node.ends() == 0
    for plan, stamp, at in run:
        check(listener, stamp, at, *plans[plan])
        for model in models:
            assert model.asked_for(stamp) == [asked(stamp, plan).serialize()], f"what {model.source} was asked"
    print(f"{len(run)} inputs, {bench.judge(node)} timestamps judged")


def a_patient_node_waits_for_all_that_outrank_what_it_has(bench):
    for commit, deadline in (("eager", 0.3), ("patient", 0.8)):
        clouds = {"west": {"deadline": 0.3}, "east": {"deadline": 0.8}}
        settings = parameters(["west", "east"], commit=commit, **clouds)
        node = bench.node(settings, ["-r", f"__ns:=/{commit}"], name=commit)
        camera, listener = Camera(f"/{commit}/input"), Listener(f"/{commit}")
        ready(camera, listener, *(Model(source, f"/{commit}/{source}") for source in ("local", "west", "east")))
        run = [camera.ask("local=0.01 west=0.05") for _ in range(5)]
        listener.until_answered(stamp for stamp, _ in run)
        assert node.ends() == 0
        for stamp, at in run:
            check(listener, stamp, at, "west", "F5", deadline=deadline)
            decided = float(listener.status_of(stamp)[0]["decided_s"])
            assert deadline <= decided < deadline + 0.4, f"{commit}: decided after {decided} s"


def under_progressive_each_better_result_is_a_revision_at_once_and_the_last_one_the_output(bench):
    plans = {
        "local=0.01 west=0.40 east=0.80": (["local", "west"], "east", "F3"),
        "local=0.01 west=0.40": (["local", "west"], "west", "F9"),
        "local=0.40 east=0.01": ([], "east", "F3"),
        "local=0.01": (["local"], "local", "F9"),
    }
    wide = {"in_flight": 64}
    settings = parameters(["west", "east"], commit="progressive", window=64, deadline=1.5, west=wide, east=wide)
    node = bench.node(settings)
    camera, listener = Camera(), Listener()
    revisions = subscribes("/output/revisions", PointStamped)
    models = [Model(source) for source in ("local", "west", "east")]
    revisions.until_matched()
    ready(camera, listener, *models)
    run = []
    for plan in list(plans) * 6:
        run.append((plan, *camera.ask(plan)))
        time.sleep(PERIOD_S)
    listener.until_answered(stamp for _, stamp, _ in run)
    time.sleep(DEADLINE_S)
    assert node.ends() == 0
    for plan, stamp, at in run:
        before, last, rule = plans[plan]
        results, states = listener.of(stamp), listener.status_of(stamp)
        sent = [heard for heard in revisions.heard if heard.message.header.stamp.stamp == stamp]
        expected = [answered(source, stamp).serialize() for source in before]
        assert [heard.message.payload for heard in sent] == expected, f"{len(sent)} revisions of {plan}"
        assert [result.message.payload for result in results] == [answered(last, stamp).serialize()], plan
        if rule == "F9":
            assert results[0].at - at >= 1.5, f"{last} is final after {results[0].at - at:.3f} s"
            assert sent[-1].at < results[0].at
        reported = [(state["source"], state["rule"], state["revision"]) for state in states]
        items = [(source, "F9") for source in before] + [(last, rule)]
        assert reported == [(*item, str(revision)) for revision, item in enumerate(items)], reported
    print(f"{len(run)} inputs, {len(revisions.heard)} revisions, {bench.judge(node)} timestamps judged")


def late_results_are_dropped_and_nothing_is_sent_twice(bench):
    node = bench.node(parameters(["west"], deadline=0.3, west={"in_flight": 64}, window=64))
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    run = []
    for _ in range(10):
        run.append(("F5", *camera.ask("local=0.02 west=0.6")))
        run.append(("F3", *camera.ask("local=0.9 west=0.6")))
        time.sleep(PERIOD_S)
    listener.until_answered(stamp for _, stamp, _ in run)
    # What west sends now comes after all that it sent late.
    ready(camera, listener, local, west)
    assert node.ends() == 0
    for rule, stamp, at in run:
        check(listener, stamp, at, "local", rule, deadline=0.3)
        assert stamp in west.sent
    drops = {why: len(node.events("drop", p=1, why=why)) for why in ("superseded", "late")}
    assert drops["superseded"] >= 10 and drops["late"] == 10, drops


def late_results_are_hints_for_who_subscribes_and_no_outputs(bench):
    node = bench.node(parameters(["west", "east"], deadline=0.3, window=64, west={"hints": "west/late", "in_flight": 64},
                                 east={"in_flight": 64}))
    camera, listener, local = Camera(), Listener(), Model("local")
    west, east = Model("west"), Model("east")
    hints = subscribes("/west/late", PointStamped)
    ready(camera, listener, local, west, east)
    hints.until_matched()
    plans = {
        "local=0.02 west=0.6": "local",  # late
        "local=0.02 west=0.15 east=0.05": "east",  # superseded
        "local=0.02 west=0.05": "west",  # in time
        "local=0.02 east=0.6": "local",  # of another cloud
    }
    run = [(plan, camera.ask(plan)[0]) for plan in list(plans) * 5]
    listener.until_answered(stamp for _, stamp in run)
    late = [stamp for plan, stamp in run if plans[plan] != "west" and "west" in plan]

    def hinted(stamp):
        return [heard.message.payload for heard in list(hints.heard) if heard.message.header.stamp.stamp == stamp]

    until(lambda: all(hinted(stamp) for stamp in late), "a hint for each late result")
    # What the sources send now comes after all that they sent late.
    ready(camera, listener, local, west, east)
    assert node.ends() == 0
    for plan, stamp in run:
        assert hinted(stamp) == ([answered("west", stamp).serialize()] if stamp in late else []), plan
        (result,) = listener.of(stamp)
        assert result.message.payload == answered(plans[plan], stamp).serialize(), plan
    print(f"{len(late)} hints of {len(run)} inputs, {bench.judge(node)} timestamps judged")


def a_published_deadline_counts_from_the_next_input_on(bench):
    node = bench.node(parameters(["west"], deadline=2.0, deadline_topic="deadline"))
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    deadline = publishes("/deadline", Float64)
    deadline.until_matched()

    def holds(seconds):
        """Returns whether local's result leaves after this deadline and before the first one."""
        stamp, _ = camera.ask("local=0")
        (status,) = until(lambda: listener.status_of(stamp), "a status")
        return seconds <= float(status["decided_s"]) < 2.0

    again(lambda: deadline.publish(Float64(0.25)), lambda: holds(0.25), "a deadline of 0.25 s")
    for nonsense in (-1.0, 0.0, 61.0, float("nan"), float("inf"), -float("inf")):
        deadline.publish(Float64(nonsense))
    deadline.publish(Float64(0.5))
    until(lambda: holds(0.5), "a deadline of 0.5 s")
    stamp, at = camera.ask("local=0.01")
    listener.until_answered([stamp])
    assert node.ends() == 0
    check(listener, stamp, at, "local", "F5", deadline=0.5)
    assert {line["deadline"] for line in node.events("offer")} == {2_000_000_000, 250_000_000, 500_000_000}


def a_repeated_stamp_gets_no_stale_value(bench):
    """misuse: two messages have one stamp, or none is set | the second is refused, and `/diagnostics` warns

    Local takes longer than it may. Its result comes when the next message with the same stamp waits for one."""
    node = bench.node(parameters(local={"deadline": 0.3}))
    camera, listener, local = Camera(), Listener(), Model("local")
    ready(camera, listener, local)

    def warns(words):
        health = listener.health("fusion")
        return health.level == WARN and words in health.message

    for stamp, words in ((camera.next_stamp(), "has the same stamp"), (0, "header.stamp is 0")):
        camera.ask("local=0.45", stamp)
        until(lambda: listener.status_of(stamp), "a status of the missed input")
        # In a period of its own, for a missed message is worse.
        again(lambda: camera.ask("local=5", stamp), lambda: warns(words), f"diagnostics with {words!r}")
        until(lambda: stamp in local.sent, "the late result")
        # What local sends now comes after it.
        ready(camera, listener, local)
        assert not listener.of(stamp), "the value of another message"
    assert listener.counted("duplicate_stamp") > listener.counted("stamp_zero") > 0
    assert node.ends() == 0
    assert "not accepted: header.stamp is 0" in node.log(), node.log()


def a_second_input_of_a_stamp_is_not_taken_in(bench):
    node = bench.node(parameters(["west"]))
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    stamp, _ = camera.ask("local=0.1 west=0.4")
    camera.ask("local=0 west=0", stamp)
    listener.until_answered([stamp])
    listener.until_counted("duplicate_stamp", 1)
    assert len(west.asked_for(stamp)) == 1 and len(listener.of(stamp)) == 1
    camera.ask("local=0 west=0", stamp)
    listener.until_counted("duplicate_stamp", 2)
    assert node.ends() == 0
    assert len(listener.of(stamp)) == 1 and len(west.asked_for(stamp)) == 1


def stamps_that_go_back_are_taken_in_as_they_come(bench):
    node = bench.node(parameters(["west"]))
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    stamps = [camera.next_stamp() for _ in range(8)]
    for stamp in reversed(stamps):
        camera.ask("local=0.02 west=0.1", stamp)
    listener.until_answered(stamps)
    listener.until_counted("stamp_backwards", 7)
    # Stamps before 1970 and at the end of their range.
    edges = [-1, 0, 2**31 * 10**9 - 1, -2**31 * 10**9]
    for stamp in edges:
        camera.ask("local=0.02 west=0.1", stamp)
    listener.until_answered(edges)
    assert node.ends() == 0
    for stamp in stamps + edges:
        assert len(listener.of(stamp)) == 1
        assert [status["source"] for status in listener.status_of(stamp)] == ["west"]


def results_of_stamps_that_nobody_asked_about_are_dropped_and_counted(bench):
    node = bench.node(parameters(["west"]))
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    for stamp in range(5):
        west.output.publish(answered("west", stamp))
    local.output.publish(answered("local", 77))
    listener.until_counted("unknown_stamp", 5, part="west")
    listener.until_counted("unknown_stamp", 1, part="local")
    stamp, at = camera.ask("local=0 west=0.05")
    listener.until_answered([stamp])
    assert node.ends() == 0
    check(listener, stamp, at, "west", "F3")
    assert not any(listener.of(unknown) for unknown in (*range(5), 77))


def what_nobody_answers_is_missed_and_said_so(bench):
    node = bench.node(parameters(["west"], deadline=0.2, local={"deadline": 0.5}))
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    stamp, at = camera.ask("")
    until(lambda: listener.status_of(stamp), "a status of the missed input")
    assert time.monotonic() - at >= 0.5, "missed before the deadline of local"
    assert node.ends() == 0
    (status,) = listener.status_of(stamp)
    assert status.level == WARN and status.message == "missed", status
    assert not listener.of(stamp)


def payloads_of_any_length_go_through_as_they_came(bench):
    image = {"type": "sensor_msgs/msg/CompressedImage"}
    node = bench.node(parameters(["west"], input=image, output=image))
    sent = {}

    def answer(source, stamp):
        return CompressedImage(Header(Time.at(stamp), f"answer of {source}"), "png", b"\x5a" * (stamp % 1000))

    def ask(plan, stamp=None):
        stamp = camera.next_stamp() if stamp is None else stamp
        sent[stamp] = CompressedImage(Header(Time.at(stamp), plan), "jpeg", b"\xa5" * (stamp // 1000 % 1000))
        at = time.monotonic()
        camera.output.publish(sent[stamp])
        return stamp, at

    camera, listener = Camera(kind=CompressedImage), Listener(kind=CompressedImage)
    camera.ask = ask
    image = {"kind": CompressedImage, "result": CompressedImage, "answer": answer}
    models = [Model(source, **image) for source in ("local", "west")]
    ready(camera, listener, *models)
    sizes = [*range(9), 63, 64, 65, 100, 511, 512, 513, 999]
    stamps = [camera.next_stamp() // 10**6 * 10**6 + size * 1000 + size for size in sizes]
    for stamp in stamps:
        ask("local=0.02 west=0.1", stamp)
        time.sleep(PERIOD_S)
    listener.until_answered(stamps)
    assert node.ends() == 0
    for stamp in stamps:
        (result,) = listener.of(stamp)
        assert carries(result.message.payload, answer("west", stamp)), f"{stamp % 1000} bytes of data"
        (west,) = models[1].asked_for(stamp)
        assert carries(west, sent[stamp]), f"{stamp % 1000} bytes of data"


def a_cloud_in_fast_dds_is_forwarded_in_both_byte_orders(bench):
    peer = bench.fast_dds()
    node = bench.node(parameters(["west"]))
    camera, listener, local = Camera(), Listener(), Model("local")
    west = FastModel(peer, "west", is_big)
    peer.subscribes("/output", PointStamped)
    peer.publishes("/input", PointStamped)
    peer.until_matched("/output", "/input")
    ready(camera, listener, local, west)
    stamps = []
    for _ in range(20):
        stamps.append(camera.ask("local=0.01 west=0.05")[0])
        time.sleep(PERIOD_S)
    # Inputs in big-endian, from Fast DDS too.
    for _ in range(10):
        stamps.append(camera.next_stamp())
        peer.publish("/input", serialized(asked(stamps[-1], "local=0.01 west=0.05"), big=True))
        time.sleep(PERIOD_S)
    listener.until_answered(stamps)
    assert node.ends() == 0
    for stamp in stamps:
        expected = serialized(answered("west", stamp), big=is_big(stamp))
        assert peer.heard["/output"].count(expected) == 1, "not the bytes that west sent"
        assert [status["source"] for status in listener.status_of(stamp)] == ["west"]
    bigs = sum(is_big(stamp) for stamp in stamps)
    assert 0 < bigs < len(stamps)
    print(f"{len(stamps)} results of Fast DDS, {bigs} of them big-endian, 10 inputs big-endian")


def a_recorded_mcap_has_the_lines_of_the_trace(bench):
    try:
        from mcap.reader import make_reader
    except ImportError:
        raise Skipped("no package mcap") from None
    file = bench.folder / "run.mcap"
    node = bench.node(parameters(["west"], trace={"mcap": str(file)}))
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    stamps = [camera.ask("local=0 west=0.05")[0] for _ in range(8)]
    listener.until_answered(stamps)
    assert node.ends() == 0
    with open(file, "rb") as mcap:
        read = [json.loads(message.data) for _, channel, message in make_reader(mcap, validate_crcs=True).iter_messages(
            log_time_order=False) if channel.topic == "/fuseline/trace"]

    def bare(line):
        return {key: value for key, value in line.items() if key != "x"}

    assert [bare(line) for line in read if "ev" in line] == [bare(line) for line in node.lines()]
    print(f"{len(read)} lines in the MCAP")
