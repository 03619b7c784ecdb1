"""Checks that the book's chapter of theorems says what is here.

    page.py PAGE

Each promise has a row. Each statement that a row names stands under a sentence, and has a case where its hypothesis holds and one
where a faulty machine breaks it. Each obligation for solvers and each group of harnesses has its reason to stay, once.
"""

import json
import re
import sys
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent.parent
# These are computed cases themselves.
WITHOUT_CASES = re.compile(r"t4_")
# These state a promise of many threads' traces; its cases are theirs, and there is one of what they suppose.
OF_THREADS = re.compile(r"s8_(?=[pf]\d)")


def rows(text, heading):
    """The first two cells of each row of a table."""
    table = text[text.index(f"| {heading} |") :].split("\n\n")[0]
    return [[cell.strip() for cell in line.split(" |")[:2]] for line in table.split("\n")[2:]]


def faults_of(name, text):
    """What is wrong with a statement, if anything."""
    found = re.search(rf"((?:^.*\n){{0,12}}?)^ *(?:Definition|Theorem|Example) {name}\b", text, re.M)
    if not found:
        yield "is not here"
        return
    above = text[: found.end()].split("\n")[:-1]
    while above and above[-1].lstrip().startswith("(* ANCHOR"):
        above.pop()
    comment = "\n".join(above)
    sentence = comment[comment.rfind("(*") :] if comment.endswith("*)") else ""
    if len(sentence.split()) < 6 or "." not in sentence or not sentence.startswith("(** ") or sentence.startswith("(** *"):
        yield "has no sentence above it"
    if WITHOUT_CASES.match(name):
        return
    case = OF_THREADS.sub("", name.lower())
    if case != name.lower() and not re.search(r"^Example s8_calls_happen\b", text, re.M):
        yield "has no case s8_calls_happen"
    if not re.search(rf"^Example {case}_happens\b", text, re.M):
        yield f"has no case {case}_happens"
    broken = re.search(rf"^Example {case}_can_break\b(?s:.*?)\bProof\b", text, re.M)
    if not broken:
        yield f"has no case {case}_can_break"
    elif name[0].isupper() and f"~ {name}" not in broken[0]:
        yield f"{case}_can_break is of another statement"


def main():
    page = Path(sys.argv[1]).read_text(encoding="utf-8")
    text = "\n".join(path.read_text(encoding="utf-8") for path in sorted(HERE.glob("*.v")))
    wrong = []
    promises = rows(page, "promise")
    names = [name for _, statements in promises for name in re.findall(r"`(\w+)`", statements)]
    names += sorted(set(re.findall(r"^Theorem (s8_[pf]\d\w*)", text, re.M)) - set(names))
    for name in names:
        wrong += [f"{name} {why}" for why in faults_of(name, text)]
    spec = (ROOT / "SPEC.md").read_text(encoding="utf-8")
    chapter = spec[spec.index("\n## 4 ") : spec.index("\n## 5 ")]
    titles = " ".join(title for title, _ in promises)
    wrong += [f"{it} has no row" for it in re.findall(r"^\| (P\d+) ", chapter, re.M) if not re.search(rf"\b{it}\b", titles)]
    stays = re.findall(r"`([\w-]+)`", " ".join(left for left, _ in rows(page, "stays")))
    obligations = json.loads((ROOT / "proofs/rules/record.json").read_text(encoding="utf-8"))["obligations"]
    groups = [path.stem for path in (ROOT / "proofs/src/harness").glob("*.rs")]
    wanted = [it["name"] for it in obligations] + groups
    wrong += [f"{it} has {stays.count(it)} reasons to stay" for it in wanted if stays.count(it) != 1]
    wrong += [f"{it} has a reason and is neither an obligation nor a group of harnesses" for it in set(stays) - set(wanted)]
    if wrong:
        sys.exit("\n".join(f"error: {sys.argv[1]}: {why}" for why in wrong))
    print(f"{len(names)} statements of {len(promises)} rows have a sentence and their cases; "
          f"{len(wanted)} obligations and harness groups a reason to stay")


main()
