use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::subsequence;

use super::*;
use crate::corpus::CASES;
use crate::event::{Cloud, Event};
use crate::read::Events;
use crate::reference::Reference;

/// Checks that both machines give the same decisions, and have the same timers and timestamps after
/// each input.
fn compare(header: &Header, inputs: impl IntoIterator<Item = Input>) -> usize {
    let (mut compact, mut reference) = (CompactReference::new(header), Reference::new(header));
    let most = 2 * compact.window * compact.priorities.len() + STALE;
    let (mut decided, mut demanded, mut total) = (Vec::new(), Vec::new(), 0);
    for input in inputs {
        compact.apply(&input, &mut decided);
        reference.apply(&input, &mut demanded);
        assert_eq!(decided, demanded, "{header:?} {input:?}");
        // Asks a copy, because the query removes disarmed timers.
        let rest = (compact.clone().next_due(), compact.waiting().count(), compact.now);
        assert_eq!(rest, (reference.next_due(), reference.open_len(), reference.now()));
        assert!(compact.timers.len() <= most, "{input:?}");
        total += decided.len();
        decided.clear();
        demanded.clear();
    }
    total
}

#[test]
fn agrees_with_the_reference_on_the_corpus() {
    for case in CASES {
        let mut reader = Events::new(case.name, case.trace.as_bytes()).expect("a header");
        let header = reader.header().clone();
        let mut inputs = Vec::new();
        while let Some(event) = reader.next_event().expect("it can be read") {
            if let Event::Input(input) = event {
                inputs.push(input);
            }
        }
        assert!(compare(&header, inputs) > 0, "{}", case.name);
    }
}

#[test]
fn timers_that_were_disarmed_are_left_out() {
    let clouds = vec![Cloud { p: 1, name: None, limit: 9, resume: 0 }];
    let header = Header { operator: None, window: 1, commit: Commit::Eager, clouds };
    let inputs = (0..1000).flat_map(|t| {
        let never = u64::MAX / 2;
        [
            Input::Open { at: t, t, deadline: Some(never) },
            Input::Offer { at: t, t, p: 1, deadline: never, backlog: 0 },
            Input::Result { at: t, t, p: 1 },
        ]
    });
    assert_eq!(compare(&header, inputs), 2000);
}

/// Generates inputs of few timestamps, sources and instants, so that they interact.
fn input() -> impl Strategy<Value = (u64, Input)> {
    let (t, p, deadline) = (0..12_u64, 0..5_u64, 0..12_u64);
    let input = (0..8_u8, t, p, deadline, 0..5_u64).prop_map(|(kind, t, p, deadline, backlog)| {
        let at = 0;
        match kind {
            0 => Input::Open { at, t, deadline: None },
            1 => Input::Open { at, t, deadline: Some(deadline) },
            2..=4 => Input::Offer { at, t, p, deadline, backlog },
            5 => Input::Result { at, t, p },
            6 => Input::Fail { at, t, p },
            _ => Input::Tick { at },
        }
    });
    (0..4_u64, input)
}

/// Returns the same input at another instant.
fn dated(input: Input, at: u64) -> Input {
    match input {
        Input::Open { t, deadline, .. } => Input::Open { at, t, deadline },
        Input::Offer { t, p, deadline, backlog, .. } => {
            Input::Offer { at, t, p, deadline, backlog }
        }
        Input::Result { t, p, .. } => Input::Result { at, t, p },
        Input::Fail { t, p, .. } => Input::Fail { at, t, p },
        Input::Tick { .. } => Input::Tick { at },
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn it_decides_as_the_reference_machine_about_anything(
        window in 1..6_u16,
        commit in proptest::sample::select(&Commit::ALL[..]),
        priorities in subsequence(vec![4_u16, 2, 1, 3], 0..=4),
        inputs in vec(input(), 1..80),
    ) {
        let cloud = |p| Cloud { p, name: None, limit: 3, resume: 1 };
        let clouds = priorities.into_iter().map(cloud).collect();
        let header = Header { operator: None, window, commit, clouds };
        let mut at = 0;
        compare(&header, inputs.into_iter().map(|(later, input)| {
            at += later;
            // Some stamps are early.
            dated(input, at - later / 3)
        }));
    }
}
