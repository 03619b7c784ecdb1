//! Plays ROS 2 nodes from the same seeds for every check. Each check has a test of its own, so that
//! it can be a witness.

use std::sync::LazyLock;

use fuseline_system_tests::simulate::nodes::{CHECKS, KINDS, Scenario};
use fuseline_system_tests::simulate::{Drawn, SeedResults, Simulator};

/// Every check that ever caught a seeded fault catches it within this many seeds from 0 on.
const SEEDS: u64 = 200;

static RESULTS: LazyLock<SeedResults> = LazyLock::new(|| SeedResults::below::<Scenario>(SEEDS));

fn holds(check: &str) {
    RESULTS.broken.holds(CHECKS, check);
}

/// Each input is accepted and leads to one status and at most one output, unless it has no key or
/// the key of an open message (D1).
#[test]
fn d1_each_input_leads_to_one_status() {
    holds("d1_one_item");
}

/// An output or a hint is what its source sent for its message, byte for byte (D2).
#[test]
fn d2_an_output_is_what_its_source_sent() {
    holds("d2_its_own_value");
}

/// The strict judge finds nothing, and statuses and outputs are the trace's decisions (D3).
#[test]
fn d3_the_rules_decide_on_topics() {
    holds("d3_the_rules_decide");
}

/// The backlog of an offer is the number of requests that wait for its cloud (D4).
#[test]
fn d4_backlogs_are_what_waits() {
    holds("d4_true_backlog");
}

/// A node that is stopped answers its open messages, and then ends (D8).
#[test]
fn d8_a_node_that_is_to_end_ends() {
    holds("d8_everything_ends");
}

/// No message and no result is kept after the node has ended (D8).
#[test]
fn d8_nothing_of_a_run_is_left() {
    holds("d8_nothing_is_left");
}

/// The trace is whole (D10).
#[test]
fn d10_the_trace_of_a_node_is_whole() {
    holds("d10_whole_trace");
}

/// Tally and trace agree (D11).
#[test]
fn d11_a_node_has_one_account() {
    holds("d11_one_account");
}

/// Once the network works again, the best source answers each message, whatever was lost before
/// (D13).
#[test]
fn d13_what_was_lost_costs_nothing_later() {
    holds("d13_lost_words");
}

/// A message without a readable key, or a result without the key of a message, is not accepted
/// (D14).
#[test]
fn d14_what_has_no_key_is_counted_and_no_more() {
    holds("d14_its_own_topic");
}

/// Diagnostics report messages that were missed, refused or not sent, with the right level, and
/// nothing else (D15).
#[test]
fn d15_levels_are_those_of_what_happened() {
    holds("d15_reported");
}

/// A message gets the deadlines, the enabled clouds and the lifecycle state that were set when it
/// came (D16).
#[test]
fn d16_what_is_set_holds_for_the_next_message() {
    holds("d16_as_set");
}

/// Each check has a test here.
#[test]
fn every_check_has_a_test() {
    let here = include_str!("nodes.rs");
    for check in CHECKS {
        assert!(here.contains(&format!("holds(\"{}\")", check.name)), "{}", check.name);
    }
}

#[test]
fn a_seed_is_the_same_run_to_the_byte() {
    // A run that hangs fails here once, and not twice for each seed.
    holds("d8_everything_ends");
    let mut simulator = Simulator::new().unwrap();
    for seed in 0..20 {
        let [one, other] = [(); 2].map(|()| simulator.simulate(&Scenario::draw(seed)).unwrap());
        assert!(!one.trace.is_empty());
        assert_eq!(one.trace, other.trace, "seed {seed}");
        assert_eq!(one.external_log(), other.external_log(), "seed {seed}");
    }
}

/// The scenarios of these tests lead to each kind of ending.
#[test]
fn the_seeds_come_to_each_kind_of_ending() {
    for (kind, _) in KINDS {
        let count = RESULTS.kinds.get(kind).copied().unwrap_or(0);
        assert!(count >= 5, "{count} runs with {kind}: {:#?}", RESULTS.kinds);
    }
}
