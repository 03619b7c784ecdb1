"""The wall clock of the node steps while it runs, as NTP or a person sets it; its monotonic clock does not."""

import time

from forwarding import PERIOD_S, check
from graph import is_over_zenoh, until
from messages import OK
from node import parameters
from roles import Camera, Listener, Model, ready

HOUR_S = 3600


def stands_off(listener, node, seconds):
    """Moves the node's clock, and waits until what the node says bears the time."""
    node.wall_clock(seconds)

    def is_told():
        told = listener.diagnostics.heard[-1].message.header.stamp.sec
        return abs(told - time.time() - seconds) < HOUR_S / 2

    until(is_told, f"a stamp {seconds} s off")


def a_wall_clock_that_steps_costs_no_input_and_no_result(bench):
    node = bench.node(parameters(["west"], window=64, west={"in_flight": 64}), wall_clock=True)
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


def a_peer_that_comes_after_the_wall_clock_stepped_back_is_met(bench):
    node = bench.node(parameters(["west"]), wall_clock=True)
    camera, listener, local = Camera(), Listener(), Model("local")
    ready(camera, listener, local)
    stands_off(listener, node, -HOUR_S)
    # A process of its own is a participant of its own.
    bench.model_process("west")
    listener.until_health("west", {OK})
    stamp, at = camera.ask("local=0.02 west=0.1")
    listener.until_answered([stamp])
    assert node.ends() == 0
    check(listener, stamp, at, "west", "F3")
