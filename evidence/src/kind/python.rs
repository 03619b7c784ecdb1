//! Operators in Python: faults of the wheel, in its modules and in its compiled part.

use super::{EvidenceKind, RunMethod};
use crate::citation::cited_by_pytest;
use crate::printed::read_pytest;

/// The wheel's modules in Python, and what is compiled.
const WHEEL: [&str; 2] = ["adapters/python/python/fuseline/", "adapters/python/src/"];

pub(super) const PYTHON: EvidenceKind = EvidenceKind {
    name: "python",
    title: "tests of operators in Python",
    applies: |_| false,
    concerns: |fault| WHEEL.iter().any(|folder| fault.file.starts_with(folder)),
    run: RunMethod::Pytest {
        arguments: &[
            "tests/test_accounts.py",
            "tests/test_operator.py",
            "tests/test_operator_bounds.py",
            "tests/test_operator_ends.py",
            "tests/test_operator_policies.py",
            "tests/test_pipeline.py",
            "tests/test_recovery.py",
            "tests/test_robot.py",
            "tests/test_states.py",
            "tests/test_tasks.py",
            "tests/test_threads.py",
        ],
    },
    sources: &[
        "adapters/python/python/fuseline/_drive.py",
        "adapters/python/python/fuseline/_join.py",
        "adapters/python/python/fuseline/_item.py",
        "adapters/python/python/fuseline/_items.py",
        "adapters/python/python/fuseline/_local.py",
        "adapters/python/python/fuseline/_operator.py",
        "adapters/python/python/fuseline/_remote.py",
        "adapters/python/python/fuseline/_side.py",
        "adapters/python/python/fuseline/_state.py",
        "adapters/python/python/fuseline/_threads.py",
        "adapters/python/python/fuseline/robot.py",
        "adapters/python/python/fuseline/testing.py",
        "adapters/python/src/calls.rs",
        "adapters/python/src/calls/source.rs",
        "adapters/python/src/calls/task.rs",
        "adapters/python/tests/conftest.py",
        "adapters/python/tests/operator_support.py",
        "adapters/python/tests/test_accounts.py",
        "adapters/python/tests/test_operator.py",
        "adapters/python/tests/test_operator_bounds.py",
        "adapters/python/tests/test_operator_ends.py",
        "adapters/python/tests/test_operator_policies.py",
        "adapters/python/tests/test_pipeline.py",
        "adapters/python/tests/test_recovery.py",
        "adapters/python/tests/test_robot.py",
        "adapters/python/tests/test_states.py",
        "adapters/python/tests/test_tasks.py",
        "adapters/python/tests/test_threads.py",
    ],
    read: read_pytest,
    cites: cited_by_pytest,
};
