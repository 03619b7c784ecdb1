"""Draws a trace with matplotlib, which is optional."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

try:
    import matplotlib.pyplot as plt
except ImportError as error:
    raise ImportError("timeline() needs matplotlib: pip install fuseline[plot]") from error

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Colours that colour-blind people can distinguish (Okabe and Ito). The first is local's, and the
#: others are the clouds'.
COLOURS = ("#E69F00", "#0072B2", "#009E73", "#CC79A7", "#56B4E9", "#F0E442", "#D55E00")
NOTHING = "#B2182B"

#: Points: the seconds since the start, and the response time in milliseconds.
Points: TypeAlias = Sequence[tuple[float, float]]


def draw(
    ax: Axes | None,
    title: str,
    went: Sequence[tuple[str, int | None, Points]],
    waits: Points,
    missed: Sequence[float],
) -> Axes:
    """Draws a point for each message, and a line for each cloud that was awaited in vain.

    Args:
        ax: The axes to draw on, or None for a new figure.
        title: The title of the drawing.
        went: A source's name, its place among the sources if it has one, and its messages.
        waits: The points at which a cloud was awaited in vain.
        missed: The instants of the messages without a result.
    """
    if ax is None:
        _, ax = plt.subplots(figsize=(10, 4), layout="constrained")
    if waits:
        x, y = zip(*waits, strict=True)
        label = f"waited for in vain ({len(waits):,})"
        ax.vlines(x, 0, y, color="#999999", lw=0.8, alpha=0.5, label=label, zorder=1)
    for name, place, points in went:
        x, y = zip(*points, strict=True)
        colour = NOTHING if place is None else COLOURS[place % len(COLOURS)]
        ax.scatter(x, y, s=14, color=colour, label=f"{name} ({len(x):,})", zorder=2, linewidths=0)
    if missed:
        style: dict[str, Any] = {"color": NOTHING, "marker": "x", "s": 30, "zorder": 3}
        ax.scatter(missed, [0.0] * len(missed), label=f"nothing ({len(missed):,})", **style)
    ax.set(xlabel="message taken in, s", ylabel="until its output, ms", ylim=(0, None))
    ax.set_title(title, loc="left")
    ax.spines[["top", "right"]].set_visible(False)
    if ax.get_legend_handles_labels()[1]:
        ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    return ax
