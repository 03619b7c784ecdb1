use super::*;

fn suite(cases: u64) -> Suite {
    Suite::whole(Generator { seed: 1, commit: None, clouds: 4 }, cases).unwrap()
}

#[test]
fn a_thousand_generated_runs_reach_every_rule_reason_pair_and_edge() {
    let suite = suite(1000);
    let mut coverage = Coverage::default();
    for number in 0..suite.generated {
        coverage.watch(&suite.case(number).run);
    }
    for share in coverage.shares() {
        assert!(share.missing.is_empty(), "{}: no run reached {:?}", share.kind, share.missing);
    }
}

#[test]
fn a_generated_case_is_the_same_for_ever() {
    let Case { id, run, .. } = suite(0).case(17);
    assert_eq!(id, "g-1-17");
    let again = Suite::of(&[id], Generator { seed: 9, commit: None, clouds: 4 }).unwrap();
    assert_eq!(again.fixed[0].run, run);
}

#[test]
fn the_digest_changes_with_the_cases() {
    let hash = suite(3).hash();
    assert_eq!(hash, suite(3).hash());
    assert_ne!(hash, suite(2).hash());
    assert_eq!(hash.len(), 64);
}
