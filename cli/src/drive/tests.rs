use super::*;

fn suite(cases: u64) -> Suite {
    Suite::whole(Generator { seed: 1, commit: None, clouds: CLOUDS }, cases).unwrap()
}

#[test]
fn a_generated_case_is_the_same_for_ever() {
    let Case { id, run, .. } = suite(0).case(17);
    assert_eq!(id, "g-1-17");
    let again = Suite::of(&[id], Generator { seed: 9, commit: None, clouds: CLOUDS }).unwrap();
    assert_eq!(again.fixed[0].run, run);
}

#[test]
fn no_change_makes_another_run_of_a_number() {
    let generator = Generator { seed: 1, commit: None, clouds: CLOUDS };
    let names = [0, 1, 2, 17, 25, 125, 999].map(|number| format!("g-1-{number}"));
    let hash = Suite::of(&names, generator).unwrap().hash();
    assert_eq!(&hash[..16], "792ff89fa9374f71");
}

#[test]
fn the_digest_changes_with_the_cases() {
    let hash = suite(3).hash();
    assert_eq!(hash, suite(3).hash());
    assert_ne!(hash, suite(2).hash());
    assert_eq!(hash.len(), 64);
}
