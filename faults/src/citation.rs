//! Identifiers: where the specification defines them, and where they are cited.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::LazyLock;

use regex::Regex;

use crate::error::FaultsError;
use crate::kind::WitnessKind;
use crate::tree::Tree;

/// The folders of the code that meets the rules.
const CODE: [&str; 9] = [
    "core/src",
    "adapters/engine/src",
    "adapters/ros2/src",
    "adapters/threads/src",
    "adapters/tokio/src",
    "deadline/src",
    "traces/src/observed/gap.rs",
    "traces/src/observed/violation.rs",
    "traces/src/reference.rs",
];
/// The libraries whose own tests are witnesses, with their folders.
const CRATES: [(&str, &str); 9] = [
    ("fuseline", "cli"),
    ("fuseline_core", "core"),
    ("fuseline_deadline", "deadline"),
    ("fuseline_engine", "adapters/engine"),
    ("fuseline_tokio", "adapters/tokio"),
    ("fuseline_report", "cli/report"),
    ("fuseline_ros2", "adapters/ros2"),
    ("fuseline_threads", "adapters/threads"),
    ("fuseline_traces", "traces"),
];
/// The folder of Python's tests.
const PYTHON_TESTS: &str = "adapters/python/tests";
/// The folders of other tests.
const TESTS: [&str; 9] = [
    "tests/tests",
    "tests/system/tests",
    "deadline/tests",
    "adapters/engine/tests",
    "adapters/threads/tests",
    "adapters/tokio/tests",
    "adapters/ros2/tests",
    "traces/tests",
    "cli/tests",
];

static DEFINITION: LazyLock<Regex> = LazyLock::new(|| {
    regex(r"(?m)^(?:### (F\d+g?) (.+)|\| ([PTDJE]\d+) ([^|]+) \||\| (A\d+) \| ([^|]+) \|)")
});
/// The folder of the proof harnesses, with a file for each group.
const HARNESSES: &str = "proofs/src/harness";
/// One identifier, or the first and the last of several.
static WORD: LazyLock<Regex> =
    LazyLock::new(|| regex(r"\b([FPATDJE])(\d+)(g?)(?:–([FPATDJE])(\d+))?\b"));
/// Words that look like an identifier but are not: a graphics processor, number types, percentiles.
const OTHER_WORDS: [&str; 6] = ["A100", "F32", "F64", "P50", "P90", "P99"];

/// Returns the identifiers in the order of their definition, each with its title.
pub(crate) fn defined(tree: &Tree) -> Result<Vec<(String, String)>, FaultsError> {
    let spec = tree.text("SPEC.md")?;
    let pair = |found: regex::Captures| {
        let mut parts = found.iter().skip(1).flatten().map(|part| part.as_str().trim().to_owned());
        Some((parts.next()?, parts.next()?))
    };
    Ok(DEFINITION.captures_iter(&spec).filter_map(pair).collect())
}

/// Returns the identifiers in a text. `F2–F7` stands for all from the first to the last.
pub(crate) fn identifiers(text: &str) -> BTreeSet<String> {
    let mut ids = BTreeSet::new();
    for found in WORD.captures_iter(text).filter(|found| !OTHER_WORDS.contains(&&found[0])) {
        match (found.get(4), found.get(5)) {
            (Some(_), Some(last)) => ids.extend(range(&found[1], &found[2], last.as_str())),
            _ => drop(ids.insert(format!("{}{}{}", &found[1], &found[2], &found[3]))),
        }
    }
    ids
}

/// Returns the identifiers in a function's name. `p1_to_p9` stands for all from the first to the
/// last.
pub(crate) fn named(name: &str) -> BTreeSet<String> {
    let parts: Vec<&str> = name.split('_').collect();
    let mut ids = BTreeSet::new();
    for (i, part) in parts.iter().enumerate() {
        let Some(id) = upper(part) else { continue };
        if let (Some(&"to"), Some(last)) =
            (parts.get(i + 1), parts.get(i + 2).and_then(|p| upper(p)))
        {
            ids.extend(range(&id[..1], &id[1..], &last[1..]));
        }
        ids.insert(id);
    }
    ids
}

/// Returns the lines of the code that cite each identifier, `file:line`.
pub(crate) fn code(tree: &Tree) -> Result<BTreeMap<String, Vec<String>>, FaultsError> {
    let mut places: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for file in tree.files(&CODE)? {
        let is_code = Path::new(&file).extension().is_some_and(|extension| extension == "rs");
        if !is_code || file.ends_with("tests.rs") {
            continue;
        }
        let text = tree.text(&file)?;
        let own = text.lines().take_while(|line| !line.trim_start().starts_with("mod tests {"));
        for (number, line) in (1_u32..).zip(own) {
            for id in identifiers(line) {
                places.entry(id).or_default().push(format!("{file}:{number}"));
            }
        }
    }
    Ok(places)
}

/// Returns the identifiers that witnesses of a kind cite. A witness that ends in a parenthesis is a
/// program whose failed test is unknown, so it cites none.
pub(crate) fn cited(
    tree: &Tree,
    kind: &WitnessKind,
    witnesses: &BTreeSet<String>,
) -> Result<BTreeSet<String>, FaultsError> {
    let mut ids = BTreeSet::new();
    for witness in witnesses.iter().filter(|witness| !witness.ends_with(')')) {
        ids.extend((kind.cites)(tree, witness)?);
    }
    Ok(ids)
}

/// Returns the identifiers that a test's name, documentation and body cite.
pub(crate) fn cited_by_test(tree: &Tree, witness: &str) -> Result<BTreeSet<String>, FaultsError> {
    let mut parts: Vec<&str> = witness.split("::").collect();
    let name = parts.pop().unwrap_or_default();
    // Programs of two crates may have the same name.
    for file in files_of_test(tree, &parts) {
        if let Some(function) = function(&tree.text(&file)?, name) {
            let mut cited = named(name);
            cited.extend(identifiers(&function));
            return Ok(cited);
        }
    }
    Err(FaultsError::content(Path::new(witness), "no file has this test".to_owned()))
}

/// Returns the identifiers that the name, documentation and body of a Python test cite.
pub(crate) fn cited_by_pytest(tree: &Tree, witness: &str) -> Result<BTreeSet<String>, FaultsError> {
    let (module, name) = witness.split_once("::").unwrap_or((witness, ""));
    let file = format!("{PYTHON_TESTS}/{module}.py");
    let text = tree.text(&file)?;
    let Some(function) = python_function(&text, name) else {
        return Err(FaultsError::content(Path::new(&file), format!("no test {name} here")));
    };
    let mut cited = named(name);
    cited.extend(identifiers(&function));
    Ok(cited)
}

/// Returns a function of a module of Python with its decorators and the comments above it.
fn python_function(text: &str, name: &str) -> Option<String> {
    let lines: Vec<&str> = text.lines().collect();
    let heads = [format!("def {name}("), format!("async def {name}(")];
    let at = lines.iter().position(|line| heads.iter().any(|head| line.starts_with(head)))?;
    let is_above = |line: &&&str| !line.is_empty() && !line.starts_with(' ');
    let above = lines.iter().take(at).rev().take_while(is_above).count();
    // Its arguments may end with a bracket at the margin.
    let is_below = |line: &&&str| line.is_empty() || line.starts_with([' ', ')']);
    let below = lines.iter().skip(at + 1).take_while(is_below).count();
    Some(lines[at - above..=at + below].join("\n"))
}

/// Returns the files that may have a test, by its target and modules: a library's own tests, and
/// those in folders of tests.
fn files_of_test(tree: &Tree, path: &[&str]) -> Vec<String> {
    let Some((target, modules)) = path.split_first() else { return Vec::new() };
    let whole = modules.join("/");
    let modules: Vec<&str> = modules.iter().copied().filter(|m| *m != "tests").collect();
    let own = CRATES.iter().find(|(name, _)| name == target).map(|(_, folder)| {
        let module = format!("{folder}/src/{}", modules.join("/"));
        let of_tests = format!("{folder}/src/{whole}.rs");
        [of_tests, format!("{module}/tests.rs"), format!("{module}.rs"), format!("{module}/mod.rs")]
    });
    let apart = TESTS.iter().flat_map(|folder| {
        let inner = format!("{folder}/{target}/{}.rs", modules.join("/"));
        [inner, format!("{folder}/{target}.rs"), format!("{folder}/{target}/main.rs")]
    });
    own.into_iter().flatten().chain(apart).filter(|file| tree.path(file).exists()).collect()
}

/// Returns a function and the lines directly above it.
fn function(text: &str, name: &str) -> Option<String> {
    let lines: Vec<&str> = text.lines().collect();
    let head = format!("fn {name}(");
    let at = lines.iter().position(|line| {
        let words = line.trim_start().trim_start_matches("pub ");
        words.trim_start_matches("async ").starts_with(&head)
    })?;
    let is_above = |line: &&&str| matches!(line.trim_start().as_bytes(), [b'/' | b'#', ..]);
    let above = lines.iter().take(at).rev().take_while(is_above).count();
    let indent = lines[at].len() - lines[at].trim_start().len();
    let end = format!("{:indent$}}}", "");
    let below = lines.iter().skip(at).position(|line| *line == end)?;
    Some(lines[at - above..=at + below].join("\n"))
}

/// Returns the identifiers that a harness's name, documentation and body cite.
pub(crate) fn cited_by_harness(
    tree: &Tree,
    witness: &str,
) -> Result<BTreeSet<String>, FaultsError> {
    let mut cited = named(witness);
    for file in tree.files(&[HARNESSES])? {
        if let Some(function) = function(&tree.text(&file)?, witness) {
            cited.extend(identifiers(&function));
            return Ok(cited);
        }
    }
    Err(FaultsError::content(Path::new(HARNESSES), format!("no harness {witness} here")))
}

/// Returns the identifiers that a trace's name and header cite.
pub(crate) fn cited_by_trace(tree: &Tree, witness: &str) -> Result<BTreeSet<String>, FaultsError> {
    let text = tree.text(&format!("traces/corpus/{witness}.jsonl"))?;
    let mut cited = identifiers(text.lines().next().unwrap_or_default());
    cited.extend(named(&witness.replace('-', "_")));
    Ok(cited)
}

fn range(family: &str, first: &str, last: &str) -> Vec<String> {
    let number = |text: &str| text.parse::<u32>().unwrap_or_default();
    let (first, last) = (number(first), number(last));
    let mut ids: Vec<String> = (first..=last).map(|n| format!("{family}{n}")).collect();
    if family == "F" && (first..=last).contains(&2) && last > 2 {
        ids.push("F2g".to_owned());
    }
    ids
}

/// Returns a part of a name as an identifier, or `None` if it is not one.
fn upper(part: &str) -> Option<String> {
    let mut letters = part.chars();
    let family = letters.next().filter(|letter| "fpatdej".contains(*letter))?;
    let number = letters.as_str();
    let number = number.strip_suffix('g').unwrap_or(number);
    let is_id = !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit());
    is_id.then(|| format!("{}{}", family.to_ascii_uppercase(), letters.as_str()))
}

fn regex(pattern: &str) -> Regex {
    Regex::new(pattern).expect("a sound pattern")
}

#[cfg(test)]
mod tests;
