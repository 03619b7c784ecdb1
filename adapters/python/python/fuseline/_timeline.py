"""A trace as a picture, for matplotlib, which may not be there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

try:
    import matplotlib.pyplot as plt
except ImportError as error:
    raise ImportError("timeline() needs matplotlib: pip install fuseline[plot]") from error

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from fuseline._trace import Trace

#: Colours that those who see fewer can tell apart (Okabe and Ito): local's, then the clouds'.
COLOURS = ("#E69F00", "#0072B2", "#009E73", "#CC79A7", "#56B4E9", "#F0E442", "#D55E00")
NOTHING = "#B2182B"


def draw(trace: Trace, ax: Axes | None) -> Axes:
    """A point for each message, and a line for how long a cloud was waited for in vain."""
    if ax is None:
        _, ax = plt.subplots(figsize=(10, 4), layout="constrained")
    opened: dict[int, int] = {}
    asked: dict[tuple[int, int], int] = {}
    went: dict[int, list[tuple[float, float]]] = {}
    missed: list[float] = []
    waits: list[tuple[float, float]] = []
    for line in trace.lines:
        t = line.t
        if t is None:
            continue
        if line.ev == "open":
            opened[t] = line.at
        elif line.ev == "refuse" and line.p is None and t in opened:
            missed.append(opened.pop(t) / 1e9)
        elif t not in opened:
            continue
        elif line.ev == "request" and line.p is not None:
            asked[t, line.p] = line.at
        elif line.ev in ("timer", "cancel") and line.p:
            waits.append((opened[t] / 1e9, (line.at - asked.get((t, line.p), line.at)) / 1e6))
        elif line.ev == "emit" and line.p is not None:
            at = opened.pop(t)
            went.setdefault(line.p, []).append((at / 1e9, (line.at - at) / 1e6))
        elif line.ev == "miss":
            missed.append(opened.pop(t) / 1e9)
    _paint(ax, trace, went, waits, missed)
    return ax


def _paint(
    ax: Axes,
    trace: Trace,
    went: dict[int, list[tuple[float, float]]],
    waits: list[tuple[float, float]],
    missed: list[float],
) -> None:
    if waits:
        x, y = zip(*waits, strict=True)
        label = f"waited for in vain ({len(waits):,})"
        ax.vlines(x, 0, y, color="#999999", lw=0.8, alpha=0.5, label=label, zorder=1)
    order = [0, *sorted(cloud["p"] for cloud in trace.header["clouds"])]
    for p in sorted(went):
        x, y = zip(*went[p], strict=True)
        colour = COLOURS[order.index(p) % len(COLOURS)] if p in order else NOTHING
        label = f"{trace.source(p)} ({len(x):,})"
        ax.scatter(x, y, s=14, color=colour, label=label, zorder=2, linewidths=0)
    if missed:
        style: dict[str, Any] = {"color": NOTHING, "marker": "x", "s": 30, "zorder": 3}
        ax.scatter(missed, [0.0] * len(missed), label=f"nothing ({len(missed):,})", **style)
    ax.set(xlabel="message taken in, s", ylabel="until its output, ms", ylim=(0, None))
    ax.set_title(str(trace.header.get("operator") or trace.file), loc="left")
    ax.spines[["top", "right"]].set_visible(False)
    if ax.get_legend_handles_labels()[1]:
        ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
