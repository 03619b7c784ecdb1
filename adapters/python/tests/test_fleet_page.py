"""Compares each figure, class, curve and bar of a fleet's page with sums of the rows."""

from __future__ import annotations

import math
import random
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from decimal import Decimal
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fuseline import fleet
from fuseline.fleet import Output, Row
from fuseline.fleet._arrow import table

Cell = tuple[str | None, str]
UNITS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6}
COLOURS = ("#E69F00", "#0072B2", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")
TEXT = {"drive", "file", "error", "rule", "source", "operator", "doubts"}
MS = {"p50": "median", "p90": "90 %", "p99": "99 %", "greatest": "greatest", "latest": "latest by"}


class PageElement:
    """Holds an element of a page and its contents."""

    def __init__(self, tag: str, attributes: dict[str, str | None]) -> None:
        self.tag, self.attributes = tag, attributes
        #: The contents: elements and texts.
        self.parts: list[PageElement | str] = []

    @property
    def children(self) -> list[PageElement]:
        return [it for it in self.parts if isinstance(it, PageElement)]

    def all(self, tag: str) -> Iterator[PageElement]:
        for child in self.children:
            if child.tag == tag:
                yield child
            yield from child.all(tag)

    @property
    def text(self) -> str:
        return "".join(it if isinstance(it, str) else it.text for it in self.parts)

    def number(self, name: str) -> float:
        return float(self.attributes[name] or "")


class PageReader(HTMLParser):
    """Reads a page into its elements."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.open = [PageElement("", {})]
        self.feed(path.read_text(encoding="utf-8"))
        assert len(self.open) == 1, f"{self.open[-1].tag} is not closed"
        self.body = next(self.open[0].all("body"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attrs)
        if tag != "meta":
            self.open.append(self.open[-1].children[-1])

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.open[-1].parts.append(PageElement(tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop().tag == tag

    def handle_data(self, data: str) -> None:
        self.open[-1].parts.append(data)

    def section(self, heading: str) -> PageElement | None:
        """Returns the element after a heading."""
        children = self.body.children
        places = [i for i, it in enumerate(children) if it.tag == "h2" and it.text == heading]
        assert len(places) <= 1
        return children[places[0] + 1] if places else None


def drawn(chance: random.Random, drives: int, sources: int = 4) -> list[Row]:
    """Returns a fleet in which some traces cannot be read, break rules or have no output."""
    names = ["local", "west", "<east>", "a cloud of a long name & number", *map(str, range(20))]
    rows = []
    for drive in range(drives):
        for part in range(chance.randint(1, 2)):
            whole = f"d{drive}", f"drive-{drive}.{part}.jsonl"
            file, named = f"logs/{whole[1]}", f"{whole[0]}<&>"
            manner, judge = chance.choice(["strict"] * 9 + ["observed"]), "digest"
            if chance.random() < 0.15:
                why = f"{file}:1:1: <cut>"
                rows.append(Row(file, named, None, False, manner, judge, why))
                continue
            operator = chance.choice(["lanes", "signs & lights", None])
            outputs = [
                Output(p, names[p], seconds, chance.choice([1, 7, 40, 1000]))
                for p in range(sources)
                for seconds in (0.0, 1e-6, 3e-5, 0.001, 0.0123, 0.12, 0.999, 2.5, 40.0)
                if chance.random() < 0.25
            ]
            broken = chance.randint(0, 3) if chance.random() < 0.3 else 0
            doubts = chance.choice([None, None, "silent", "silent, coarse"])
            conforms = not broken and doubts is None
            first = (file, named, operator, conforms, manner, judge, None)
            missed, refused = (chance.choice([0, 0, 1, 23]) for _ in "mr")
            span, messages = 360.0 * chance.randint(0, 40), chance.randint(0, 5000)
            more = chance.randint(0, 2) if broken else 0
            own = Row(*first, 9, 4000, span, messages, missed, refused, outputs)
            rows.append(own._replace(violations=broken + more, doubts=doubts))
            for line in range(broken):
                late = chance.choice([None, 0.0251, 1.5])
                rule = chance.choice(["F5", "P2", "J<1>"])
                rows.append(Row(*first, line=line, t=1, rule=rule, late=late))
    return rows


def alone(*outputs: Output, judge: str = "digest", manner: str = "strict") -> Row:
    """Returns the row of a drive with one trace, which conforms."""
    whole = ("a.jsonl", "a", "lanes", True, manner, judge, None)
    return Row(*whole, 1, 4, 360.0, 2, 0, 0, list(outputs), 0)


def of_two_judges() -> list[Row]:
    return [alone(judge="one"), alone(judge="two")._replace(file="b.jsonl", drive="b")]


def in_two_manners() -> list[Row]:
    return [alone(), alone(manner="observed")._replace(file="b.jsonl", drive="b")]


FLEETS: dict[str, Callable[[], list[Row]]] = {
    "empty": list,
    "unread": lambda: [Row("a", "a", None, False, "strict", "digest", "a:1:1: cut")],
    "silent": lambda: [alone()],
    "a single output": lambda: [alone(Output(0, "local", 0.001, 1))],
    "a second": lambda: [alone(Output(1, "west", 1.0, 3), Output(0, "local", 0.1, 1))],
    "at once": lambda: [alone(Output(0, "local", 0.0, 1))],
    "of two judges": of_two_judges,
    "in two manners": in_two_manners,
    "many sources": lambda: drawn(random.Random(99), 5, sources=9),
    "many drives": lambda: drawn(random.Random(98), 90),
    **{
        f"seed {seed}": lambda seed=seed: drawn(random.Random(seed), 1 + seed % 5)  # type: ignore[misc]
        for seed in range(10)
    },
}


@pytest.mark.parametrize("of", FLEETS)
def test_a_page_shows_what_an_account_of_the_rows_says(of: str, tmp_path: Path) -> None:
    rows = FLEETS[of]()
    pq.write_table(table(rows), tmp_path / "rows.parquet")
    fleet.report(tmp_path / "rows.parquet", tmp_path / "page.html", title="R&D <fleet>")
    page = PageReader(tmp_path / "page.html")
    own = [row for row in rows if row.rule is None]
    assert [it.text for it in page.body.all("h1")] == ["R&D <fleet>"]
    assert [it.text for it in next(page.open[0].all("head")).all("title")] == ["R&D <fleet>"]
    headline(page, own)
    tiles(page, own)
    assert_tables(page, rows, own)
    outputs = [it for row in own for it in row.outputs or []]
    curves(page, outputs)
    bars(page, own)


def headline(page: PageReader, own: list[Row]) -> None:
    said = [
        (it.text, [(word.attributes["class"], word.text) for word in it.children])
        for it in page.body.children
        if it.tag == "p" and it.attributes.get("class") in (None, "bad")
    ]
    if not own:
        assert said == [("There are no traces.", [])]
        return
    good = sum(row.conforms for row in own)
    unread = sum(row.error is not None for row in own)
    doubtful = sum(row.violations == 0 and not row.conforms for row in own)
    expected = [("good", f"{good:,} of {len(own):,} traces conform")]
    if doubtful:
        expected.append(("doubt", f"{doubtful:,} in doubt"))
    if bad := len(own) - good - unread - doubtful:
        expected.append(("bad", f"{bad:,} do not"))
    if unread:
        expected.append(("bad", f"{unread:,} cannot be read"))
    assert said[0] == (", ".join(words for _, words in expected) + ".", expected)
    judges, manners = {row.judge for row in own}, {row.manner for row in own}
    if len(judges) == len(manners) == 1:
        assert len(said) == 1
        return
    ((warning, _),) = said[1:]
    assert f"{len(judges)} builds of the judge in {len(manners)} ways" in warning


def tiles(page: PageReader, own: list[Row]) -> None:
    expected = {
        "drives": f"{len({row.drive for row in own}):,}",
        "hours": f"{sum(int(row.seconds or 0) for row in own) // 360 / 10:,.1f}",
    }
    for name in ("messages", "missed", "refused", "violations", "lines"):
        expected[name] = f"{sum(getattr(row, name) or 0 for row in own):,}"
    shown = [it for it in page.body.all("div") if it.attributes.get("class") == "tile"]
    assert [(it.children[1].text, it.children[0].text) for it in shown] == list(expected.items())


def assert_tables(page: PageReader, rows: list[Row], own: list[Row]) -> None:
    outputs = [(row.operator, it) for row in own for it in row.outputs or []]
    by_source = shares([((it.source,), it) for _, it in outputs], 0)
    by_operator = shares([((operator, it.source), it) for operator, it in outputs], 1)
    names: tuple[str, ...] = ("source", "items", "share", "p50", "p90", "p99", "greatest")
    shown(page, "Results that were sent, by source", names, by_source, "There is nothing.")
    shown(page, "By operator", ("operator", *names), by_operator, "There is nothing.")
    found: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        if row.rule is not None:
            found[row.rule].append(row)
    rules = [
        (rule, len(of), len({row.drive for row in of}), max(row.late or -1.0 for row in of))
        for rule, of in found.items()
    ]
    rules.sort(key=lambda it: (-it[1], it[0]))
    broken = [(*it[:3], None if it[3] < 0 else it[3]) for it in rules]
    names = ("rule", "violations", "drives", "latest")
    shown(page, "Broken rules", names, broken, "No rule is broken.")
    doubted: dict[str, list[Row]] = defaultdict(list)
    for row in own:
        if row.doubts is not None and row.violations == 0:
            doubted[row.doubts].append(row)
    doubts = [(of, len(it), len({row.drive for row in it})) for of, it in doubted.items()]
    doubts.sort(key=lambda it: (-it[1], it[0]))
    shown(page, "Doubts", ("doubts", "traces", "drives"), doubts, "Nothing is in doubt.")
    drives: dict[str, list[int]] = defaultdict(lambda: [0] * 7)
    for row in own:
        doubtful = row.violations == 0 and not row.conforms
        counts = (row.missed, row.refused, row.messages)
        given = (1, row.violations, row.error is not None, doubtful, *counts)
        drives[row.drive] = [a + (b or 0) for a, b in zip(drives[row.drive], given, strict=True)]
    worst: list[Any] = [(drive, *of) for drive, of in drives.items() if any(of[1:6])]
    worst.sort(key=lambda it: (-it[2], -it[3], -it[4], -it[5] - it[6], it[0]))
    names = ("drive", "files", "violations", "unreadable", "doubtful", "missed", "refused")
    names = (*names, "messages")
    none = "Nothing went wrong in any drive."
    shown(page, "The worst drives", names, worst[:50], none)
    unread = sorted((row.file, row.error) for row in own if row.error is not None)
    none = "All traces could be read."
    shown(page, "Traces that cannot be read", ("file", "error"), unread[:50], none)


def shares(outputs: list[tuple[tuple[Any, ...], Output]], key: int) -> list[tuple[Any, ...]]:
    """Returns each group's items, their share by the first ``key`` columns, and quantiles."""
    took: dict[tuple[Any, ...], list[float]] = defaultdict(list)
    for group, it in outputs:
        took[group] += [it.seconds] * it.items
    all_of = Counter[Any]()
    for group, times in took.items():
        all_of[group[:key]] += len(times)
    rows = []
    for group, times in took.items():
        times.sort()
        quantiles = [times[-(-len(times) * percent // 100) - 1] for percent in (50, 90, 99)]
        rows.append((*group, len(times), len(times) / all_of[group[:key]], *quantiles, times[-1]))
    rows.sort(key=lambda it: ([(x is None, x or "") for x in it[:key]], -it[key + 1], it[key]))
    return rows


def shown(
    page: PageReader, heading: str, names: tuple[str, ...], rows: list[Any], none: str
) -> None:
    section = page.section(heading)
    assert section is not None, heading
    if not rows:
        assert (section.tag, section.text) == ("p", none)
        return
    cells = [[cell(it) for it in row.children] for row in section.all("tr")]
    classes = ["text" if name in TEXT else None for name in names]
    titles = [f"{MS[name]}, ms" if name in MS else name for name in names]
    assert cells[0] == list(zip(classes, titles, strict=True))
    expected = [list(zip(classes, map(in_words, names, row), strict=True)) for row in rows]
    assert cells[1:] == expected, heading


def cell(it: PageElement) -> Cell:
    """Returns a cell's class and text. Unknown values must be dimmed."""
    for child in it.children:
        assert (child.tag, child.attributes["class"], child.text) == ("span", "dim", "–")
    return it.attributes.get("class"), it.text


def in_words(name: str, value: Any) -> str:
    if value is None:
        return "–"
    if name in MS:
        return f"{(Decimal(str(value)) * 1000).quantize(Decimal('0.1')):,}"
    if name == "share":
        return f"{100 * value:.2f}%"
    return f"{value:,}" if isinstance(value, int) else value


def labels(svg: PageElement, anchor: str | None) -> list[tuple[float, float, str]]:
    texts = [it for it in svg.all("text") if it.attributes.get("text-anchor") == anchor]
    return [(it.number("x"), it.number("y"), it.text) for it in texts]


def curves(page: PageReader, outputs: list[Output]) -> None:
    """Reads points off the ticks, and checks that each is the share of outputs until then."""
    svg = page.section("Share of each source's outputs that took at most this long")
    if not outputs:
        assert svg is None
        return
    assert svg is not None and svg.attributes["viewbox"] == "0 0 900 240"
    bins: dict[str, Counter[float]] = defaultdict(Counter)
    for it in outputs:
        bins[it.source][it.seconds] += it.items
    # Nothing is drawn below a microsecond.
    every = [math.log10(seconds or 1e-6) for of in bins.values() for seconds in of]
    low = math.floor(min(every))
    high = max(math.ceil(max(every)), low + 1)
    lines = list(svg.all("line"))
    across = [it for it in lines if it.attributes["y1"] == it.attributes["y2"]]
    assert {(it.number("x1"), it.number("x2")) for it in across} == {(46, 770)}
    assert [it.number("y1") for it in across] == [212, 112, 12]
    assert labels(svg, "end") == [(40, 216, "0%"), (40, 116, "50%"), (40, 16, "100%")]
    ticks = [it.number("x1") for it in lines if it not in across]
    assert all(it.number("x2") == it.number("x1") for it in lines if it not in across)
    powers = range(low, high + 1)
    assert ticks == [round(46 + 724 * i / (high - low), 1) for i in range(len(powers))]
    under = labels(svg, "middle")
    assert [(x, y) for x, y, _ in under] == [(x, 228) for x in ticks]
    for (_, _, label), power in zip(under, powers, strict=True):
        figure, unit = label.split()
        assert float(figure.replace(",", "")) * UNITS[unit] == pytest.approx(10.0**power)
        assert 1 <= float(figure.replace(",", "")) < 1000 or unit == "s"
    ordered = sorted(bins, key=lambda it: (it != "local", it))
    key = [(798, 25 + 16 * i, source[:18]) for i, source in enumerate(ordered)]
    assert labels(svg, None) == key
    squares = [(it.number("x"), it.number("y"), it.attributes["fill"]) for it in svg.all("rect")]
    colours = [COLOURS[i % 6] for i in range(len(ordered))]
    assert squares == [(782, 16 + 16 * i, colour) for i, colour in enumerate(colours)]
    polylines = list(svg.all("polyline"))
    assert [it.attributes["stroke"] for it in polylines] == colours
    for source, polyline in zip(ordered, polylines, strict=True):
        points, upto = [], 0
        for seconds, items in sorted(bins[source].items()):
            x = 46 + 724 * (math.log10(seconds or 1e-6) - low) / (high - low)
            for upto in (upto, upto + items):  # noqa: B020
                points += [x, 212 - 200 * upto / sum(bins[source].values())]
        pairs = (polyline.attributes["points"] or "").replace(",", " ").split()
        assert list(map(float, pairs)) == pytest.approx(points, abs=0.0501)


def bars(page: PageReader, own: list[Row]) -> None:
    """Checks that each bar is as high as the number of drives with its share."""
    svg = page.section("Number of drives by the share of their outputs from on board")
    items: dict[str, Counter[bool]] = defaultdict(Counter)
    for row in own:
        for it in row.outputs or []:
            items[row.drive][it.p == 0] += it.items
    drives = Counter(20 * it[True] // (it[True] + it[False]) for it in items.values())
    if not drives:
        assert svg is None
        return
    assert svg is not None
    greatest, step = max(drives.values()), 834 / 21
    assert labels(svg, "end") == [(40, 216, "0"), (40, 16, f"{greatest:,}")]
    shares = [(round(46 + step * (i + 0.5), 1), 228, f"{5 * i} %") for i in (0, 4, 8, 12, 16, 20)]
    assert labels(svg, "middle") == shares
    rects = list(svg.all("rect"))
    for rect, (twentieth, count) in zip(rects, sorted(drives.items()), strict=True):
        least = "100 %" if twentieth == 20 else f"{5 * twentieth} to {5 * twentieth + 5} %"
        assert rect.text == f"{least}: {count:,} drives"
        height = 200 * count / greatest
        box = [rect.number(name) for name in ("x", "y", "width", "height")]
        expected = [46 + step * twentieth, 212 - height, step - 3, height]
        assert box == pytest.approx(expected, abs=0.0501)
        assert rect.attributes["fill"] == "#0072B2"


def test_a_folder_a_pattern_and_an_odd_name_are_rows(tmp_path: Path) -> None:
    folder = tmp_path / "the fleet's"
    folder.mkdir()
    for seed in range(2):
        rows = [row._replace(file=f"{seed}{row.file}") for row in drawn(random.Random(seed), 2)]
        pq.write_table(table(rows), folder / f"{seed}.parquet")
    (folder / "notes.txt").write_text("no rows")
    pages = []
    for rows_at in (folder, folder / "*.parquet", folder / "0.parquet"):
        fleet.report(rows_at, tmp_path / "page.html")
        pages.append((tmp_path / "page.html").read_text())
    assert pages[0] == pages[1] != pages[2]
    assert "<title>Fleet</title>" in pages[0]


def test_a_page_that_cannot_be_made_leaves_the_one_before(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text("the one before")
    pq.write_table(table([alone()]), tmp_path / "rows.parquet")
    with pytest.raises(ValueError, match="surrogates"):
        fleet.report(tmp_path / "rows.parquet", page, title="\ud800")
    pq.write_table(pa.table({"a": [1]}), tmp_path / "other.parquet")
    with pytest.raises(ValueError, match=r"other\.parquet: no rows of a fleet"):
        fleet.report(tmp_path / "other.parquet", page)
    assert page.read_text() == "the one before"
    assert sorted(it.suffix for it in tmp_path.iterdir()) == [".html", ".parquet", ".parquet"]
