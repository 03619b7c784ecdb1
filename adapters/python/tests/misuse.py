"""The mark of a case of misuse; `docs/safety/make` makes the book's table of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

Case = TypeVar("Case", bound=Callable[..., None])


def misuse(does: str, happens: str) -> Callable[[Case], Case]:
    """A caller who does this, and what happens: it is refused, or reported."""
    assert does and happens
    return lambda case: case
