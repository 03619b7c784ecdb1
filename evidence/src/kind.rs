//! The kinds of witness. A new kind is one entry here.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::LazyLock;

use regex::Regex;

use crate::citation::{named, words};
use crate::error::Error;
use crate::fault::SeededFault;
use crate::sources::{
    ARBITER, CORE, CORPUS, KIT, NO_LIST, NO_LIST_OF_KIT, NO_LIST_OF_THREADS, NO_LIST_OF_TRACES,
    NO_OBSERVED, TESTS, THREADS, TRACES,
};
use crate::tree::Tree;

/// What a run printed, by witness: whether it held.
pub(crate) type Outcomes = BTreeMap<String, bool>;

/// One kind of witness: how it is run, what it printed means, and what each witness cites.
pub struct Kind {
    /// Its name, which is that of its record too.
    pub name: &'static str,
    /// What its witnesses are, for readers.
    pub title: &'static str,
    /// Which identifiers must have a witness of this kind.
    pub(crate) applies: fn(&str) -> bool,
    /// Which faults its witnesses could see.
    pub(crate) concerns: fn(&SeededFault) -> bool,
    pub(crate) run: Run,
    /// The files that the results depend on.
    pub(crate) sources: &'static [&'static str],
    /// Reads what cargo printed.
    pub(crate) read: fn(&str) -> Outcomes,
    /// The identifiers that a witness cites.
    pub(crate) cites: fn(&Tree, &str) -> Result<BTreeSet<String>, Error>,
}

/// How the witnesses of a kind run.
pub(crate) enum Run {
    /// cargo with these arguments and variables, under every fault.
    Cargo { arguments: &'static [&'static str], variables: &'static [(&'static str, &'static str)] },
    /// A command of its own, which keeps its own record and holds it against the sources in each run of it.
    Prove,
}

/// All of them.
pub const KINDS: &[Kind] = &[
    Kind {
        name: "test",
        title: "tests",
        applies: |_| true,
        concerns: is_of_machine,
        run: Run::Cargo {
            arguments: &[
                "test",
                "-p",
                "fuseline-core",
                "-p",
                "fuseline-tests",
                "--lib",
                "--test",
                "rules",
                "--test",
                "surface",
                "--test",
                "differential",
                "--test",
                "window",
                "--no-fail-fast",
            ],
            variables: &[],
        },
        sources: &[
            CORE,
            NO_LIST,
            ARBITER,
            TRACES,
            NO_LIST_OF_TRACES,
            NO_OBSERVED,
            CORPUS,
            KIT,
            NO_LIST_OF_KIT,
            TESTS,
            "tests/tests/rules.rs",
            "tests/tests/differential.rs",
            "tests/tests/surface.rs",
            "tests/tests/window.rs",
        ],
        read: read_tests,
        cites: cited_by_test,
    },
    Kind {
        name: "trace",
        title: "traces of the corpus",
        applies: |id| id.starts_with('F'),
        concerns: is_of_machine,
        run: Run::Cargo {
            arguments: &["run", "-p", "fuseline-tests", "--example", "corpus"],
            variables: &[],
        },
        sources: &[
            CORE,
            NO_LIST,
            ARBITER,
            TRACES,
            NO_LIST_OF_TRACES,
            NO_OBSERVED,
            CORPUS,
            "tests/examples/corpus.rs",
        ],
        read: read_tests,
        cites: cited_by_trace,
    },
    Kind {
        name: "model",
        title: "properties of the models",
        applies: |_| true,
        concerns: is_of_machine,
        run: Run::Cargo {
            arguments: &[
                "run",
                "--release",
                "-p",
                "fuseline-models",
                "--",
                "check",
                "--quick",
                "--keep-going",
                "--threads",
                "1",
                "--json",
            ],
            variables: &[],
        },
        sources: &[
            CORE,
            NO_LIST,
            TRACES,
            NO_LIST_OF_TRACES,
            NO_OBSERVED,
            KIT,
            NO_LIST_OF_KIT,
            "models/src",
        ],
        read: read_models,
        cites: |_, witness| Ok(words(witness)),
    },
    Kind {
        name: "fuzz",
        title: "fuzz targets, on their seeds",
        applies: |id| id.starts_with('F'),
        concerns: is_of_machine,
        run: Run::Cargo {
            arguments: &["test", "-p", "fuseline-tests", "--test", "seeds", "seeds_of_"],
            variables: &[],
        },
        sources: &[
            CORE,
            NO_LIST,
            ARBITER,
            TRACES,
            NO_LIST_OF_TRACES,
            NO_OBSERVED,
            CORPUS,
            KIT,
            NO_LIST_OF_KIT,
            TESTS,
            "tests/tests/seeds.rs",
            "fuzz/seeds",
        ],
        read: read_tests,
        cites: cited_by_test,
    },
    Kind {
        name: "proof",
        title: "proofs",
        applies: |id| id.starts_with('P'),
        concerns: is_of_machine,
        run: Run::Prove,
        sources: &[CORE, NO_LIST, "proofs/src"],
        read: |_| Outcomes::new(),
        cites: cited_by_harness,
    },
    Kind {
        name: "drive",
        title: "cases that `fuseline drive` sends",
        applies: |_| false,
        concerns: is_of_machine,
        run: Run::Cargo {
            arguments: &[
                "run",
                "-p",
                "fuseline",
                "--",
                "drive",
                "--json",
                "--cases",
                "200",
                "--",
                "sh",
                "-c",
                "exec \"$CARGO_TARGET_DIR/debug/fuseline\" impl",
            ],
            variables: &[],
        },
        sources: &[
            CORE,
            NO_LIST,
            ARBITER,
            TRACES,
            NO_LIST_OF_TRACES,
            NO_OBSERVED,
            CORPUS,
            KIT,
            NO_LIST_OF_KIT,
            "cli/src/drive",
            "cli/src/implementation.rs",
        ],
        read: read_drive,
        cites: |tree, witness| match witness {
            GENERATED => Ok(BTreeSet::new()),
            case => cited_by_trace(tree, case),
        },
    },
    Kind {
        name: "loom",
        title: "races under loom",
        applies: |_| false,
        concerns: |fault| !is_of_machine(fault),
        run: Run::Cargo {
            arguments: &[
                "test",
                "-p",
                "fuseline-loom",
                "--release",
                "--test",
                "loom",
                "--test",
                "values",
                "--no-fail-fast",
            ],
            variables: &[("RUSTFLAGS", "--cfg loom")],
        },
        sources: &[
            THREADS,
            NO_LIST_OF_THREADS,
            "core/src/clouds.rs",
            "core/src/entry.rs",
            "core/src/gate.rs",
            "core/src/slot.rs",
            "tests/loom",
        ],
        read: read_tests,
        cites: cited_by_test,
    },
];

/// The witness that all generated runs of a drive are.
const GENERATED: &str = "generated runs";

/// Whether a fault is in the machine with one caller.
fn is_of_machine(fault: &SeededFault) -> bool {
    !fault.file.starts_with(THREADS)
}

impl Kind {
    /// A digest of what its results depend on.
    ///
    /// # Errors
    /// A file cannot be read.
    pub fn digest(&self, tree: &Tree) -> Result<String, Error> {
        tree.digest(self.sources)
    }

    /// Whether its witnesses run under every fault by a campaign.
    #[must_use]
    pub fn is_run_here(&self) -> bool {
        matches!(self.run, Run::Cargo { .. })
    }

    /// The one of this name.
    #[must_use]
    pub fn find(name: &str) -> Option<&'static Self> {
        KINDS.iter().find(|kind| kind.name == name)
    }
}

/// Lines of the test harness. A test that began and never ended is red.
fn read_tests(printed: &str) -> Outcomes {
    static BINARY: LazyLock<Regex> =
        LazyLock::new(|| regex(r"^ +Running .*/deps/(\w+)-[0-9a-f]+\)"));
    static TEST: LazyLock<Regex> = LazyLock::new(|| regex(r"^test (\S+) \.\.\.(?: (ok|ignored))?"));
    let mut outcomes = Outcomes::new();
    let mut binary = String::new();
    for line in printed.lines() {
        if let Some(found) = BINARY.captures(line) {
            binary = format!("{}::", &found[1]);
        } else if let Some(found) = TEST.captures(line) {
            let outcome = found.get(2).map(|outcome| outcome.as_str());
            if outcome != Some("ignored") {
                outcomes.insert(format!("{binary}{}", &found[1]), outcome == Some("ok"));
            }
        }
    }
    outcomes
}

/// A JSON object a configuration: the properties that are broken there, or the configuration itself if it holds.
fn read_models(printed: &str) -> Outcomes {
    #[derive(serde::Deserialize)]
    struct Verdict {
        config: String,
        holds: bool,
        violations: BTreeMap<String, Vec<String>>,
    }
    let verdicts = printed.lines().filter_map(|line| serde_json::from_str::<Verdict>(line).ok());
    let mut outcomes = Outcomes::new();
    for verdict in verdicts {
        outcomes.extend(verdict.violations.into_keys().map(|claim| (claim, false)));
        if verdict.holds {
            outcomes.insert(verdict.config, true);
        }
    }
    outcomes
}

/// A JSON object: how the cases of the corpus ended, and whether a generated run differed.
fn read_drive(printed: &str) -> Outcomes {
    #[derive(serde::Deserialize)]
    struct Driven {
        fixed: Vec<Case>,
        generated: Generated,
    }
    #[derive(serde::Deserialize)]
    struct Case {
        case: String,
        result: String,
    }
    #[derive(serde::Deserialize)]
    struct Generated {
        failed: Option<String>,
        passed: u64,
    }
    let mut driven = printed.lines().filter_map(|line| serde_json::from_str::<Driven>(line).ok());
    let Some(Driven { fixed, generated }) = driven.next() else { return Outcomes::new() };
    // What a silent command leaves unsaid did not run.
    let ran =
        fixed.into_iter().filter(|case| case.result == "pass" || case.result.starts_with("fail"));
    let mut outcomes: Outcomes = ran.map(|case| (case.case, case.result == "pass")).collect();
    if generated.failed.is_some() || generated.passed > 0 {
        outcomes.insert(GENERATED.to_owned(), generated.failed.is_none());
    }
    outcomes
}

/// What a test's name, its documentation and its body cite.
fn cited_by_test(tree: &Tree, witness: &str) -> Result<BTreeSet<String>, Error> {
    let mut parts: Vec<&str> = witness.split("::").collect();
    let name = parts.pop().unwrap_or_default();
    let file = match parts.split_first() {
        Some((&"fuseline_core", modules)) => {
            let modules: Vec<&str> = modules.iter().copied().filter(|m| *m != "tests").collect();
            let own = format!("core/src/{}/tests.rs", modules.join("/"));
            let whole = format!("core/src/{}.rs", modules.join("/"));
            if tree.path(&own).exists() { own } else { whole }
        }
        Some((target, _)) => {
            let places = ["tests/tests", "tests/loom/tests"].map(|at| format!("{at}/{target}.rs"));
            let there = places.into_iter().find(|place| tree.path(place).exists());
            there.unwrap_or_else(|| format!("tests/tests/{target}.rs"))
        }
        None => return Ok(BTreeSet::new()),
    };
    let text = tree.text(&file)?;
    let Some(function) = function(&text, name) else {
        return Err(Error::content(Path::new(&file), format!("no test {name} here")));
    };
    let mut cited = named(name);
    cited.extend(words(&function));
    Ok(cited)
}

/// A function with what stands directly above it.
fn function(text: &str, name: &str) -> Option<String> {
    let lines: Vec<&str> = text.lines().collect();
    let head = format!("fn {name}(");
    let at = lines
        .iter()
        .position(|line| line.trim_start().trim_start_matches("pub ").starts_with(&head))?;
    let is_above = |line: &&&str| matches!(line.trim_start().as_bytes(), [b'/' | b'#', ..]);
    let above = lines.iter().take(at).rev().take_while(is_above).count();
    let indent = lines[at].len() - lines[at].trim_start().len();
    let end = format!("{:indent$}}}", "");
    let below = lines.iter().skip(at).position(|line| *line == end)?;
    Some(lines[at - above..=at + below].join("\n"))
}

/// What a harness' name, its documentation and its body cite.
fn cited_by_harness(tree: &Tree, witness: &str) -> Result<BTreeSet<String>, Error> {
    let mut cited = named(witness);
    for file in tree.files(&["proofs/src/harness"])? {
        if let Some(function) = function(&tree.text(&file)?, witness) {
            cited.extend(words(&function));
            return Ok(cited);
        }
    }
    Err(Error::content(Path::new("proofs/src/harness"), format!("no harness {witness} here")))
}

/// What a trace's name and its header cite.
fn cited_by_trace(tree: &Tree, witness: &str) -> Result<BTreeSet<String>, Error> {
    let text = tree.text(&format!("traces/corpus/{witness}.jsonl"))?;
    let mut cited = words(text.lines().next().unwrap_or_default());
    cited.extend(named(&witness.replace('-', "_")));
    Ok(cited)
}

fn regex(pattern: &str) -> Regex {
    Regex::new(pattern).expect("a sound pattern")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_test_that_began_and_never_ended_is_red() {
        let printed = "     Running tests/rules.rs (/x/deps/rules-0a1b)\n\
            test f1_a ... ok\ntest f2_b ... FAILED\ntest f3_c ... ignored, not here\ntest f4_d ... ";
        let expected = [("rules::f1_a", true), ("rules::f2_b", false), ("rules::f4_d", false)];
        assert_eq!(
            read_tests(printed),
            expected.map(|(name, held)| (name.to_owned(), held)).into()
        );
    }

    #[test]
    fn a_build_that_failed_ran_nothing() {
        assert!(read_tests("error: could not compile `fuseline-core`").is_empty());
        assert!(read_models("error: could not compile `fuseline-core`").is_empty());
    }

    #[test]
    fn a_violated_property_is_red_in_whatever_configuration() {
        let printed = r#"{"config":"a","holds":true,"states":1,"violations":{}}
            {"config":"b","holds":false,"states":1,"violations":{"P1 once":["{}"]}}"#;
        let expected = [("P1 once", false), ("a", true)];
        let expected = expected.map(|(name, held)| (name.to_owned(), held));
        assert_eq!(read_models(printed), expected.into());
    }

    #[test]
    fn a_case_that_was_not_driven_says_nothing() {
        let printed = r#"{"fixed":[{"case":"a","result":"pass"},{"case":"b","result":"fail, F1"},
            {"case":"c","result":"not run"}],"generated":{"failed":null,"passed":0,"runs":20}}"#;
        let expected = [("a", true), ("b", false)].map(|(name, held)| (name.to_owned(), held));
        assert_eq!(read_drive(&printed.replace('\n', "")), expected.into());
    }

    #[test]
    fn a_test_cites_by_its_name_its_documentation_and_its_body() {
        let text = "/// F1.\n#[test]\nfn p2_never() {\n    // A3.\n}\n\n// F8\n";
        let found = function(text, "p2_never").expect("it is there");
        assert_eq!(words(&found), ["A3", "F1"].map(String::from).into());
        assert_eq!(named("p2_never"), ["P2".to_owned()].into());
    }
}
