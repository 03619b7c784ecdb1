"""Checks that a policy's reply is an action that a robot can execute."""

from __future__ import annotations

import logging
import math
import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeAlias

from fuseline._errors import CallError

_log = logging.getLogger("fuseline")

#: The form of an action: the shape of its numbers, which begins with `bool` if they are bools,
#: the parts of a dictionary, or another type.
Form: TypeAlias = "tuple[int | type[bool], ...] | dict[Any, Form] | type"

#: At most this many characters of a text are repeated in an error.
_SHORT_LEN = 100


def form_of(action: Any, where: str = "the action") -> Form:
    """Returns the form of an action.

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
    """Checks an action before the robot executes it.

    Args:
        action: The remote policy's reply.
        like: The form of an action on board, if it is known.
        where: The name of the action in the error.

    Raises:
        CallError: if its form differs from an action on board, or its numbers are not finite.
    """
    form = form_of(action, where)
    if like is not None:
        _compare(action, form, like, where)
    elif not _has_numbers(form):
        raise CallError(f"{where} has no numbers: {_short_repr(action)}")


class ArrayKinds:
    """Reports a reply that has a list where an action on board has an array, or the reverse.

    Both hold the same numbers, but arithmetic differs: doubling a list makes it longer.
    """

    def __init__(self) -> None:
        self._on_board: dict[Any, str] = {}
        self._is_reported = False

    def learn(self, action: Any) -> None:
        """Remembers which kinds of rows an action on board has."""
        self._on_board = _row_types(action)

    def check(self, action: Any) -> None:
        """Logs the first reply that has another kind of rows than the action on board."""
        if self._is_reported:
            return
        for key, kind in _row_types(action).items():
            own = self._on_board.get(key, kind)
            if own != kind:
                self._is_reported = True
                where = "actions" if key is None else f"actions[{key!r}]"
                _log.warning(
                    "%s of the remote policy are of the type %s, and on board they are of the type "
                    "%s: arithmetic treats them differently, so give both the same type",
                    where,
                    kind,
                    own,
                )


def _row_types(action: Any) -> dict[Any, str]:
    """Returns the type of each row of numbers, by its key in a dictionary, or by None."""
    parts = action if isinstance(action, Mapping) else {None: action}
    return {
        key: type(it).__name__
        for key, it in parts.items()
        if isinstance(it, (list, tuple)) or (hasattr(it, "shape") and hasattr(it, "dtype"))
    }


def _compare(action: Any, form: Form, like: Form, where: str) -> None:
    if isinstance(like, dict):
        if not isinstance(form, dict):
            raise CallError(f"{where} is {_short_repr(action)}; it has {', '.join(map(str, like))}")
        for key, part in like.items():
            if key not in form:
                raise CallError(f"{where} has no {key!r}: {_short_repr(action)}")
            own = action[key] if isinstance(action, Mapping) else getattr(action, key)
            _compare(own, form[key], part, f"{where}[{key!r}]")
    elif form == like:
        return
    elif isinstance(like, tuple) and isinstance(form, tuple) and (bool in form) == (bool in like):
        is_chunk = len(form) == len(like) + 1
        remedy = "; if it is a chunk, give chunk=" if is_chunk else ""
        shapes = f"has the shape {_shape(form)}, and on board it has {_shape(like)}"
        raise CallError(f"{where} {shapes}{remedy}")
    else:
        raise CallError(f"{where} is {_short_repr(action)}, and on board it is {_named(like)}")


def _of_array(array: Any, where: str) -> Form:
    kind = getattr(array.dtype, "kind", "f")
    if kind not in "fiubV":
        raise CallError(f"{where} is an array of {array.dtype}; give numbers")
    if kind not in "iub" and not _are_finite(array):
        raise CallError(f"{where} has numbers that are not finite: {_short_repr(array)}")
    return (bool, *array.shape) if kind == "b" else tuple(array.shape)


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
        raise CallError(f"{where} has parts of different forms: {_short_repr(rows)}")
    first = forms[0]
    if first is bool:
        return (bool, len(forms))
    if not isinstance(first, tuple):
        return list
    return (bool, len(forms), *first[1:]) if bool in first else (len(forms), *first)


def _has_numbers(form: Form) -> bool:
    if isinstance(form, dict):
        return any(map(_has_numbers, form.values()))
    if isinstance(form, tuple):
        return 0 not in form and bool not in form
    # An object of another class may be an action, but a text is not one.
    return not issubclass(form, (str, bytes, bytearray, bool, list))


def _named(like: Form) -> str:
    if isinstance(like, type):
        return like.__name__
    if isinstance(like, dict):
        return f"a dictionary of {', '.join(map(str, like))}"
    return f"{'bools' if bool in like else 'numbers'} of the shape {_shape(like)}"


def _shape(form: tuple[Any, ...]) -> tuple[int, ...]:
    return tuple(it for it in form if it is not bool)


def _short_repr(action: Any) -> str:
    try:
        text = " ".join(repr(action)[: 4 * _SHORT_LEN].split())
    except Exception:
        text = ""
    text = text if len(text) <= _SHORT_LEN else text[: _SHORT_LEN - 1] + "…"
    return f"{type(action).__name__} {text}"
