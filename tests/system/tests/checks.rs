//! Runs each check on the same seeds, and on the saved seeds. Each check has a test of its own, so
//! that it can be a witness.

use std::sync::LazyLock;

use fuseline_system_tests::simulate::{CHECKS, Scenario, SeedResults};

/// Every check that ever caught a seeded fault catches it within this many seeds from 0 on, in a
/// few seconds.
const SEEDS: u64 = 300;

static RESULTS: LazyLock<SeedResults> = LazyLock::new(|| SeedResults::below::<Scenario>(SEEDS));

fn holds(check: &str) {
    RESULTS.broken.holds(CHECKS, check);
}

/// Each message leads to one item, with the content and at the instant that the trace states (D1).
#[test]
fn d1_one_item() {
    holds("d1_one_item");
}

/// An item or a hint has the value that its source computed from its message (D2).
#[test]
fn d2_its_own_value() {
    holds("d2_its_own_value");
}

/// The strict judge finds nothing, and each cloud gets an offer of each message (D3).
#[test]
fn d3_the_rules_decide() {
    holds("d3_the_rules_decide");
}

/// The backlog of an offer is the number of requests that wait in its queue, and queues are served
/// in order (D4).
#[test]
fn d4_true_backlog() {
    holds("d4_true_backlog");
}

/// A call gets the time that is left when it begins (D5).
#[test]
fn d5_time_left() {
    holds("d5_time_left");
}

/// A call ends when it is cancelled or due, not sooner. Local is never ended (D6).
#[test]
fn d6_aborted() {
    holds("d6_aborted");
}

/// An error or a panic fails its own call, and nothing else ends (D7).
#[test]
fn d7_failures() {
    holds("d7_failures");
}

/// Nothing panics, except where the scenario asks for it (D7).
#[test]
fn d7_no_panic_comes_through() {
    holds("d7_no_panic_comes_through");
}

/// The operator ends without an error, and no call's panic ends it (D7, D8).
#[test]
fn d8_everything_ends() {
    holds("d8_everything_ends");
}

/// Messages, values, calls and tasks stay within the configured numbers (D8).
#[test]
fn d8_bounded() {
    holds("d8_bounded");
}

/// Timers are served within a millisecond, and messages at once (D9).
#[test]
fn d9_served_in_time() {
    holds("d9_served_in_time");
}

/// The trace ends with a whole input. If it ends early, that is reported (D10).
#[test]
fn d10_whole_trace() {
    holds("d10_whole_trace");
}

/// Tally, metrics, items and trace agree (D11).
#[test]
fn d11_one_account() {
    holds("d11_one_account");
}

/// A policy learns how and when each call ended (T5).
#[test]
fn t5_every_end_is_reported() {
    holds("t5_every_end_is_reported");
}

/// Each check has a test here.
#[test]
fn every_check_has_a_test() {
    let here = include_str!("checks.rs");
    for check in CHECKS {
        assert!(here.contains(&format!("fn {}()", check.name)), "{} has no test", check.name);
    }
}
