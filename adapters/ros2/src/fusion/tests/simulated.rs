//! The node's loop in virtual time, on topics that lose, delay, double and reorder what they carry, with peers that die and
//! come back and parameters that are set meanwhile.
//!
//! A seed makes a [`Scenario`]. It is played by the shipped loop, engine and recorder; instead of the middleware there
//! are the channels by which the node receives it. Each check is a test, on the same seeds. Fresh ones, or one of them again:
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

/// This many seeds from 0 on show everything that a seeded fault was ever caught by.
const SEEDS: u64 = 200;

/// A run takes some milliseconds.
const HANGS: Duration = Duration::from_secs(20);

/// The check that a run breaks which has no end.
const ENDS: &str = "d8_everything_ends";

/// Seeds that ever failed: they are played first.
const KEPT: [u64; 0] = [];

/// The sums over the seeds.
#[derive(Default)]
struct Sum {
    broken: BrokenChecks,
    /// The number of runs that came to each kind of ending.
    kinds: BTreeMap<&'static str, usize>,
}

static SUM: LazyLock<Sum> = LazyLock::new(|| {
    let mut sum = Sum::default();
    for seed in KEPT.into_iter().chain(0..SEEDS) {
        let (findings, kinds) = simulated(&Scenario::draw(seed));
        sum.broken.add(seed, findings);
        for kind in kinds {
            *sum.kinds.entry(kind).or_default() += 1;
        }
        // A run that hangs goes on in its thread.
        if sum.broken.has(ENDS) {
            break;
        }
    }
    sum
});

/// Returns what does not hold of a run, and what it came to.
fn simulated(scenario: &Scenario) -> (Vec<Finding>, BTreeSet<&'static str>) {
    let (publish_report, ended) = mpsc::channel();
    let scenario = scenario.clone();
    // In a loop that never sleeps no virtual time passes, so real time decides.
    thread::spawn(move || {
        let played = play(&scenario);
        let reported = match Facts::new(&scenario, &played) {
            Ok(facts) => (facts.findings(), facts.kinds()),
            Err(reason) => (vec![Finding { check: "d10_whole_trace", reason }], BTreeSet::new()),
        };
        // Nobody listens any more if it took too long.
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

/// The seed's run, a smallest one that breaks the same, and why.
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

/// D1: each input is taken in, and leads to one status and at most one output, unless it has no key or that of an open message.
#[test]
fn d1_each_input_leads_to_one_status() {
    holds("d1_one_item");
}

/// D2: an output and a hint are what their source sent for their message, byte for byte.
#[test]
fn d2_an_output_is_what_its_source_sent() {
    holds("d2_its_own_value");
}

/// D3: the strict judge finds nothing, and statuses and outputs are its decisions.
#[test]
fn d3_the_rules_decide_on_topics() {
    holds("d3_the_rules_decide");
}

/// D4: the backlog of an offer is what waits for its cloud.
#[test]
fn d4_backlogs_are_what_waits() {
    holds("d4_true_backlog");
}

/// D8: the node ends when it is stopped, and answers what is open before.
#[test]
fn d8_a_node_that_is_to_end_ends() {
    holds("d8_everything_ends");
}

/// D8: nothing is kept once the node has ended.
#[test]
fn d8_nothing_of_a_run_is_left() {
    holds("d8_nothing_is_left");
}

/// D10: the trace is whole.
#[test]
fn d10_the_trace_of_a_node_is_whole() {
    holds("d10_whole_trace");
}

/// D11: tally and trace agree.
#[test]
fn d11_a_node_has_one_account() {
    holds("d11_one_account");
}

/// D13: once the network is well again, each message is answered by the best, whatever was lost before.
#[test]
fn d13_what_was_lost_costs_nothing_later() {
    holds("d13_lost_words");
}

/// D14: what has no key, or the key of no message, is not taken in.
#[test]
fn d14_what_has_no_key_is_counted_and_no_more() {
    holds("d14_its_own_topic");
}

/// D15: diagnostics report what was missed, refused and not sent with the right level, and nothing else.
#[test]
fn d15_levels_are_those_of_what_happened() {
    holds("d15_reported");
}

/// D16: deadlines, clouds that are enabled, and the state of a managed node are as they were set when a message came.
#[test]
fn d16_what_is_set_holds_for_the_next_message() {
    holds("d16_as_set");
}

/// No check is without its test here.
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

#[test]
fn a_smallest_run_has_what_breaks_it_and_no_more() {
    let drawn = (0..SEEDS).map(Scenario::draw);
    let mut large = drawn.filter(|it| it.inputs.len() > 20 && it.turns.len() > 2);
    let scenario = large.next().unwrap();
    let (input, turn) = (scenario.inputs[7].key, scenario.turns[1].0);
    let smallest = smaller::smallest(&scenario, |it| {
        it.inputs.iter().any(|it| it.key == input) && it.turns.iter().any(|it| it.0 == turn)
    });
    assert_eq!((smallest.inputs.len(), smallest.turns.len()), (1, 1), "{smallest}");
    assert_eq!((smallest.window, smallest.waiting), (16, 64), "{smallest}");
}

/// The scenarios that the tests play lead to each kind of ending.
#[test]
fn the_seeds_come_to_each_kind_of_ending() {
    for kind in facts::KINDS {
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
    // Printed also when all tests run.
    let reported = format!("seeds {first} to {}: {inputs} inputs in {took:.1} s", next - 1);
    writeln!(io::stderr(), "{reported}").unwrap();
}

/// A seed by chance, short enough to be read aloud.
fn by_chance() -> u64 {
    Rng::by_chance().u64(0..1_000_000_000)
}
