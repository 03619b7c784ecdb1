//! Races random calls on real threads: each recorded history is some order of the pure step.
#![cfg(not(loom))]

mod common;

use std::sync::Barrier;
use std::thread;

use common::{
    CallAnswer, CallHistory, CallInput, Sequential, ThreadHandle, Timed, TimedCall, open, result,
    tick,
};
use fuseline_core::{Cloud, Commit, ConfigError, Gate, Priority};
use fuseline_threads::Shared;
use proptest::collection::vec;
use proptest::prelude::*;

const CLOUDS: usize = 2;
const WINDOW: usize = 2;
const GATE: (u64, u64) = (3, 1);

/// The calls of one thread, each with the number of turns of an empty loop before it.
type ThreadScript = Vec<(Timed, u8)>;

fn sequential(commit: Commit) -> Sequential {
    Sequential::new(commit, WINDOW, vec![Gate::new(GATE.0, GATE.1).unwrap(); CLOUDS])
}

fn make(mut member: ThreadHandle<CLOUDS, WINDOW>, part: &ThreadScript) {
    let (calls, pauses): (Vec<Timed>, Vec<u8>) = part.iter().copied().unzip();
    let mut pauses = pauses.into_iter();
    member.make(&calls, || match pauses.next() {
        Some(u8::MAX) => thread::yield_now(),
        turns => (0..turns.unwrap_or_default()).for_each(|_| std::hint::spin_loop()),
    });
}

/// Makes the owner's calls alone, then its other calls together with other threads' calls.
fn race(commit: Commit, before: &[Timed], threads: &[ThreadScript]) -> CallHistory {
    let clouds =
        [1, 2].map(|p| Cloud { priority: Priority::new(p), limit: GATE.0, resume: GATE.1 });
    let mut shared = Shared::<CLOUDS, WINDOW>::new(WINDOW, commit, &clouds).unwrap();
    let history = CallHistory::default();
    let (intake, handle) = shared.split();
    let mut owner = ThreadHandle::owner(&history, handle, intake);
    owner.make(before, || {});
    let start = Barrier::new(threads.len());
    thread::scope(|scope| {
        for part in &threads[1..] {
            let (member, start) = (owner.other(), &start);
            scope.spawn(move || {
                start.wait();
                make(member, part);
            });
        }
        start.wait();
        make(owner, &threads[0]);
    });
    history
}

fn by_any_thread() -> impl Strategy<Value = Timed> {
    let input = prop_oneof![
        4 => (0..3_u64, 0..4_u8).prop_map(|(t, p)| CallInput::Result { t, p }),
        2 => (0..3_u64, 0..4_u8).prop_map(|(t, p)| CallInput::Fail { t, p }),
        2 => (0..3_u64).prop_map(|t| CallInput::Tick { t }),
        1 => (0..3_u64).prop_map(|t| CallInput::NextDue { t }),
    ];
    (0..20_u64, input)
}

fn by_the_owner() -> impl Strategy<Value = Timed> {
    let deadline = prop::option::of(0..15_u64);
    let input = prop_oneof![
        2 => (0..6_u64, deadline).prop_map(|(t, deadline)| CallInput::Open { t, deadline }),
        3 => (0..6_u64, 0..4_u8, 0..15_u64, 0..5_u64)
            .prop_map(|(t, p, deadline, backlog)| CallInput::Offer { t, p, deadline, backlog }),
    ];
    prop_oneof![3 => (0..10_u64, input), 1 => by_any_thread()]
}

fn part(call: impl Strategy<Value = Timed>) -> impl Strategy<Value = ThreadScript> {
    vec((call, any::<u8>()), 1..7)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4_000, ..ProptestConfig::default() })]

    /// Whatever threads do, some order of the pure step gives the same answers (P1–P4, P8, P11,
    /// F0–F7).
    #[test]
    fn f8_every_race_is_some_order_of_the_pure_step(
        commit in prop::sample::select(&[Commit::Eager, Commit::Patient, Commit::Progressive][..]),
        before in vec(by_the_owner(), 0..6),
        parts in (part(by_the_owner()), vec(part(by_any_thread()), 1..3)),
    ) {
        let before = [&[open(0, 0), open(0, 1)], &*before].concat();
        let threads = [&[parts.0], &*parts.1].concat();
        let history = race(commit, &before, &threads);
        let explained = history.is_explained_by(&sequential(commit));
        prop_assert!(explained, "no order of the pure step explains {:#?}", history.calls());
    }
}

#[test]
fn a_history_that_no_order_explains_is_found() {
    let history = CallHistory::default();
    let mut shared = Shared::<CLOUDS, WINDOW>::new(WINDOW, Commit::Eager, &[]).unwrap();
    let (intake, handle) = shared.split();
    let mut owner = ThreadHandle::owner(&history, handle, intake);
    owner.make(&[open(0, 0), result(1, 0, 0), tick(2, 0)], || {});
    assert!(history.is_explained_by(&sequential(Commit::Eager)));

    let calls = history.calls();
    let twice = [&*calls, &[TimedCall { began: 9, ended: 10, ..calls[1] }]].concat();
    assert!(!CallHistory::of(twice).is_explained_by(&sequential(Commit::Eager)), "P1");
    let early = TimedCall { began: 0, ended: 0, ..calls[1] };
    let before_its_open = vec![early, TimedCall { began: 1, ..calls[0] }];
    assert!(!CallHistory::of(before_its_open).is_explained_by(&sequential(Commit::Eager)));
    let other_answer = TimedCall { answer: CallAnswer::Ticked(None), ..calls[0] };
    assert!(!CallHistory::of(vec![other_answer]).is_explained_by(&sequential(Commit::Eager)));
}

#[test]
fn refuses_windows_of_0_and_beyond_capacity() {
    let of = |window| Shared::<CLOUDS, WINDOW>::new(window, Commit::Eager, &[]).err();
    let refused = |window| Some(ConfigError::Window { window, capacity: WINDOW });
    assert_eq!([0, 1, 2, 3].map(of), [refused(0), None, None, refused(3)]);
}

#[test]
fn a_desk_shows_its_rule_and_its_window() {
    let shared = Shared::<CLOUDS, WINDOW>::new(2, Commit::Patient, &[]).unwrap();
    let shown = format!("{shared:?}");
    assert!(shown.contains("SharedHandle { commit: Patient, window: 2, .. }"), "{shown}");
}
