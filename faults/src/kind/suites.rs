//! The suites from which the kinds of witness are built.

use super::BuildSuite;

/// The core, with all tests about it, in one build.
pub(super) const MACHINE: BuildSuite = BuildSuite {
    name: "machine",
    packages: &[
        "-p=fuseline-core",
        "-p=fuseline-tests",
        "-p=fuseline-models",
        "-p=fuseline-proofs",
        "-p=fuseline-threads",
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
pub(super) const LOOM: BuildSuite = BuildSuite {
    name: "loom",
    packages: &["-p=fuseline-threads"],
    tests: &["--release", "--test=loom", "--test=values"],
    programs: &[],
    variables: &[("RUSTFLAGS", "--cfg loom")],
};
pub(super) const POLICY: BuildSuite = BuildSuite {
    name: "policy",
    packages: &["-p=fuseline-deadline", "-p=fuseline-tests"],
    tests: &["--lib", "--test=all_deadline", "--test=machine", "--test=search"],
    programs: &[],
    variables: &[],
};
pub(super) const OPERATOR: BuildSuite = BuildSuite {
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
        "--test=client_limits",
        "--test=visitors",
        "--test=misuse",
        "--test=checks",
    ],
    programs: &[],
    variables: QUICK,
};
pub(super) const ROS2: BuildSuite = BuildSuite {
    name: "ros2",
    packages: &["-p=fuseline-ros2", "-p=fuseline-system-tests"],
    tests: &["--lib", "--test=settings", "--test=nodes"],
    programs: &[],
    variables: QUICK,
};
pub(super) const COMMAND: BuildSuite = BuildSuite {
    name: "command",
    packages: &["-p=fuseline", "-p=fuseline-report"],
    tests: &["--lib", "--test=all_cli"],
    programs: &[],
    variables: QUICK,
};
/// The programs that cases of misuse call.
pub(super) const CALLED: BuildSuite = BuildSuite {
    name: "called",
    packages: &["-p=fuseline", "-p=fuseline-ros2"],
    tests: &[],
    programs: &["--bin=fuseline", "--bin=fuseline-ros2"],
    variables: QUICK,
};
pub(super) const PYTHON: BuildSuite =
    BuildSuite { name: "python", packages: &[], tests: &[], programs: &[], variables: &[] };

/// Large crates with short tests use these, because most of their run is the build.
pub(super) const QUICK: &[(&str, &str)] =
    &[("CARGO_PROFILE_DEV_OPT_LEVEL", "0"), ("CARGO_INCREMENTAL", "1")];
