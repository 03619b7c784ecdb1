"""Checks that the book's chapter of theorems says what is here.

    page.py PAGE FILE

Each rule and each promise of SPEC.md that theorems could speak of has a row, with its theorems or with the words that say that there are
none. Each theorem that a row names is here, under a sentence, and has a case where its hypothesis holds and one where a faulty machine
breaks it. FILE is written: with it Coq prints the axioms that each of these theorems rests on.
"""

import re
import sys
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent.parent
# These are computed cases themselves.
WITHOUT_CASES = re.compile(r"t4_")
# A theorem with `s8_` states about the traces of many threads what the theorem without it states
# about one run. Both have the same cases.
OF_THREADS = re.compile(r"s8_(?=[pf]\d)")
TEXTS = {path.stem: path.read_text(encoding="utf-8") for path in sorted(HERE.glob("*.v"))}
TEXT = "\n".join(TEXTS.values())


def rows(page):
    """Returns the cells of each row of the table."""
    table = page[page.index("| identifier |") :].split("\n\n")[0]
    return [[cell.strip() for cell in line.strip("|").split(" |")] for line in table.split("\n")[2:]]


def identifiers():
    """Returns the identifiers of the rules and of the promises of the machine, of deadlines and of pipelines."""
    spec = (ROOT / "SPEC.md").read_text(encoding="utf-8")
    return re.findall(r"^### (F\d+g?) ", spec, re.M) + re.findall(r"^\| ([PTE]\d+) ", spec, re.M)


def home(theorem):
    """Returns the file that has a theorem, or None unless exactly one has it."""
    found = [name for name, text in TEXTS.items() if re.search(rf"^(?:Theorem|Example) {theorem}\b", text, re.M)]
    return found[0] if len(found) == 1 else None


def wrong_with(theorem):
    """Yields what is wrong with a theorem."""
    if not home(theorem):
        yield "is not here"
        return
    statement = theorem[0].upper() + theorem[1:]
    named = re.search(rf"^Definition {statement}\b", TEXT, re.M)
    name = statement if named else theorem
    found = re.search(rf"((?:^.*\n){{0,12}}?)^ *(?:Definition|Theorem|Example) {name}\b", TEXT, re.M)
    above = TEXT[: found.end()].split("\n")[:-1]
    # The statement about one timestamp stands between the sentence and the statement about all
    # timestamps.
    while above and (above[-1].startswith(("(* ANCHOR", "Definition", " ")) and not above[-1].endswith("*)") or "ANCHOR" in above[-1]):
        above.pop()
    comment = "\n".join(above)
    sentence = comment[comment.rfind("(*") :] if comment.endswith("*)") else ""
    if len(sentence.split()) < 6 or "." not in sentence or not sentence.startswith("(** ") or sentence.startswith("(** *"):
        yield "has no sentence above it"
    if WITHOUT_CASES.match(theorem):
        return
    case = OF_THREADS.sub("", theorem)
    if case != theorem and not re.search(r"^Example s8_calls_happen\b", TEXT, re.M):
        yield "has no case s8_calls_happen"
    if not re.search(rf"^Example {case}_happens\b", TEXT, re.M):
        yield f"has no case {case}_happens"
    broken = re.search(rf"^Example {case}_can_break\b(?s:.*?)\bProof\b", TEXT, re.M)
    if not broken:
        yield f"has no case {case}_can_break"
    elif named and f"~ {statement}" not in broken[0]:
        yield f"{case}_can_break is of another statement"


def main():
    page, file = map(Path, sys.argv[1:])
    table = rows(page.read_text(encoding="utf-8"))
    wrong = []
    titles = [it for row in table for it in re.findall(r"\b[FPTE]\d+g?\b", row[0]) if "section" not in row[0]]
    wanted = identifiers()
    wrong += [f"{it} has {titles.count(it)} rows" for it in wanted if titles.count(it) != 1]
    wrong += [f"{it} has a row and is not in SPEC.md" for it in set(titles) - set(wanted)]
    theorems = []
    for title, proved, missing in table:
        named = re.findall(r"`(\w+)`", proved)
        theorems += named
        if not named and not missing:
            wrong.append(f"{title} has neither theorems nor what is not proved")
    for name in theorems:
        wrong += [f"{name} {why}" for why in wrong_with(name)]
    here = re.findall(r"^Theorem ([fp]\d\w*|s8_\w+)", TEXT, re.M)
    wrong += [f"{name} is a theorem that no row names" for name in here if name not in theorems]
    if wrong:
        sys.exit("\n".join(f"error: {page}: {why}" for why in wrong))
    names = sorted(f"{home(name)}.{name}" for name in set(theorems))
    modules = sorted({name.split(".")[0] for name in names})
    lines = [f"From Fuseline Require {' '.join(modules)}.", *(f"Print Assumptions {name}." for name in names)]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"{len(names)} theorems of {len(table)} rows have a sentence and their cases; every identifier has its row")


main()
