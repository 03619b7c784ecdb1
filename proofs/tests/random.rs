//! Runs each harness as a plain function on random values, so that a wrong harness is found without a
//! checker.

use std::collections::BTreeSet;
use std::path::Path;
use std::{fs, panic};

use fuseline_proofs::harness::ALL;
use fuseline_traces::{Decision, Event, Input, Line};
use kani::native::Failure;

/// The number of runs of each harness that come to their end.
const ACCEPTED: u64 = 10_000;

/// Every harness holds on random values, is hardly ever excluded by an assumption, and reaches all of its
/// covers. The test prints each name at its beginning and end, to help when a fault is seeded.
#[test]
fn every_harness_holds_on_random_values() {
    let mut failed = Vec::new();
    for (name, harness) in ALL {
        println!("harness {name} ...");
        match panic::catch_unwind(|| holds(*harness)).unwrap_or(Err("it panicked".to_owned())) {
            Ok(()) => println!("harness {name} ... ok"),
            Err(why) => {
                println!("harness {name} ... FAILED: {why}");
                failed.push(*name);
            }
        }
    }
    assert!(failed.is_empty(), "{failed:?} do not hold");
}

fn holds(harness: fn()) -> Result<(), String> {
    let failed = |failure: Failure| format!("{failure:?}");
    let report = kani::native::random(harness, 1, ACCEPTED).map_err(failed)?;
    let never = report.covers.iter().find(|(_, times)| **times == 0);
    if report.accepted != ACCEPTED || report.rejected > 2 * ACCEPTED {
        return Err(format!("an assumption leaves most runs out: {}", report.rejected));
    }
    if report.assertions.is_empty() || report.covers.is_empty() {
        return Err("it asserts or covers nothing".to_owned());
    }
    never.map_or(Ok(()), |((line, cover), _)| Err(format!("line {line} is never reached: {cover}")))
}

/// A counterexample is recorded as a header, states behind a `#`, inputs and decisions, in the form of a
/// trace.
#[test]
fn replay_is_recorded_in_lines_of_a_trace() {
    // `p3_best_available`, if the machine forwards the least available result.
    let values = [0, 12033, 55424, 65534, 1, 2, 65535];
    let harness = ALL.iter().find(|(name, _)| *name == "p3_best_available").expect("it is there").1;
    kani::native::replay(harness, &values).expect("the machine as it ships holds");
    let recorded = fuseline_proofs::take_recording();
    let (states, lines): (Vec<&String>, Vec<&String>) =
        recorded.iter().partition(|line| line.starts_with('#'));
    assert_eq!(states.len(), 1);
    let read = lines.iter().map(|line| fuseline_traces::parse(line.as_bytes()).expect("a line"));
    let read: Vec<Line> = read.collect();
    assert!(matches!(read[0], Line::Header(_)));
    assert!(matches!(read[1], Line::Event(Event::Input(Input::Tick { .. }))));
    assert!(matches!(read[2..], [.., Line::Event(Event::Decision(Decision::Emit { p: 10, .. }))]));
}

fn sources() -> Vec<String> {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/src/harness"));
    let files = fs::read_dir(folder).expect("the harness files");
    files.map(|file| fs::read_to_string(file.expect("a file").path()).expect("text")).collect()
}

/// The checker alone would run a harness that is missing from the list.
#[test]
fn every_harness_is_listed_under_a_name_of_its_own() {
    let listed: BTreeSet<&str> = ALL.iter().map(|(name, _)| *name).collect();
    assert_eq!(listed.len(), ALL.len(), "a name is taken twice");
    let sources = sources();
    let mut written = BTreeSet::new();
    for text in &sources {
        for harness in text.split("#[kani::proof]").skip(1) {
            let (_, head) = harness.split_once("pub fn ").expect("a harness is a public function");
            written.insert(head.split('(').next().expect("a name"));
        }
    }
    assert_eq!(listed, written);
}

/// The harnesses include all modules of the core, except the module that stores values and decides
/// nothing. The window is in a module of its own.
#[test]
fn the_modules_are_those_of_the_core() {
    let read = |file: &str| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
        fs::read_to_string(path).expect("a crate's root")
    };
    let lines = |text: &str| -> BTreeSet<String> {
        let starts = ["mod ", "pub mod ", "pub use "];
        let is_wanted = |line: &&str| starts.iter().any(|start| line.starts_with(start));
        text.lines().filter(is_wanted).map(str::to_owned).collect()
    };
    let (text, core) = (read("src/lib.rs"), lines(&read("../core/src/lib.rs")));
    let own = lines(&text);
    let missing: Vec<&String> = core.difference(&own).collect();
    let others: Vec<&String> = own.difference(&core).collect();
    assert_eq!(missing, ["mod held;", "pub use held::Held;"]);
    assert_eq!(
        others,
        [
            "mod arbitrary;",
            "mod cell_window {",
            "mod cells;",
            "mod levels;",
            "mod rules;",
            "mod shipped {",
            "mod steps;",
            "mod valid;",
            "pub mod comparison;",
            "pub mod harness;",
            "pub use steps::take as take_recording;"
        ]
    );
    let shipped = "#[path = \"../../core/src\"]\nmod shipped {";
    assert!(text.contains(shipped), "the shipped window is not the core's");
    let over = "over_cells!(\"core/src/window.rs\" ";
    assert!(text.contains(over), "the window over cells is not the core's");
    let shared = core.intersection(&own).filter(|line| *line != "mod window;");
    for module in shared.filter_map(|line| line.strip_prefix("mod ")) {
        let path = format!("#[path = \"../../core/src/{}.rs\"]", module.trim_end_matches(';'));
        assert!(text.contains(&path), "{module} is not the core's");
    }
}
