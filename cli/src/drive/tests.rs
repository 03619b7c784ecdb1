use std::path::PathBuf;

use fuseline_testkit::VariedGenerator;
use fuseline_traces::Commit;

use super::*;

const SEED_1: VariedGenerator = VariedGenerator { seed: 1, commit: None, clouds: 15 };

fn suite(cases: u64) -> Suite {
    Suite::whole(SEED_1, cases).unwrap()
}

#[test]
fn a_generated_case_is_the_same_for_ever() {
    let case = suite(0).case(17);
    assert_eq!(case.id, "g2-1-17");
    let again = Suite::of(&[case.id], VariedGenerator { seed: 9, ..SEED_1 }).unwrap();
    assert_eq!(again.fixed[0].run, case.run);
}

#[test]
fn no_change_makes_another_varied_run() {
    let names = [0, 1, 2, 3, 20, 44, 92, 999].map(|number| format!("g2-1-{number}"));
    let hash = Suite::of(&names, SEED_1).unwrap().hash();
    assert_eq!(&hash[..16], "b0750e0bf9e8915a");
}

#[test]
fn restricted_suite_leaves_cases_out() {
    let eager = Suite::whole(VariedGenerator { commit: Some(Commit::Eager), ..SEED_1 }, 0).unwrap();
    assert!(eager.fixed.iter().all(|case| case.run.header.commit == Commit::Eager));
    assert_eq!(eager.fixed.len() + eager.left_out, suite(0).fixed.len());
    assert!(eager.fixed.len() > 40 && eager.left_out > 10, "{}", eager.left_out);
    let few = Suite::whole(VariedGenerator { clouds: 1, ..SEED_1 }, 0).unwrap();
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
