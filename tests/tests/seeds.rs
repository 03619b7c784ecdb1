//! Replays the fuzz targets' seeds, so that every `cargo test` checks what was found once.

use std::fs;
use std::path::{Path, PathBuf};

use fuseline_testkit::{Coverage, Generator, Mark, Run};
use fuseline_tests::fuzz::{
    Edit, EditKind, bytes_of, judge, marks_of_judge, run_of, step, trace_parse,
};
use proptest::prelude::*;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// Generates random runs of the one generator.
fn runs() -> impl Strategy<Value = Run> {
    let generator = Generator { seed: 1, commit: None, clouds: 15 };
    any::<u64>().prop_map(move |number| generator.run(number))
}

type Check = fn(&[u8], &mut Coverage) -> Result<(), String>;

/// Returns the files of a folder, by name.
fn files(folder: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(Path::new(ROOT).join(folder)).expect("the folder is there");
    let paths = entries.map(|entry| entry.expect("a readable folder").path());
    let mut files: Vec<_> = paths.filter(|path| path.is_file()).collect();
    files.sort();
    assert!(!files.is_empty(), "no file in {folder}");
    files
}

/// Checks every file of these folders. Together they must reach all of `marks`.
fn replay(folders: &[&str], check: Check, marks: Vec<Mark>) {
    let mut reach = Coverage::default();
    for path in folders.iter().flat_map(|folder| files(folder)) {
        let bytes = fs::read(&path).expect("a readable file");
        if let Err(fault) = check(&bytes, &mut reach) {
            panic!("{}: {fault}", path.display());
        }
    }
    let missing = reach.missing(marks);
    assert!(missing.is_empty(), "no file in {folders:?} reaches {missing:?}");
}

/// The core agrees with the reference machine (F0–F8).
#[test]
fn step_seeds_agree_and_reach_every_rule() {
    replay(&["fuzz/seeds/step"], step, Mark::of_runs());
}

/// The judge accepts the core's decisions, and finds what was changed in them (F0–F8).
#[test]
fn seeds_of_judge_agree_and_break_every_rule() {
    replay(&["fuzz/seeds/judge"], judge, marks_of_judge());
}

#[test]
fn parse_seeds_and_corpus_reach_every_line_and_fault() {
    let folders = ["fuzz/seeds/trace_parse", "traces/corpus", "traces/corpus/bad"];
    replay(&folders, trace_parse, Mark::of_files());
}

proptest! {
    #![proptest_config(ProptestConfig {
        failure_persistence: None,
        cases: 64,
        ..ProptestConfig::default()
    })]

    #[test]
    fn a_run_survives_its_bytes(run in runs()) {
        prop_assert_eq!(run_of(&bytes_of(&run)), run);
    }

    #[test]
    fn any_bytes_are_a_run_that_its_own_bytes_report(bytes in any::<Vec<u8>>()) {
        let run = run_of(&bytes);
        prop_assert_eq!(run_of(&bytes_of(&run)), run);
    }

    #[test]
    fn an_edit_of_a_random_run_is_found_at_its_line(
        run in runs(), op in 0..EditKind::ALL.len(), index in any::<u16>(), by in any::<[i8; 6]>()
    ) {
        let edit = Edit { op: EditKind::ALL[op], index, by: by.map(|by| by % 2) };
        let bytes = [edit.bytes(), bytes_of(&run)].concat();
        judge(&bytes, &mut Coverage::default()).map_err(TestCaseError::fail)?;
    }

    #[test]
    fn bytes_that_are_no_trace_are_refused_in_good_order(bytes in any::<Vec<u8>>()) {
        trace_parse(&bytes, &mut Coverage::default()).map_err(TestCaseError::fail)?;
    }
}
