"""Reads exports and findings of `fuseline` with the libraries of MCAP and SARIF: viewers.py FUSELINE."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from mcap.reader import make_reader
from sarif.loader import load_sarif_file

FUSELINE = sys.argv[1]
CORPUS = Path("traces/corpus")
TRACE = CORPUS / "f5-coarse-tick-decides-what-fine-ticks-decide-eager.jsonl"

with tempfile.TemporaryDirectory() as work:
    exported, findings = Path(work, "trace.mcap"), Path(work, "found.sarif")
    subprocess.run([FUSELINE, "export", "--mcap", TRACE, "-o", exported], check=True)
    with exported.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        messages = [(c.topic, m.log_time, json.loads(m.data)) for _, c, m in reader.iter_messages(log_time_order=False)]
    lines = [{key: value for key, value in json.loads(line).items() if key != "x"} for line in TRACE.open()]
    read = [line for topic, _, line in messages if topic == "/fuseline/trace"]
    outputs = [line for topic, _, line in messages if topic == "/fuseline/outputs"]
    assert read == lines, "the lines differ"
    assert outputs == [line for line in lines if line.get("ev") in ("emit", "miss")], "the outputs differ"
    assert all(at == line.get("at", 0) for _, at, line in messages), "the log times differ"
    print(f"mcap read {len(read)} lines and {len(outputs)} outputs back")

    check = [FUSELINE, "check", "--sarif", findings, *sorted(CORPUS.glob("bad/*.jsonl")), TRACE]
    printed = subprocess.run(check, stdout=subprocess.PIPE, text=True)
    assert printed.returncode == 1, printed.returncode
    violations = printed.stdout.count("breaks ")
    found = load_sarif_file(findings).get_records()
    assert len(found) == violations > 60, (len(found), violations)
    print(f"sarif-tools read {violations} violations back")
