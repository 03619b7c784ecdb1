//! All kinds. A new one is one entry here.

use super::{BuildSuite, Program, WitnessKind};
use crate::citation::{cited_by_harness, cited_by_pytest, cited_by_test, cited_by_trace, words};
use crate::fault::SeededFault;
use crate::printed::{read_models, read_pytest, read_steps, read_tests, read_traces};

/// The core with all that tells about it in one build.
const MACHINE: BuildSuite = BuildSuite {
    name: "machine",
    packages: &[
        "-p=fuseline-core",
        "-p=fuseline-tests",
        "-p=fuseline-models",
        "-p=fuseline-proofs",
        "-p=fuseline-threads",
        "-p=fuseline-loom",
        "-p=fuseline-traces",
    ],
    tests: &[
        "--lib",
        "--test=rules",
        "--test=surface",
        "--test=window",
        "--test=differential",
        "--test=seeds",
        "--test=random",
        "--test=messages",
        "--test=history",
        "--test=stress",
        "--test=all_traces",
        "--test=streaming",
        "--test=observed_faults",
    ],
    programs: &["--bin=fuseline-models", "--example=corpus", "--test=rules"],
    variables: &[],
};
const LOOM: BuildSuite = BuildSuite {
    name: "loom",
    packages: &["-p=fuseline-loom"],
    tests: &["--release", "--test=loom", "--test=values"],
    programs: &[],
    variables: &[("RUSTFLAGS", "--cfg loom")],
};
const POLICY: BuildSuite = BuildSuite {
    name: "policy",
    packages: &["-p=fuseline-deadline", "-p=fuseline-tests"],
    tests: &["--lib", "--test=all_deadline", "--test=machine", "--test=search"],
    programs: &[],
    variables: &[],
};
const OPERATOR: BuildSuite = BuildSuite {
    name: "operator",
    packages: &[
        "-p=fuseline-engine",
        "-p=fuseline-tokio",
        "-p=fuseline-tests",
        "-p=fuseline-system-tests",
    ],
    tests: &[
        "--lib",
        "--test=all_engine",
        "--test=all_tokio",
        "--test=logs",
        "--test=memory",
        "--test=prometheus",
        "--test=strangers",
        "--test=visitors",
        "--test=checks",
    ],
    programs: &[],
    variables: QUICK,
};
const ROS2: BuildSuite = BuildSuite {
    name: "ros2",
    packages: &["-p=fuseline-ros2"],
    tests: &["--lib", "--test=settings"],
    programs: &[],
    variables: QUICK,
};
const COMMAND: BuildSuite = BuildSuite {
    name: "command",
    packages: &["-p=fuseline", "-p=fuseline-report"],
    tests: &["--lib", "--test=all_cli"],
    programs: &[],
    variables: QUICK,
};
const PYTHON: BuildSuite =
    BuildSuite { name: "python", packages: &[], tests: &[], programs: &[], variables: &[] };

/// For large crates with short tests, most of whose run is the build.
const QUICK: &[(&str, &str)] = &[("CARGO_PROFILE_DEV_OPT_LEVEL", "0"), ("CARGO_INCREMENTAL", "1")];

const ARBITER: &str = "adapters/engine/src/arbiter";
const THREADS: &str = "adapters/threads/src/";
const GRPC: &str = "adapters/tokio/src/grpc/";
const OPERATORS: [&str; 2] = ["adapters/engine/", "adapters/tokio/"];

const fn program(
    package: &'static str,
    target: &'static str,
    arguments: &'static [&'static str],
) -> Program {
    Program { package, target, arguments }
}

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
        threads: "1",
        stops: false,
        read: read_tests,
        cites: cited_by_test,
    },
    WitnessKind {
        name: "trace",
        title: "traces of the corpus",
        concerns: is_of_machine,
        suite: &MACHINE,
        programs: &[program("fuseline-tests", "corpus", &[])],
        threads: "1",
        stops: false,
        read: read_traces,
        cites: cited_by_trace,
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
        threads: "1",
        stops: false,
        read: read_tests,
        cites: cited_by_test,
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
        threads: "1",
        stops: false,
        read: read_models,
        cites: |_, witness| Ok(words(witness)),
    },
    WitnessKind {
        name: "harness",
        title: "the proofs' harnesses, on random values",
        concerns: |fault| fault.file.starts_with("core/src/"),
        suite: &MACHINE,
        programs: &[program("fuseline-proofs", "random", &["every_harness_holds", "--nocapture"])],
        threads: "1",
        stops: false,
        read: read_steps,
        cites: cited_by_harness,
    },
    WitnessKind {
        name: "history",
        title: "histories of threads beside the pure step",
        concerns: |fault| fault.file.starts_with(THREADS),
        suite: &MACHINE,
        programs: &[
            program("fuseline-threads", "fuseline_threads", &[]),
            program("fuseline-threads", "messages", &[]),
            program("fuseline-loom", "history", &[]),
            program("fuseline-loom", "stress", &[]),
        ],
        threads: "1",
        stops: false,
        read: read_tests,
        cites: cited_by_test,
    },
    WitnessKind {
        name: "loom",
        title: "interleavings under loom",
        concerns: |fault| fault.file.starts_with(THREADS),
        suite: &LOOM,
        programs: &[program("fuseline-loom", "loom", &[]), program("fuseline-loom", "values", &[])],
        threads: "1",
        stops: true,
        read: read_tests,
        cites: cited_by_test,
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
        threads: "1",
        stops: false,
        read: read_tests,
        cites: cited_by_test,
    },
    WitnessKind {
        name: "corpus",
        title: "verdicts of the corpus",
        concerns: is_of_judges,
        suite: &MACHINE,
        programs: &[program("fuseline-tests", "all_traces", &["corpus::"])],
        threads: "1",
        stops: false,
        read: read_tests,
        cites: cited_by_test,
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
        threads: "1",
        stops: false,
        read: read_tests,
        cites: cited_by_test,
    },
    WitnessKind {
        name: "policy",
        title: "tests of policies",
        concerns: |fault| fault.file.starts_with("deadline/"),
        suite: &POLICY,
        programs: &[
            program("fuseline-deadline", "fuseline_deadline", &[]),
            program("fuseline-tests", "all_deadline", &[]),
            program("fuseline-deadline", "machine", &[]),
        ],
        threads: "1",
        stops: false,
        read: read_tests,
        cites: cited_by_test,
    },
    WitnessKind {
        name: "safe",
        title: "search for a collision that the policies promise away",
        concerns: |fault| fault.file.starts_with("deadline/"),
        suite: &POLICY,
        programs: &[program("fuseline-deadline", "search", &[])],
        threads: "1",
        stops: false,
        read: read_tests,
        cites: cited_by_test,
    },
    WitnessKind {
        name: "operator",
        title: "tests of operators",
        concerns: |fault| starts_with(fault, &OPERATORS) && !starts_with(fault, &[ARBITER, GRPC]),
        suite: &OPERATOR,
        programs: &[
            program("fuseline-engine", "fuseline_engine", &[]),
            program("fuseline-tokio", "fuseline_tokio", &[]),
            program("fuseline-tests", "all_engine", &[]),
            program("fuseline-tokio", "all_tokio", &[]),
            program("fuseline-tokio", "logs", &[]),
            program("fuseline-tokio", "memory", &[]),
            program("fuseline-tokio", "prometheus", &[]),
        ],
        threads: "6",
        stops: false,
        read: read_tests,
        cites: cited_by_test,
    },
    WitnessKind {
        name: "grpc",
        title: "tests of clouds over gRPC",
        concerns: |fault| fault.file.starts_with(GRPC),
        suite: &OPERATOR,
        programs: &[
            program("fuseline-tokio", "fuseline_tokio", &[]),
            program("fuseline-tokio", "all_tokio", &[]),
            program("fuseline-tokio", "strangers", &[]),
            program("fuseline-tokio", "visitors", &[]),
        ],
        threads: "6",
        stops: false,
        read: read_tests,
        cites: cited_by_test,
    },
    WitnessKind {
        name: "simulation",
        title: "checks of simulated operators",
        concerns: |fault| {
            let others =
                [GRPC, ARBITER, "adapters/tokio/src/shared.rs", "adapters/engine/src/workload.rs"];
            starts_with(fault, &OPERATORS) && !starts_with(fault, &others) || fault.file == RECORDER
        },
        suite: &OPERATOR,
        programs: &[program("fuseline-system-tests", "checks", &[])],
        threads: "1",
        stops: false,
        read: read_tests,
        cites: cited_by_test,
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
        stops: false,
        read: read_tests,
        cites: cited_by_test,
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
                // They take long, and show nothing under a fault that shorter ones do not.
                &[
                    "--skip=drive::",
                    "--skip=scenario::",
                    "--skip=schemas::",
                    "--skip=paper_vehicle::",
                ],
            ),
        ],
        threads: "6",
        stops: false,
        read: read_tests,
        cites: cited_by_test,
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
        )],
        threads: "1",
        stops: false,
        read: read_pytest,
        cites: cited_by_pytest,
    },
];

/// What writes a trace as a run goes on.
const RECORDER: &str = "traces/src/record.rs";

fn starts_with(fault: &SeededFault, files: &[&str]) -> bool {
    files.iter().any(|file| fault.file.starts_with(file))
}

/// Whether a fault is in the machine with one caller.
fn is_of_machine(fault: &SeededFault) -> bool {
    starts_with(fault, &["core/src/", ARBITER])
}

/// Whether a fault is in the format, the judges or the recorder.
fn is_of_judges(fault: &SeededFault) -> bool {
    starts_with(fault, &["traces/src/"])
}

/// Whether a fault is of core, judges or threads, which run at each landing.
pub(crate) fn runs_at_landing(fault: &SeededFault) -> bool {
    is_of_machine(fault) || is_of_judges(fault) || fault.file.starts_with(THREADS)
}

/// Whether a kind needs nothing but the builds of core, judges and threads.
pub(crate) fn builds_at_landing(kind: &WitnessKind) -> bool {
    [&MACHINE, &LOOM].contains(&kind.suite)
}
