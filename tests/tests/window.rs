//! Compares lookups in the window with a plain map, with hundreds of timestamps open (P9).

use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};

use fuseline_core::{Commit, Instant, Opening, Outcome, Priority, Timestamp};
use fuseline_tests::CoreDriver;
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};

/// The due instants of one open timestamp: local's at 0, the cloud's at 1.
type Dues = BTreeMap<u16, u64>;

#[derive(Clone, Debug)]
enum Step {
    /// Opens `count` timestamps, `stride` apart, each with a deadline for local and a request.
    Open { count: u16, stride: u64, local: Option<u64>, deadline: u64 },
    /// Retires the n-th open timestamp.
    Retire(prop::sample::Index),
    /// Retires every n-th open timestamp.
    Thin(usize),
    /// Moves to the next due instant.
    Fire,
}

fn step() -> impl Strategy<Value = Step> {
    let open = (1_u16..300, 1_u64..5, prop::option::of(1_u64..400), 1_u64..400);
    prop_oneof![
        3 => open.prop_map(|(count, stride, local, deadline)| {
            Step::Open { count, stride, local, deadline }
        }),
        8 => any::<prop::sample::Index>().prop_map(Step::Retire),
        1 => (2_usize..9).prop_map(Step::Thin),
        4 => Just(Step::Fire),
    ]
}

struct Pair {
    driver: CoreDriver,
    window: usize,
    now: u64,
    next_t: u64,
    naive: BTreeMap<u64, Dues>,
}

impl Pair {
    fn step(&mut self, step: &Step) {
        match step {
            Step::Open { count, stride, local, deadline } => {
                for i in 0..u64::from(*count) {
                    // The due instants fall and rise along the timestamps, with ties.
                    let (local, deadline) =
                        (local.map(|local| 1 + (local + 7 * i) % 97), *deadline);
                    self.open(local, 1 + (deadline + 31 * i) % 101);
                    self.next_t += stride;
                }
            }
            Step::Retire(index) => {
                if !self.naive.is_empty() {
                    let t =
                        *self.naive.keys().nth(index.index(self.naive.len())).expect("in range");
                    self.retire(t);
                }
            }
            Step::Thin(every) => {
                let thinned: Vec<u64> = self.naive.keys().copied().step_by(*every).collect();
                for t in thinned {
                    self.retire(t);
                }
            }
            Step::Fire => self.fire(),
        }
    }

    fn open(&mut self, local: Option<u64>, deadline: u64) {
        let (t, full) = (self.next_t, self.naive.len() == self.window);
        let opening = self.driver.open(t, local);
        assert_eq!(opening == Opening::Accepted, !full);
        if !full {
            self.driver.requested(t, 1, deadline);
            let mut dues = Dues::from([(1, self.now + deadline)]);
            dues.extend(local.map(|local| (0, self.now + local)));
            self.naive.insert(t, dues);
        }
    }

    fn retire(&mut self, t: u64) {
        let is_requested = self.naive.remove(&t).is_some_and(|dues| dues.contains_key(&1));
        let outcome = self.driver.result(t, u16::from(is_requested));
        assert!(matches!(outcome, Outcome::Forwarded { .. }), "{t}: {outcome:?}");
    }

    fn fire(&mut self) {
        let Some(now) = self.naive.values().flat_map(Dues::values).min().copied() else { return };
        self.now = now;
        let mut expected = Vec::new();
        for (t, dues) in &mut self.naive {
            let fired: BTreeSet<u16> =
                dues.iter().filter(|(_, due)| **due == now).map(|(p, _)| *p).collect();
            dues.retain(|_, due| *due != now);
            if !fired.is_empty() {
                expected.push((*t, fired));
            }
        }
        let found: Vec<_> = self
            .driver
            .tick(now)
            .iter()
            .map(|firing| {
                let t = firing.timestamp.as_u64();
                if !matches!(firing.outcome, Outcome::Waiting) {
                    self.naive.remove(&t);
                }
                (t, firing.timers.iter().map(Priority::as_u16).collect::<BTreeSet<_>>())
            })
            .collect();
        assert_eq!(found, expected);
    }

    fn compare(&self) {
        let fusion = self.driver.fusion();
        assert_eq!(fusion.len(), self.naive.len());
        let least = self.naive.values().flat_map(Dues::values).min();
        assert_eq!(self.driver.next_due(), least.copied());
        assert!(fusion.open().map(|(t, _)| t.as_u64()).eq(self.naive.keys().copied()));
        for (t, dues) in &self.naive {
            for p in [0, 1] {
                let found = fusion.due(Timestamp::new(*t), Priority::new(p));
                assert_eq!(found.map(Instant::as_nanos), dues.get(&p).copied(), "({t}, {p})");
            }
            let beside = t + 1;
            let is_open = fusion.slot(Timestamp::new(beside)).is_some();
            assert_eq!(is_open, self.naive.contains_key(&beside), "{beside}");
        }
    }
}

#[test]
fn p9_finds_what_a_map_finds() {
    let most = Cell::new(0);
    let config = Config { cases: 96, failure_persistence: None, ..Config::default() };
    let windows = prop_oneof![1_usize..40, 900_usize..=1024];
    let steps = prop::collection::vec(step(), 1..60);
    let outcome = TestRunner::new(config).run(&(windows, steps), |(window, steps)| {
        let driver = CoreDriver::new(window, Commit::Patient, &[1]);
        let mut pair = Pair { driver, window, now: 0, next_t: 0, naive: BTreeMap::new() };
        for step in &steps {
            pair.step(step);
            pair.compare();
            most.set(most.get().max(pair.naive.len()));
        }
        Ok(())
    });
    if let Err(failure) = outcome {
        panic!("{failure}");
    }
    assert!(most.get() >= 900, "at most {} timestamps were open at once", most.get());
}
