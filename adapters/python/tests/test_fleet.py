"""Tests the rows of fleets: their contents, that every file has some, and the queries over them."""

from __future__ import annotations

import gzip
import io
import itertools
import json
import subprocess
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

import duckdb
import fuseline
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from conftest import BAD, CORPUS
from drives import drive, spoiled
from fuseline import fleet
from fuseline.fleet import ray as on_ray
from fuseline.fleet import spark as on_spark
from fuseline.fleet.__main__ import main as page_program

#: A trace with a violation at the greatest timestamp.
FAR = b"""{"fuseline":1,"window":1,"clouds":[]}
{"ev":"open","at":0,"t":18446744073709551615}
{"ev":"miss","at":0,"t":18446744073709551615}
"""
CHAPTER = Path(__file__).parents[3] / "docs/book/src/use/python.md"


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Writes six drives, one of which breaks a rule, and a file that cannot be read."""
    folder = tmp_path_factory.mktemp("logs")
    for seed in range(6):
        (folder / f"drive-{seed}.jsonl").write_bytes(drive(seed, 300))
    (folder / "drive-4.jsonl").write_bytes(spoiled(drive(4, 300)))
    (folder / "drive-5.jsonl").write_bytes(drive(5, 300)[:-7])
    return folder


@pytest.fixture(scope="module")
def rows(logs: Path) -> Path:
    """Writes the rows of the logs as Parquet."""
    path = logs / "rows.parquet"
    pq.write_table(fleet.judge_all(sorted(logs.glob("*.jsonl"))), path)
    return path


@pytest.mark.parametrize("how", [{}, {"tolerance": 0.002, "lateness": 0.005}])
def test_the_rows_say_what_check_says(how: dict[str, Any]) -> None:
    for path in CORPUS + BAD:
        own, *found = fleet.judge(path, **how)
        try:
            verdict = fuseline.check_observed(path, **how) if how else fuseline.check(path)
        except fuseline.ReadError as error:
            assert (own.error, found) == (str(error), [])
            continue
        assert (own.file, own.conforms) == (verdict.file, verdict.conforms)
        assert (own.judged, own.lines) == (verdict.judged, verdict.lines)
        assert (own.error, own.rule) == (None, None)
        assert own.violations == len(verdict.violations) + verdict.more
        alone = [(it.line, it.t, it.rule, it.found, it.expected) for it in verdict.violations]
        assert [(it.line, it.t, it.rule, it.found, it.expected) for it in found] == alone
        late = [None if it.late is None else it.late / 1e9 for it in verdict.violations]
        assert [it.late for it in found] == late
        assert all(it.lines is None and it.outputs is None for it in found)


def test_the_rows_say_what_the_command_says(command: str) -> None:
    words = [command, "check", "--json", *map(str, CORPUS + BAD)]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    for line in ended.stdout.splitlines():
        verdict = json.loads(line)
        own, *found = fleet.judge(verdict["file"])
        for key in ("conforms", "judged", "lines"):
            assert getattr(own, key) == verdict[key]
        for row, violation in zip(found, verdict["violations"], strict=True):
            for key in ("line", "t", "rule", "found", "expected"):
                assert getattr(row, key) == violation.get(key), violation


def test_what_came_out_is_counted(logs: Path) -> None:
    path = logs / "drive-1.jsonl"
    (own,) = fleet.judge(path)
    trace = fuseline.Trace(path)
    opened = {line.t: line.at for line in trace.lines if line.ev == "open"}
    emitted = [(line.p, line.at - opened[line.t]) for line in trace.lines if line.ev == "emit"]
    assert own.outputs is not None
    counted = Counter({p: 0 for p, _ in emitted})
    for it in own.outputs:
        counted[it.p] += it.items
    assert counted == Counter(p for p, _ in emitted)
    assert {it.source for it in own.outputs} == {"local", "west", "east"}
    for output in own.outputs:
        low = output.seconds * 31 / 32
        took = [took / 1e9 for p, took in emitted if p == output.p]
        assert sum(low <= it <= output.seconds for it in took) >= output.items
    ats = [line.at for line in trace.lines]
    assert own.seconds == (max(ats) - min(ats)) / 1e9
    assert (own.messages, own.missed, own.refused) == (300, 0, 0)


def test_a_message_that_is_refused_or_missed_is_counted() -> None:
    lines = b"""{"fuseline":1,"window":1,"clouds":[]}
{"ev":"open","at":0,"t":1}
{"ev":"open","at":1,"t":1}
{"ev":"refuse","at":1,"t":1,"why":"order"}
{"ev":"open","at":2,"t":2}
{"ev":"refuse","at":2,"t":2,"why":"full"}
{"ev":"result","at":5000,"t":1,"p":0}
{"ev":"emit","at":5000,"t":1,"p":0}
{"ev":"open","at":6000,"t":3}
{"ev":"fail","at":6001,"t":3,"p":0}
{"ev":"miss","at":6001,"t":3}
"""
    (own, *_) = fleet.judge("a.jsonl", open=lambda _: io.BytesIO(lines))
    assert (own.messages, own.refused, own.missed) == (4, 2, 1)
    assert own.outputs == [fleet.Output(0, "local", 5.119e-06, 1)]
    assert own.conforms


def test_under_progressive_a_message_counts_once_by_its_last_output() -> None:
    clouds = [fuseline.Cloud(1), fuseline.Cloud(2)]
    fusion = fuseline.Fusion(clouds, commit="progressive", record=True)
    for t in range(3):
        fusion.open(0, t)
        for p in (1, 2):
            fusion.offer(0, t, p, fuseline.ns(9000))
        fusion.result(1000, t, 0)
    fusion.result(4000, 0, 1)
    fusion.result(5000, 0, 2)
    fusion.result(5000, 1, 1)
    trace = fusion.header.encode() + b"\n" + fusion.take_trace().partition(b"\n")[2]
    # The third message is open at the end.
    (own, *_) = fleet.judge("a.jsonl", open=lambda _: io.BytesIO(trace))
    assert [(it.p, it.items) for it in own.outputs or []] == [(0, 1), (1, 1), (2, 1)]
    assert (own.messages, own.conforms) == (3, True)
    fusion.tick(20_000)
    went, _, missed = fuseline.Trace(trace + fusion.take_trace())._latencies()
    points = {0: [(0.0, 0.001)], 1: [(0.0, 0.005)], 2: [(0.0, 0.005)]}
    assert (went, missed) == (points, [])


def test_rows_are_the_same_however_a_trace_is_packed(command: str, tmp_path: Path) -> None:
    whole = spoiled(drive(3, 200))
    plain, mcap = tmp_path / "drive.jsonl", tmp_path / "drive.mcap"
    plain.write_bytes(whole)
    subprocess.run([command, "export", "--mcap", plain, "-o", mcap], check=True)
    (tmp_path / "drive.jsonl.gz").write_bytes(gzip.compress(whole))
    (tmp_path / "drive.zst").write_bytes(pa.compress(whole, "zstd", asbytes=True))
    rows = [row._replace(file="") for row in fleet.judge(plain)]
    assert not rows[0].conforms
    for name in ("drive.jsonl.gz", "drive.zst", "drive.mcap"):
        assert [row._replace(file="") for row in fleet.judge(tmp_path / name)] == rows, name
        ended = subprocess.run([command, "check", tmp_path / name], check=False)
        assert ended.returncode == 1, name


def test_what_cannot_be_read_is_a_row_with_its_error(tmp_path: Path) -> None:
    whole = drive(3, 50)
    bad = {
        "empty.jsonl": b"",
        "text.jsonl": b"no trace\n",
        "cut.jsonl": whole[:-3],
        "cut.gz": gzip.compress(whole)[:-9],
        "cut.zst": pa.compress(whole, "zstd", asbytes=True)[:-9],
        "junk.mcap": b"\x89MCAP0\r\n" + bytes(100),
        "junk.zst": b"\x28" + bytes(100),
    }
    for name, data in bad.items():
        (tmp_path / name).write_bytes(data)
    names = [*bad, "nowhere.jsonl", "", "nul\0.jsonl"]
    for name in names:
        path = str(tmp_path / name)
        (row,) = fleet.judge(path)
        assert (row.file, row.conforms, row.lines, row.rule) == (path, False, None, None)
        assert row.error is not None and row.error.startswith(path), name
        assert "\n" not in row.error
    assert fleet.judge_all(names).num_rows == len(names)


def test_a_mistake_in_the_call_is_no_row(tmp_path: Path) -> None:
    with pytest.raises(fuseline.TimeError):
        fleet.judge("a", tolerance=-1.0, lateness=0.1)
    with pytest.raises(TypeError):
        fleet.judge_all(["a"], lateless=0.1)


def test_a_trace_of_any_length_takes_the_same_memory(tmp_path: Path) -> None:
    script = (
        "import re, sys; from fuseline import fleet; (row,) = fleet.judge(sys.argv[1]);"
        "print(row.lines, re.search(r'VmHWM:\\s+(\\d+)', open('/proc/self/status').read())[1])"
    )
    measured = []
    for messages in (1_000, 30_000):
        path = tmp_path / f"{messages}.gz"
        path.write_bytes(gzip.compress(drive(1, messages), 1))
        words = [sys.executable, "-c", script, str(path)]
        ran = subprocess.run(words, capture_output=True, text=True, check=True)
        measured.append([int(word) for word in ran.stdout.split()])
    (few, least), (many, most) = measured
    assert many > 25 * few
    assert most < least + 4 * 1024, f"{least} and {most} KiB"


def test_the_schema_is_that_of_the_rows_and_of_the_chapter() -> None:
    names = fleet.schema().names
    assert tuple(names) == fleet.Row._fields
    table = CHAPTER.read_text().partition("| column |")[2].partition("\n\n")[0]
    documented = [
        word.strip("` ")
        for line in table.splitlines()[2:]
        for word in line.split("|")[1].split(",")
    ]
    assert sorted(documented) == sorted(names)


def test_the_table_keeps_every_row_and_number(tmp_path: Path) -> None:
    path = tmp_path / "far.jsonl"
    path.write_bytes(FAR)
    table = fleet.judge_all([path, *CORPUS, *BAD])
    assert table.schema == fleet.schema()
    assert table.column("t").to_pylist()[1] == 2**64 - 1
    assert len(set(table.column("file").to_pylist())) == 1 + len(CORPUS) + len(BAD)
    own = [rule is None for rule in table.column("rule").to_pylist()]
    assert sum(own) == 1 + len(CORPUS) + len(BAD)


def test_the_summaries_say_what_is_in_the_rows(logs: Path, rows: Path) -> None:
    every = [row for path in sorted(logs.glob("*.jsonl")) for row in fleet.judge(path)]
    answers = ask(rows)
    (totals,) = answers["totals"]
    own = [row for row in every if row.rule is None]
    assert (totals["drives"], totals["files"], totals["unreadable"]) == (6, 6, 1)
    assert (totals["conforming"], totals["judges"], totals["manners"]) == (4, 1, 1)
    assert totals["lines"] == sum(row.lines or 0 for row in own)
    assert totals["violations"] == len(every) - len(own) > 0
    assert totals["hours"] == pytest.approx(sum(row.seconds or 0 for row in own) / 3600)
    outputs = [it for row in own for it in row.outputs or []]
    for answer in answers["sources"]:
        bins = sorted((it.seconds, it.items) for it in outputs if it.source == answer["source"])
        total = sum(items for _, items in bins)
        assert answer["items"] == total
        assert answer["share"] == pytest.approx(total / sum(it.items for it in outputs))
        for name, share in (("p50", 0.5), ("p90", 0.9), ("p99", 0.99)):
            upto = list(itertools.accumulate(items for _, items in bins))
            place = next(i for i, it in enumerate(upto) if it >= share * total)
            assert answer[name] == bins[place][0]
    assert answers["operators"] == [{"operator": "perception", **it} for it in answers["sources"]]
    assert answers["worst"][0]["drive"] == "drive-4"
    assert answers["worst"][1]["drive"] == "drive-5"
    wrong = {row.drive for row in own if not row.conforms or row.missed or row.refused}
    assert {it["drive"] for it in answers["worst"]} == wrong < {row.drive for row in own}
    assert sum(it["drives"] for it in answers["on_board"]) == 5
    assert sum(it["violations"] for it in answers["rules"]) == len(every) - len(own)
    (unread,) = answers["unreadable"]
    assert "does not end in LF" in unread["error"]


def ask(rows: Path) -> dict[str, list[dict[str, Any]]]:
    """Returns the answers, with a dict for each row."""
    with duckdb.connect() as engine:
        engine.execute(f"CREATE VIEW verdicts AS SELECT * FROM '{rows}'")
        engine.execute(fleet.FLATTEN["duckdb"])
        return {
            name: engine.sql(sql).to_arrow_table().to_pylist()
            for name, sql in fleet.SUMMARIES.items()
        }


def test_a_page_is_made_of_the_rows(rows: Path, tmp_path: Path) -> None:
    page = tmp_path / "fleet.html"
    ran = subprocess.run(
        [sys.executable, "-m", "fuseline.fleet", rows, "-o", page, "--title", "A <fleet>"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ran.returncode, ran.stderr) == (0, "")
    text = page.read_text()
    assert "A &lt;fleet&gt;" in text and "<fleet>" not in text
    assert "4 of 6 traces conform" in text
    for word in ("drive-4", "does not end in LF", "west", "perception", "<polyline"):
        assert word in text
    assert [path.name for path in tmp_path.iterdir()] == ["fleet.html"]


def test_a_doubtful_trace_is_a_third_state(tmp_path: Path) -> None:
    paths = {name: tmp_path / f"{name}.jsonl" for name in ("good", "hung", "bad")}
    paths["good"].write_bytes(drive(1, 300))
    paths["bad"].write_bytes(spoiled(drive(4, 300)))
    opened = b'{"ev":"open","at":%d,"t":%d}\n'
    answered = b'{"ev":"result","at":7,"t":2,"p":0}\n{"ev":"emit","at":7,"t":2,"p":0}\n'
    header = b'{"fuseline":1,"window":9,"clouds":[]}\n'
    paths["hung"].write_bytes(header + opened % (1, 1) + opened % (2, 2) + answered)
    states = {name: fleet.judge(path)[0] for name, path in paths.items()}
    assert {name: (it.conforms, it.doubts) for name, it in states.items() if name != "bad"} == {
        "good": (True, None),
        "hung": (False, "unanswered"),
    }
    table = tmp_path / "rows.parquet"
    pq.write_table(fleet.judge_all(paths.values()), table)
    (totals,) = ask(table)["totals"]
    assert (totals["conforming"], totals["doubtful"], totals["files"]) == (1, 1, 3)
    assert ask(table)["doubts"] == [{"doubts": "unanswered", "traces": 1, "drives": 1}]
    (own, *_) = fleet.judge(paths["hung"], accept=["unanswered"])
    assert (own.conforms, own.doubts) == (True, None)
    with pytest.raises(ValueError, match="not a kind of doubt"):
        fleet.judge(paths["hung"], accept=["rumour"])  # type: ignore[list-item]


def test_a_page_of_nothing_is_refused(tmp_path: Path) -> None:
    other = tmp_path / "other.parquet"
    pq.write_table(pa.table({"a": [1]}), other)
    for rows in (other, tmp_path / "none.parquet"):
        ran = subprocess.run(
            [sys.executable, "-m", "fuseline.fleet", rows, "-o", tmp_path / "none.html"],
            capture_output=True,
            text=True,
            check=False,
        )
        assert ran.returncode == 2
        assert ran.stderr.startswith(f"error: {rows}: no rows of a fleet: ")
        assert not (tmp_path / "none.html").exists()


class PlayedRay:
    """Stands in for Ray's data sets, with files in blocks that tasks judge."""

    def __init__(self) -> None:
        self.blocks = 0
        self.options: dict[str, Any] = {}

    def from_arrow(self, table: pa.Table) -> pa.Table:
        return table

    def from_items(self, items: list[dict[str, Any]], *, override_num_blocks: int) -> PlayedRay:
        self.items, self.blocks = items, override_num_blocks
        return self

    def map_batches(
        self, judge: Any, *, batch_size: None, batch_format: str, **options: Any
    ) -> pa.Table:
        assert (batch_size, batch_format) == (None, "pyarrow"), "a block is a task"
        self.options = options
        blocks = [self.items[k :: self.blocks] for k in range(self.blocks)]
        return pa.concat_tables(judge(pa.Table.from_pylist(block)) for block in blocks)


def test_ray_is_given_the_files_in_tasks_and_its_own_options(
    logs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    played = PlayedRay()
    monkeypatch.setitem(sys.modules, "ray", SimpleNamespace(data=played))
    paths = sorted(logs.glob("*.jsonl"))
    how: dict[str, Any] = {"tolerance": 0.1, "lateness": 0.1}
    alone = fleet.judge_all(paths, **how).sort_by("file")
    for files_per_task, tasks in ((1, 6), (4, 2), (5, 2), (6, 1), (16, 1)):
        rows = on_ray.judge(paths, files_per_task=files_per_task, **how)
        assert played.blocks == tasks
        assert rows.sort_by("file").select(["file", "line"]) == alone.select(["file", "line"])
    assert set(rows.column("manner").to_pylist()) == set(alone.column("manner").to_pylist())
    assert played.options == {}
    on_ray.judge(paths, remote={"num_cpus": 0.5})
    assert played.options == {"num_cpus": 0.5}
    assert (played.blocks, on_ray.judge([]).num_rows) == (1, 0)
    with pytest.raises(ValueError, match="go together"):
        on_ray.judge([], tolerance=0.1)


class PlayedSpark:
    """Stands in for a session of Spark and its frames."""

    def __init__(self) -> None:
        self.sparkContext = self
        self.tasks = 0

    def parallelize(self, items: list[tuple[str]], tasks: int) -> PlayedSpark:
        self.items, self.tasks = items, tasks
        return self

    def toDF(self, columns: str) -> PlayedSpark:  # noqa: N802
        assert columns == "file string"
        return self

    def mapInArrow(self, judge: Any, columns: str) -> tuple[list[Any], str]:  # noqa: N802
        files = [pa.array([it for (it,) in self.items], pa.string())]
        return list(judge(iter([pa.record_batch(files, names=["file"])]))), columns


def test_spark_is_given_the_files_in_tasks_and_timestamps_as_decimals(
    logs: Path, tmp_path: Path
) -> None:
    far = tmp_path / "far.jsonl"
    far.write_bytes(FAR)
    paths = [*sorted(logs.glob("*.jsonl")), far]
    played: Any = PlayedSpark()
    for files_per_task, tasks in ((1, 7), (3, 3), (7, 1), (16, 1)):
        batches, columns = on_spark.judge(played, paths, files_per_task=files_per_task)
        assert played.tasks == tasks
    table = pa.Table.from_batches(batches)
    assert [it.split(":")[0].split()[0] for it in columns.split(", ")[:7]] == table.column_names[:7]
    assert table.column("t").type == pa.decimal128(20, 0)
    assert table.column("t").to_pylist()[-1] == 2**64 - 1
    alone = fleet.judge_all(paths)
    names = [name for name in alone.column_names if name != "t"]
    assert table.column_names == alone.column_names
    assert table.select(names).to_pylist() == alone.select(names).to_pylist()
    on_spark.judge(played, [])
    assert played.tasks == 1
    with pytest.raises(ValueError, match="go together"):
        on_spark.judge(played, [], tolerance=0.1)


@pytest.mark.parametrize(
    ("path", "named"),
    [("a/drive-7.2.jsonl", "drive-7"), ("a/.jsonl", "a/.jsonl"), ("", ""), ("x", "x")],
)
def test_a_drive_is_named_by_its_file_or_by_a_function(path: str, named: str) -> None:
    opened: list[str] = []

    def empty(file: str) -> BinaryIO:
        opened.append(file)
        return io.BytesIO(FAR)

    own, found = fleet.judge(path, open=empty)
    assert (own.file, own.drive, found.drive) == (path, named, named)
    assert fleet.judge(path, open=empty, drive=lambda file: f"{file}!")[0].drive == f"{path}!"
    assert opened == [path, path]


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (FileNotFoundError(2, "No such file or directory"), "No such file or directory"),
        (ConnectionError("the store is away"), "the store is away"),
        (EOFError(), "EOFError"),
        (ValueError(), "ValueError"),
    ],
)
def test_what_a_store_raises_is_a_row_with_its_words(error: Exception, words: str) -> None:
    def away(file: str) -> BinaryIO:
        raise error

    (row,) = fleet.judge("s3://a", open=away)
    assert (row.error, row.conforms) == (f"s3://a: {words}", False)


def test_a_violation_of_an_observed_trace_is_late_by_so_many_seconds() -> None:
    late = b"""{"fuseline":1,"window":1,"clouds":[{"p":1,"limit":9}]}
{"ev":"open","at":0,"t":1}
{"ev":"request","at":0,"t":1,"p":1,"due":1000000000}
{"ev":"result","at":1000,"t":1,"p":0}
{"ev":"timer","at":1750000000,"t":1,"p":1}
{"ev":"emit","at":1750000000,"t":1,"p":0}
"""
    how: dict[str, Any] = {"tolerance": 0.0, "lateness": 0.25}
    own, *found = fleet.judge("a.jsonl", open=lambda _: io.BytesIO(late), **how)
    assert not own.conforms and own.late is None
    assert [it.late for it in found if it.late is not None] == [0.25]
    assert own.manner == "observed, tolerance 0 ns, lateness 250000000 ns"


def test_violations_without_a_row_are_counted() -> None:
    """A trace has more than 100 violations, and the rest are counted."""
    opens = b"".join(b'{"ev":"open","at":%d,"t":%d}\n' % (at, at) for at in range(1, 131))
    lines = b'{"fuseline":1,"window":1,"clouds":[]}\n' + opens
    own, *found = fleet.judge("a.jsonl", open=lambda _: io.BytesIO(lines))
    verdict = fuseline.check(lines)
    assert verdict.more > 0 and len(found) == 100
    assert own.violations == 100 + verdict.more


def test_the_program_for_a_page_has_defaults_and_says_them(
    rows: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["fleet", str(rows)])
    assert page_program() == 0
    assert "<h1>Fleet</h1>" in (tmp_path / "fleet.html").read_text()
    monkeypatch.setattr(sys, "argv", ["fleet", "--help"])
    with pytest.raises(SystemExit, match="0"):
        page_program()
    said = " ".join(capsys.readouterr().out.split())
    for words in (
        "usage: python -m fuseline.fleet",
        "Makes a page of the rows of a fleet that are kept in Parquet.",
        "rows a Parquet file, a folder of them, or a pattern",
        "the page (fleet.html)",
        "--title TITLE its title",
    ):
        assert words in said
