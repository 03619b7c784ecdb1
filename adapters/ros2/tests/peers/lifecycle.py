"""A managed node, as a lifecycle manager sees it: over DDS by Fast DDS, as `rmw_fastrtps` asks."""

import signal
import threading
import time

from graph import subscribes, until
from messages import (
    ChangeStateRequest,
    ChangeStateResponse,
    GetAvailableStatesRequest,
    GetAvailableStatesResponse,
    GetAvailableTransitionsRequest,
    GetAvailableTransitionsResponse,
    GetStateRequest,
    GetStateResponse,
    Parameter,
    ParameterValue,
    SetParametersRequest,
    SetParametersResponse,
    Transition,
    TransitionEvent,
)
from node import parameters
from roles import Camera, Listener, Model, ready

BY_ID = {"configure": 1, "cleanup": 2, "activate": 3, "deactivate": 4}


class Manager:
    """Tells a node what to do, and hears what it does."""

    def __init__(self, bench, node="fuseline"):
        self.changing = bench.client(f"{node}/change_state", ChangeStateRequest, ChangeStateResponse)
        self.asking = bench.client(f"{node}/get_state", GetStateRequest, GetStateResponse)
        self.listing = bench.client(f"{node}/get_available_states", GetAvailableStatesRequest,
                              GetAvailableStatesResponse)
        self.ways = bench.client(f"{node}/get_available_transitions", GetAvailableTransitionsRequest,
                           GetAvailableTransitionsResponse)
        self.graph = bench.client(f"{node}/get_transition_graph", GetAvailableTransitionsRequest,
                            GetAvailableTransitionsResponse)
        self.setting = bench.client(f"{node}/set_parameters", SetParametersRequest, SetParametersResponse)
        self.events = subscribes(f"/{node}/transition_event", TransitionEvent)
        self.events.until_matched()

    def does(self, label):
        """Requests a transition, by its number or else by its label. Returns whether the node made it."""
        way = Transition(BY_ID[label], "") if label in BY_ID else Transition(0, label)
        return self.changing.call(ChangeStateRequest(way)).success

    def state(self):
        state = self.asking.call(GetStateRequest()).current_state
        return state.id, state.label

    def can(self):
        return [way.transition.label for way in self.ways.call(GetAvailableTransitionsRequest()).available_transitions]

    def reported(self):
        """The transitions that were reported."""
        return [(heard.message.start_state.label, heard.message.transition.label, heard.message.goal_state.label)
                for heard in list(self.events.heard)]


def no_answer(camera, listener, *models):
    """An input that nobody is asked about, and that is not answered."""
    stamp, _ = camera.ask(" ".join(f"{model.source}=0" for model in models))
    time.sleep(1.5)
    assert not listener.of(stamp) and not listener.status_of(stamp), "an input was taken in"
    assert not any(model.asked_for(stamp) for model in models), "a model was asked"


def a_managed_node_takes_inputs_in_only_while_it_is_active(bench):
    node = bench.refused(parameters(["west"], lifecycle=True))
    manager = Manager(bench)
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    assert manager.state() == (1, "unconfigured")
    assert manager.can() == ["configure", "shutdown"]
    assert len(manager.graph.call(GetAvailableTransitionsRequest()).available_transitions) == 25
    states = manager.listing.call(GetAvailableStatesRequest()).available_states
    assert [(state.id, state.label) for state in states][:5] == [
        (0, "unknown"), (1, "unconfigured"), (2, "inactive"), (3, "active"), (4, "finalized")]
    assert not manager.does("activate"), "a node that is not configured was activated"
    assert camera.output.matched() == 0 and not node.trace_file.exists(), "it opened something before its transition"

    assert manager.does("configure") and manager.state() == (2, "inactive")
    assert manager.can() == ["cleanup", "activate", "shutdown"]
    camera.output.until_matched()
    listener.until_matched()
    no_answer(camera, listener, local, west)

    assert manager.does("activate") and manager.state() == (3, "active")
    ready(camera, listener, local, west)
    # What is open when the node is deactivated is answered.
    stamp, _ = camera.ask("local=0.3")
    until(lambda: west.asked_for(stamp), "a request")
    assert manager.does("deactivate") and manager.state() == (2, "inactive")
    listener.until_answered([stamp])
    assert listener.status_of(stamp)[0]["source"] == "local"
    no_answer(camera, listener, local, west)

    # Cleaned up in the midst of a message: that one is answered first.
    assert manager.does("activate")
    ready(camera, listener, local, west)
    stamp, _ = camera.ask("local=0.3")
    until(lambda: west.asked_for(stamp), "a request")
    assert manager.does("deactivate") and manager.does("cleanup") and manager.state() == (1, "unconfigured")
    listener.until_answered([stamp])
    until(lambda: camera.output.matched() == 0, "the input's topic to be left")
    first = bench.judge(node)
    assert first > 0

    assert manager.does("configure") and manager.does("activate")
    ready(camera, listener, local, west)
    assert manager.does("shutdown") and manager.state() == (4, "finalized")
    assert manager.can() == [] and not manager.does("configure")
    until(lambda: len(manager.reported()) == 18, lambda: f"every transition, not only {manager.reported()}")
    assert manager.reported()[:4] == [
        ("unconfigured", "configure", "configuring"), ("configuring", "transition_success", "inactive"),
        ("inactive", "activate", "activating"), ("activating", "transition_success", "active")]
    assert manager.reported()[-2:] == [
        ("active", "shutdown", "shuttingdown"), ("shuttingdown", "transition_success", "finalized")]
    assert node.ends() == 0
    # What was judged first has not been written over.
    assert bench.judge(node) == first
    node.trace_file = node.trace_file.with_name("trace-2.jsonl")
    print(f"{first} timestamps judged, {bench.judge(node)} after the second configuration")


def a_signal_while_a_managed_node_is_cleaned_up_ends_it(bench):
    node = bench.refused(parameters(["west"], lifecycle=True))
    manager = Manager(bench)
    assert manager.does("configure") and manager.does("activate")
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    stamp, _ = camera.ask("local=0.8")
    until(lambda: west.asked_for(stamp), "a request")
    assert manager.does("deactivate")
    threading.Thread(target=manager.does, args=["cleanup"], daemon=True).start()
    until(lambda: "cleaningup" in node.log(), "the beginning")
    node.process.send_signal(signal.SIGINT)
    assert node.until_exit() == 0
    listener.until_answered([stamp])


def a_managed_node_that_cannot_be_configured_says_why_and_may_be_told_again(bench):
    folder = bench.folder / "later"
    node = bench.refused(parameters(["west"], deadline=2.0, lifecycle=True,
                                    trace={"file": str(folder / "trace.jsonl")}))
    node.trace_file = folder / "trace.jsonl"
    manager = Manager(bench)
    assert not manager.does("configure") and manager.state() == (1, "unconfigured")
    assert "cannot be configured" in node.log() and str(node.trace_file) in node.log()
    until(lambda: manager.reported()[-1:] == [("configuring", "transition_failure", "unconfigured")], "a failure")

    # What is set while nothing is open is in force afterwards.
    deadline = Parameter("deadline", ParameterValue.of(0.3))
    assert manager.setting.call(SetParametersRequest([deadline])).results[0].successful
    folder.mkdir()
    assert manager.does("configure") and manager.does("activate")
    camera, listener, local, west = Camera(), Listener(), Model("local"), Model("west")
    ready(camera, listener, local, west)
    stamp, _ = camera.ask("local=0.01")
    listener.until_answered([stamp])
    assert 0.3 <= float(listener.status_of(stamp)[0]["decided_s"]) < 2.0
    assert node.ends() == 0
    print(f"{bench.judge(node)} timestamps judged")
