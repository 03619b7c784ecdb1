"""Misuses a node that runs. It reports each misuse, or goes on; `docs/safety/make` lists the tests that say so."""

import signal
import time

from forwarding import check
from graph import again, is_over_zenoh, publishes, until
from messages import OK, WARN, Clock, Time
from node import parameters
from roles import Camera, Listener, Model, ready


def a_node_that_was_stopped_goes_on(bench):
    """misuse: the process is stopped and continued (Ctrl-Z, a debugger, a frozen container) | it is logged, and the node goes on"""
    node = bench.node(parameters(["west"], deadline=0.2))
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    for stopped in (1, 2):
        node.process.send_signal(signal.SIGSTOP)
        time.sleep(0.2)
        node.process.send_signal(signal.SIGCONT)
        if not is_over_zenoh():
            until(lambda stopped=stopped: node.log().count("joined the domain again") == stopped, "another participant")
        # Peers have the former participant too, until its lease ends.
        run = []
        again(lambda run=run: run.append(camera.ask("local=0.02 west=0.05")),
              lambda run=run: any(listener.of(stamp) for stamp, _ in run), "an output again")
        stamp, at = camera.ask("local=0.02 west=0.05")
        listener.until_answered([stamp])
        check(listener, stamp, at, "west", "F3", deadline=0.2)
    assert is_over_zenoh() or node.log().count("the process was stopped and continued") == 2, node.log()
    assert node.ends() == 0


def a_trace_that_is_removed_is_reported(bench):
    """misuse: the trace is removed while it is written | ERROR in `/diagnostics`, and exit code 1 at the end"""
    node = bench.node(parameters())
    camera, listener, local = Camera(), Listener(), Model("local")
    ready(camera, listener, local)
    node.trace_file.unlink()
    words = "trace.jsonl was removed while it was written"
    again(lambda: camera.ask("local=0"), lambda: words in listener.health("fusion").message, "a word of the removed trace")
    assert node.ends() == 1
    bench.nodes.remove(node)


def a_terminal_that_closes_ends_the_node(bench):
    """misuse: the terminal closes (SIGHUP) | open messages are answered and the trace is ended; after `nohup` the node goes on"""
    node = bench.node(parameters())
    camera, listener, local = Camera(), Listener(), Model("local")
    ready(camera, listener, local)
    stamp, at = camera.ask("local=0.3")
    until(lambda: local.asked_for(stamp), "the input with local")
    assert node.ends(signal.SIGHUP) == 0
    check(listener, stamp, at, "local", "F3")
    usual = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    node = bench.node(parameters(), name="nohup")
    signal.signal(signal.SIGHUP, usual)
    node.process.send_signal(signal.SIGHUP)
    ready(camera, listener, local)
    assert node.ends() == 0


def a_camera_that_never_appears_is_reported(bench):
    """misuse: the camera has another topic, or none | WARN in `/diagnostics` after 10 s, or after `input.silence`"""
    node = bench.node(parameters(input={"type": "geometry_msgs/msg/PointStamped", "silence": 1.0}))
    listener = Listener()
    publishes("/inptu", Clock)
    status = listener.until_health("fusion", {WARN})
    assert "no message yet on /input for 1." in status.message and "publishers: 0" in status.message, status
    camera, local = Camera(), Model("local")
    ready(camera, listener, local)
    again(lambda: camera.ask("local=0"), lambda: listener.health("fusion").level == OK, "a node without a warning")
    assert node.ends() == 0


def simulated_time_stamps_the_diagnostics(bench):
    """misuse: `use_sim_time` with a clock that starts late and goes back | stamps are 0 until it comes, and follow it"""
    node = bench.node(parameters(use_sim_time=True))
    camera, listener, local, clock = Camera(), Listener(), Model("local"), publishes("/clock", Clock)
    ready(camera, listener, local)

    def stands(sec):
        return listener.diagnostics.heard and listener.diagnostics.heard[-1].message.header.stamp.sec == sec

    until(lambda: stands(0), "a stamp of 0")
    for sec in (100, 50):
        again(lambda sec=sec: clock.publish(Clock(Time(sec, 0))), lambda sec=sec: stands(sec), f"a stamp of {sec} s")
    assert node.ends() == 0
