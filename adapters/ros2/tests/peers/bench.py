"""The bench of a test: it starts the processes, ends them, and has every trace judged."""

import json
import os
import subprocess
import sys
from pathlib import Path

from fastdds import Client, FastDds
from graph import is_over_zenoh
from node import Node


NEEDS_ZENOH = "needs a build with --features zenoh"


class Skipped(Exception):
    """The test cannot run here, and why."""


class Bench:
    def __init__(self, folder, programs):
        self.folder, self.programs = Path(folder), programs
        self.nodes, self.others, self.peer = [], [], None
        if is_over_zenoh():
            self.router = self.starts_router()

    def node(self, settings, arguments=(), name="fuseline", wall_clock=False, environment=None):
        """A node that runs; its wall clock can be moved if `wall_clock` says so."""
        if wall_clock and not self.programs["clock"]:
            raise Skipped("no clock that can be moved")
        clock = self.programs["clock"] if wall_clock else None
        node = self.refused(settings, arguments, name, clock, environment)
        node.until_running()
        if node.process.poll() is not None and NEEDS_ZENOH in node.log():
            raise Skipped("the node was built without Zenoh")
        assert node.process.poll() is None, f"the node ended: {node.log()}"
        return node

    def refused(self, settings, arguments=(), name="fuseline", wall_clock=None, environment=None):
        """A node that may end by itself."""
        node = Node(self.programs["node"], self.folder, settings, arguments, name, wall_clock, environment or {})
        self.nodes.append(node)
        return node

    def starts_router(self, *changes):
        """The router of Zenoh through which all meet."""
        return self.starts("router.py", *changes)

    def starts(self, script, *arguments, environment=None):
        """A script as a process of its own, once it says that it is ready."""
        command = [sys.executable, str(Path(__file__).parent / script), *arguments]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ | (environment or {}))
        self.others.append(process)
        assert process.stdout.readline() == "ready\n"
        return process

    def client(self, service, request, response, is_new=False):
        """A client of one of the node's services, whose name has no slash before it; a participant of its own if it is new."""
        if is_over_zenoh():
            import overzenoh
            return overzenoh.Client(service, request, response)
        if is_new or not self.peer:
            self.peer = self.fast_dds()
        return Client(self.peer, service, request, response)

    def model_process(self, source, *arguments, environment=None):
        """A model that can be killed."""
        return self.starts("model.py", source, *arguments, environment=environment)

    def fast_dds(self):
        if is_over_zenoh():
            raise Skipped("Fast DDS does not speak Zenoh")
        if not self.programs["fastdds"]:
            raise Skipped("no Fast DDS")
        peer = FastDds(self.programs["fastdds"])
        self.others.append(peer.process)
        return peer

    def judge(self, node):
        """The node's trace conforms; returns how many timestamps were judged."""
        command = [self.programs["fuseline"], "check", "--json", str(node.trace_file)]
        verdict = subprocess.run(command, capture_output=True, text=True)
        assert verdict.returncode == 0, f"the trace does not conform: {verdict.stdout}{verdict.stderr}"
        return json.loads(verdict.stdout)["judged"]

    def finish(self):
        """Ends what still runs; each node ends well and each trace conforms."""
        for node in self.nodes:
            code = node.ends()
            assert code in (0, 2, 130), f"the node ended with {code}"
            # Without a message there is nothing to judge.
            if code != 2 and node.events("open"):
                self.judge(node)
            assert "panicked" not in node.log(), "the node panicked"

    def kill(self):
        """Leaves no process behind."""
        for node in self.nodes:
            node.kill()
        for process in self.others:
            if process.poll() is None:
                process.kill()
                process.wait()
