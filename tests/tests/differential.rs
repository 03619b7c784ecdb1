//! The machine that ships against the reference machine, decision for decision.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::BufReader;
use std::path::Path;

use fuseline_arbiter::Arbiter;
use fuseline_tests::{Ledger, Run, runs};
use fuseline_traces::{
    Commit, Decision, DropReason, Event, Header, Input, OfferRefusal, OpenRefusal, Reader,
    Reference,
};
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestError, TestRunner};

/// Enough that an outcome that one run in a hundred reaches is not missed; `PROPTEST_CASES` overrides it.
const CASES: u32 = 1024;
/// Enough where nothing is counted.
const FEWER: u32 = 256;

fn arbiter(header: &Header) -> Arbiter {
    Arbiter::new(header).expect("the reader and the strategy make sound configurations")
}

fn decisions(arbiter: &mut Arbiter, input: &Input) -> Vec<Decision> {
    let mut decisions = Vec::new();
    arbiter.decide(input, |decision| decisions.push(decision));
    decisions
}

/// Runs `property` on random runs; a failure shows the smallest run as a trace.
fn check(cases: u32, property: impl Fn(&Run) -> Result<(), String>) {
    let wanted = std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok());
    let config = Config {
        cases: wanted.unwrap_or(cases),
        failure_persistence: None,
        // Unoptimized, the default generator takes most of the time.
        rng_algorithm: RngAlgorithm::XorShift,
        ..Config::default()
    };
    let outcome =
        TestRunner::new(config).run(&runs(), |run| property(&run).map_err(TestCaseError::fail));
    match outcome {
        Ok(()) => {}
        Err(TestError::Fail(_, run)) => {
            let (smallest, difference) = shorten(run, &property);
            panic!("{difference}\nThe smallest run, as it should be:\n{smallest:?}");
        }
        Err(abort) => panic!("{abort}"),
    }
}

/// Leaves out every input that a failing run does not need: a step that shrinks may still stand for many.
fn shorten(mut run: Run, property: impl Fn(&Run) -> Result<(), String>) -> (Run, String) {
    let mut difference = property(&run).err().unwrap_or_default();
    let mut i = 0;
    while i < run.inputs.len() {
        let mut shorter = run.clone();
        shorter.inputs.remove(i);
        match property(&shorter) {
            // What was needed before may no longer be.
            Err(still) => (run, difference, i) = (shorter, still, 0),
            Ok(()) => i += 1,
        }
    }
    (run, difference)
}

/// F0–F8: every decision that the rules demand, in order, and no other.
#[test]
fn the_core_decides_what_the_reference_machine_decides() {
    let seen = RefCell::new(BTreeMap::new());
    check(CASES, |run| {
        let (mut arbiter, mut reference) = (arbiter(&run.header), Reference::new(&run.header));
        let mut demands = Vec::new();
        for (i, input) in run.inputs.iter().enumerate() {
            demands.clear();
            reference.apply(input, &mut demands);
            let expected: Vec<Decision> = demands.iter().map(|(decision, _)| *decision).collect();
            let found = decisions(&mut arbiter, input);
            if found != expected {
                return Err(format!("input {i}, {input:?}: {found:?}, the rules say {expected:?}"));
            }
            if arbiter.next_due() != reference.next_due() {
                return Err(format!("input {i}, {input:?}: next due is {:?}", arbiter.next_due()));
            }
            note(run.header.commit, input, &found, &mut seen.borrow_mut());
        }
        Ok(())
    });
    let seen = seen.into_inner();
    let missing: Vec<_> =
        all_outcomes().into_iter().filter(|outcome| !seen.contains_key(outcome)).collect();
    assert!(missing.is_empty(), "no run reached {missing:#?}");
}

#[test]
fn p1_to_p9_and_p11_hold_in_every_run() {
    check(FEWER, |run| {
        let (mut arbiter, mut ledger) = (arbiter(&run.header), Ledger::new(&run.header));
        for (i, input) in run.inputs.iter().enumerate() {
            let found = decisions(&mut arbiter, input);
            ledger
                .enter(input, &found, arbiter.next_due())
                .map_err(|broken| format!("input {i}, {input:?}: {broken}"))?;
        }
        Ok(())
    });
}

#[test]
fn p10_ticks_at_every_due_instant_change_no_decision() {
    check(FEWER, |run| {
        let (mut coarse, mut fine) = (arbiter(&run.header), arbiter(&run.header));
        for input in &run.inputs {
            let expected = decisions(&mut coarse, input);
            let mut found = Vec::new();
            while let Some(at) = fine.next_due().filter(|due| *due <= input.at()) {
                found.extend(decisions(&mut fine, &Input::Tick { at }));
                if fine.next_due().is_some_and(|due| due <= at) {
                    return Err(format!("{input:?}: what is due at {at} does not fire then"));
                }
            }
            found.extend(decisions(&mut fine, input));
            let undated =
                |all: &[Decision]| -> Vec<_> { all.iter().map(|d| d.redated(0)).collect() };
            if undated(&found) != undated(&expected) {
                return Err(format!("{input:?}: fine {found:?}, coarse {expected:?}"));
            }
        }
        Ok(())
    });
}

#[test]
fn p10_the_order_of_clouds_in_the_configuration_changes_no_decision() {
    check(FEWER, |run| {
        let mut turned = run.header.clone();
        turned.clouds.reverse();
        let (mut one, mut other) = (arbiter(&run.header), arbiter(&turned));
        for input in &run.inputs {
            let (found, expected) = (decisions(&mut other, input), decisions(&mut one, input));
            if found != expected {
                return Err(format!("{input:?}: reversed {found:?}, else {expected:?}"));
            }
        }
        Ok(())
    });
}

#[test]
fn the_core_replays_every_conforming_trace_of_the_corpus() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../traces/corpus");
    let mut replayed = 0;
    for entry in fs::read_dir(&corpus).expect("the corpus is there") {
        let path = entry.expect("a readable folder").path();
        if path.extension().is_none_or(|extension| extension != "jsonl") {
            continue;
        }
        let file = BufReader::new(fs::File::open(&path).expect("a readable file"));
        let mut reader = Reader::new(path.display().to_string(), file).expect("a header");
        let mut arbiter = arbiter(reader.header());
        let mut expected = Vec::new().into_iter();
        while let Some(event) = reader.next_event().expect("a well-formed trace") {
            let place = format!("{}:{}", path.display(), reader.line());
            match event {
                Event::Input(input) => {
                    assert_eq!(expected.next(), None, "{place}: a decision is missing before it");
                    expected = decisions(&mut arbiter, &input).into_iter();
                }
                Event::Decision(found) => assert_eq!(expected.next(), Some(found), "{place}"),
            }
        }
        assert_eq!(expected.next(), None, "{}: a decision is missing at its end", path.display());
        replayed += 1;
    }
    assert!(replayed > 0, "no trace in {}", corpus.display());
}

/// Notes what an input came to: the outcome with its reason, the input's kind, the commit rule.
fn note(commit: Commit, input: &Input, found: &[Decision], seen: &mut BTreeMap<String, u64>) {
    let kind = kind(input);
    for decision in found {
        let what = match decision {
            Decision::Timer { p: 0, .. } => "the deadline fires".into(),
            Decision::Timer { .. } => "a cloud's timer fires".into(),
            Decision::RefuseOpen { why, .. } => format!("{kind} refused {why}"),
            Decision::RefuseOffer { why, .. } => format!("{kind} refused {why}"),
            Decision::Request { .. } => "request".into(),
            Decision::Hold { p: 0, .. } => "local held".into(),
            Decision::Hold { .. } => "a cloud held".into(),
            Decision::Drop { why, .. } => format!("{kind} dropped {why}"),
            Decision::Emit { p, .. } => {
                format!("{kind} emits {}", if *p == 0 { "local" } else { "a cloud" })
            }
            Decision::Miss { .. } => format!("{kind} misses"),
            Decision::Cancel { .. } => format!("{kind} cancels"),
        };
        *seen.entry(format!("{commit}: {what}")).or_default() += 1;
    }
    if found.is_empty() {
        *seen.entry(format!("{commit}: {kind} without a decision")).or_default() += 1;
    }
}

/// All that `note` can note, but what F5 does before an input of another kind than a tick.
fn all_outcomes() -> BTreeSet<String> {
    let mut outcomes: Vec<String> = [
        "the deadline fires",
        "a cloud's timer fires",
        "request",
        "local held",
        "a cloud held",
        "open without a decision",
        "fail without a decision",
        "tick without a decision",
        "tick misses",
        "fail misses",
        "tick emits local",
        "tick emits a cloud",
        "result emits local",
        "result emits a cloud",
        "fail emits local",
        "fail emits a cloud",
        "result cancels",
        "fail cancels",
        "tick cancels",
    ]
    .map(String::from)
    .into();
    for why in OpenRefusal::ALL {
        outcomes.push(format!("open refused {why}"));
    }
    for why in OfferRefusal::ALL {
        outcomes.push(format!("offer refused {why}"));
    }
    for why in DropReason::ALL {
        outcomes.push(format!("result dropped {why}"));
        outcomes.push(format!("fail dropped {why}"));
    }
    let mut all = BTreeSet::new();
    for commit in Commit::ALL {
        all.extend(outcomes.iter().map(|outcome| format!("{commit}: {outcome}")));
    }
    all
}

fn kind(input: &Input) -> &'static str {
    match input {
        Input::Open { .. } => "open",
        Input::Offer { .. } => "offer",
        Input::Result { .. } => "result",
        Input::Fail { .. } => "fail",
        Input::Tick { .. } => "tick",
    }
}
