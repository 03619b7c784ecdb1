//! All kinds. A new one is one entry here.

use std::collections::BTreeSet;

use super::{Kind, Run};
use crate::citation::{cited_by_harness, cited_by_test, cited_by_trace, words};
use crate::fault::SeededFault;
use crate::printed::{GENERATED, Outcomes, read_drive, read_models, read_tests};
use crate::record::cited_by_obligation;
use crate::sources::{
    ARBITER, CORE, CORPUS, KIT, NO_LIST, NO_LIST_OF_KIT, NO_LIST_OF_THREADS, NO_LIST_OF_TRACES,
    NO_OBSERVED, TESTS, THREADS, TRACES,
};

/// All of them.
pub const KINDS: &[Kind] = &[
    Kind {
        name: "test",
        title: "tests",
        applies: is_of_spec,
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
        applies: is_of_spec,
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
        title: "proofs of one timestamp",
        applies: |id| id.starts_with('P') && !["P9", "P11"].contains(&id),
        concerns: is_of_machine,
        run: Run::Prove { files: &["gate.rs", "slot.rs", "time.rs"], of: &[] },
        sources: &[CORE, NO_LIST, "proofs/src"],
        read: |_| Outcomes::new(),
        cites: cited_by_harness,
    },
    Kind {
        name: "facade",
        title: "proofs of the façade, beside any number of timestamps",
        applies: |id| {
            let shown = ["F0", "F1", "F2", "F2g", "F3", "F4", "F5", "P5", "P7", "P8", "P11", "P12"];
            shown.contains(&id)
        },
        concerns: is_of_machine,
        run: Run::Prove { files: &["fusion.rs", "wait.rs"], of: &["core/src/fusion.rs"] },
        sources: &[CORE, NO_LIST, "proofs/src"],
        read: |_| Outcomes::new(),
        cites: cited_by_harness,
    },
    Kind {
        name: "window",
        title: "proofs of the window, of any size",
        applies: |id| id == "P9",
        concerns: is_of_machine,
        run: Run::Prove { files: &["window.rs"], of: &["core/src/window.rs"] },
        sources: &[CORE, NO_LIST, "proofs/src"],
        read: |_| Outcomes::new(),
        cites: cited_by_harness,
    },
    Kind {
        name: "rules",
        title: "obligations of the rules, of any size",
        applies: |id| id.starts_with('P'),
        concerns: |_| false,
        run: Run::Solve,
        sources: &[
            "proofs/rules/rules.smt2",
            "proofs/rules/promises.smt2",
            "proofs/rules/faults.toml",
        ],
        read: |_| Outcomes::new(),
        cites: cited_by_obligation,
    },
    Kind {
        name: "drive",
        title: "cases that `fuseline drive` sends",
        applies: |_| false,
        concerns: is_of_machine,
        run: Run::Driven {
            arguments: &["run", "-p", "fuseline-tests", "--example", "machine"],
            by: &["drive", "--json", "--cases", "200", "--"],
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
            "tests/examples/machine.rs",
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
        concerns: |fault| fault.file.starts_with(THREADS),
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
    Kind {
        name: "policy",
        title: "tests of policies",
        applies: |_| false,
        concerns: |fault| fault.file.starts_with("deadline/"),
        run: Run::Cargo {
            arguments: &["test", "-p", "fuseline-deadline", "--lib", "--tests", "--no-fail-fast"],
            variables: &[],
        },
        sources: &["deadline/src", "!deadline/src/lib.rs", "deadline/tests", CORE, NO_LIST],
        read: read_tests,
        cites: cited_by_test,
    },
    Kind {
        name: "operator",
        title: "tests of operators",
        applies: |_| false,
        concerns: |fault| {
            let is_of_operator = ["adapters/operator/", "adapters/tokio/"]
                .iter()
                .any(|at| fault.file.starts_with(at));
            is_of_operator && !fault.file.starts_with(GRPC)
        },
        run: Run::Cargo {
            arguments: &[
                "test",
                "-p",
                "fuseline-operator",
                "-p",
                "fuseline-tokio",
                "--lib",
                "--test",
                "engine",
                "--test",
                "logs",
                "--test",
                "pace",
                "--test",
                "probes",
                "--test",
                "recording",
                "--test",
                "asides",
                "--test",
                "behaviour",
                "--test",
                "deadlines",
                "--test",
                "ends",
                "--test",
                "outcomes",
                "--test",
                "prometheus",
                "--test",
                "timers",
                "--no-fail-fast",
            ],
            variables: QUICK,
        },
        sources: &[
            "adapters/operator/src",
            "!adapters/operator/src/lib.rs",
            "adapters/operator/tests",
            "adapters/tokio/src",
            "!adapters/tokio/src/lib.rs",
            "!adapters/tokio/src/grpc",
            "adapters/tokio/tests",
            "!adapters/tokio/tests/grpc.rs",
            "!adapters/tokio/tests/strangers.rs",
            ARBITER,
            CORE,
            NO_LIST,
        ],
        read: read_tests,
        cites: cited_by_test,
    },
    Kind {
        name: "grpc",
        title: "tests of clouds over gRPC",
        applies: |_| false,
        concerns: |fault| fault.file.starts_with(GRPC),
        run: Run::Cargo {
            arguments: &[
                "test",
                "-p",
                "fuseline-tokio",
                "--lib",
                "--test",
                "grpc",
                "--test",
                "strangers",
                "--no-fail-fast",
            ],
            variables: QUICK,
        },
        sources: &[
            "adapters/tokio/src/grpc",
            "adapters/tokio/tests/grpc.rs",
            "adapters/tokio/tests/strangers.rs",
            "adapters/tokio/tests/support",
        ],
        read: read_tests,
        cites: cited_by_test,
    },
    Kind {
        name: "recorder",
        title: "tests of the recorder",
        applies: |_| false,
        concerns: |fault| fault.file == RECORDER,
        run: Run::Cargo {
            arguments: &["test", "-p", "fuseline-traces", "--test", "record", "--no-fail-fast"],
            variables: QUICK,
        },
        sources: &[RECORDER, "traces/tests/record.rs"],
        read: read_tests,
        cites: cited_by_test,
    },
    Kind {
        name: "simulation",
        title: "checks of simulated operators",
        applies: |_| false,
        concerns: |fault| is_simulated(&fault.file),
        run: Run::Cargo {
            arguments: &["test", "-p", "fuseline-simulate", "--test", "checks"],
            variables: QUICK,
        },
        sources: &[
            "adapters/operator/src",
            "!adapters/operator/src/lib.rs",
            "adapters/tokio/src",
            "!adapters/tokio/src/lib.rs",
            "!adapters/tokio/src/grpc",
            ARBITER,
            CORE,
            NO_LIST,
            TRACES,
            NO_LIST_OF_TRACES,
            NO_OBSERVED,
            "tests/simulate/seeds.toml",
            "tests/simulate/src",
            "!tests/simulate/src/lib.rs",
            "!tests/simulate/src/main.rs",
            "tests/simulate/tests/checks.rs",
        ],
        read: read_tests,
        cites: cited_by_test,
    },
    Kind {
        name: "ros2",
        title: "tests of the ROS 2 node",
        applies: |_| false,
        concerns: |fault| fault.file.starts_with("adapters/ros2/"),
        run: Run::Cargo {
            arguments: &[
                "test",
                "-p",
                "fuseline-ros2",
                "--lib",
                "--test",
                "settings",
                "--no-fail-fast",
            ],
            variables: QUICK,
        },
        sources: &[
            "adapters/ros2/src",
            "!adapters/ros2/src/lib.rs",
            "adapters/ros2/tests/settings",
        ],
        read: read_tests,
        cites: cited_by_test,
    },
    Kind {
        name: "command",
        title: "tests of the command",
        applies: |_| false,
        concerns: |fault| fault.file.starts_with("cli/src/"),
        run: Run::Cargo {
            arguments: &[
                "test",
                "-p",
                "fuseline",
                "--test",
                "convert",
                "--test",
                "locations",
                "--test",
                "outputs",
                "--test",
                "report",
                "--test",
                "run",
                "--test",
                "serve",
                "--test",
                "traces",
                "--no-fail-fast",
                "--",
                // They take long, and show nothing under a fault that shorter ones do not.
                "--skip",
                "a_run_under_way_is_followed",
                "--skip",
                "nobody_has_to_read_standard_error",
                "--skip",
                "what_is_lost_when_a_run_is_killed_is_its_last_second",
                "--skip",
                "what_is_not_answered_at_the_end_of_a_followed_file_is_not_judged",
            ],
            variables: QUICK,
        },
        sources: &[
            "cli/src",
            "!cli/src/deadline.rs",
            "!cli/src/drive/",
            "!cli/src/plot/",
            "!cli/src/probe/",
            "!cli/src/scenario/",
            "cli/examples/two_vehicles",
            "cli/tests/common",
            "cli/tests/convert.rs",
            "cli/tests/locations.rs",
            "cli/tests/outputs.rs",
            "cli/tests/report.rs",
            "cli/tests/run.rs",
            "cli/tests/serve.rs",
            "cli/tests/traces.rs",
        ],
        read: read_tests,
        cites: cited_by_test,
    },
];

/// For large crates with short tests, most of whose run is the build.
const QUICK: &[(&str, &str)] = &[("CARGO_PROFILE_DEV_OPT_LEVEL", "0"), ("CARGO_INCREMENTAL", "1")];

/// Clouds over the network.
const GRPC: &str = "adapters/tokio/src/grpc/";

/// What writes a trace as a run goes on.
const RECORDER: &str = "traces/src/record.rs";

/// Whether simulated operators go through this file.
fn is_simulated(file: &str) -> bool {
    let around = ["adapters/operator/", "adapters/tokio/", RECORDER];
    let others = [
        "adapters/tokio/src/grpc",
        "adapters/tokio/src/common.rs",
        "adapters/operator/src/pace.rs",
    ];
    around.iter().any(|at| file.starts_with(at)) && !others.iter().any(|at| file.starts_with(at))
}

/// Whether a fault is in the machine with one caller.
fn is_of_machine(fault: &SeededFault) -> bool {
    fault.file.starts_with(CORE) || fault.file.starts_with(ARBITER)
}

/// Whether an identifier is a rule, a promise or an ambiguity of the machine.
fn is_of_spec(id: &str) -> bool {
    id.starts_with(['F', 'P', 'A'])
}
