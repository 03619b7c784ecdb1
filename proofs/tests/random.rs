//! Each harness as a plain function on random values, so that a wrong harness is found without a checker.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use fuseline_proofs::harness::ALL;
use fuseline_traces::{Decision, Event, Input, Line};

/// How many runs of each harness come to their end.
const ACCEPTED: u64 = 10_000;

/// Every harness holds on random values, is hardly ever left out by an assumption, and reaches all of its covers.
#[test]
fn every_harness_holds_on_random_values_and_reaches_its_covers() {
    for (name, harness) in ALL {
        let report = kani::native::random(*harness, 1, ACCEPTED)
            .unwrap_or_else(|failure| panic!("{name} does not hold: {failure:?}"));
        assert_eq!(report.accepted, ACCEPTED, "{name}: {} runs were rejected", report.rejected);
        assert!(report.rejected <= 2 * ACCEPTED, "{name} rejects most: {}", report.rejected);
        assert!(!report.assertions.is_empty(), "{name} asserts nothing");
        assert!(!report.covers.is_empty(), "{name} covers nothing");
        for ((line, cover), times) in &report.covers {
            assert!(*times > 0, "{name} never reaches the cover at line {line}: {cover}");
        }
    }
}

/// A counterexample is recorded as a header, states behind a `#`, inputs and decisions, all as the trace has them.
#[test]
fn a_replay_is_recorded_in_lines_that_a_reader_of_traces_takes() {
    // `p3_best_available` when the least available result is forwarded.
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

/// A harness that is not in the list would run nowhere but under the checker.
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

/// The harnesses look at the shipped sources: all of the core's modules, but for the one that keeps values, which decides
/// nothing; the window stands in a module of its own.
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
