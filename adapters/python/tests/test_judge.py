"""Tests judging, reading and replaying traces from every kind of source."""

from __future__ import annotations

import gzip
import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any, cast

import fuseline
import pyarrow as pa
import pytest
from conftest import ANNOTATED, BAD, CORPUS, DOUBTS
from fuseline import Trace, Verdict, Violation, check, check_observed, ns, replay, report

HEADER = b'{"fuseline":1,"window":16,"clouds":[{"p":1,"limit":31}]}\n'
GOOD = (
    HEADER
    + b"""{"ev":"open","at":0,"t":1}
{"ev":"offer","at":0,"t":1,"p":1,"deadline":500,"backlog":0}
{"ev":"request","at":0,"t":1,"p":1,"due":500}
{"ev":"result","at":499,"t":1,"p":1}
{"ev":"emit","at":499,"t":1,"p":1}
"""
)
LATE = GOOD.replace(b"499", b"500")


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.stem)
def test_the_corpus_conforms_and_replays(path: Path) -> None:
    # In two of the traces, nothing is judged.
    assert check(path, accept=["unjudged"]).conforms
    inputs = b"".join(path.read_bytes().splitlines(keepends=True))
    assert replay(path) == replay(inputs)
    assert check(replay(path), accept=["unjudged"]).conforms


@pytest.mark.parametrize("path", ANNOTATED, ids=lambda path: path.stem)
def test_traces_with_further_keys_are_judged_by_them(path: Path) -> None:
    options = json.loads(path.with_suffix(".json").read_text())
    slack = options.get("observed")
    expected = [(it["rule"], it["line"]) for it in options["violations"]]
    if slack:
        sources = {int(p): ns(it) for p, it in slack.get("tolerances", {}).items()}
        verdict = check_observed(
            path,
            tolerance=ns(slack["tolerance"]),
            lateness=ns(slack["lateness"]),
            tolerances={Trace(path).source(p): it for p, it in sources.items()},
        )
    else:
        verdict = check(path)
        if not expected:
            assert replay(path) == path.read_bytes()
    assert sorted((it.rule, it.line) for it in verdict.violations) == sorted(expected)
    assert verdict.judged == options["judged"]


@pytest.mark.parametrize("path", BAD, ids=lambda path: path.stem)
def test_what_breaks_a_rule_does_not_conform(path: Path) -> None:
    verdict = check(path)
    assert not verdict.conforms
    assert verdict.violations[0].sentence


def test_bytes_paths_files_and_lines_are_one_trace(tmp_path: Path) -> None:
    path = tmp_path / "late.jsonl"
    path.write_bytes(LATE)
    packed = tmp_path / "late.jsonl.gz"
    packed.write_bytes(gzip.compress(LATE))
    with path.open() as text, path.open("rb") as binary:
        traces: list[Any] = [
            LATE,
            gzip.compress(LATE),
            path,
            str(path),
            packed,
            text,
            binary,
            LATE.splitlines(keepends=True),
            LATE.splitlines(),
            LATE.decode().splitlines(),
            (line for line in LATE.splitlines()),
            # Any pieces are accepted, as long as the first one ends a line.
            [HEADER, LATE[len(HEADER) : 80], LATE[80:]],
        ]
        for trace in traces:
            verdict = check(trace, name="it")
            assert (verdict.file, verdict.judged, verdict.lines) == ("it", 1, 6)
            (violation,) = verdict.violations
            assert (violation.line, violation.t, violation.rule) == (6, 1, "F5")
            assert violation.found == '{"ev":"emit","at":500,"t":1,"p":1}'
            assert violation.expected == '{"ev":"timer","at":500,"t":1,"p":1}'
    assert check(path).file == str(path)


def test_the_command_says_the_same_of_a_trace(command: str, tmp_path: Path) -> None:
    path = tmp_path / "late.jsonl"
    path.write_bytes(LATE)
    ended = subprocess.run(
        [command, "check", str(path)], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 1
    words = " ".join(ended.stdout.split())
    (violation,) = check(path).violations
    for part in (violation.sentence, violation.found, violation.expected, *violation.story):
        assert part in words


@pytest.mark.parametrize("observed", [False, True], ids=["strictly", "as-observed"])
def test_a_page_is_the_commands_page_to_the_byte(
    command: str, tmp_path: Path, observed: bool
) -> None:
    traces = [tmp_path / "good.jsonl", tmp_path / "late.jsonl"]
    traces[0].write_bytes(GOOD)
    traces[1].write_bytes(LATE)
    page = tmp_path / "page.html"
    argv = [command, "report", *map(str, traces), "-o", str(tmp_path / "theirs.html")]
    slack: dict[str, Any] = {}
    if observed:
        argv += ["--observed", "--tolerance", "3us", "--lateness", "1ms"]
        slack = {"tolerance": 3e-6, "lateness": timedelta(milliseconds=1)}
    done = subprocess.run(argv, capture_output=True, check=False)
    verdicts = report(*traces, page=page, **slack)
    assert verdicts == _each(traces, slack)
    assert [not verdict.violations for verdict in verdicts] == [True, observed]
    # With such a tolerance nothing is certain.
    assert done.returncode == (3 if observed else 1)
    assert page.read_bytes() == (tmp_path / "theirs.html").read_bytes()
    named = report(BAD[0].read_bytes(), page=page, names=["of <script>"])
    assert named[0].file == "of <script>"
    assert b"of \\u003cscript>" in page.read_bytes()


def _each(traces: list[Path], slack: dict[str, Any]) -> tuple[fuseline.Verdict, ...]:
    return tuple(check_observed(it, **slack) if slack else check(it) for it in traces)


def test_a_page_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text("before")
    with pytest.raises(fuseline.ReadError, match="broken"):
        report(GOOD, GOOD + b"broken\n", page=page, names=["good", "broken"])
    assert page.read_text() == "before"
    with pytest.raises(OSError):
        report(GOOD, page=tmp_path / "nowhere" / "page.html")
    # The disk has no room for the page.
    program = """
import resource, signal, sys, fuseline
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
fuseline.report(bytes(sys.argv[1], "ascii"), page=sys.argv[2])
"""
    argv = [sys.executable, "-c", program, GOOD.decode(), str(page)]
    done = subprocess.run(argv, capture_output=True, text=True, check=False)
    assert "OSError: [Errno 27] File too large" in done.stderr
    assert page.read_text() == "before"
    assert list(tmp_path.iterdir()) == [page]


@pytest.mark.parametrize(
    ("trace", "line", "column", "defect"),
    [
        (b"", 1, 1, "the trace is empty; its first line must be a header"),
        (HEADER + b'{"ev":"tick","at":-1}\n', 2, 19, None),
        (HEADER + b'{"ev":"tick","at":1}', 2, 21, "the last line does not end in LF"),
        (HEADER + HEADER, 2, 1, "a second header"),
        (HEADER + b"x" * 70_000 + b"\n", 2, 65537, "the line is longer than 64 KiB"),
        (gzip.compress(HEADER)[:-9], 2, 1, "incomplete deflate stream"),
    ],
)
def test_what_is_no_trace_is_refused_with_its_place(
    trace: bytes, line: int, column: int | None, defect: str | None
) -> None:
    for judge in (check, replay, Trace, lambda it: check_observed(it, tolerance=0, lateness=0)):
        with pytest.raises(fuseline.ReadError) as error:
            judge(trace)
        raised = error.value
        assert raised.line == line
        assert column is None or raised.column == column
        assert str(raised).startswith(f"<bytes>:{line}:")
        assert defect is None or defect in raised.defect


def test_a_file_that_is_not_there_is_an_os_error_with_its_name(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"gone\.jsonl"):
        check(tmp_path / "gone.jsonl")
    with pytest.raises(IsADirectoryError):
        check(tmp_path)
    with pytest.raises(TypeError, match="something that gives lines, not int"):
        check(cast(Any, 12))
    with pytest.raises(TypeError, match="a line is str or bytes, not int"):
        check(cast(Any, [1]))


def test_an_exception_of_the_lines_comes_through() -> None:
    def lines() -> Iterator[bytes]:
        yield from GOOD.splitlines(keepends=True)
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        check(lines())


def test_an_observed_trace_is_judged_within_its_tolerance() -> None:
    later = GOOD.replace(b"499", b"503")
    verdict = check_observed(later, tolerance=ns(1), lateness=0)
    assert not verdict.conforms
    assert verdict.violations[0].t == 1
    assert not check_observed(later, tolerance=ns(2), lateness=0).violations
    assert not check_observed(later, tolerance=2e-9, lateness=0.0).violations
    disorder = GOOD + b'{"ev":"tick","at":5}\n'
    out_of_order = r"^<bytes>:7:1: the line at 5 follows a line at 499"
    with pytest.raises(fuseline.ReadError, match=out_of_order):
        check_observed(disorder, tolerance=ns(10), lateness=0)


def test_sources_have_tolerances_of_their_own(tmp_path: Path) -> None:
    trace = b"""{"fuseline":1,"window":16,"clouds":[{"p":1,"name":"west","limit":31}]}
{"ev":"open","at":0,"t":1}
{"ev":"request","at":0,"t":1,"p":1,"due":500}
{"ev":"emit","at":501,"t":1,"p":1}
{"ev":"result","at":505,"t":1,"p":1}
"""
    own: dict[str, Any] = {"tolerance": ns(0), "lateness": ns(1)}
    assert not check_observed(trace, **own).conforms
    assert not check_observed(trace, **own, tolerances={"west": ns(5)}).violations
    assert check_observed(trace, **own, tolerances={"local": ns(5)}).violations
    page = tmp_path / "page.html"
    (verdict,) = report(trace, page=page, tolerances={"west": ns(5)}, **own)
    assert not verdict.violations


def test_other_threads_run_while_a_trace_is_judged() -> None:
    """The judge waits for a pipe that another Python thread fills."""
    read, write = os.pipe()

    def fill() -> None:
        with os.fdopen(write, "wb") as file:
            file.write(GOOD)

    thread = threading.Thread(target=fill)
    thread.start()
    verdict = check(f"/dev/fd/{read}")
    thread.join()
    os.close(read)
    assert verdict.conforms


def test_ctrl_c_ends_judging() -> None:
    """Judges a trace without an end in a process of its own."""
    endless = """
import fuseline, itertools, os, signal, sys
header = '{"fuseline":1,"window":16,"clouds":[]}'
def fifo(path):
    import threading
    def fill():
        with open(path, "wb", buffering=0) as out:
            out.write(header.encode() + b"\\n")
            tick = b'{"ev":"tick","at":1}\\n' * 1000
            print("judging", flush=True)
            try:
                while True: out.write(tick)
            except BrokenPipeError: pass
    threading.Thread(target=fill, daemon=True).start()
# A job in the background ignores it.
signal.signal(signal.SIGINT, signal.default_int_handler)
fifo(sys.argv[1])
try:
    fuseline.check(sys.argv[1])
except KeyboardInterrupt:
    print("interrupted", flush=True)
    os._exit(0)
"""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        fifo = f"{folder}/fifo"
        os.mkfifo(fifo)
        command = [sys.executable, "-c", endless, fifo]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            try:
                assert process.stdout.readline() == "judging\n"
                process.send_signal(signal.SIGINT)
                assert process.wait(60) == 0
                assert process.stdout.readline() == "interrupted\n"
            finally:
                process.kill()


def test_a_list_of_paths_stands_for_its_traces_and_one_of_lines_is_a_trace(tmp_path: Path) -> None:
    paths, page = CORPUS[:2], tmp_path / "page.html"
    lists: list[Any] = [paths, list(map(str, paths))]
    for given in lists:
        assert [it.file for it in report(given, page=page)] == list(map(str, paths))
    lines = paths[0].read_text().splitlines(keepends=True)
    (verdict,) = report(lines, page=page, names=["lines"])
    assert (verdict.file, verdict.lines) == ("lines", len(lines))


def test_verdict_has_each_figure_in_words_and_html() -> None:
    whole = (9, 4, "P2", "No late result leaves.", "<late>", "a miss")
    first = Violation(*whole, late=5, story=("3 | open", '4 "emit"'))
    violations = (first, Violation(7, None, *whole[2:]))
    verdict = Verdict("run.jsonl", False, 1234, 56789, violations, more=1001)
    assert (
        str(verdict)
        == """run.jsonl: does not conform; 1234 timestamps judged in 56789 lines
run.jsonl:9: timestamp 4 breaks P2: No late result leaves.
  found    <late>
  expected a miss
  | 3 | open
  | 4 "emit"
run.jsonl:7: breaks P2: No late result leaves.
  found    <late>
  expected a miss
1001 more violations"""
    )
    html = verdict._repr_html_()
    head, *rows = html.split("<tr")
    assert "#cf222e" in head and "1,234 timestamps judged in 56,789 lines" in head
    cells = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in rows]
    breaks = ["P2: No late result leaves.", "&lt;late&gt;", "a miss"]
    assert cells == [
        ["line", "timestamp", "rule", "found", "expected"],
        ["9", "4", *breaks],
        ["7", "", *breaks],
    ]
    assert 'title="3 | open\n4 &quot;emit&quot;"' in rows[1] and 'title=""' in rows[2]
    assert html.endswith("</table><p>1,001 more violations</p>")
    short = Verdict("run.jsonl", True, 1, 2, violations)
    assert "more violations" not in short._repr_html_() + str(short)
    good = Verdict("<b>run</b>", True, 1, 2)._repr_html_()
    assert "#1a7f37" in good and "&lt;b&gt;run&lt;/b&gt;" in good and "<table" not in good


def test_verdicts_are_tables() -> None:
    table = pa.concat_tables([check(GOOD, name="a").to_arrow(), check(LATE, name="b").to_arrow()])
    assert table.column("file").to_pylist() == ["a", "b"]
    assert table.column("conforms").to_pylist() == [True, False]
    assert table.column("rule").to_pylist() == [None, "F5"]
    assert table.column("line").to_pylist() == [None, 6]
    table.validate(full=True)


def test_a_trace_is_a_table_of_its_lines() -> None:
    table = Trace(GOOD).to_arrow()
    assert table.column("ev").to_pylist() == ["open", "offer", "request", "result", "emit"]
    assert table.column("due").to_pylist() == [None, None, 500, None, None]
    assert Trace(HEADER).to_arrow().num_rows == 0
    assert [Trace(GOOD).source(p) for p in (0, 1, 9)] == ["local", "cloud-1", "cloud-9"]


def test_further_keys_are_fields_and_columns() -> None:
    trace = b"""{"fuseline":1,"window":16,"local":"none","clouds":[{"p":1,"limit":31,"max_age":3}]}
{"ev":"open","at":9,"t":1,"within":50,"age":7,"origin":"camera","seq":41,"missing":["right"]}
{"ev":"request","at":9,"t":1,"p":1,"due":500,"try":2}
{"ev":"result","at":499,"t":1,"p":1,"of":0,"for":1,"try":2}
{"ev":"emit","at":499,"t":1,"p":1,"of":0,"for":1}
"""
    read = Trace(trace)
    assert (read.header["local"], read.header["clouds"][0]["max_age"]) == ("none", 3)
    table = read.to_arrow()
    table.validate(full=True)
    columns = {name: table.column(name).to_pylist() for name in table.column_names[-8:]}
    assert columns == {
        "of": [None, None, 0, 0],
        "meant_for": [None, None, 1, 1],
        "attempt": [None, 2, 2, None],
        "within": [50, None, None, None],
        "age": [7, None, None, None],
        "origin": ["camera", None, None, None],
        "seq": [41, None, None, None],
        "missing": [["right"], None, None, None],
    }


HUNG = b"""{"fuseline":1,"window":16,"clouds":[{"p":1,"limit":9}]}
{"ev":"open","at":0,"t":1}
{"ev":"result","at":1,"t":1,"p":0}
{"ev":"emit","at":1,"t":1,"p":0}
{"ev":"open","at":100,"t":2}
{"ev":"request","at":100,"t":2,"p":1,"due":200}
{"ev":"result","at":101,"t":2,"p":0}
"""


def test_a_run_that_is_over_owes_what_was_due() -> None:
    def judged(**known: Any) -> fuseline.Verdict:
        return fuseline.check_observed(HUNG, tolerance=ns(0), lateness=ns(10), **known)

    assert not judged().violations
    assert [it.rule for it in judged(ended=True).violations] == ["P5"]
    assert "unfinished" not in [it.kind for it in judged(ended=True).doubts]
    assert not judged(period=ns(200)).violations
    assert [it.rule for it in judged(period=ns(50)).violations] == ["J1"]
    strict = HUNG.split(b'{"ev":"open","at":100')[0] + b'{"ev":"open","at":100,"t":2}\n'
    doubts = fuseline.check(strict, ended=True).doubts
    assert [(it.kind, it.count) for it in doubts] == [("unfinished", 1)]


@pytest.mark.parametrize("path", DOUBTS, ids=lambda path: path.stem)
def test_doubts_are_those_of_the_corpus(path: Path) -> None:
    sidecar = json.loads(path.with_suffix(".json").read_text())
    known: dict[str, Any] = {"ended": sidecar.get("ended", False)}

    def judged(**more: Any) -> fuseline.Verdict:
        if slack := sidecar.get("observed"):
            within: dict[str, Any] = {name: ns(slack[name]) for name in ("tolerance", "lateness")}
            return check_observed(path, **within, **known, **more)
        return check(path, **known, **more)

    if "cut" in sidecar["doubts"]:
        with pytest.raises(fuseline.ReadError, match="cut short"):
            judged()
        return
    verdict = judged()
    assert {it.kind: it.count for it in verdict.doubts} == sidecar["doubts"]
    assert verdict.conforms == (not sidecar["doubts"])
    word = "conforms" if verdict.conforms else "no violation found"
    assert f": {word}; {verdict.judged} timestamps judged" in str(verdict)
    assert word in verdict._repr_html_()
    accepted = judged(accept=list(sidecar["doubts"]))
    assert accepted.conforms and all(it.accepted for it in accepted.doubts)
    with pytest.raises(ValueError, match="'rumour' is not a kind of doubt; the kinds are unjudged"):
        verdict.accepting("rumour")  # type: ignore[arg-type]
