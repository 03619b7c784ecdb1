use super::*;

fn suite(cases: u64) -> Suite {
    Suite::whole(Generate { seed: 1, commit: None, clouds: None }, cases).unwrap()
}

#[test]
fn a_generated_case_is_the_same_for_ever() {
    for (number, name) in [(34, "g-1-17"), (35, "w-1-17")] {
        let DriveCase { id, run, .. } = suite(0).case(number);
        assert_eq!(id, name);
        let again = Suite::of(&[id], Generate { seed: 9, commit: None, clouds: None }).unwrap();
        assert_eq!(again.fixed[0].run, run);
    }
}

#[test]
fn no_change_makes_another_run_of_a_number() {
    let generator = Generate { seed: 1, commit: None, clouds: None };
    let names = [0, 1, 2, 17, 25, 125, 999].map(|number| format!("g-1-{number}"));
    let hash = Suite::of(&names, generator).unwrap().hash();
    assert_eq!(&hash[..16], "eaca2caaacf77594");
}

#[test]
fn no_change_makes_another_wide_run_of_a_number() {
    let generator = Generate { seed: 1, commit: None, clouds: None };
    let names = [0, 1, 4, 17, 499].map(|number| format!("w-1-{number}"));
    let hash = Suite::of(&names, generator).unwrap().hash();
    assert_eq!(&hash[..16], "28f0b2a66c14f5ff");
}

#[test]
fn the_digest_changes_with_the_cases() {
    let hash = suite(3).hash();
    assert_eq!(hash, suite(3).hash());
    assert_ne!(hash, suite(2).hash());
    assert_eq!(hash.len(), 64);
}

#[test]
fn a_suite_that_ends_by_time_counts_without_overflow() {
    assert_eq!(suite(u64::MAX).len(), u64::MAX);
}
