"""The way to the cloud over Zenoh: routers that die, links with limits, strangers; and a robot over DDS."""

import json
import os
import signal
import time
from pathlib import Path

from bench import Skipped
from certificates import Ca
from faults import Stream, firewall
from forwarding import check
from graph import is_over_zenoh, until
from messages import ERROR, OK, WARN
from node import parameters
from roles import Camera, Listener, Model, ready

AS_CLIENT = 'mode="client"'
THROUGH_LINK = f'{AS_CLIENT};connect/endpoints=["tcp/127.0.0.1:7448"]'
LOSES_ON_LINK = """
add table inet loss
add chain inet loss arrives { type filter hook input priority 0; }
add rule inet loss arrives tcp dport 7448 numgen random mod 100 < 5 drop
add rule inet loss arrives tcp sport 7448 numgen random mod 100 < 5 drop
"""


def over_zenoh_alone():
    if not is_over_zenoh():
        raise Skipped("over Zenoh alone")


def sources(listener, count=20):
    """Returns the sources of the last results."""
    return [heard.message["source"] for heard in list(listener.status.heard)[-count:]]


def _answered_once(bench, node, listener, run):
    """Each input of a run has its one answer, and the trace conforms."""
    listener.until_answered(stamp for stamp, _ in run)
    assert node.ends() == 0
    assert all(len(listener.of(stamp)) == 1 == len(listener.status_of(stamp)) for stamp, _ in run)
    return bench.judge(node)


def a_router_that_is_killed_and_started_again_costs_no_input_its_one_answer(bench):
    over_zenoh_alone()
    node = bench.node(parameters(["west"], deadline=0.3, window=64, west={"in_flight": 64}))
    camera, listener, local = Camera(), Listener(), Model("local")
    # On board they are peers, and need the router only to meet; the cloud has nobody else.
    bench.model_process("west", environment={"ZENOH_CONFIG_OVERRIDE": AS_CLIENT})
    listener.until_health("west", {OK})
    ready(camera, listener, local)
    stream = Stream(camera, "local=0.02 west=0.05")
    until(lambda: sources(listener) == ["west"] * 20, "west's results")
    os.kill(bench.router.pid, signal.SIGKILL)
    until(lambda: sources(listener) == ["local"] * 20, "local's results")
    listener.until_health("west", {WARN, ERROR})
    bench.starts_router()
    back = time.monotonic()
    until(lambda: sources(listener) == ["west"] * 20, "west's results again", cap=30)
    took = time.monotonic() - back
    listener.until_health("west", {OK})
    stream.end()
    judged = _answered_once(bench, node, listener, stream.run)
    print(f"{len(stream.run)} inputs, {judged} judged; west was heard again {took:.1f} s after the router")


def a_router_may_be_started_last(bench):
    over_zenoh_alone()
    bench.router.kill()
    bench.router.wait()
    node = bench.node(parameters(["west"]))
    until(lambda: "neither a router nor a peer" in node.log(), "a line of the log")
    bench.starts_router()
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    stamp, at = camera.ask("local=0.02 west=0.1")
    listener.until_answered([stamp])
    assert node.ends() == 0
    check(listener, stamp, at, "west", "F3")


def ends_of_lyrical_that_say_where_bytes_may_be_are_met(bench):
    over_zenoh_alone()
    import overzenoh
    overzenoh.as_in_lyrical()
    node = bench.node(parameters(["west"]))
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    assert all(token.endswith("/backends:cpu:") for token in camera.output.peers.there), camera.output.peers.there
    stamp, at = camera.ask("local=0.02 west=0.1")
    listener.until_answered([stamp])
    assert node.ends() == 0
    check(listener, stamp, at, "west", "F3")


def a_slow_link_that_loses_and_goes_dark_costs_no_input_its_one_answer(bench):
    over_zenoh_alone()
    node = bench.node(parameters(["west"], deadline=0.3, window=64, west={"in_flight": 64}))
    camera, listener, local = Camera(), Listener(), Model("local")
    link = bench.starts("link.py", "1e6")
    bench.model_process("west", environment={"ZENOH_CONFIG_OVERRIDE": THROUGH_LINK})
    listener.until_health("west", {OK})
    ready(camera, listener, local)
    firewall(LOSES_ON_LINK)
    stream = Stream(camera, "local=0.02 west=0.05")
    until(lambda: sources(listener).count("west") > 10, "west's results over a link that loses")
    for _ in range(2):
        link.send_signal(signal.SIGUSR1)
        until(lambda: sources(listener) == ["local"] * 20, "local's results")
        until(lambda: sources(listener).count("west") > 10, "west's results again", cap=30)
    firewall("delete table inet loss")
    until(lambda: sources(listener) == ["west"] * 20, "west's results", cap=30)
    stream.end()
    judged = _answered_once(bench, node, listener, stream.run)
    by_west = sum(heard.message["source"] == "west" for heard in listener.status.heard)
    print(f"{len(stream.run)} inputs, {judged} judged, {by_west} answered by west")


def a_robot_over_dds_has_a_cloud_over_zenoh(bench):
    if is_over_zenoh():
        raise Skipped("on board over DDS")
    router = bench.starts_router()
    node = bench.node(parameters(["west"], deadline=0.3, window=64, west={"in_flight": 64, "middleware": "zenoh"}))
    camera, listener, local = Camera(), Listener(), Model("local")
    bench.model_process("west", environment={"MIDDLEWARE": "zenoh"})
    listener.until_health("west", {OK})
    ready(camera, listener, local)
    stream = Stream(camera, "local=0.02 west=0.05")
    until(lambda: sources(listener) == ["west"] * 20, "west's results")
    bench.others[-1].kill()
    until(lambda: sources(listener) == ["local"] * 20, "local's results")
    bench.model_process("west", environment={"MIDDLEWARE": "zenoh"})
    until(lambda: sources(listener) == ["west"] * 20, "west's results again", cap=30)
    stream.end()
    judged = _answered_once(bench, node, listener, stream.run)
    assert router.poll() is None
    print(f"{len(stream.run)} inputs, {judged} judged")


def _certificates(bench):
    """Makes certificates for the router and its clients. Returns a function that gives a file's path in JSON."""
    ca = Ca(bench.folder)
    for who in ("router", "robot", "west", "other"):
        ca.signs(who, "localhost")
    return lambda name: json.dumps(str(bench.folder / name))


def who_has_no_certificate_is_not_let_in(bench):
    over_zenoh_alone()
    file = _certificates(bench)
    tls = "transport/link/tls/"
    bench.starts_router('listen/endpoints=["tcp/127.0.0.1:7449", "tls/localhost:7450"]',
                        f"{tls}root_ca_certificate={file('ca.pem')}", f"{tls}listen_certificate={file('router.pem')}",
                        f"{tls}listen_private_key={file('router.key')}", f"{tls}enable_mtls=true")
    plain = f'{AS_CLIENT};connect/endpoints=["tcp/localhost:7449"]'
    known = f'{AS_CLIENT};connect/endpoints=["tls/localhost:7450"];{tls}root_ca_certificate={file("ca.pem")}'
    with_ours = (f"{known};{tls}enable_mtls=true;{tls}connect_certificate={file('robot.pem')};"
                 f"{tls}connect_private_key={file('robot.key')}")
    stranger = bench.refused(parameters(["west"]), name="stranger", environment={"ZENOH_CONFIG_OVERRIDE": known})
    assert stranger.until_exit() == 1 and "Zenoh" in stranger.log(), stranger.log()
    bench.nodes.remove(stranger)
    node = bench.node(parameters(["west"]), environment={"ZENOH_CONFIG_OVERRIDE": with_ours})
    os.environ["ZENOH_CONFIG_OVERRIDE"] = plain
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    stamp, at = camera.ask("local=0.02 west=0.1")
    listener.until_answered([stamp])
    assert node.ends() == 0
    check(listener, stamp, at, "west", "F3")
    print(stranger.log().strip().splitlines()[-1][:160])


def _with_certificate(file, who):
    """Returns the environment of a process that gets a certificate."""
    tls = "transport/link/tls/"
    parts = {"connect/endpoints": '["tls/localhost:7447"]', f"{tls}root_ca_certificate": file("ca.pem"),
             f"{tls}connect_certificate": file(f"{who}.pem"), f"{tls}connect_private_key": file(f"{who}.key"),
             f"{tls}enable_mtls": "true", "mode": '"client"'}
    return ";".join(f"{key}={value}" for key, value in parts.items())


def the_access_control_of_the_book_lets_in_whom_it_names(bench):
    over_zenoh_alone()
    bench.router.kill()
    bench.router.wait()
    file = _certificates(bench)
    chapter = (Path(__file__).parents[4] / "docs/book/src/use/ros2.md").read_text()
    config = chapter.partition("```json5\n")[2].partition("```")[0]
    domain = os.environ["ROS_DOMAIN_ID"]
    for written, meant in {"0/camera/image_raw/": "0/input/", "0/detections/": "0/output/", '"0/': f'"{domain}/',
                           "@ros2_lv/0/": f"@ros2_lv/{domain}/", '"ca.pem"': file("ca.pem"),
                           '"router.pem"': file("router.pem"), '"router.key"': file("router.key")}.items():
        assert written in config, f"the chapter has no {written}"
        config = config.replace(written, meant)
    (bench.folder / "router.json5").write_text(config)
    bench.starts_router(str(bench.folder / "router.json5"))
    os.environ["ZENOH_CONFIG_OVERRIDE"] = _with_certificate(file, "robot")
    node = bench.node(parameters(["west"], deadline=0.3))
    camera, listener, local = Camera(), Listener(), Model("local")
    bench.model_process("west", environment={"ZENOH_CONFIG_OVERRIDE": _with_certificate(file, "west")})
    listener.until_health("west", {OK})
    ready(camera, listener, local)
    stamp, at = camera.ask("local=0.02 west=0.1")
    listener.until_answered([stamp])
    check(listener, stamp, at, "west", "F3", deadline=0.3)
    # A certificate of the same CA that the rules do not name: it hears nothing and nobody hears it.
    other = {"ZENOH_CONFIG_OVERRIDE": _with_certificate(file, "other")}
    bench.model_process("local", environment=other)
    time.sleep(1)
    stamp, at = camera.ask("local=0.02")
    listener.until_answered([stamp])
    assert len(local.asked_for(stamp)) == 1
    assert listener.health("local").level == OK and "matched /local/output" in str(listener.health("local"))
    assert [pair.value for pair in listener.health("local").values if pair.key == "matched /local/output"] == ["1"]
    assert node.ends() == 0


def a_configuration_that_cannot_be_read_ends_the_start(bench):
    over_zenoh_alone()
    for name, value in {"ZENOH_SESSION_CONFIG_URI": "/nowhere.json5", "ZENOH_CONFIG_OVERRIDE": "mode"}.items():
        node = bench.refused(parameters(), name=name, environment={name: value})
        assert node.until_exit() == 2, f"exit {node.code}"
        assert name in node.log() and not node.trace_file.exists(), node.log()
        print(node.log().strip())
