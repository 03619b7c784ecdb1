"""The step of one timestamp by the rules, in the words in which the program prints the core's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .finite import State, World

SETS = ("requested", "pending", "armed", "cached")
KINDS = {"result": "a-result", "failure": "a-failure", "timers": "a-firing", "offer": "an-offer"}
# The only timestamp, which is open or was.
T = 1
NOW = 1


@dataclass(frozen=True)
class Step:
    """Four sets, as bits, and what comes; `operand` is a source, or the set of timers that fire."""

    commit: str
    sets: tuple[int, int, int, int]
    kind: str = ""
    operand: int = 0

    @property
    def armed(self) -> int:
        """The timers that can fire."""
        return self.sets[2]

    def line(self) -> str:
        """As the program reads it."""
        come = f" {self.kind} {self.operand}" if self.kind else ""
        return f"slot {self.commit} {' '.join(map(str, self.sets))}{come}"


class Rules:
    """The rules for so many sources, local among them."""

    def __init__(self, script: str, sources: int) -> None:
        self._all = range(sources)
        domains = {"Source": self._all, "Timestamp": (T,), "Entry": (0,)}
        self._world = world = World(script, domains)
        world.facts["local"] = {(): 0}
        world.facts["priority"] = {(source,): source for source in self._all}
        world.facts["registered"] = {(source,): source > 0 for source in self._all}
        world.facts["limit"] = {(source,): 1 for source in self._all}
        world.facts["number"] = {(T,): 1}

    def is_state(self, step: Step) -> bool:
        """Whether these sets are a state: all empty, or as the invariant has it."""
        if not any(step.sets):
            return True
        state = self._begin(step)
        local_armed = bool(step.armed & 1)
        # Whether it was opened with a deadline is known by local's timer while local is pending.
        state["timed"] = {(T,): local_armed}
        # Of a timestamp that is not open nothing but the empty sets is a state.
        return self._world.call("is-open", state, T) and self._world.call("valid-sets", state, T)

    def answer(self, step: Step) -> str:
        """The four sets after the step, and the decision, as the program prints them."""
        state = self._begin(step)
        after = [self._set(f"{name}-then", state, T) for name in SETS]
        return f"{' '.join(map(str, after))} {self._decision(step, state)}"

    def _begin(self, step: Step) -> State:
        world = self._world
        world.forget()
        members = [[source for source in self._all if bits >> source & 1] for bits in step.sets]
        state: State = {
            name: {(T, source): True for source in chosen} for name, chosen in zip(SETS, members)
        }
        fired = step.operand if step.kind == "timers" else 0
        state |= {
            "commit": {(): step.commit},
            "clock": {(): NOW},
            "began": {(): True},
            "newest": {(): T},
            "shut": {},
            "due": {(T, source): NOW if fired >> source & 1 else NOW + 1 for source in self._all},
        }
        world.facts |= {
            "input": {(): KINDS.get(step.kind)},
            "t": {(): T},
            "p": {(): step.operand},
            "d": {(): 1},
            "backlog": {},
            "firing": {(): NOW},
        }
        return state

    def _decision(self, step: Step, state: State) -> str:
        call = self._world.call
        if step.kind == "offer":
            why = call("offer-refused", state)
            return "admitted" if call("admits", state) else f"refused {why}"
        if step.kind != "timers" and (why := call("dropped", state)) != "none":
            return f"dropped {why}"
        by = [source for source in self._all if call("forwards", state, source)]
        words = [f"forwarded {source} {self._set('cancels', state)}" for source in by]
        words += [f"sent {step.operand} {self._set('cancels', state)}"] * call("sends", state)
        words += [f"final {source}" for source in self._all if call("finals", state, source)]
        words += ["held"] * call("holds", state) + ["missed"] * call("misses", state)
        words += ["waiting"] * call("waits", state)
        return " and ".join(words)

    def _set(self, definition: str, *about: Any) -> int:
        """The sources of which this holds, as bits."""
        call = self._world.call
        return sum(1 << source for source in self._all if call(definition, *about, source))
