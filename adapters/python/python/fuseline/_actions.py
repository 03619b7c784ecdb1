"""Whether what a policy replied is an action that a robot can be given."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeAlias

from fuseline._errors import CallError

#: What an action is made of: the shape of its numbers, the parts of a dictionary, or another type.
Form: TypeAlias = "tuple[int, ...] | dict[Any, Form] | type"

#: How much of a text is repeated in an error.
_SAID_LEN = 100


def form_of(action: Any, where: str = "the action") -> Form:
    """Returns what an action is made of.

    Raises:
        CallError: if one of its numbers is not finite, its rows differ in length, or it is None.
    """
    if action is None:
        raise CallError(f"{where} is None; add the return")
    if isinstance(action, Mapping):
        return {
            key: form_of(it, f"{where}[{key!r}]") for key, it in action.items() if it is not None
        }
    if is_dataclass(action) and not isinstance(action, type):
        parts = {it.name: getattr(action, it.name) for it in fields(action)}
        return {
            name: form_of(it, f"{where}.{name}") for name, it in parts.items() if it is not None
        }
    if hasattr(action, "shape") and hasattr(action, "dtype"):
        return _of_array(action, where)
    if isinstance(action, (list, tuple)):
        return _of_rows(action, where)
    if isinstance(action, bool) or not isinstance(action, (int, float)):
        return type(action)
    if isinstance(action, float) and not math.isfinite(action):
        raise CallError(f"{where} is {action}, which is not finite")
    return ()


def check_form(action: Any, like: Form | None, where: str = "the action") -> None:
    """Checks an action before anything moves by it.

    Args:
        action: What the remote policy replied.
        like: What an action on board is made of, if that is known.
        where: What it is in the error.

    Raises:
        CallError: if it has other numbers than an action on board, or no finite ones.
    """
    form = form_of(action, where)
    if like is not None:
        _compare(action, form, like, where)
    elif not _has_numbers(form):
        raise CallError(f"{where} has no numbers: {_said(action)}")


def _compare(action: Any, form: Form, like: Form, where: str) -> None:
    if isinstance(like, dict):
        if not isinstance(form, dict):
            raise CallError(f"{where} is {_said(action)}; it has {', '.join(map(str, like))}")
        for key, part in like.items():
            if key not in form:
                raise CallError(f"{where} has no {key!r}: {_said(action)}")
            own = action[key] if isinstance(action, Mapping) else getattr(action, key)
            _compare(own, form[key], part, f"{where}[{key!r}]")
    elif form == like:
        return
    elif isinstance(like, tuple) and isinstance(form, tuple):
        is_chunk = len(form) == len(like) + 1
        remedy = "; if it is a chunk, give chunk=" if is_chunk else ""
        raise CallError(f"{where} has the shape {form}, and on board it has {like}{remedy}")
    else:
        raise CallError(f"{where} is {_said(action)}, and on board it is {_named(like)}")


def _of_array(array: Any, where: str) -> Form:
    kind = getattr(array.dtype, "kind", "f")
    if kind not in "fiubV":
        raise CallError(f"{where} is an array of {array.dtype}; give numbers")
    if kind not in "iub" and not _are_finite(array):
        raise CallError(f"{where} has numbers that are not finite: {_said(array)}")
    return tuple(array.shape)


def _are_finite(array: Any) -> bool:
    if hasattr(array, "isfinite"):
        return bool(array.isfinite().all())
    if (numpy := sys.modules.get("numpy")) is not None:
        return bool(numpy.isfinite(array).all())
    return bool((array - array == 0).all())


def _of_rows(rows: Any, where: str) -> Form:
    forms = [form_of(it, f"{where}[{number}]") for number, it in enumerate(rows)]
    if not forms:
        return (0,)
    if any(form != forms[0] for form in forms):
        raise CallError(f"{where} has parts that differ: {_said(rows)}")
    first = forms[0]
    return (len(forms), *first) if isinstance(first, tuple) else list


def _has_numbers(form: Form) -> bool:
    if isinstance(form, dict):
        return any(map(_has_numbers, form.values()))
    if isinstance(form, tuple):
        return 0 not in form
    # An object of another class may be an action; a text is none.
    return not issubclass(form, (str, bytes, bytearray, bool, list))


def _named(like: Form) -> str:
    return like.__name__ if isinstance(like, type) else f"numbers of the shape {like}"


def _said(action: Any) -> str:
    try:
        text = " ".join(repr(action)[: 4 * _SAID_LEN].split())
    except Exception:
        text = ""
    text = text if len(text) <= _SAID_LEN else text[: _SAID_LEN - 1] + "…"
    return f"{type(action).__name__} {text}"
