//! All kinds. A new kind needs only an entry here.

use std::collections::BTreeSet;

use super::suites::{CALLED, COMMAND, LOOM, MACHINE, OPERATOR, POLICY, PYTHON, ROS2};
use super::{Program, WitnessKind};
use crate::citation::{
    cited_by_harness, cited_by_pytest, cited_by_test, cited_by_trace, identifiers,
};
use crate::fault::SeededFault;
use crate::printed::{read_models, read_peers, read_pytest, read_steps, read_tests, read_traces};

const ARBITER: &str = "adapters/engine/src/arbiter";
const THREADS: &str = "adapters/threads/src/";
const GRPC: &str = "adapters/tokio/src/grpc/";

const fn program(
    package: &'static str,
    target: &'static str,
    arguments: &'static [&'static str],
) -> Program {
    Program { package, target, arguments }
}

/// Most kinds are tests that run one at a time, and cite by their names, documentation and bodies.
const TESTS: WitnessKind = WitnessKind {
    name: "",
    title: "",
    concerns: |_| false,
    suite: &MACHINE,
    programs: &[],
    threads: "1",
    stops: false,
    read: read_tests,
    cites: cited_by_test,
};

/// All of them.
pub const KINDS: &[WitnessKind] = &[
    WitnessKind {
        name: "test",
        title: "tests with written expectations",
        concerns: is_of_machine,
        suite: &MACHINE,
        programs: &[
            program("fuseline-core", "fuseline_core", &[]),
            program("fuseline-tests", "rules", &[]),
            program("fuseline-tests", "surface", &[]),
            program("fuseline-tests", "window", &[]),
        ],
        ..TESTS
    },
    WitnessKind {
        name: "trace",
        title: "traces of the corpus",
        concerns: is_of_machine,
        suite: &MACHINE,
        programs: &[program("fuseline-tests", "corpus", &[])],
        read: read_traces,
        cites: cited_by_trace,
        ..TESTS
    },
    WitnessKind {
        name: "reference",
        title: "runs beside the reference machine",
        concerns: is_of_machine,
        suite: &MACHINE,
        programs: &[
            program("fuseline-tests", "differential", &[]),
            program("fuseline-tests", "seeds", &["seeds_of_"]),
        ],
        ..TESTS
    },
    WitnessKind {
        name: "model",
        title: "properties of the models",
        concerns: is_of_machine,
        suite: &MACHINE,
        programs: &[program(
            "fuseline-models",
            "fuseline-models",
            &["check", "--quick", "--keep-going", "--threads", "1", "--json"],
        )],
        read: read_models,
        cites: |_, witness| Ok(identifiers(witness)),
        ..TESTS
    },
    WitnessKind {
        name: "harness",
        title: "the proofs' harnesses, on random values",
        concerns: |fault| fault.file.starts_with("core/src/"),
        suite: &MACHINE,
        programs: &[program("fuseline-proofs", "random", &["every_harness_holds", "--nocapture"])],
        read: read_steps,
        cites: cited_by_harness,
        ..TESTS
    },
    WitnessKind {
        name: "history",
        title: "histories of threads beside the pure step",
        concerns: |fault| fault.file.starts_with(THREADS),
        suite: &MACHINE,
        programs: &[
            program("fuseline-threads", "fuseline_threads", &[]),
            program("fuseline-threads", "messages", &[]),
            program("fuseline-threads", "history", &[]),
            program("fuseline-threads", "stress", &[]),
        ],
        stops: true,
        ..TESTS
    },
    WitnessKind {
        name: "loom",
        title: "interleavings under loom",
        concerns: |fault| fault.file.starts_with(THREADS),
        suite: &LOOM,
        programs: &[
            program("fuseline-threads", "loom", &[]),
            program("fuseline-threads", "values", &[]),
        ],
        stops: true,
        ..TESTS
    },
    WitnessKind {
        name: "judge",
        title: "tests of the judges with written verdicts",
        concerns: is_of_judges,
        suite: &MACHINE,
        programs: &[
            program("fuseline-traces", "fuseline_traces", &["--skip", "story::"]),
            program("fuseline-tests", "all_traces", &["--skip", "corpus::"]),
            program("fuseline-traces", "streaming", &[]),
        ],
        ..TESTS
    },
    WitnessKind {
        name: "corpus",
        title: "verdicts of the corpus",
        concerns: is_of_judges,
        suite: &MACHINE,
        programs: &[program("fuseline-tests", "all_traces", &["corpus::"])],
        ..TESTS
    },
    WitnessKind {
        name: "search",
        title: "brute-force search beside the judge, and operators that err",
        concerns: is_of_judges,
        suite: &MACHINE,
        programs: &[
            program("fuseline-traces", "fuseline_traces", &["story::"]),
            program("fuseline-tests", "observed_faults", &[]),
        ],
        stops: true,
        ..TESTS
    },
    WitnessKind {
        name: "policy",
        title: "tests of policies",
        concerns: |fault| fault.file.starts_with("deadline/"),
        suite: &POLICY,
        programs: &[
            program("fuseline-deadline", "fuseline_deadline", &[]),
            program("fuseline-tests", "all_deadline", &["--skip=drawn::"]),
            program("fuseline-deadline", "machine", &[]),
        ],
        ..TESTS
    },
    WitnessKind {
        name: "drawn",
        title: "drives, calls and figures drawn at random",
        concerns: |fault| fault.file.starts_with("deadline/"),
        suite: &POLICY,
        programs: &[
            program("fuseline-tests", "all_deadline", &["drawn::"]),
            program("fuseline-deadline", "search", &[]),
        ],
        stops: true,
        ..TESTS
    },
    WitnessKind {
        name: "part",
        title: "tests of one part of an operator",
        concerns: |fault| is_of_operators(fault) && !fault.file.starts_with(GRPC),
        suite: &OPERATOR,
        programs: &[
            program("fuseline-engine", "fuseline_engine", &[]),
            program("fuseline-tokio", "fuseline_tokio", &[]),
            program("fuseline-tests", "all_engine", &[]),
            program("fuseline-engine", "logs", &[]),
        ],
        threads: "6",
        ..TESTS
    },
    WitnessKind {
        name: "operator",
        title: "tests of whole operators",
        concerns: |fault| is_of_operators(fault) && !fault.file.starts_with(GRPC),
        suite: &OPERATOR,
        programs: &[
            program("fuseline-tokio", "all_tokio", &["--skip=graphs::", "--skip=floor::"]),
            program("fuseline-tokio", "memory", &[]),
            program("fuseline-tokio", "prometheus", &[]),
        ],
        threads: "6",
        ..TESTS
    },
    WitnessKind {
        name: "graph",
        title: "graphs of operators drawn at random",
        concerns: |fault| is_of_operators(fault) && !fault.file.starts_with(GRPC),
        suite: &OPERATOR,
        programs: &[program("fuseline-tokio", "all_tokio", &["graphs::", "floor::"])],
        threads: "2",
        ..TESTS
    },
    WitnessKind {
        name: "grpc",
        title: "tests of clouds over gRPC",
        concerns: |fault| fault.file.starts_with(GRPC),
        suite: &OPERATOR,
        programs: &[
            program("fuseline-tokio", "fuseline_tokio", &[]),
            program("fuseline-tokio", "all_tokio", &["--skip=graphs::", "--skip=floor::"]),
        ],
        threads: "6",
        ..TESTS
    },
    WitnessKind {
        name: "visitor",
        title: "servers with visitors, kind and hostile",
        concerns: |fault| fault.file.starts_with(GRPC),
        suite: &OPERATOR,
        programs: &[
            program("fuseline-tokio", "client_limits", &[]),
            program("fuseline-tokio", "visitors", &[]),
        ],
        threads: "6",
        ..TESTS
    },
    WitnessKind {
        name: "simulation",
        title: "checks of simulated operators",
        concerns: |fault| {
            let others = [GRPC, "adapters/tokio/src/shared.rs", "adapters/engine/src/workload.rs"];
            is_of_operators(fault) && !starts_with(fault, &others) || fault.file == RECORDER
        },
        suite: &OPERATOR,
        programs: &[program("fuseline-system-tests", "checks", &[])],
        ..TESTS
    },
    WitnessKind {
        name: "ros2",
        title: "tests of the ROS 2 node",
        concerns: |fault| fault.file.starts_with("adapters/ros2/"),
        suite: &ROS2,
        programs: &[
            program("fuseline-ros2", "fuseline_ros2", &[]),
            program("fuseline-ros2", "settings", &[]),
        ],
        threads: "6",
        ..TESTS
    },
    WitnessKind {
        name: "node",
        title: "simulated ROS 2 nodes",
        concerns: |fault| fault.file.starts_with("adapters/ros2/"),
        suite: &ROS2,
        programs: &[program("fuseline-system-tests", "nodes", &[])],
        ..TESTS
    },
    WitnessKind {
        name: "command",
        title: "tests of the command",
        concerns: |fault| fault.file.starts_with("cli/"),
        suite: &COMMAND,
        programs: &[
            program("fuseline", "fuseline", &[]),
            program("fuseline-report", "fuseline_report", &[]),
            program(
                "fuseline",
                "all_cli",
                // They take long, and they catch no fault that shorter tests do not catch.
                &["--skip=drive::"],
            ),
        ],
        threads: "6",
        ..TESTS
    },
    WitnessKind {
        name: "python",
        title: "tests of operators in Python",
        concerns: |fault| fault.file.starts_with("adapters/python/"),
        suite: &PYTHON,
        programs: &[program(
            "fuseline-python",
            "pytest",
            &[
                "tests/test_accounts.py",
                "tests/test_operator.py",
                "tests/test_operator_ends.py",
                "tests/test_operator_policies.py",
                "tests/test_pipeline.py",
                "tests/test_recovery.py",
                "tests/test_robot.py",
                "tests/test_same.py",
                "tests/test_states.py",
                "tests/test_tasks.py",
                "tests/test_threads.py",
            ],
        )],
        read: read_pytest,
        cites: cited_by_pytest,
        ..TESTS
    },
    WitnessKind {
        name: "rust-misuse",
        title: "cases of misuse from Rust",
        suite: &OPERATOR,
        programs: &[program("fuseline-tokio", "misuse", &[])],
        cites: |_, _| Ok(BTreeSet::new()),
        ..TESTS
    },
    WitnessKind {
        name: "command-misuse",
        title: "cases of misuse of the command",
        suite: &CALLED,
        programs: &[program("fuseline", "fuseline", &[])],
        cites: |_, _| Ok(BTreeSet::new()),
        ..TESTS
    },
    WitnessKind {
        name: "ros2-misuse",
        title: "cases of misuse of the node's parameters",
        suite: &CALLED,
        programs: &[program("fuseline-ros2", "fuseline-ros2", &[])],
        cites: |_, _| Ok(BTreeSet::new()),
        ..TESTS
    },
    WitnessKind {
        name: "ros2-run-misuse",
        title: "cases of misuse of a node that runs, among real peers",
        suite: &CALLED,
        programs: &[program("fuseline-ros2", "fuseline-ros2", &["--misuse"])],
        read: read_peers,
        cites: |_, _| Ok(BTreeSet::new()),
        ..TESTS
    },
    WitnessKind {
        name: "python-misuse",
        title: "cases of misuse from Python",
        suite: &PYTHON,
        programs: &[program(
            "fuseline-python",
            "pytest",
            &[
                "tests/test_misuse.py",
                "tests/test_misuse_ends.py",
                "tests/test_misuse_failures.py",
                "tests/test_misuse_robot.py",
                "tests/test_misuse_running.py",
                "tests/test_misuse_setup.py",
                "tests/test_misuse_streams.py",
                "tests/test_misuse_values.py",
            ],
        )],
        read: read_pytest,
        cites: |_, _| Ok(BTreeSet::new()),
        ..TESTS
    },
];

/// The files that write a trace during a run.
const RECORDER: &str = "traces/src/record.rs";

fn starts_with(fault: &SeededFault, files: &[&str]) -> bool {
    files.iter().any(|file| fault.file.starts_with(file))
}

/// Returns `true` if a fault is in the machine with one caller.
fn is_of_machine(fault: &SeededFault) -> bool {
    starts_with(fault, &["core/src/", ARBITER])
}

/// Returns `true` if a fault is in the code that drives the machine.
fn is_of_operators(fault: &SeededFault) -> bool {
    starts_with(fault, &["adapters/engine/", "adapters/tokio/"]) && !is_of_machine(fault)
}

/// Returns `true` if a fault is in the format, the judges or the recorder.
fn is_of_judges(fault: &SeededFault) -> bool {
    starts_with(fault, &["traces/src/"])
}

/// Returns `true` if a fault is in the core, the judges or the threads, whose faults run at each
/// landing.
pub(crate) fn runs_at_landing(fault: &SeededFault) -> bool {
    let is_of_both = is_of_machine(fault) || is_of_judges(fault);
    fault.case.is_none() && (is_of_both || fault.file.starts_with(THREADS))
}

/// Returns `true` if a kind needs only the builds of core, judges and threads.
pub(crate) fn builds_at_landing(kind: &WitnessKind) -> bool {
    [&MACHINE, &LOOM].contains(&kind.suite)
}
