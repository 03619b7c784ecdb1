use std::path::PathBuf;

use fuseline_traces::Commit;

use super::*;

use super::case::{Generate, GeneratorVersion};

const FIRST: Generate =
    Generate { version: GeneratorVersion::First, seed: 1, commit: None, clouds: None };
const SECOND: Generate = Generate { version: GeneratorVersion::Second, ..FIRST };

fn suite(cases: u64) -> Suite {
    Suite::whole(FIRST, cases).unwrap()
}

#[test]
fn a_generated_case_is_the_same_for_ever() {
    for (generator, number, name) in
        [(FIRST, 34, "g-1-17"), (FIRST, 35, "w-1-17"), (SECOND, 17, "g2-1-17")]
    {
        let case = Suite::whole(generator, 0).unwrap().case(number);
        let (id, run) = (case.id, case.run);
        assert_eq!(id, name);
        let again = Suite::of(&[id], Generate { seed: 9, ..FIRST }).unwrap();
        assert_eq!(again.fixed[0].run, run);
    }
}

#[test]
fn no_change_makes_another_run_of_a_number() {
    let generator = FIRST;
    let names = [0, 1, 2, 17, 25, 125, 999].map(|number| format!("g-1-{number}"));
    let hash = Suite::of(&names, generator).unwrap().hash();
    assert_eq!(&hash[..16], "eaca2caaacf77594");
}

#[test]
fn no_change_makes_another_wide_run_of_a_number() {
    let generator = FIRST;
    let names = [0, 1, 4, 17, 499].map(|number| format!("w-1-{number}"));
    let hash = Suite::of(&names, generator).unwrap().hash();
    assert_eq!(&hash[..16], "28f0b2a66c14f5ff");
}

#[test]
fn no_change_makes_another_varied_run() {
    let names = [0, 1, 2, 3, 20, 44, 92, 999].map(|number| format!("g2-1-{number}"));
    let hash = Suite::of(&names, SECOND).unwrap().hash();
    assert_eq!(&hash[..16], "b0750e0bf9e8915a");
}

#[test]
fn restricted_suite_leaves_cases_out() {
    let eager = Suite::whole(Generate { commit: Some(Commit::Eager), ..SECOND }, 0).unwrap();
    assert!(eager.fixed.iter().all(|case| case.run.header.commit == Commit::Eager));
    assert_eq!(eager.fixed.len() + eager.left_out, suite(0).fixed.len());
    assert!(eager.fixed.len() > 40 && eager.left_out > 10, "{}", eager.left_out);
    let few = Suite::whole(Generate { clouds: Some(1), ..SECOND }, 0).unwrap();
    assert!(few.left_out > 0 && few.fixed.iter().all(|case| case.run.header.clouds.len() < 2));
}

#[test]
fn saved_names_are_free_and_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let names = |before: usize| {
        let paths = save::paths(folder.path(), "g2-1-7", before, false);
        let name = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().to_owned();
        paths.iter().map(name).collect::<Vec<_>>()
    };
    assert_eq!(names(0), ["g2-1-7.jsonl"]);
    std::fs::write(folder.path().join("g2-1-7.jsonl"), "").unwrap();
    assert_eq!(names(0), ["g2-1-7-2.jsonl"]);
    assert_eq!(names(1), ["g2-1-7-run1.jsonl", "g2-1-7-run2.jsonl"]);
    std::fs::write(folder.path().join("g2-1-7-run2.jsonl"), "").unwrap();
    assert_eq!(names(1), ["g2-1-7-2-run1.jsonl", "g2-1-7-2-run2.jsonl"]);
    assert!(names(11).is_sorted() && names(11)[0] == "g2-1-7-run01.jsonl");
}

#[test]
fn the_digest_changes_with_the_cases() {
    let hash = suite(3).hash();
    assert_eq!(hash, suite(3).hash());
    assert_ne!(hash, suite(2).hash());
    assert_eq!(hash.len(), 64);
}
