//! Checks an assumption of the guarantees: with the shipped machine, no output is later than both
//! local's arrival and the last due instant that was admitted for its message.

use std::collections::BTreeMap;

use fuseline_core::{
    Admission, At, Cloud, Commit, Deadline, Fusion, Instant, Opening, Outcome, Priority, Timestamp,
};
use fuseline_testkit::Rng;

type Machine = Fusion<3, 8>;

/// An open timestamp.
#[derive(Clone, Copy, Default)]
struct Open {
    /// The instant when local's result came, or when it became known that none will come.
    local: Option<u64>,
    has_result: bool,
    /// The latest due instant of its requests.
    due: u64,
    limit: Option<u64>,
}

/// Counts how timestamps ended, by the cause.
#[derive(Default)]
struct Outcomes {
    forwarded_at_local: u64,
    forwarded_at_due: u64,
    missed: u64,
}

/// Checks a timestamp that is retired: everything that could be awaited has come by then.
fn retire(
    open: &mut BTreeMap<u64, Open>,
    t: Timestamp,
    is_forwarded: bool,
    outcomes: &mut Outcomes,
) {
    let retired = open.remove(&t.as_u64()).expect("it was open");
    assert!(is_forwarded || !retired.has_result, "local's result is not missed");
    outcomes.missed += u64::from(!is_forwarded);
}

fn run(random: &mut Rng, outcomes: &mut Outcomes) {
    let commit = random.one_of(&[Commit::Eager, Commit::Patient]);
    let clouds = [1, 2, 3].map(|p| Cloud::new(Priority::new(p), 31));
    let mut machine = Machine::new(8, commit, &clouds).unwrap();
    let mut open: BTreeMap<u64, Open> = BTreeMap::new();
    let (mut now, mut next) = (0, 0);
    for _ in 0..200 {
        // Ticks are late at random, so the next input may come long after a due instant.
        now += random.one_of(&[0, 1, 2, 5, 20]);
        let mut ready = loop {
            match machine.at(Instant::from_nanos(now)) {
                At::Ready(ready) => break ready,
                At::Fired(firing) => {
                    let at = firing.due.as_nanos();
                    let slot = open.get_mut(&firing.timestamp.as_u64()).unwrap();
                    if slot.limit == Some(at) {
                        slot.local.get_or_insert(at);
                    }
                    let bound = slot.local.map(|local| local.max(slot.due));
                    match firing.outcome {
                        Outcome::Forwarded { .. } => {
                            outcomes.forwarded_at_due += 1;
                            assert!(bound.is_none_or(|bound| at <= bound), "{at} after {bound:?}");
                            retire(&mut open, firing.timestamp, true, outcomes);
                        }
                        Outcome::Missed => retire(&mut open, firing.timestamp, false, outcomes),
                        Outcome::Waiting => {}
                        Outcome::Held
                        | Outcome::Dropped(_)
                        | Outcome::Preliminary { .. }
                        | Outcome::Final { .. } => unreachable!("no answer to these timers"),
                    }
                }
            }
        };
        let t = Timestamp::new(next - random.u64(0..8) % (next + 1));
        let deadline = Deadline::from_nanos(random.one_of(&[1, 3, 10, 30]));
        match random.u8(0..6) {
            0 => {
                let limit = (random.f64() < 0.3).then_some(deadline);
                if ready.open(Timestamp::new(next + 1), limit) == Opening::Accepted {
                    next += 1;
                    let limit = limit.map(|limit| now + limit.as_nanos());
                    open.insert(next, Open { limit, ..Open::default() });
                }
            }
            1 | 2 => {
                let cloud = Priority::new(random.one_of(&[1, 2, 3]));
                if let Admission::Admitted { due } = ready.offer(t, cloud, deadline, 0) {
                    let slot = open.get_mut(&t.as_u64()).unwrap();
                    slot.due = slot.due.max(due.as_nanos());
                }
            }
            kind => {
                let source = Priority::new(random.one_of(&[0, 0, 1, 2, 3]));
                let is_result = kind > 3;
                let outcome =
                    if is_result { ready.result(t, source) } else { ready.fail(t, source) };
                if source == Priority::LOCAL && !matches!(outcome, Outcome::Dropped(_)) {
                    let slot = open.get_mut(&t.as_u64()).unwrap();
                    (slot.local, slot.has_result) = (Some(now), is_result);
                }
                match outcome {
                    Outcome::Forwarded { by, .. } => {
                        outcomes.forwarded_at_local += u64::from(by == Priority::LOCAL);
                        retire(&mut open, t, true, outcomes);
                    }
                    Outcome::Missed => retire(&mut open, t, false, outcomes),
                    Outcome::Waiting
                    | Outcome::Held
                    | Outcome::Dropped(_)
                    | Outcome::Preliminary { .. }
                    | Outcome::Final { .. } => {}
                }
            }
        }
        // Each open timestamp waits for local, or for a request that is not due yet.
        for (t, slot) in &open {
            let bound = slot.local.map(|local| local.max(slot.due));
            assert!(bound.is_none_or(|bound| bound > now), "{t} is open at {now}, {bound:?}");
        }
    }
}

#[test]
fn p5_p7_output_is_no_later_than_local_and_dues() {
    let mut outcomes = Outcomes::default();
    (0..3000).for_each(|seed| run(&mut Rng::with_seed(seed), &mut outcomes));
    assert!(
        outcomes.forwarded_at_local > 1000
            && outcomes.forwarded_at_due > 1000
            && outcomes.missed > 1000
    );
}

/// A late timer does not delay local's result, as the deadline of T1 requires.
#[test]
fn p6_late_timers_do_not_delay_local() {
    for (local, is_late) in [(299, false), (300, true), (301, true)] {
        let cloud = Priority::new(1);
        let mut machine = Machine::new(8, Commit::Eager, &[Cloud::new(cloud, 31)]).unwrap();
        let t = Timestamp::new(0);
        let At::Ready(mut ready) = machine.at(Instant::START) else { panic!("nothing is due") };
        assert_eq!(ready.open(t, None), Opening::Accepted);
        assert!(matches!(
            ready.offer(t, cloud, Deadline::from_nanos(300), 0),
            Admission::Admitted { .. }
        ));
        let outcome = loop {
            if let At::Ready(mut ready) = machine.at(Instant::from_nanos(local)) {
                break ready.result(t, Priority::LOCAL);
            }
        };
        assert_eq!(matches!(outcome, Outcome::Forwarded { .. }), is_late, "{local}");
        assert_eq!(outcome == Outcome::Held, !is_late, "{local}");
    }
}
