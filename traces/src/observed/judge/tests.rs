use super::closing::OVERDUE;
use super::*;
use crate::event::Commit;

const SLACK: Slack = Slack { tolerance: 2, lateness: 5 };

fn judge() -> Judge {
    let header = Header { operator: None, window: 4, commit: Commit::Eager, clouds: vec![] };
    Judge::new("a.jsonl", &header, SLACK)
}

fn opened(at: u64, t: u64) -> Event {
    Event::Input(Input::Open { at, t, deadline: None })
}

fn came(at: u64, t: u64) -> Event {
    Event::Input(Input::Result { at, t, p: 0 })
}

/// The open timestamps bound the memory, whatever the trace's length.
#[test]
fn keeps_only_the_range_of_done_timestamps() {
    let mut judge = judge();
    for t in 0..20_000 {
        let at = 10 * t;
        let emit = Event::Decision(Decision::Emit { at, t, p: 0 });
        for event in [opened(at, t), came(at, t), emit] {
            judge.line(t, &event).expect("it is in order");
        }
        assert!(judge.open.len() <= 4 && judge.closing.len() <= 4, "{}", judge.open.len());
    }
    assert_eq!(judge.ended.len(), 1);
    assert_eq!(judge.finish().judged, 20_000);
}

/// Outputs that are never said to be final take no memory either (F9).
#[test]
fn keeps_only_the_range_without_finals() {
    let header = Header { operator: None, window: 4, commit: Commit::Progressive, clouds: vec![] };
    let mut judge = Judge::new("a.jsonl", &header, SLACK);
    for t in 0..20_000 {
        let at = 10 * t;
        let emit = Event::Decision(Decision::Emit { at, t, p: 0 });
        for event in [opened(at, t), came(at, t), emit] {
            judge.line(t, &event).expect("it is in order");
        }
        assert!(judge.open.len() <= 5 && judge.closing.len() <= 5, "{}", judge.open.len());
    }
    assert_eq!(judge.finish().judged, 20_000);
}

#[test]
fn waits_for_a_bounded_number_of_overdue_outputs() {
    let mut judge = judge();
    for t in 0..5_000 {
        for event in [opened(10 * t, t), came(10 * t, t)] {
            judge.line(t, &event).expect("it is in order");
        }
    }
    assert!(judge.open.len() < OVERDUE + 8, "{}", judge.open.len());
    let verdict = judge.finish();
    assert_eq!(verdict.violations.len() as u64 + verdict.more, 4_999, "the last may still end");
}

#[test]
fn repeated_facts_of_a_timestamp_are_stored_once() {
    let mut judge = judge();
    judge.line(1, &opened(0, 0)).expect("it is in order");
    for at in 0..50_000 {
        judge.line(1, &came(at, 1)).expect("it is in order");
        let drop = Decision::Drop { at, t: 1, p: 7, why: DropReason::Superseded };
        judge.line(1, &Event::Decision(drop)).expect("it is in order");
    }
    let held = judge.open.get(&1).map_or(0, |open| open.len());
    assert!(held < 300, "{held} facts are held");
}

/// Whichever of many results are left out, the latest value that may have been sent is kept (D2).
#[test]
fn what_comes_again_and_again_leaves_the_latest_value() {
    let clouds = vec![crate::event::Cloud { p: 1, name: None, limit: 9, resume: 8 }];
    let header = Header { operator: None, window: 4, commit: Commit::Eager, clouds };
    for (of, breaks) in [(700, false), (600, true)] {
        let max_ages = [(1, 400)].into();
        let terms = HeaderAnnotations { max_ages, ..HeaderAnnotations::default() };
        let mut judge = Judge::new("a.jsonl", &header, SLACK).with_header_annotations(&terms);
        let mut line = |event, of| {
            let annotations = Annotations { of, ..Annotations::NONE };
            judge.annotated_line(1, &event, &annotations).expect("it is in order");
            judge.open.get(&1000).map_or(0, |open| open.len())
        };
        line(opened(0, 1000), None);
        line(Event::Decision(Decision::Request { at: 0, t: 1000, p: 1, due: 9_000 }), None);
        // The first value is old, the next is as the case says, and the others count down.
        for (at, of) in (1..4_000).zip([3, of].into_iter().chain((0..300).rev().cycle())) {
            let held = line(Event::Input(Input::Result { at, t: 1000, p: 1 }), Some(of));
            assert!(held < 300, "{held} facts are held");
        }
        line(Event::Decision(Decision::Emit { at: 4_000, t: 1000, p: 1 }), Some(650));
        let verdict = judge.finish();
        let is_broken = verdict.violations.iter().any(|found| found.rule.id() == "D2");
        assert_eq!(is_broken, breaks, "{:?}", verdict.violations);
    }
}
