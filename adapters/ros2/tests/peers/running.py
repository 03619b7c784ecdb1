"""Tests how the node starts and ends, and that several nodes run side by side."""

import signal
import time

from forwarding import check
from graph import again, is_over_zenoh, publishes, quality, subscribes, until
from messages import (
    ERROR,
    OK,
    WARN,
    DescribeParametersRequest,
    DescribeParametersResponse,
    GetParametersRequest,
    GetParametersResponse,
    ListParametersRequest,
    ListParametersResponse,
    Log,
    Parameter,
    ParameterValue,
    ParticipantEntitiesInfo,
    SetParametersRequest,
    SetParametersResponse,
    String,
    answered,
)
from node import POINTS, parameters
from roles import Camera, Listener, Model, ready

if is_over_zenoh():
    import overzenoh


def two_nodes_of_one_domain_do_not_disturb_each_other(bench):
    sides = {}
    for side in ("left", "right"):
        node = bench.node(parameters(["west"], window=64, west={"in_flight": 64}), ["-r", f"__ns:=/{side}"], name=side)

        def answer(source, stamp, side=side):
            return answered(f"{side} {source}", stamp)

        sides[side] = (node, Camera(f"/{side}/input"), Listener(f"/{side}"),
                       Model("local", f"/{side}/local", answer=answer), Model("west", f"/{side}/west", answer=answer))
    for node, *peers in sides.values():
        ready(*peers)
    runs = {side: [] for side in sides}
    # The same stamps on both sides, answered differently.
    start = max(peers[1].stamp for peers in sides.values())
    for peers in sides.values():
        peers[1].stamp = start
    for i in range(20):
        for side, (_, camera, *_) in sides.items():
            late = "local=0.05 west=0.2" if (i % 2 == 0) == (side == "left") else "local=0.05"
            runs[side].append((late, *camera.ask(late)))
        time.sleep(1 / 30)
    for side, (node, _, listener, *_) in sides.items():
        listener.until_answered(stamp for _, stamp, _ in runs[side])
    for side, (node, _, listener, *_) in sides.items():
        assert node.ends() == 0
        for plan, stamp, _ in runs[side]:
            source = "west" if "west" in plan else "local"
            (result,) = listener.of(stamp)
            assert result.message.payload == answered(f"{side} {source}", stamp).serialize()
            (status,) = listener.status_of(stamp)
            assert status["source"] == source
        print(f"{side}: {bench.judge(node)} timestamps judged")


def peers_start_in_any_order(bench):
    orders = ["node camera model", "camera node model", "model node camera", "camera model node", "model camera node",
              "node model camera"]
    for order in orders:
        namespace = "/" + order.replace(" ", "_")
        peers = {}
        for who in order.split():
            if who == "node":
                peers[who] = bench.node(parameters(["west"]), ["-r", f"__ns:={namespace}"], name=namespace[1:])
            elif who == "camera":
                peers[who] = Camera(f"{namespace}/input")
            else:
                peers[who] = (Model("local", f"{namespace}/local"), Model("west", f"{namespace}/west"))
        listener = Listener(namespace)
        for model in peers["model"]:
            model.until_matched()
        ready(peers["camera"], listener, *peers["model"])
        stamp, at = peers["camera"].ask("local=0.02 west=0.1")
        listener.until_answered([stamp])
        check(listener, stamp, at, "west", "F3")
        assert peers["node"].ends() == 0


def a_local_that_comes_later_is_taken_on_when_it_comes(bench):
    node = bench.node(parameters())
    camera, listener = Camera(), Listener()
    camera.output.until_matched()
    listener.until_matched()

    def missed():
        stamp, _ = camera.ask("local=0")
        time.sleep(0.1)
        return listener.status_of(stamp)

    (status,) = until(missed, "a status without local")
    assert (status.level, status.message) == (WARN, "missed"), status
    listener.until_health("local", {WARN, ERROR})
    assert not listener.results.heard
    local = Model("local")
    ready(camera, listener, local)
    stamp, at = camera.ask("local=0.05")
    listener.until_answered([stamp])
    assert node.ends() == 0
    check(listener, stamp, at, "local", "F3")


def a_signal_ends_the_node_after_the_open_messages_are_answered(bench):
    for by in (signal.SIGINT, signal.SIGTERM):
        namespace = f"/{by.name.lower()}"
        node = bench.node(parameters(["west"], deadline=0.8, local={"deadline": 1.2}), ["-r", f"__ns:={namespace}"],
                          name=by.name)
        camera, listener = Camera(f"{namespace}/input"), Listener(namespace)
        local, west = Model("local", f"{namespace}/local"), Model("west", f"{namespace}/west")
        ready(camera, listener, local, west)
        plans = {"local=0.1 west=0.6": "west", "local=0.1": "local", "": None}
        run = {plan: camera.ask(plan)[0] for plan in plans}
        for stamp in run.values():
            until(lambda stamp=stamp: west.asked_for(stamp), "the input with west")
        start = time.monotonic()
        node.process.send_signal(by)
        # Inputs that come after the signal are not taken in.
        late = []
        while node.process.poll() is None and time.monotonic() < start + 10:
            time.sleep(0.1)
            late.append(camera.ask("local=0 west=0")[0])
        took = time.monotonic() - start
        assert node.until_exit() == 0, f"exit {node.code} after {by.name}"
        assert took >= 0.4, f"ended after {took:.1f} s, with messages open"
        for plan, source in plans.items():
            (status,) = until(lambda: listener.status_of(run[plan]), "a status")
            results = [heard.message.payload for heard in listener.of(run[plan])]
            if source:
                assert status["source"] == source and results == [answered(source, run[plan]).serialize()]
            else:
                assert status.message == "missed" and not results
        # The first may have come just before the signal was seen.
        assert not any(listener.status_of(stamp) for stamp in late[1:]), "an input after the signal was answered"
        judged = bench.judge(node)
        print(f"{by.name}: {took:.1f} s, {judged} timestamps judged")


def a_second_signal_ends_the_node_at_once_with_its_trace_whole(bench):
    node = bench.node(parameters(["west"], deadline=8.0, local={"deadline": 9.0}))
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    stamp, _ = camera.ask("")
    until(lambda: west.asked_for(stamp), "the input with west")
    node.process.send_signal(signal.SIGINT)
    start = time.monotonic()
    time.sleep(0.5)
    assert node.process.poll() is None, "the node ended with a message open"
    node.process.send_signal(signal.SIGINT)
    assert node.until_exit() == 130, f"exit {node.code}"
    assert time.monotonic() - start < 5
    assert node.events("open")
    bench.judge(node)


def without_a_key_the_node_refuses_to_start(bench):
    string = {"type": "std_msgs/msg/String"}
    faulty = {
        "input.key": parameters(input=string),
        "output.key": parameters(output=string),
        "input.type": parameters(input={"topic": "input"}),
    }
    for number, (what, settings) in enumerate(faulty.items()):
        node = bench.refused(settings, name=f"refused{number}")
        assert node.until_exit() == 2, f"exit {node.code} without {what}"
        log = node.log().strip()
        assert what in log, f"{what} is not named: {log}"
        assert len(log.splitlines()) == 1, f"more than one line: {log}"
        print(log.replace(str(bench.folder), ""))


def a_secret_that_is_set_and_cannot_be_read_ends_the_start(bench):
    token = bench.folder / "token"
    token.write_bytes(b"a-token\xff")
    for number, (path, what) in enumerate({bench.folder / "missing": "cannot be read", token: "has no token"}.items()):
        grpc = {"url": "http://127.0.0.1:1", "token_file": str(path)}
        node = bench.refused(parameters(["west"], west={"grpc": grpc}), name=f"refused{number}")
        assert node.until_exit() == 2, f"exit {node.code}"
        assert f"the cloud west: {path} {what}" in node.log(), node.log()


def an_earlier_trace_is_kept(bench):
    """misuse: `trace.file` exists already, as after a crash with `respawn` | it is kept; the next file has a number

    Also that of a node that was killed, as a launch file with respawn would start it again."""
    trace = bench.folder / "trace.jsonl"
    mcap = bench.folder / "trace.mcap"
    settings = parameters(trace={"file": str(trace), "mcap": str(mcap)})
    killed = bench.node(settings)
    camera, listener, local = Camera(), Listener(), Model("local")
    ready(camera, listener, local)
    killed.kill()
    bench.nodes.remove(killed)
    earlier = trace.read_bytes(), mcap.read_bytes()
    assert earlier[0]
    node = bench.refused(settings, name="next")
    node.trace_file = bench.folder / "trace-2.jsonl"
    node.until_running()
    assert node.ends() == 0
    assert "an existing recording is kept; this run is recorded in another file" in node.log(), node.log()
    assert (trace.read_bytes(), mcap.read_bytes()) == earlier
    assert (bench.folder / "trace-2.mcap").stat().st_size > 0


def two_nodes_of_one_name_are_reported(bench):
    """misuse: two nodes of one name | both warn in `/diagnostics` and in the log"""
    first, second = (bench.node(parameters(), name=name) for name in ("first", "second"))
    camera, listener = Camera(), Listener()
    Model("local")
    camera.output.until_matched(2)

    def reported():
        for part in ("fusion", "local"):
            status = listener.health(part)
            if not status or status.level == OK or "does a second node have this name" not in status.message:
                return False
        return True

    def asks():
        camera.ask("local=0")

    again(asks, reported, lambda: f"a warning of both, last {listener.health('fusion')}")
    words = "another node also publishes on this topic"
    until(lambda: words in first.log() and words in second.log(), "a line in the log of both")
    # The other one leaves; the first is alone again.
    assert second.ends() == 0
    again(asks, lambda: listener.health("fusion").level == OK, lambda: f"no warning, last {listener.health('fusion')}")
    assert first.ends() == 0


def enforced_security_keeps_the_node_from_starting(bench):
    enforced = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce"}
    node = bench.refused(parameters(), environment=enforced)
    assert node.until_exit() == 2, f"exit {node.code}"
    assert "has no DDS security" in node.log(), node.log()
    assert not node.trace_file.exists()


def names_and_parameters_of_the_command_line_go_before_those_of_files(bench):
    arguments = ["-r", "input:=/camera/points", "-r", "output:=/detections", "-r", "__ns:=/robot", "-r", "__node:=eyes",
                 "-p", "deadline:=0.2", "-p", "eyes:west.deadline:=0.4", "-p", "other:deadline:=9.0"]
    node = bench.node(parameters(["west", "east"], deadline=3.0), arguments)
    camera, listener = Camera("/camera/points"), Listener("/robot", "eyes", output="/detections")
    models = [Model(source, f"/robot/{source}") for source in ("local", "west", "east")]
    ready(camera, listener, *models)
    stamp, at = camera.ask("local=0.02 west=0.3")
    listener.until_answered([stamp])
    check(listener, stamp, at, "local", "F5", deadline=0.2)
    assert node.ends() == 0
    assert {(line["p"], line["deadline"]) for line in node.events("offer")} == {(1, 400_000_000), (2, 200_000_000)}


def parameters_are_read_and_set_by_their_services(bench):
    node = bench.node(parameters(["west"], deadline=2.0))
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    setting = bench.client("fuseline/set_parameters", SetParametersRequest, SetParametersResponse)
    reading = bench.client("fuseline/get_parameters", GetParametersRequest, GetParametersResponse)

    def sets(**values):
        named = [Parameter(name.replace("__", "."), ParameterValue.of(value)) for name, value in values.items()]
        return [(result.successful, result.reason) for result in setting.call(SetParametersRequest(named)).results]

    def reads(*names):
        return reading.call(GetParametersRequest(list(names))).values

    assert [value.double_value for value in reads("deadline", "local.deadline")] == [2.0, 5.0]
    assert sets(deadline=0.3) == [(True, "")]
    assert reads("deadline")[0].double_value == 0.3
    stamp, at = camera.ask("local=0.01")
    listener.until_answered([stamp])
    check(listener, stamp, at, "local", "F5", deadline=0.3)
    assert 0.3 <= float(listener.status_of(stamp)[0]["decided_s"]) < 2.0
    for refused in ({"window": 4}, {"deadline": -1.0}, {"deadline": float("nan")}, {"deadline": True}, {"nonsense": 1}):
        ((successful, reason),) = sets(**refused)
        assert not successful and reason, f"{refused} was not refused with a reason"
        print(refused, "-", reason)
    assert reads("deadline")[0].double_value == 0.3
    assert sets(west__enabled=False) == [(True, "")]
    stamp, at = camera.ask("local=0.01 west=0.05")
    listener.until_answered([stamp])
    check(listener, stamp, at, "local", "F3")
    assert not west.asked_for(stamp), "a cloud that is not enabled was asked"
    assert node.ends() == 0


def parameters_are_listed_and_described_by_their_services(bench):
    node = bench.node(parameters(["west"]))
    listing = bench.client("fuseline/list_parameters", ListParametersRequest, ListParametersResponse)
    describing = bench.client("fuseline/describe_parameters", DescribeParametersRequest, DescribeParametersResponse)

    def lists(*prefixes, depth=0):
        return set(listing.call(ListParametersRequest(list(prefixes), depth)).result.names)

    every = lists()
    assert {"window", "deadline", "west.deadline", "use_sim_time"} <= every
    assert "west.deadline" not in lists(depth=1) and "window" in lists(depth=1)
    assert lists("west") == {name for name in every if name.startswith("west.")}
    named = ["window", "deadline", "commit", "nonsense"]
    window, deadline, commit, nonsense = describing.call(DescribeParametersRequest(named)).descriptors
    (of_window,), (of_deadline,) = window.integer_range, deadline.floating_point_range
    assert (window.type, window.read_only, of_window.from_value, of_window.to_value) == (2, True, 1, 1024), window
    assert (deadline.type, deadline.read_only, of_deadline.to_value) == (3, False, 60), deadline
    assert "deadline of a request" in deadline.description and "more than 0" in deadline.additional_constraints
    assert (commit.type, commit.additional_constraints) == (4, "eager, patient or progressive")
    assert nonsense.type == 0
    assert node.ends() == 0
    print(len(every), "parameters;", deadline.description, "-", deadline.additional_constraints)


def a_node_in_real_time_has_one_urgent_thread_and_its_memory_locked_or_says_what_would_grant_it(bench):
    node = bench.refused(parameters(["west"], realtime=20))
    until(lambda: node.process.poll() is not None or node.trace_file.exists(), "the node's trace, or why there is none")
    if node.process.poll() is not None:
        assert node.until_exit() == 1, f"exit {node.code}"
        assert "realtime: " in node.log() and "realtime:=0 runs without it" in node.log(), node.log()
        bench.nodes.remove(node)
        print("not granted here:", node.log().strip().splitlines()[-1])
        return
    camera, listener, local = Camera(), Listener(), Model("local")
    ready(camera, listener, local)
    assert node.urgent_threads() == [(20, 1)], node.urgent_threads()
    assert node.locked_kib() > 0
    stamp, at = camera.ask("local=0.02")
    listener.until_answered([stamp])
    check(listener, stamp, at, "local", "F3")
    assert node.ends() == 0


def tools_of_ros_find_the_node_and_its_log(bench):
    seen = overzenoh.seen() if is_over_zenoh() else None
    nodes = None if seen else subscribes("ros_discovery_info", ParticipantEntitiesInfo, quality(transient=True))
    logs = subscribes("/rosout", Log, quality(transient=True))
    node = bench.node(parameters(), ["-r", "__ns:=/robot"])

    def listed():
        if seen:
            return [(entity.namespace, entity.node) for entity in seen() if entity.kind == "NN"]
        return [(info.node_namespace, info.node_name) for heard in list(nodes.heard)
                for info in heard.message.node_entities_info_seq]

    until(lambda: ("/robot", "fuseline") in listed(), lambda: f"the node among {listed()}")
    until(lambda: [heard for heard in list(logs.heard) if "fuseline" in heard.message.name], "a line of the node's log")
    camera, listener, local = Camera("/robot/input"), Listener("/robot"), Model("local", "/robot/local")
    ready(camera, listener, local)
    if seen:
        # With its own topics and services at once, and with the others once a peer has said their types.
        ends = {(entity.kind, entity.topic) for entity in seen() if (entity.namespace, entity.node) == ("/robot", "fuseline")}
        assert ends >= {("MS", "/robot/input"), ("MP", "/robot/output"), ("MP", "/robot/local/input"),
                        ("MS", "/robot/local/output"), ("MP", "/diagnostics"), ("MP", "/robot/fuseline/status"),
                        ("SS", "/robot/fuseline/set_parameters")}, ends
    assert node.ends() == 0
    if seen:
        until(lambda: ("/robot", "fuseline") not in listed(), "the node to be gone")
    print(logs.heard[0].message.name, "-", logs.heard[0].message.msg)


def a_string_with_a_key_by_its_place_is_taken(bench):
    # The first integer of a std_msgs/String is its length.
    node = bench.node(parameters(input={"type": "std_msgs/msg/String", "key": "uint32"}, output=POINTS,
                                 local={"deadline": 0.3}))
    camera = publishes("/input", String)
    local = subscribes("/local/input", String)
    status = Listener()
    camera.until_matched()
    local.until_matched()
    status.until_matched()

    def went(text):
        camera.publish(String(text))
        time.sleep(0.05)
        return [heard.message.data for heard in local.heard if heard.message.data == text]

    for text in ("abc", "a longer text", ""):
        until(lambda: went(text), f"{text!r} with local")
        until(lambda: status.status_of(len(text) + 1), f"a status with the key {len(text) + 1}")
    assert node.ends() == 0
