//! Tests the runs of the second generator.

use std::collections::BTreeSet;

use fuseline_testkit::{Coverage, Run, RunContext, VariedGenerator};
use fuseline_traces::{Commit, Decision, Header, Input};

const GENERATOR: VariedGenerator = VariedGenerator { seed: 1, commit: None, clouds: 15 };

fn runs(count: u64) -> impl Iterator<Item = Run> {
    (0..count).map(|number| GENERATOR.run(number))
}

#[test]
fn number_makes_the_same_varied_run() {
    assert_eq!(GENERATOR.run(20), GENERATOR.run(20));
    assert_ne!(GENERATOR.run(20), GENERATOR.run(21));
    assert_ne!(GENERATOR.run(20), VariedGenerator { seed: 2, ..GENERATOR }.run(20));
}

#[test]
fn varied_headers_are_valid() {
    for number in 0..4_000 {
        let header = GENERATOR.run(number % 500 * 8 + number / 500).header;
        assert!((1..=1_024).contains(&header.window), "{header}");
        let all: BTreeSet<u16> = header.clouds.iter().map(|cloud| cloud.p).collect();
        assert!(all.len() == header.clouds.len() && header.clouds.len() <= 15, "{header}");
        assert!(header.clouds.iter().all(|it| it.p > 0 && it.resume < it.limit), "{header}");
    }
}

#[test]
fn restricted_varied_runs_stay_restricted() {
    for clouds in [0, 1, 3] {
        let generator = VariedGenerator { commit: Some(Commit::Patient), clouds, ..GENERATOR };
        for number in 0..200 {
            let header = generator.run(number).header;
            assert_eq!(header.commit, Commit::Patient);
            assert!(header.clouds.len() <= usize::from(clouds), "{header}");
        }
    }
}

#[test]
fn family_has_equal_headers_and_small_changes() {
    let header = |number: u64| GENERATOR.run(number).header;
    let mut changes = [0; 4];
    for first in (0..400).step_by(4) {
        assert_eq!(header(first), header(first + 1));
        let (one, other) = (header(first), header(first + 2));
        let reordered = |header: &Header| {
            let mut clouds = header.clouds.clone();
            clouds.sort_by_key(|cloud| cloud.p);
            clouds
        };
        changes[0] += usize::from(one.commit != other.commit);
        changes[1] += usize::from(one.window != other.window);
        let is_order = one.clouds != other.clouds && reordered(&one) == reordered(&other);
        changes[2] += usize::from(is_order);
        changes[3] += usize::from(reordered(&one) != reordered(&other));
    }
    assert!(changes.iter().all(|count| *count > 0), "{changes:?}");
}

#[test]
fn varied_runs_reach_all_that_runs_reach() {
    let mut coverage = Coverage::default();
    runs(1_000).for_each(|run| coverage.watch(&run));
    for share in coverage.shares() {
        assert!(share.missing.is_empty(), "{}: no run reached {:?}", share.kind, share.missing);
    }
}

#[test]
fn varied_runs_fill_windows_between_64_and_1024() {
    let mut filled = BTreeSet::new();
    for run in runs(1_000).filter(|run| run.header.window > 64) {
        let mut context = RunContext::new(&run.header);
        for input in &run.inputs {
            context.apply(input);
            if context.open().len() == context.window() {
                filled.insert(run.header.window);
            }
        }
    }
    assert!(filled.range(65..1_024).count() > 10 && filled.contains(&1_024), "{filled:?}");
}

#[test]
fn varied_chains_hold_and_send_as_many_as_clouds() {
    let most = |commit: Commit, counts: fn(&Decision) -> Option<u64>| {
        let generator = VariedGenerator { commit: Some(commit), ..GENERATOR };
        let of_run = |run: Run| {
            let (mut context, mut of) = (RunContext::new(&run.header), Vec::new());
            for input in &run.inputs {
                of.extend(context.apply(input).decisions().filter_map(counts));
            }
            let all: BTreeSet<u64> = of.iter().copied().collect();
            all.iter().map(|t| of.iter().filter(|u| *u == t).count()).max().unwrap_or(0)
        };
        (0..1_000).map(|number| of_run(generator.run(number))).max()
    };
    let held = |decision: &Decision| match decision {
        Decision::Hold { t, .. } => Some(*t),
        _ => None,
    };
    let sent = |decision: &Decision| match decision {
        Decision::Emit { t, .. } => Some(*t),
        _ => None,
    };
    assert_eq!(most(Commit::Patient, held), Some(15));
    assert_eq!(most(Commit::Progressive, sent), Some(16));
}

#[test]
fn varied_clocks_step_by_nanoseconds_and_by_hours() {
    let (mut forward, mut back) = (BTreeSet::new(), BTreeSet::new());
    for run in runs(1_000) {
        let mut now = 0;
        for at in run.inputs.iter().map(Input::at) {
            forward.insert(u64::BITS - at.saturating_sub(now).leading_zeros());
            back.insert(u64::BITS - now.saturating_sub(at).leading_zeros());
            now = now.max(at);
        }
    }
    // An hour in ns takes 42 bits.
    for steps in [forward, back] {
        assert!((0..=42).all(|bits| steps.contains(&bits)) && steps.contains(&63), "{steps:?}");
    }
}

#[test]
fn varied_gate_stays_shut_for_thousands_of_inputs() {
    let longest = runs(200).map(|run| {
        let refused = |decision: &Decision| {
            matches!(decision, Decision::RefuseOffer { why, .. } if why.as_str() == "queue")
        };
        let mut context = RunContext::new(&run.header);
        let (mut row, mut most) = (0, 0);
        for input in &run.inputs {
            let step = context.apply(input);
            if step.own.iter().any(|(decision, _)| matches!(decision, Decision::Request { .. })) {
                row = 0;
            }
            row += usize::from(step.own.iter().any(|(decision, _)| refused(decision)));
            most = most.max(row);
        }
        most
    });
    assert!(longest.max() > Some(1_000));
}

#[test]
fn later_family_begins_with_over_65536_inputs() {
    assert!(GENERATOR.run(4 * 1_023).inputs.len() > 65_536);
}
