//! What stands between operators: joins, order, budgets, substitutes, states.

use super::{EvidenceKind, QUICK, RunMethod};
use crate::citation::cited_by_test;
use crate::printed::read_tests;

/// The files of the parts and their tests; what they share with one operator alone is of that kind.
const SOURCES: &[&str] = &[
    "adapters/engine/src/aligner.rs",
    "adapters/engine/src/budget.rs",
    "adapters/engine/src/engine.rs",
    "adapters/engine/src/latency.rs",
    "adapters/engine/src/policies.rs",
    "adapters/engine/src/reorderer.rs",
    "adapters/tokio/src/carried_state.rs",
    "adapters/tokio/src/join.rs",
    "adapters/tokio/src/run.rs",
    "adapters/engine/tests/aligner.rs",
    "adapters/engine/tests/budget.rs",
    "adapters/engine/tests/reorderer.rs",
    "adapters/tokio/tests/graphs.rs",
    "adapters/tokio/tests/pipeline.rs",
    "adapters/tokio/tests/support/graph.rs",
];

pub(super) const PIPELINES: EvidenceKind = EvidenceKind {
    name: "pipeline",
    title: "tests of pipelines",
    applies: |id| id.starts_with('E'),
    concerns: |fault| {
        let is_of_pipeline = |id: &String| id.starts_with('E') || id == "D17";
        SOURCES.contains(&&*fault.file) && fault.breaks.iter().any(is_of_pipeline)
    },
    run: RunMethod::Cargo {
        arguments: &[
            "test",
            "-p",
            "fuseline-engine",
            "-p",
            "fuseline-tokio",
            "-p",
            "fuseline-tests",
            "--lib",
            "--test",
            "all_engine",
            "--test",
            "all_tokio",
            "--no-fail-fast",
        ],
        variables: QUICK,
    },
    sources: SOURCES,
    read: read_tests,
    cites: cited_by_test,
};
