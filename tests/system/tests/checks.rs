//! Each check on the same seeds, and on the saved ones: a test a check, so that each can be a witness.

use std::collections::BTreeMap;
use std::sync::LazyLock;
use std::thread;

use fuseline_system_tests::simulate::{CHECKS, KeptSeed, Scenario, Simulator, saved_seeds};

/// So many seeds from 0 on show everything that a seeded fault was ever caught by, in a few seconds.
const SEEDS: u64 = 300;

/// By check: a seed that broke it, and how.
static BROKEN: LazyLock<BTreeMap<&'static str, (u64, String)>> = LazyLock::new(|| {
    let saved = saved_seeds().into_iter().map(|KeptSeed { seed, .. }| seed);
    let seeds: Vec<u64> = saved.chain(0..SEEDS).collect();
    let half = |first| broken_of(seeds.iter().skip(first).step_by(2));
    let (mut broken, others) = thread::scope(|scope| {
        let others = scope.spawn(|| half(1));
        (half(0), others.join().expect("no panic"))
    });
    broken.extend(others);
    broken
});

fn broken_of<'a>(seeds: impl Iterator<Item = &'a u64>) -> BTreeMap<&'static str, (u64, String)> {
    let simulator = Simulator::new().expect("a folder for traces");
    let mut broken = BTreeMap::new();
    for seed in seeds {
        let run = simulator.simulate(&Scenario::draw(*seed)).expect("a folder for traces");
        for finding in run.findings {
            broken.entry(finding.check).or_insert((*seed, finding.reason));
        }
    }
    broken
}

fn holds(check: &str) {
    assert!(CHECKS.iter().any(|known| known.name == check), "there is no check {check}");
    if let Some((seed, reason)) = BROKEN.get(check) {
        let reason: String = reason.chars().take(2000).collect();
        panic!("seed {seed}: {reason}");
    }
}

/// D1: each message taken in leaves as one item, as and when the trace says.
#[test]
fn d1_one_item() {
    holds("d1_one_item");
}

/// D2: an item and a hint bear the value that their source made of their message.
#[test]
fn d2_its_own_value() {
    holds("d2_its_own_value");
}

/// D3: the strict judge finds nothing, and each cloud gets an offer of each message.
#[test]
fn d3_the_rules_decide() {
    holds("d3_the_rules_decide");
}

/// D4: the backlog of an offer is what waits in its queue, and queues are served in order.
#[test]
fn d4_true_backlog() {
    holds("d4_true_backlog");
}

/// D5: a call gets the time that is left when it begins.
#[test]
fn d5_time_left() {
    holds("d5_time_left");
}

/// D6: a call ends when it is cancelled or due, no sooner, and local never.
#[test]
fn d6_aborted() {
    holds("d6_aborted");
}

/// D7: an error or panic fails its own call, and ends nothing else.
#[test]
fn d7_failures() {
    holds("d7_failures");
}

/// D7: nothing panics but what the scenario lets panic.
#[test]
fn d7_no_panic_comes_through() {
    holds("d7_no_panic_comes_through");
}

/// D8: the operator ends, and ends well.
#[test]
fn d8_everything_ends() {
    holds("d8_everything_ends");
}

/// D8: messages, values, calls and tasks are no more than was configured.
#[test]
fn d8_bounded() {
    holds("d8_bounded");
}

/// D9: timers are served within a millisecond, and messages at once.
#[test]
fn d9_served_in_time() {
    holds("d9_served_in_time");
}

/// D10: the trace ends with a whole input; if it ends early, that is reported.
#[test]
fn d10_whole_trace() {
    holds("d10_whole_trace");
}

/// D11: tally, metrics, items and trace agree.
#[test]
fn d11_one_account() {
    holds("d11_one_account");
}

/// T5: a policy gets how each call ended, and when.
#[test]
fn t5_every_end_is_reported() {
    holds("t5_every_end_is_reported");
}

/// No check is without its test here.
#[test]
fn every_check_has_a_test() {
    let here = include_str!("checks.rs");
    for check in CHECKS {
        assert!(here.contains(&format!("fn {}()", check.name)), "{} has no test", check.name);
    }
}
