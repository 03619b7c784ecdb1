"""The whole machine by the rules, input by input, in the words of the program for the core."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from .finite import State, World

# What is declared of a state, with the definition of it in the state after.
OF_MACHINE = {"clock": "clock-then", "began": "began-then", "newest": "newest-then"}
OF_SOURCE = {"shut": "gate-then"}
OF_TIMESTAMP = {"entry": "entry-then"}
OF_REQUEST = {
    "requested": "requested-then",
    "pending": "pending-then",
    "armed": "armed-then",
    "cached": "cached-then",
    "due": "due-of-then",
}
KINDS = {"open": "an-open", "offer": "an-offer", "result": "a-result", "fail": "a-failure"}


@dataclass(frozen=True)
class Cloud:
    priority: int
    limit: int
    resume: int


class Machine:
    """A machine just made.

    Sources are their priorities, timestamps their numbers, entries those from 0 on.
    """

    def __init__(
        self,
        script: str,
        commit: str,
        window: int,
        clouds: Sequence[Cloud],
        timestamps: Sequence[int],
        strangers: Sequence[int],
    ) -> None:
        self._clouds = sorted(cloud.priority for cloud in clouds)
        self._sources = [0, *sorted({*self._clouds, *strangers})]
        self._timestamps = sorted(timestamps)
        domains = {
            "Source": self._sources,
            "Timestamp": self._timestamps,
            "Entry": range(window),
        }
        self._world = World(script, domains)
        self._world.facts |= {
            "local": {(): 0},
            "priority": {(source,): source for source in self._sources},
            "number": {(timestamp,): timestamp for timestamp in self._timestamps},
            "registered": {(cloud.priority,): True for cloud in clouds},
            "limit": {(cloud.priority,): cloud.limit for cloud in clouds},
            "resume": {(cloud.priority,): cloud.resume for cloud in clouds},
        }
        every = (*OF_MACHINE, *OF_SOURCE, *OF_TIMESTAMP, *OF_REQUEST)
        self._state: State = {name: {} for name in every}
        self._state["newest"] = {(): self._timestamps[0]}
        self._state["commit"] = {(): commit}

    def answer(self, line: str) -> str:
        """What comes of an input, as the program prints it."""
        now, *come = line.split()
        words = []
        self._come(input={(): "a-tick"}, now={(): int(now)})
        self._step()
        # Each firing takes a timer, or it would go on for ever (P7).
        left = sum(self._state["armed"].values())
        while left >= 0 and self._find_firing():
            words.append(self._fired())
            self._step()
            left -= 1
        if not self._world.call("at-rest", self._state):
            words.append("not at rest")
        if come:
            words.append(self._input(come))
            self._step()
        return "; ".join([*words, self._left()])

    def _come(self, **facts: dict[tuple[()], object]) -> None:
        self._world.forget()
        self._world.facts |= {name.replace("_", "-"): value for name, value in facts.items()}

    def _step(self) -> None:
        """Puts the state after in place of the state."""
        call, state = self._world.call, self._state
        after: State = {name: {(): call(then, state)} for name, then in OF_MACHINE.items()}
        after["commit"] = state["commit"]
        for name, then in OF_SOURCE.items():
            after[name] = {(c,): call(then, state, c) for c in self._sources}
        for name, then in OF_TIMESTAMP.items():
            after[name] = {(u,): call(then, state, u) for u in self._timestamps}
        for name, then in OF_REQUEST.items():
            after[name] = {
                (u, c): call(then, state, u, c) for u in self._timestamps for c in self._sources
            }
        self._world.forget()
        self._state = after

    def _find_firing(self) -> bool:
        """Makes the next firing the input, if there is one; no two are next."""
        armed = [key for key, is_armed in self._state["armed"].items() if is_armed]
        candidates = sorted(
            {(timestamp, self._state["due"][timestamp, c]) for timestamp, c in armed}
        )
        firings = []
        for timestamp, due in candidates:
            self._come(input={(): "a-firing"}, t={(): timestamp}, firing={(): due})
            if self._world.call("next-firing", self._state):
                firings.append((timestamp, due))
        if len(firings) > 1:
            raise AssertionError(f"several firings are next: {firings}")
        for timestamp, due in firings:
            self._come(t={(): timestamp}, firing={(): due})
        return bool(firings)

    def _fired(self) -> str:
        facts, call = self._world.facts, self._world.call
        timers = [source for source in self._sources if call("fires", self._state, source)]
        listed = " ".join(map(str, timers))
        early = ", at rest" if call("at-rest", self._state) else ""
        return (
            f"fired {facts['t'][()]} at {facts['firing'][()]} [{listed}] {self._outcome()}{early}"
        )

    def _input(self, words: list[str]) -> str:
        kind, timestamp, *rest = words
        numbers = [int(word) for word in rest]
        self._come(input={(): KINDS[kind]}, t={(): int(timestamp)})
        call, state = self._world.call, self._state
        if kind == "open":
            taken = {entry for (u,), entry in state["entry"].items() if call("is-open", state, u)}
            free = next((entry for entry in self._entries() if entry not in taken), 0)
            self._come(with_deadline={(): bool(numbers)}, d={(): sum(numbers)}, free={(): free})
            why = call("open-refused", state)
            return "accepted" if call("opens", state) else f"refused {why}"
        self._come(p={(): numbers[0]})
        if kind == "offer":
            self._come(d={(): numbers[1]}, backlog={(): numbers[2]})
            why = call("offer-refused", state)
            due = call("due-then", state)
            return f"admitted {due}" if call("admits", state) else f"refused {why}"
        why = call("dropped", state)
        if why != "none":
            return f"dropped {why}"
        if call("holds", state):
            return "held"
        return self._sent(numbers[0]) if call("sends", state) else self._outcome()

    def _entries(self) -> Sequence[int]:
        entries: Sequence[int] = self._world.domains["Entry"]
        return entries

    def _cancelled(self) -> str:
        call, state = self._world.call, self._state
        return " ".join(str(c) for c in self._sources if call("cancels", state, c))

    def _sent(self, source: int) -> str:
        return f"sent {source} [{self._cancelled()}]"

    def _outcome(self) -> str:
        call, state = self._world.call, self._state
        forwarded = [c for c in self._sources if call("forwards", state, c)]
        words = [f"forwarded {c} [{self._cancelled()}]" for c in forwarded]
        words += [f"final {c}" for c in self._sources if call("finals", state, c)]
        words += ["missed"] * call("misses", state) + ["waiting"] * call("waits", state)
        return " and ".join(words)

    def _left(self) -> str:
        state = self._state
        newest = state["newest"][()] if state["began"].get(()) else "none"
        shut = [c for c in self._clouds if state["shut"][c,]]
        words = [" ".join(map(str, ["clock", state["clock"][()], "newest", newest, "shut", *shut]))]
        for u in self._timestamps:
            if self._world.call("is-open", state, u):
                words.append(f"{u} {self._sets(u)}")
        return " | ".join(words)

    def _sets(self, timestamp: int) -> str:
        places = [0, *self._clouds]
        sets = [
            sum(1 << place for place, c in enumerate(places) if self._state[name][timestamp, c])
            for name in ("requested", "pending", "armed", "cached")
        ]
        dues = [
            f"{c}@{self._state['due'][timestamp, c]}"
            for c in places
            if self._state["armed"][timestamp, c]
        ]
        return " ".join([*map(str, sets), *dues])
