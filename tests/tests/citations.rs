//! Checks that every identifier that is cited exists, and that code and a test or trace cite every
//! rule and promise.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use ignore::WalkBuilder;
use regex::Regex;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// Words that look like an identifier, with what they are.
const OTHER_WORDS: [(&str, &str); 6] = [
    ("A100", "a graphics processor"),
    ("F32", "a number type"),
    ("F64", "a number type"),
    ("P50", "a percentile"),
    ("P90", "a percentile"),
    ("P99", "a percentile"),
];

/// An identifier in a comment, a document or a string.
static WORD: LazyLock<Regex> = LazyLock::new(|| regex(r"\b([FPATDJE]\d{1,3}g?)\b"));
/// An identifier at the start of a function's name.
static FUNCTION: LazyLock<Regex> = LazyLock::new(|| regex(r"\bfn ([fpatdje]\d+g?)_"));
/// Identifiers at the start of a trace's name.
static TRACE: LazyLock<Regex> = LazyLock::new(|| regex(r"^([fpadje]\d+g?)-"));
/// The places of definitions in the specification: a rule's heading, and a promise's or an
/// ambiguity's row.
static DEFINITION: LazyLock<Regex> =
    LazyLock::new(|| regex(r"(?m)^(?:### (F\d+g?) |\| ([PTDJE]\d+) |\| (A\d+) \|)"));

fn regex(pattern: &str) -> Regex {
    Regex::new(pattern).expect("a sound pattern")
}

/// The kind of witness that a citation is.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum WitnessKind {
    /// Shipped code.
    Code,
    /// A test, or a trace of the corpus.
    Witness,
    /// Anything else. It must cite what exists, and proves nothing.
    Text,
}

/// An identifier and the place that cites it.
#[derive(Clone, PartialEq, Eq, Debug)]
struct Citation {
    id: String,
    kind: WitnessKind,
    /// The place as `file:line`.
    at: String,
}

fn spec() -> String {
    fs::read_to_string(Path::new(ROOT).join("SPEC.md")).expect("SPEC.md is there")
}

/// Returns the identifiers in the order in which they are defined.
fn defined(spec: &str) -> Vec<String> {
    let id = |found: regex::Captures| {
        found.iter().skip(1).flatten().next().map(|id| id.as_str().to_owned())
    };
    DEFINITION.captures_iter(spec).filter_map(id).collect()
}

/// Returns all files that the project keeps, without those that git ignores.
fn files() -> impl Iterator<Item = PathBuf> {
    let walk = WalkBuilder::new(ROOT).require_git(false).build();
    walk.map(|entry| entry.expect("a readable folder").into_path()).filter(|path| path.is_file())
}

fn is_witness(file: &Path) -> bool {
    let within = |folder: &str| file.components().any(|part| part.as_os_str() == folder);
    within("tests") || within("testkit") || within("corpus") || file.ends_with("tests.rs")
}

/// Returns the citations of one file, whose path is relative to the root.
fn citations(file: &Path, text: &str) -> Vec<Citation> {
    let mut found = Vec::new();
    let mut kind = match file.extension().and_then(|extension| extension.to_str()) {
        _ if is_witness(file) => WitnessKind::Witness,
        Some("rs") => WitnessKind::Code,
        _ => WitnessKind::Text,
    };
    for (number, line) in (1_u32..).zip(text.lines()) {
        if kind == WitnessKind::Code && line.trim_start().starts_with("mod tests {") {
            kind = WitnessKind::Witness;
        }
        let ids = WORD.captures_iter(line).chain(FUNCTION.captures_iter(line));
        for id in ids.map(|captures| identifier(&captures[1])) {
            if !OTHER_WORDS.iter().any(|(word, _)| *word == id) {
                found.push(Citation { id, kind, at: format!("{}:{number}", file.display()) });
            }
        }
    }
    found
}

/// Returns the identifier as the specification writes it: `f2g` becomes `F2g`.
fn identifier(word: &str) -> String {
    let mut id = word.to_owned();
    id[..1].make_ascii_uppercase();
    id
}

/// Returns the citations of the whole project, with names of traces, but without the
/// specification's own.
fn all_citations() -> Vec<Citation> {
    let mut all = Vec::new();
    for path in files() {
        let file = path.strip_prefix(ROOT).unwrap_or(&path);
        let name = file.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        match file.extension().and_then(|extension| extension.to_str()) {
            Some("jsonl") => all.extend(TRACE.captures(name).map(|captures| Citation {
                id: identifier(&captures[1]),
                kind: WitnessKind::Witness,
                at: file.display().to_string(),
            })),
            // This file's own examples are not witnesses.
            _ if name == "SPEC.md" || name == "citations.rs" => {}
            Some("rs" | "md" | "json" | "toml") => {
                all.extend(citations(file, &fs::read_to_string(&path).expect("UTF-8")));
            }
            Some("v") => {
                let text = fs::read_to_string(&path).expect("UTF-8");
                all.extend(citations(file, &comments(&text)));
            }
            _ => {}
        }
    }
    all
}

/// Returns the comments of a Coq file, each in its line; names in its proofs are not identifiers.
fn comments(text: &str) -> String {
    let mut kept = String::new();
    let mut depth = 0_usize;
    for word in text.split_inclusive([' ', '\n']) {
        depth += word.matches("(*").count();
        kept.push_str(if depth > 0 {
            word
        } else if word.ends_with('\n') {
            "\n"
        } else {
            " "
        });
        depth = depth.saturating_sub(word.matches("*)").count());
    }
    kept
}

/// Returns the citations of identifiers that are not defined.
fn unknown<'a>(defined: &[String], citations: &'a [Citation]) -> Vec<&'a Citation> {
    citations.iter().filter(|citation| !defined.contains(&citation.id)).collect()
}

/// Returns the rules and promises that no citation of this kind names.
fn uncited(defined: &[String], citations: &[Citation], kind: WitnessKind) -> Vec<String> {
    let cited: BTreeSet<_> = citations
        .iter()
        .filter(|citation| citation.kind == kind)
        .map(|citation| &citation.id)
        .collect();
    defined.iter().filter(|id| !id.starts_with('A') && !cited.contains(id)).cloned().collect()
}

#[test]
fn every_cited_identifier_exists() {
    let citations = all_citations();
    assert!(citations.len() > 100, "the project was not read: {} citations", citations.len());
    let unknown = unknown(&defined(&spec()), &citations);
    assert!(unknown.is_empty(), "SPEC.md does not define {unknown:#?}");
}

#[test]
fn every_rule_and_promise_is_cited_by_code() {
    let uncited = uncited(&defined(&spec()), &all_citations(), WitnessKind::Code);
    assert!(uncited.is_empty(), "no code cites {uncited:?}");
}

#[test]
fn every_rule_and_promise_is_cited_by_a_test_or_trace() {
    let uncited = uncited(&defined(&spec()), &all_citations(), WitnessKind::Witness);
    assert!(uncited.is_empty(), "no test or trace cites {uncited:?}");
}

#[test]
fn identifiers_are_defined_once_and_without_gaps() {
    let mut families: BTreeMap<char, Vec<String>> = BTreeMap::new();
    for id in defined(&spec()) {
        families.entry(id.chars().next().unwrap_or_default()).or_default().push(id);
    }
    let numbered = |family: char, from: usize, to: usize| -> Vec<String> {
        (from..=to).map(|number| format!("{family}{number}")).collect()
    };
    let mut rules = numbered('F', 0, 9);
    rules.insert(3, "F2g".into());
    assert_eq!(families[&'F'], rules);
    assert_eq!(families[&'P'], numbered('P', 1, 13));
    let last = families[&'A'].len();
    assert!(last >= 17, "ambiguities went missing: {last}");
    assert_eq!(families[&'A'], numbered('A', 1, last));
}

#[test]
fn every_rule_and_ambiguity_names_its_place_in_paper() {
    let spec = spec();
    let marks = ["design", "techniques", "feasibility", "scenarios", "conclusion", "silent"];
    let is_marked = |text: &str| marks.iter().any(|mark| text.contains(mark));
    let table = spec.split("\n## 1 ").next().unwrap_or_default();
    assert!(
        marks.iter().all(|mark| table.contains(&format!("*{mark}"))),
        "a mark is not explained"
    );
    let rules = spec.split("\n### ").filter(|section| section.starts_with('F'));
    for section in rules {
        let paper = section.split_once("\n*Paper, ").map(|(_, paper)| paper);
        assert!(paper.is_some_and(is_marked), "{}", section.lines().next().unwrap_or_default());
    }
    let row = regex(r"^\| A\d+ \|");
    for line in spec.lines().filter(|line| row.is_match(line)) {
        let cells: Vec<_> = line.split('|').collect();
        assert_eq!(cells.len(), 6, "{line}");
        assert!(is_marked(cells[4]), "{line}");
    }
}

#[test]
fn an_identifier_beyond_the_specification_is_found() {
    let text = "/// P14: nothing of the kind, on an A100.\nfn f10_is_no_rule() {}";
    let cited = citations(Path::new("core/src/slot.rs"), text);
    let ids: Vec<_> = unknown(&defined(&spec()), &cited).into_iter().map(|c| &*c.id).collect();
    assert_eq!(ids, ["P14", "F10"]);
}

#[test]
fn rule_cited_only_by_tests_is_uncited_by_code() {
    let spec = ["F3".to_owned(), "P2".to_owned()];
    let text = "// F3 late.\n#[cfg(test)]\nmod tests {\n#[test]\nfn p2_never_late() {}\n}";
    let cited = citations(Path::new("core/src/slot.rs"), text);
    assert_eq!(uncited(&spec, &cited, WitnessKind::Code), ["P2"]);
    assert_eq!(uncited(&spec, &cited, WitnessKind::Witness), ["F3"]);
    let elsewhere = citations(Path::new("core/src/slot/tests.rs"), "// F3");
    assert_eq!(elsewhere[0].kind, WitnessKind::Witness);
}

#[test]
fn of_a_file_of_coq_its_comments_are_read() {
    let text =
        "Lemma a : T9.\n(** P2 never\n    late. *)\nProof. destruct A as [F3 D99]. Qed. (* F4 *)\n";
    let cited = citations(Path::new("proofs/coq/A.v"), &comments(text));
    let found: Vec<_> = cited.iter().map(|citation| (&*citation.id, &*citation.at)).collect();
    assert_eq!(found, [("P2", "proofs/coq/A.v:2"), ("F4", "proofs/coq/A.v:4")]);
}
