//! The third way: each harness as a plain function on random values, so that a wrong harness is found by anyone, anywhere.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use fuseline_proofs::harness::ALL;

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

/// The harnesses look at the shipped sources: all of the core's modules, and no others.
#[test]
fn the_modules_are_those_of_the_core() {
    let modules = |file: &str| -> BTreeSet<String> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
        let text = fs::read_to_string(path).expect("a crate's root");
        let lines =
            text.lines().filter(|line| line.starts_with("mod ") || line.starts_with("pub use "));
        lines.map(str::to_owned).collect()
    };
    let own = modules("src/lib.rs");
    let core = modules("../core/src/lib.rs");
    let others: Vec<&String> = own.difference(&core).collect();
    assert!(core.is_subset(&own), "the core has other modules: {:?}", core.difference(&own));
    assert_eq!(others, ["mod any;", "mod valid;"]);
    let text = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/lib.rs"));
    for module in core.iter().filter_map(|line| line.strip_prefix("mod ")) {
        let path = format!("#[path = \"../../core/src/{}.rs\"]", module.trim_end_matches(';'));
        assert!(text.as_ref().is_ok_and(|text| text.contains(&path)), "{module} is not the core's");
    }
}
