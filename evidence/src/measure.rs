//! Measurements of the tests: mutants that they let pass, lines and branches that they never take; those of the core are
//! measured anew each time (`reach`).

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::EvidenceError;
use crate::gap::CoverageGap;
use crate::reach::CoverageReport;
use crate::sources::{
    ARBITER, CORE, CORPUS, NO_LIST, NO_LIST_OF_THREADS, NO_LIST_OF_TRACES, NO_OBSERVED, NO_PACKED,
    NO_ROWS, TESTS, THREADS, TRACES,
};
use crate::tool::Tests;
use crate::tree::Tree;
use crate::{coverage, mutants};

/// One measurement.
pub struct Measure {
    /// Its name, which is that of its record too.
    pub name: &'static str,
    /// What is measured, for readers.
    pub title: &'static str,
    /// The files that the result depends on.
    sources: &'static [&'static str],
    tool: Tool,
    tests: Tests,
}

enum Tool {
    /// cargo-mutants, on these files; what follows a `!` is left out.
    Mutants(&'static [&'static str]),
    /// Lines and branches of the files in a folder; what follows a `!` is left out.
    Coverage(&'static [&'static str]),
}

/// The result, as it is committed.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeasurementResult {
    /// A digest of the sources that it depends on.
    pub sources: String,
    /// What measured it.
    pub by: String,
    /// How many there are of each kind.
    pub counts: BTreeMap<String, u64>,
    /// What the tests leave open.
    pub gaps: BTreeSet<CoverageGap>,
}

const TESTS_OF_CORE: Tests = Tests {
    packages: &["fuseline-core", "fuseline-tests"],
    targets: &[
        "--lib",
        "--test=rules",
        "--test=surface",
        "--test=parts",
        "--test=differential",
        "--test=window",
    ],
};
const SOURCES_OF_CORE: &[&str] = &[
    CORE,
    NO_LIST,
    ARBITER,
    "traces/src/reference.rs",
    CORPUS,
    TESTS,
    "tests/tests/rules.rs",
    "tests/tests/differential.rs",
    "tests/tests/surface.rs",
    "tests/tests/parts.rs",
    "tests/tests/window.rs",
];

const TESTS_OF_THREADS: Tests = Tests {
    packages: &["fuseline-threads", "fuseline-loom"],
    targets: &["--lib", "--test=messages", "--test=history", "--test=stress"],
};
const SOURCES_OF_THREADS: &[&str] = &[
    THREADS,
    NO_LIST_OF_THREADS,
    "core/src/clouds.rs",
    "core/src/entry.rs",
    "core/src/gate.rs",
    "core/src/slot.rs",
    "adapters/threads/tests/messages.rs",
    "tests/loom",
];

/// All of them.
pub const MEASURES: &[Measure] = &[
    Measure {
        name: "mutants-core",
        title: "mutants of the core",
        sources: SOURCES_OF_CORE,
        tool: Tool::Mutants(&["core/src/*.rs"]),
        tests: TESTS_OF_CORE,
    },
    Measure {
        name: "mutants-judge",
        title: "mutants of the judge and of its reference machine",
        sources: &[
            TRACES,
            NO_LIST_OF_TRACES,
            NO_OBSERVED,
            NO_PACKED,
            NO_ROWS,
            CORPUS,
            TESTS,
            "traces/tests/corpus.rs",
            "traces/tests/judge.rs",
            "traces/tests/reference.rs",
            "tests/tests/seeds.rs",
            "tests/tests/differential.rs",
            "fuzz/seeds",
        ],
        tool: Tool::Mutants(&[
            "traces/src/compact.rs",
            "traces/src/judge.rs",
            "traces/src/reference.rs",
            "traces/src/rule.rs",
        ]),
        tests: Tests {
            packages: &["fuseline-traces", "fuseline-tests"],
            targets: &["--lib", "--test=all_traces", "--test=seeds", "--test=differential"],
        },
    },
    Measure {
        name: "mutants-threads",
        title: "mutants of the machine for many threads",
        sources: SOURCES_OF_THREADS,
        tool: Tool::Mutants(&["adapters/threads/src/*.rs"]),
        tests: TESTS_OF_THREADS,
    },
    Measure {
        name: "coverage-threads",
        title: "coverage of the machine for many threads",
        sources: SOURCES_OF_THREADS,
        tool: Tool::Coverage(&[THREADS]),
        tests: TESTS_OF_THREADS,
    },
];

/// Measures which lines and branches of the core its tests reach.
///
/// # Errors
/// The compiler or LLVM's tools cannot measure, or a test fails.
pub fn core_coverage(tree: &Tree, target: &Path) -> Result<CoverageReport, EvidenceError> {
    CoverageReport::of(tree, target, &TESTS_OF_CORE)
}

impl Measure {
    /// A digest of what its result depends on.
    ///
    /// # Errors
    /// A file cannot be read.
    pub fn digest(&self, tree: &Tree) -> Result<String, EvidenceError> {
        tree.digest(self.sources)
    }

    /// Measures it and keeps the result. The tool's own progress goes to standard error.
    ///
    /// # Errors
    /// The tool is not there, cannot measure, or the result cannot be kept.
    pub fn take(&self, tree: &Tree, jobs: u8) -> Result<MeasurementResult, EvidenceError> {
        let sources = self.digest(tree)?;
        let out = tree.path("target/evidence").join(self.name);
        std::fs::create_dir_all(&out).map_err(EvidenceError::file(&out))?;
        let (by, counts, gaps) = match self.tool {
            Tool::Mutants(files) => mutants::take(tree, &out, files, &self.tests, jobs)?,
            Tool::Coverage(files) => coverage::take(tree, &out, files, &self.tests)?,
        };
        let measured = MeasurementResult { sources, by, counts, gaps };
        let path = self.path(tree);
        let mut text = serde_json::to_string_pretty(&measured)
            .map_err(|error| EvidenceError::content(&path, error.to_string()))?;
        text.push('\n');
        crate::record::write_whole(&path, &text)?;
        Ok(measured)
    }

    /// The committed result, if there is one.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn load(&self, tree: &Tree) -> Result<Option<MeasurementResult>, EvidenceError> {
        let path = self.path(tree);
        if !path.exists() {
            return Ok(None);
        }
        let text = std::fs::read_to_string(&path).map_err(EvidenceError::file(&path))?;
        serde_json::from_str(&text)
            .map(Some)
            .map_err(|error| EvidenceError::content(&path, error.to_string()))
    }

    fn path(&self, tree: &Tree) -> std::path::PathBuf {
        crate::record::folder(tree).join(format!("{}.json", self.name))
    }
}
