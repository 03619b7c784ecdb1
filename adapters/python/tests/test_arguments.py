"""Tests that a bad argument is refused where it is given, or accepted as it is.

The table is compared with the signatures, so that an argument without a case fails.
"""

from __future__ import annotations

import inspect
from typing import Any

import pytest
from arguments import OPERATOR_CASES, Arguments, started
from arguments_around import CASES_AROUND
from fuseline.deadline import Capped, End
from fuseline.testing import VirtualLoop

CASES = OPERATOR_CASES | CASES_AROUND


async def called(case: Arguments, **of: Any) -> None:
    """Calls it within a loop, because some calls need one."""
    made = case.call(**{**case.good, **of})
    assert not isinstance(made, Capped)


def in_a_loop(case: Arguments, **of: Any) -> None:
    if case.call is started:
        started(**{**case.good, **of})
        return
    loop = VirtualLoop()
    try:
        loop.run_until_complete(called(case, **of))
    finally:
        loop.close()


@pytest.mark.parametrize("name", CASES)
def test_each_argument_has_a_case_or_is_taken_as_it_is(name: str) -> None:
    case = CASES[name]
    names = set(inspect.signature(case.of or case.call).parameters) - {"self"}
    assert names == set(case.bad) | set(case.free.split())
    assert set(case.taken) | set(case.good) <= names


BAD = [
    (name, argument, value, error, words)
    for name, case in CASES.items()
    for argument, values in case.bad.items()
    for value, error, words in values
]


@pytest.mark.parametrize(("name", "argument", "value", "error", "words"), BAD)
def test_a_bad_argument_is_refused_where_it_is_given(
    name: str, argument: str, value: Any, error: type[Exception], words: str
) -> None:
    with pytest.raises(error) as raised:
        in_a_loop(CASES[name], **{argument: value})
    assert words in str(raised.value)


@pytest.mark.parametrize("name", CASES)
def test_what_is_at_the_bounds_is_taken(name: str) -> None:
    case = CASES[name]
    if not name.startswith("report"):
        in_a_loop(case)
    for argument, values in case.taken.items():
        for value in values:
            in_a_loop(case, **{argument: value})


def test_what_ends_a_call_is_one_of_three_words() -> None:
    assert [it.value for it in End] == ["answered", "failed", "censored"]
