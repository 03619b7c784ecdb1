"""Message handlers that send less."""

from __future__ import annotations

import pytest
from fuseline.handlers import by_content, every_nth


def send(message: int, timestamp: int) -> tuple[int, float]:
    return message, 0.5


def test_every_third_message_is_sent_and_clouds_take_turns() -> None:
    for turn, expected in [(0, [0, 3, 6]), (2, [2, 5])]:
        handler = every_nth(3, send, turn=turn)
        assert [t for t in range(8) if handler(t, t)] == expected


def test_handlers_nest_and_the_outer_decides_first() -> None:
    handler = by_content(lambda message: message > 2, every_nth(2, send))
    assert [handler(t, t) for t in range(6)] == [None, None, None, None, (4, 0.5), None]


@pytest.mark.parametrize(("n", "turn"), [(0, 0), (3, 3), (3, -1)])
def test_a_turn_that_never_comes_is_refused(n: int, turn: int) -> None:
    with pytest.raises(ValueError, match=r"turn|n must"):
        every_nth(n, send, turn=turn)
