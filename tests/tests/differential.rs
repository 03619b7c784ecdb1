//! Compares the machine that ships with the reference machine, decision by decision.

use std::cell::RefCell;
use std::fs;
use std::io::BufReader;
use std::path::Path;

use fuseline_engine::arbiter::Arbiter;
use fuseline_testkit::{
    Coverage, Generator, Ledger, OperatorConfig, Run, VariedGenerator, admissions_and_ends, split,
};
use fuseline_tests::fuzz::compare;
use fuseline_traces::{
    Commit, Decision, Event, Events, ExpectedDecisions, Header, Input, Reference,
};

/// The runs under each commit rule, enough to reach everything. The variable `CASES` overrides it.
const CASES: u64 = 1024;
/// The runs that suffice if nothing is counted.
const FEWER: u64 = 512;

fn arbiter(header: &Header) -> Arbiter {
    Arbiter::new(header).expect("the reader and the strategy make sound configurations")
}

fn decisions(arbiter: &mut Arbiter, input: &Input) -> Vec<Decision> {
    let mut decisions = Vec::new();
    arbiter.decide(input, |decision| decisions.push(decision));
    decisions
}

/// Runs `property` on generated runs. A failure shows the smallest run as a trace.
fn check(commits: &[Commit], cases: u64, mut property: impl FnMut(&Run) -> Result<(), String>) {
    let wanted = std::env::var("CASES").ok().and_then(|cases| cases.parse().ok());
    for commit in commits {
        let generator = Generator { seed: 1, commit: Some(*commit), clouds: 15 };
        for number in 0..wanted.unwrap_or(cases) {
            let run = generator.run(number);
            if let Err(difference) = property(&run) {
                let property = RefCell::new(&mut property);
                let shortest = run.shortened(|run| property.borrow_mut()(run).err());
                let (run, difference) = shortest.unwrap_or((run, difference));
                panic!(
                    "{difference}\nThe smallest part of run {number}, as it should be:\n{run:?}"
                );
            }
        }
    }
}

/// The core makes every decision that the rules demand, in order, and no other (F0–F8).
#[test]
fn core_decides_as_the_reference_machine() {
    let mut reach = Coverage::default();
    check(&Commit::ALL, CASES, |run| compare(run, &mut reach));
    for share in reach.shares() {
        assert!(share.missing.is_empty(), "no run reached {:#?}", share.missing);
    }
}

/// The core and the reference machine agree at all scales of time, with long chains and full
/// windows.
#[test]
fn core_and_reference_agree_on_varied_runs() {
    let mut reach = Coverage::default();
    let generator = VariedGenerator { seed: 1, commit: None, clouds: 15 };
    for number in 0..FEWER {
        let run = generator.run(number);
        if let Err(difference) = compare(&run, &mut reach) {
            panic!("{difference}\nRun {number}, as it should be:\n{run:?}");
        }
    }
}

/// This tests the reference machine; the core's decisions are compared with it (P13).
#[test]
fn p13_reference_progressive_is_as_patient() {
    check(&[Commit::Progressive], FEWER, |run| {
        let patient = Header { commit: Commit::Patient, ..run.header.clone() };
        let mut machines = [Reference::new(&run.header), Reference::new(&patient)];
        for input in &run.inputs {
            let [found, expected] = [0, 1].map(|index| {
                let mut decided = ExpectedDecisions::new();
                machines[index].apply(input, &mut decided);
                let commit = [Commit::Progressive, Commit::Patient][index];
                admissions_and_ends(commit, decided.iter().map(|(decision, _)| decision))
            });
            if found != expected {
                return Err(format!("{input}: {found:?}, patient {expected:?}"));
            }
        }
        Ok(())
    });
}

#[test]
fn p1_to_p9_and_p11_to_p12_hold_in_every_run() {
    check(&Commit::ALL, FEWER, |run| {
        let (mut arbiter, mut ledger) = (arbiter(&run.header), Ledger::default());
        for (i, input) in run.inputs.iter().enumerate() {
            let found = decisions(&mut arbiter, input);
            let ((fired, own), terms) = (split(input, &found), OperatorConfig::from(&run.header));
            let violations = ledger.enter(terms, input, fired, own, arbiter.next_due());
            if let Some(violation) = violations.first() {
                return Err(format!("input {i}, {input}: {violation}"));
            }
        }
        Ok(())
    });
}

#[test]
fn p10_ticks_at_every_due_instant_change_no_decision() {
    check(&Commit::ALL, FEWER, |run| {
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
fn p10_order_of_clouds_changes_no_decision() {
    check(&Commit::ALL, FEWER, |run| {
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
fn core_replays_the_conforming_corpus() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../traces/corpus");
    let mut replayed = 0;
    for entry in fs::read_dir(&corpus).expect("the corpus is there") {
        let path = entry.expect("a readable folder").path();
        if path.extension().is_none_or(|extension| extension != "jsonl") {
            continue;
        }
        let file = BufReader::new(fs::File::open(&path).expect("a readable file"));
        let mut reader = Events::new(path.display().to_string(), file).expect("a header");
        let mut arbiter = arbiter(reader.header());
        let mut expected = Vec::new().into_iter();
        while let Some(event) = reader.next_event().expect("a well-formed trace") {
            let location = format!("{}:{}", path.display(), reader.line());
            match event {
                Event::Input(input) => {
                    assert_eq!(
                        expected.next(),
                        None,
                        "{location}: a decision is missing before it"
                    );
                    expected = decisions(&mut arbiter, &input).into_iter();
                }
                Event::Decision(found) => assert_eq!(expected.next(), Some(found), "{location}"),
            }
        }
        assert_eq!(expected.next(), None, "{}: a decision is missing at its end", path.display());
        replayed += 1;
    }
    assert!(replayed > 0, "no trace in {}", corpus.display());
}
