"""The formulas as they stand in the files: S-expressions, obligations, faults."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

# A word, or a list of forms.
Form: TypeAlias = Any

FOLDER = Path(__file__).resolve().parent.parent
RULES = FOLDER / "rules.smt2"
PROMISES = FOLDER / "promises.smt2"
FAULTS = FOLDER / "faults.toml"
SPEC = FOLDER.parent.parent / "SPEC.md"

TOKEN = re.compile(r"[()]|[^\s();]+|;[^\n]*")
IDENTIFIER = re.compile(r"\b[FPA]\d+g?\b")
STATED = re.compile(
    r"^;; (?P<sentence>[^\n]+)\n\(define-fun (?P<name>\S+) \(\) Bool.*?\n"
    r"^;; for instance: (?P<instance>[^\n]+)\n\(define-fun (?P<case>\S+) \(\) Bool",
    re.MULTILINE | re.DOTALL,
)


class Malformed(Exception):
    """A file that is not what its first lines say; the message names it."""


@dataclass(frozen=True)
class Obligation:
    """A sentence, and a formula `(=> GIVEN THEN)` that must hold in every case."""

    name: str
    identifiers: tuple[str, ...]
    sentence: str
    # A case, in words, that must be possible.
    instance: str
    given: Form
    # The members of THEN, if it is an `and`; each is a question by itself.
    then: tuple[Form, ...]


@dataclass(frozen=True)
class Fault:
    """A mistake that is put into the rules."""

    name: str
    breaks: tuple[str, ...]
    find: str
    replace: str

    def put_into(self, rules: str) -> str:
        """The rules with this mistake."""
        if rules.count(self.find) != 1:
            found = rules.count(self.find)
            raise Malformed(f"{FAULTS}: `find` of {self.name} occurs {found} times in {RULES.name}")
        return rules.replace(self.find, self.replace)


def read(text: str) -> list[Form]:
    """All forms of a text, without its comments."""
    open_forms: list[list[Form]] = [[]]
    for found in TOKEN.finditer(text):
        token = found[0]
        if token == "(":
            open_forms.append([])
        elif token == ")" and len(open_forms) > 1:
            form = open_forms.pop()
            open_forms[-1].append(form)
        elif token == ")":
            raise Malformed(f"line {text.count(chr(10), 0, found.start()) + 1}: ) without (")
        elif not token.startswith(";"):
            open_forms[-1].append(token)
    if len(open_forms) > 1:
        raise Malformed("the last ( is never closed")
    return open_forms[0]


def write(form: Form) -> str:
    """The text of a form."""
    return form if isinstance(form, str) else f"({' '.join(map(write, form))})"


def constructors(script: str, sort: str) -> list[str]:
    """All members of a datatype without parameters."""
    [members] = [form[2] for form in read(script) if form[:2] == ["declare-datatype", sort]]
    return [name for [name] in members]


def obligations(promises: str, spec: str) -> list[Obligation]:
    """What is to be shown, in the order of the file."""
    bodies = {form[1]: form[4] for form in read(promises) if form[0] == "define-fun"}
    known = set(re.findall(r"^(?:### (F\d+g?) |\| ([PA]\d+) )", spec, re.MULTILINE))
    known = {identifier for pair in known for identifier in pair if identifier}
    stated = []
    for found in STATED.finditer(promises):
        name, sentence = found["name"], found["sentence"]
        body = bodies[name]
        if body[0] != "=>" or len(body) != 3 or found["case"] != f"{name}.case":
            raise Malformed(f"{PROMISES}: {name} is not (=> GIVEN THEN) with a {name}.case")
        identifiers = tuple(IDENTIFIER.findall(sentence.partition(":")[0]))
        for unknown in set(identifiers) - known:
            raise Malformed(f"{PROMISES}: {name} cites {unknown}, which SPEC.md does not define")
        if not identifiers or not name.startswith(tuple(f"{id.lower()}-" for id in identifiers)):
            raise Malformed(f"{PROMISES}: {name} does not begin with an identifier of its sentence")
        then = tuple(body[2][1:]) if body[2][0] == "and" else (body[2],)
        stated.append(Obligation(name, identifiers, sentence, found["instance"], body[1], then))
    cases = [name for name in bodies if name.endswith(".case")]
    if [f"{one.name}.case" for one in stated] != cases:
        lost = set(cases) - {f"{one.name}.case" for one in stated}
        raise Malformed(f"{PROMISES}: no sentence and case in place of {', '.join(sorted(lost))}")
    return stated


def faults(text: str, stated: list[Obligation]) -> list[Fault]:
    """The faults of the rules; each obligation must be in one."""
    entries = tomllib.loads(text)["fault"]
    listed = [
        Fault(entry["name"], tuple(entry["breaks"]), entry["find"], entry["replace"])
        for entry in entries
    ]
    names = {obligation.name for obligation in stated}
    broken = {name for fault in listed for name in fault.breaks}
    if unknown := broken - names:
        raise Malformed(f"{FAULTS}: no obligation is called {', '.join(sorted(unknown))}")
    if spared := names - broken:
        raise Malformed(f"{FAULTS}: no fault breaks {', '.join(sorted(spared))}")
    return listed
