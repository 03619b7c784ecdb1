//! The node's loop in virtual time. The topics lose, delay, duplicate and reorder messages, peers
//! die and come back, and parameters are set meanwhile.
//!
//! A seed determines a [`Scenario`]. The shipped loop, engine and recorder play it. In place of the
//! middleware there are the channels by which the node receives from it. Each check is a test, on
//! the same seeds. To play fresh seeds, or one of them again:
//!
//! ```sh
//! SIMULATED_SECONDS=60 cargo test -p fuseline-ros2 --lib fresh_seeds -- --nocapture
//! SIMULATED_SEED=42 cargo test -p fuseline-ros2 --lib fresh_seeds -- --nocapture
//! ```

mod checks;
mod draw;
mod facts;
mod play;
mod scenario;
mod smaller;

use std::collections::{BTreeMap, BTreeSet};
use std::env;
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::sync::{LazyLock, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use checks::CHECKS;
use facts::Facts;
use fuseline_system_tests::judge::{BrokenChecks, Finding};
use fuseline_testkit::Rng;
use play::play;
use scenario::Scenario;

/// Every check that ever caught a seeded fault catches it within this many seeds from 0 on.
const SEEDS: u64 = 200;

/// A run takes some milliseconds. A run that takes longer than this hangs.
const HANGS: Duration = Duration::from_secs(20);

/// The check that a run without end breaks.
const ENDS: &str = "d8_everything_ends";

/// The sums over the seeds.
#[derive(Default)]
struct Sum {
    broken: BrokenChecks,
    /// The number of runs that had each kind of ending.
    kinds: BTreeMap<&'static str, usize>,
}

static SUM: LazyLock<Sum> = LazyLock::new(|| {
    let mut sum = Sum::default();
    for seed in 0..SEEDS {
        let (findings, kinds) = simulated(&Scenario::draw(seed));
        sum.broken.add(seed, findings);
        for kind in kinds {
            *sum.kinds.entry(kind).or_default() += 1;
        }
        // A run that hangs continues in its thread.
        if sum.broken.has(ENDS) {
            break;
        }
    }
    sum
});

/// Returns the checks that a run breaks, and its kinds of endings.
fn simulated(scenario: &Scenario) -> (Vec<Finding>, BTreeSet<&'static str>) {
    let (publish_report, ended) = mpsc::channel();
    let scenario = scenario.clone();
    // No virtual time passes in a loop that never sleeps, so real time decides.
    thread::spawn(move || {
        let played = play(&scenario);
        let reported = match Facts::new(&scenario, &played) {
            Ok(facts) => (facts.findings(), facts.kinds()),
            Err(reason) => (vec![Finding { check: "d10_whole_trace", reason }], BTreeSet::new()),
        };
        // If the run took too long, nobody listens.
        let _ = publish_report.send(reported);
    });
    ended.recv_timeout(HANGS).unwrap_or_else(|_| {
        let reason = format!("the node did not end well within {HANGS:?}");
        (vec![Finding { check: ENDS, reason }], BTreeSet::new())
    })
}

fn holds(check: &str) {
    SUM.broken.holds(CHECKS, check);
}

/// Describes the seed's run, a smallest run that breaks the same check, and the reason.
fn reported(seed: u64, finding: &Finding) -> String {
    if finding.check == ENDS {
        return format!(
            "seed {seed} breaks {ENDS}: {}\n\n{}",
            finding.reason,
            Scenario::draw(seed)
        );
    }
    let breaks = |smaller: &Scenario| {
        simulated(smaller).0.into_iter().find(|again| again.check == finding.check)
    };
    let smallest = smaller::smallest(&Scenario::draw(seed), |it| breaks(it).is_some());
    let reason = breaks(&smallest).map_or_else(|| finding.reason.clone(), |again| again.reason);
    let mut reported = format!("seed {seed} breaks {}: {reason}\n\n{smallest}", finding.check);
    let trace = play(&smallest).trace;
    let _ = write!(reported, "{}", String::from_utf8_lossy(&trace));
    reported
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
    let here = include_str!("simulated.rs");
    for check in CHECKS {
        assert!(here.contains(&format!("holds(\"{}\")", check.name)), "{}", check.name);
    }
}

#[test]
fn a_seed_is_the_same_run_to_the_byte() {
    for seed in 0..20 {
        let [one, other] = [(); 2].map(|()| play(&Scenario::draw(seed)));
        assert!(!one.trace.is_empty());
        assert_eq!(one.trace, other.trace, "seed {seed}");
        assert_eq!(format!("{:?}", one.log), format!("{:?}", other.log), "seed {seed}");
    }
}

/// The scenarios of these tests lead to each kind of ending.
#[test]
fn the_seeds_come_to_each_kind_of_ending() {
    for (kind, _) in facts::KINDS {
        let count = SUM.kinds.get(kind).copied().unwrap_or(0);
        assert!(count >= 5, "{count} runs with {kind}: {:#?}", SUM.kinds);
    }
}

/// Plays the seeds that the variables in the module's documentation select, or else five more.
#[test]
fn fresh_seeds() {
    let number = |name| env::var(name).ok().map(|text| text.parse::<u64>().expect("a number"));
    let seconds = number("SIMULATED_SECONDS").map(Duration::from_secs);
    let (first, runs, is_requested) = match number("SIMULATED_SEED") {
        Some(seed) => (seed, 1, true),
        None if seconds.is_some() => (by_chance(), u64::MAX, true),
        None => (SEEDS, 5, false),
    };
    let start = Instant::now();
    let (mut next, mut inputs) = (first, 0);
    while next - first < runs && seconds.is_none_or(|seconds| start.elapsed() < seconds) {
        let scenario = Scenario::draw(next);
        inputs += scenario.inputs.len();
        if let Some(finding) = simulated(&scenario).0.first() {
            assert!(
                is_requested,
                "SIMULATED_SEED={next} breaks {}: {}",
                finding.check, finding.reason
            );
            panic!("{}", reported(next, finding));
        }
        next += 1;
    }
    if runs == 1 {
        print!("{}", Scenario::draw(first));
    }
    if !is_requested {
        return;
    }
    let took = start.elapsed().as_secs_f64();
    // This is printed even if all tests run.
    let reported = format!("seeds {first} to {}: {inputs} inputs in {took:.1} s", next - 1);
    writeln!(io::stderr(), "{reported}").unwrap();
}

/// Returns a random seed that is short enough to be read aloud.
fn by_chance() -> u64 {
    Rng::by_chance().u64(0..1_000_000_000)
}
