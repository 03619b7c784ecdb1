"""Makes a page from the rows of a fleet."""

from __future__ import annotations

import math
import os
from html import escape
from pathlib import Path
from typing import Any, TypeAlias

try:
    import duckdb
except ImportError as error:
    raise ImportError("a page needs duckdb: pip install fuseline[fleet]") from error

from fuseline._judge import replace_file
from fuseline.fleet._summaries import FLATTEN, SUMMARIES

#: The answer to a query: the names of its columns, and its rows.
Answer: TypeAlias = tuple[list[str], list[tuple[Any, ...]]]

#: Colours that colour-blind people can distinguish (Okabe and Ito). The first is local's, and the
#: others are the clouds'.
COLOURS = ("#E69F00", "#0072B2", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")

STYLE = """
:root { color-scheme: light dark; --line: #8884; --dim: #767676 }
:root { --bad: #c62828; --good: #1a7f37; --doubt: #9a6700 }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 64rem; margin: 2rem auto; padding: 0 1rem }
h1 { font-size: 1.5rem; margin: 0 } h2 { font-size: 1.1rem; margin: 2.2rem 0 .5rem }
.dim { color: var(--dim) } .bad { color: var(--bad) } .good { color: var(--good) }
.doubt { color: var(--doubt) }
.tiles { display: flex; flex-wrap: wrap; gap: .75rem; margin: 1.2rem 0 }
.tile { border: 1px solid var(--line); border-radius: 6px; padding: .5rem .9rem; min-width: 6.5rem }
.tile b { display: block; font-size: 1.35rem; font-variant-numeric: tabular-nums }
.wide { overflow-x: auto } table { border-collapse: collapse; width: 100% }
th, td { text-align: right; padding: .25rem .6rem; border-bottom: 1px solid var(--line);
  font-variant-numeric: tabular-nums; white-space: nowrap }
th { font-weight: 600 } .text { text-align: left; white-space: normal; overflow-wrap: anywhere }
svg { width: 100%; height: auto; display: block } svg text { font-size: 11px; fill: currentColor }
"""


def write(rows: str, page: Path, title: str) -> None:
    """Runs the summaries over the rows, and writes the page once all have answers."""
    replace_file(page, _page(ask(rows), title).encode())


def ask(rows: str) -> dict[str, Answer]:
    """Returns the answers to all summaries, over Parquet."""
    if Path(rows).is_dir():
        rows = os.path.join(rows, "*.parquet")  # noqa: PTH118
    with duckdb.connect() as engine:
        source = rows.replace("'", "''")
        try:
            engine.execute(f"CREATE VIEW verdicts AS SELECT * FROM read_parquet('{source}')")
            engine.execute(FLATTEN["duckdb"])
            answers = {name: _answer(engine, sql) for name, sql in SUMMARIES.items()}
        except duckdb.Error as error:
            raise ValueError(f"{rows}: no rows of a fleet: {str(error).splitlines()[0]}") from error
    return answers


def _answer(engine: duckdb.DuckDBPyConnection, sql: str) -> Answer:
    answer = engine.execute(sql)
    return [column[0] for column in answer.description or ()], answer.fetchall()


def _page(answers: dict[str, Answer], title: str) -> str:
    totals = dict(zip(answers["totals"][0], answers["totals"][1][0], strict=True))
    parts = [
        f"<h1>{escape(title)}</h1>",
        _headline(totals),
        _tiles(totals),
        _table("Results that were sent, by source", answers["sources"]),
        _curves(answers["responses"]),
        _table("By operator", answers["operators"]),
        _bars(answers["on_board"]),
        _table("Broken rules", answers["rules"], "No rule is broken."),
        _table("Doubts", answers["doubts"], "Nothing is in doubt."),
        _table("The worst drives", answers["worst"], "Nothing went wrong in any drive."),
        _table("Traces that cannot be read", answers["unreadable"], "All traces could be read."),
    ]
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head>"
        f"<body>{''.join(parts)}</body></html>\n"
    )


def _headline(totals: dict[str, Any]) -> str:
    files, good, unread = totals["files"], totals["conforming"], totals["unreadable"]
    if files == 0:
        return "<p>There are no traces.</p>"
    doubtful = totals["doubtful"]
    bad = files - good - unread - doubtful
    parts = [f'<span class="good">{good:,} of {files:,} traces conform</span>']
    if doubtful:
        parts.append(f'<span class="doubt">{doubtful:,} in doubt</span>')
    if bad:
        parts.append(f'<span class="bad">{bad:,} do not</span>')
    if unread:
        parts.append(f'<span class="bad">{unread:,} cannot be read</span>')
    note = ""
    if totals["judges"] > 1 or totals["manners"] > 1:
        note = (
            f'<p class="bad">They were judged by {totals["judges"]} builds of the judge in '
            f"{totals['manners']} ways: compare them with care.</p>"
        )
    return f"<p>{', '.join(parts)}.</p>{note}"


def _tiles(totals: dict[str, Any]) -> str:
    names = ("drives", "hours", "messages", "missed", "refused", "violations", "lines")
    return f'<div class="tiles">{"".join(_tile(name, totals[name]) for name in names)}</div>'


def _tile(name: str, figure: float) -> str:
    text = f"{figure:,.1f}" if isinstance(figure, float) else f"{figure:,}"
    return f'<div class="tile"><b>{text}</b><span class="dim">{name}</span></div>'


def _table(heading: str, answer: Answer, none: str = "There is nothing.") -> str:
    names, rows = answer
    if not rows:
        return f'<h2>{heading}</h2><p class="dim">{none}</p>'
    cells = "".join(f"<th{_class(name)}>{SECONDS.get(name, name)}</th>" for name in names)
    lines = [f"<tr>{cells}</tr>"]
    for row in rows:
        cells = "".join(
            f"<td{_class(name)}>{_cell(name, value)}</td>"
            for name, value in zip(names, row, strict=True)
        )
        lines.append(f"<tr>{cells}</tr>")
    return f'<h2>{heading}</h2><div class="wide"><table>{"".join(lines)}</table></div>'


#: The columns with text.
WORDS = frozenset({"drive", "file", "error", "rule", "source", "operator", "doubts"})
#: Columns in seconds.
SECONDS = {"p50": "median, ms", "p90": "90 %, ms", "p99": "99 %, ms", "greatest": "greatest, ms"}
SECONDS["latest"] = "latest by, ms"


def _class(name: str) -> str:
    return ' class="text"' if name in WORDS else ""


def _cell(name: str, value: Any) -> str:
    if value is None:
        return '<span class="dim">–</span>'
    if name in SECONDS:
        return f"{value * 1e3:,.1f}"
    if name == "share":
        return f"{value:.2%}"
    return escape(f"{value:,}" if isinstance(value, int) else str(value))


WIDTH, HEIGHT, LEFT, FLOOR = 900, 240, 46, 212


def _curves(answer: Answer) -> str:
    """Draws, for each source, the share of its outputs that took at most a given time."""
    sources: dict[str, list[tuple[float, int]]] = {}
    for source, seconds, items in answer[1]:
        sources.setdefault(source, []).append((max(seconds, 1e-6), items))
    if not sources:
        return ""
    every = [seconds for bins in sources.values() for seconds, _ in bins]
    low, high = math.floor(math.log10(min(every))), math.ceil(math.log10(max(every)))
    high = max(high, low + 1)

    def x(seconds: float) -> float:
        return LEFT + (math.log10(seconds) - low) / (high - low) * (WIDTH - LEFT - 130)

    def y(share: float) -> float:
        return FLOOR - share * (FLOOR - 12)

    drawn = [_tick(x(10.0**power), _time(10.0**power)) for power in range(low, high + 1)]
    drawn += [_level(y(share), f"{share:.0%}") for share in (0, 0.5, 1)]
    ordered = sorted(sources, key=lambda source: (source != "local", source))
    for i, source in enumerate(ordered):
        colour = COLOURS[i % len(COLOURS)]
        total, upto, points = sum(n for _, n in sources[source]), 0, []
        for seconds, items in sources[source]:
            points.append(f"{x(seconds):.1f},{y(upto / total):.1f}")
            upto += items
            points.append(f"{x(seconds):.1f},{y(upto / total):.1f}")
        line = " ".join(points)
        drawn.append(f'<polyline fill="none" stroke="{colour}" stroke-width="2" points="{line}"/>')
        x0, y0 = WIDTH - 118, 16 + 16 * i
        drawn.append(f'<rect x="{x0}" y="{y0}" width="10" height="10" fill="{colour}"/>')
        drawn.append(f'<text x="{x0 + 16}" y="{y0 + 9}">{escape(source[:18])}</text>')
    caption = "Share of each source's outputs that took at most this long"
    return f"<h2>{caption}</h2>{_svg(caption, drawn)}"


def _bars(answer: Answer) -> str:
    """Draws the number of drives by the share of their outputs that came from local."""
    if not answer[1]:
        return ""
    greatest = max(drives for _, drives in answer[1])
    step = (WIDTH - LEFT - 20) / 21
    drawn = [_level(FLOOR, "0"), _level(12, f"{greatest:,}")]
    for twentieth, drives in answer[1]:
        x, height = LEFT + twentieth * step, drives / greatest * (FLOOR - 12)
        least = 5 * twentieth
        label = f"{least} %" if least == 100 else f"{least} to {least + 5} %"
        drawn.append(
            f'<rect x="{x:.1f}" y="{FLOOR - height:.1f}" width="{step - 3:.1f}" '
            f'height="{height:.1f}" fill="{COLOURS[1]}">'
            f"<title>{label}: {drives:,} drives</title></rect>"
        )
    drawn += [_below(LEFT + step * (i + 0.5), f"{5 * i} %") for i in range(0, 21, 4)]
    caption = "Number of drives by the share of their outputs from on board"
    return f"<h2>{caption}</h2>{_svg(caption, drawn)}"


def _svg(caption: str, drawn: list[str]) -> str:
    head = f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(caption)}">'
    return f"{head}{''.join(drawn)}</svg>"


def _tick(x: float, label: str) -> str:
    line = f'<line x1="{x:.1f}" x2="{x:.1f}" y1="12" y2="{FLOOR}" stroke="#8884"/>'
    return line + _below(x, label)


def _below(x: float, label: str) -> str:
    return f'<text x="{x:.1f}" y="{FLOOR + 16}" text-anchor="middle">{label}</text>'


def _level(y: float, label: str) -> str:
    line = f'<line x1="{LEFT}" x2="{WIDTH - 130}" y1="{y:.1f}" y2="{y:.1f}" stroke="#8884"/>'
    return f'{line}<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{label}</text>'


def _time(seconds: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= size * 0.999:
            return f"{seconds / size:,.0f} {unit}"
    return f"{seconds * 1e9:,.0f} ns"
