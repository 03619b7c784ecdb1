//! Clouds over gRPC: the servers, and the calls to them.

use super::{EvidenceKind, QUICK, RunMethod};
use crate::citation::cited_by_test;
use crate::printed::read_tests;

/// Clouds over the network.
pub(super) const GRPC: &str = "adapters/tokio/src/grpc/";

pub(super) const SERVERS: EvidenceKind = EvidenceKind {
    name: "grpc",
    title: "tests of clouds over gRPC",
    applies: |_| false,
    concerns: |fault| fault.file.starts_with(GRPC),
    run: RunMethod::Cargo {
        arguments: &[
            "test",
            "-p",
            "fuseline-tokio",
            "--lib",
            "--test",
            "all_tokio",
            "--test",
            "strangers",
            "--test",
            "visitors",
            "--no-fail-fast",
        ],
        variables: QUICK,
    },
    sources: &[
        "adapters/tokio/src/grpc",
        "adapters/tokio/tests/connections.rs",
        "adapters/tokio/tests/grpc.rs",
        "adapters/tokio/tests/strangers.rs",
        "adapters/tokio/tests/visitors.rs",
        "adapters/tokio/tests/support",
    ],
    read: read_tests,
    cites: cited_by_test,
};
