"""Copies messages, so that a reused buffer does not change a waiting message."""

from __future__ import annotations

import copy
from array import array
from collections import deque
from dataclasses import fields, is_dataclass
from types import SimpleNamespace
from typing import Any

#: The types with immutable values.
UNCHANGEABLE = frozenset({int, float, bool, complex, str, bytes, range, type(None)})


def snapshot(message: Any) -> Any:
    """Copies a message as far as it consists of plain data.

    Plain data are arrays, Python's containers, dataclasses, and their contents. The copy shares
    every other object.
    """
    return message if type(message) in UNCHANGEABLE else _copied(message, {})


def _copied(value: Any, known: dict[int, Any]) -> Any:
    kind = type(value)
    if kind in UNCHANGEABLE:
        return value
    if id(value) in known:
        return known[id(value)]
    if kind is list and set(map(type, value)) <= UNCHANGEABLE:
        known[id(value)] = same = value.copy()
        return same
    if kind is dict:
        made: dict[Any, Any] = {}
        known[id(value)] = made
        made.update((key, _copied(it, known)) for key, it in value.items())
        return made
    if kind is list or kind is deque:
        values: list[Any] | deque[Any] = [] if kind is list else deque(maxlen=value.maxlen)
        known[id(value)] = values
        values.extend(_copied(it, known) for it in value)
        return values
    if kind is tuple:
        parts = [_copied(it, known) for it in value]
        is_same = all(a is b for a, b in zip(parts, value, strict=True))
        return value if is_same else tuple(parts)
    if kind is set or kind is bytearray or kind is array:
        return copy.copy(value)
    if kind is memoryview:
        return _of_view(value)
    if kind is SimpleNamespace or (is_dataclass(value) and not isinstance(value, type)):
        return _of_object(value, known)
    # NumPy, PyTorch and similar libraries have such arrays.
    if hasattr(kind, "__dlpack__"):
        return _of_array(value)
    return value


def _of_object(value: Any, known: dict[int, Any]) -> Any:
    try:
        known[id(value)] = made = copy.copy(value)
        names = [it.name for it in fields(value)] if is_dataclass(value) else list(vars(value))
        for name in names:
            if hasattr(value, name):
                object.__setattr__(made, name, _copied(getattr(value, name), known))
    except Exception:
        # An object that cannot be copied is shared like any other object.
        known[id(value)] = value
        return value
    return made


def _of_array(value: Any) -> Any:
    try:
        return copy.deepcopy(value)
    except Exception:
        return value


def _of_view(view: memoryview) -> memoryview:
    copied = memoryview(view.tobytes())
    try:
        return (
            copied
            if (view.format, view.ndim) == ("B", 1)
            else copied.cast("B").cast(
                view.format,
                view.shape,  # type: ignore[call-overload]
            )
        )
    except (TypeError, ValueError):
        return view
