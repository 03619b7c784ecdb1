"""The formulas in a small world: a few timestamps, sources and entries, listed one by one.

A case that is found there is a case: nothing says how many there are. So models are looked for
here, where solvers are sure and quick, and contradictions never.
"""

from __future__ import annotations

from itertools import product

from .text import Form, read, write

# The input's timestamp, the newest and one more; local and three others; a window of two.
SIZES = {"Timestamp": 3, "Source": 4, "Entry": 2}


def members(sort: str) -> list[str]:
    """The names of all members of a sort."""
    return [f"{sort}-{index}" for index in range(SIZES[sort])]


def shrink(script: str) -> str:
    """The same script, with nothing but these members."""
    return "\n".join(write(_spell_out(_enumerate(form), {})) for form in read(script))


def _enumerate(form: Form) -> Form:
    if form[0] == "declare-sort" and form[1] in SIZES:
        return ["declare-datatype", form[1], [[member] for member in members(form[1])]]
    return form


def _spell_out(form: Form, bound: dict[str, str]) -> Form:
    if isinstance(form, str):
        return bound.get(form, form)
    if form and form[0] in ("forall", "exists"):
        _, variables, body = form
        parts = [
            _spell_out(body, bound | dict(zip((name for name, _ in variables), chosen)))
            for chosen in product(*(members(sort) for _, sort in variables))
        ]
        return ["and" if form[0] == "forall" else "or", *parts]
    if form and form[0] == "define-fun":
        return [*form[:4], _spell_out(form[4], {})]
    return [_spell_out(part, bound) for part in form]
