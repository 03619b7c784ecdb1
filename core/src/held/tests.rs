use std::rc::Rc;

use super::*;
use crate::{Admission, Cloud, Commit, Deadline, Fusion, Instant, Opening};

const NEAR: Priority = Priority::new(1);
const FAR: Priority = Priority::new(2);

/// A machine and values that count how many of them live.
struct Inputs {
    fusion: Fusion<2, 2>,
    held: Held<Rc<Priority>, 2>,
    /// The results sent downstream.
    sent: std::vec::Vec<(u64, Option<Priority>)>,
    lives: std::vec::Vec<std::rc::Weak<Priority>>,
}

impl Inputs {
    fn new() -> Self {
        let clouds = [Cloud::new(NEAR, 9), Cloud::new(FAR, 9)];
        let fusion = Fusion::new(2, Commit::Eager, &clouds).unwrap();
        Self { fusion, held: Held::new(), sent: [].into(), lives: [].into() }
    }

    /// Opens a timestamp and requests both clouds, NEAR until 10 and FAR until 20.
    fn open(&mut self, t: u64) {
        self.tick(0);
        let mut ready = self.fusion.ready(Instant::START, |_| {});
        let t = Timestamp::new(t);
        assert_eq!(ready.open(t, None), Opening::Accepted);
        for (cloud, by) in [(NEAR, 10), (FAR, 20)] {
            let admission = ready.offer(t, cloud, Deadline::from_nanos(by), 0);
            assert!(matches!(admission, Admission::Admitted { .. }));
        }
    }

    fn tick(&mut self, now: u64) {
        let Self { fusion, held, sent, .. } = self;
        fusion.ready(Instant::from_nanos(now), |firing| {
            let value = held.firing(&firing);
            sent.push((firing.timestamp.as_u64(), value.map(|value| *value)));
        });
    }

    fn result(&mut self, t: u64, source: Priority) {
        let t = Timestamp::new(t);
        let value = Rc::new(source);
        self.lives.push(Rc::downgrade(&value));
        let outcome = self.fusion.ready(Instant::START, |_| {}).result(t, source);
        if let Some(value) = self.held.result(t, source, value, &outcome) {
            self.sent.push((t.as_u64(), Some(*value)));
        }
    }

    fn fail(&mut self, t: u64, source: Priority) {
        let t = Timestamp::new(t);
        let outcome = self.fusion.ready(Instant::START, |_| {}).fail(t, source);
        if let Some(value) = self.held.failure(t, &outcome) {
            self.sent.push((t.as_u64(), Some(*value)));
        }
    }

    fn live(&self) -> usize {
        self.lives.iter().filter(|value| value.strong_count() > 0).count()
    }
}

#[test]
fn the_best_held_value_is_kept_and_the_lesser_is_dropped() {
    let mut inputs = Inputs::new();
    inputs.open(0);
    inputs.result(0, Priority::LOCAL);
    assert_eq!((inputs.held.len(), inputs.live()), (1, 1));
    inputs.result(0, NEAR);
    assert_eq!((inputs.held.len(), inputs.live()), (1, 1));
    inputs.fail(0, FAR);
    assert_eq!(inputs.sent, [(0, Some(NEAR))]);
    assert_eq!((inputs.held.is_empty(), inputs.live()), (true, 0));
}

#[test]
fn a_lesser_value_that_comes_later_is_not_kept() {
    let mut inputs = Inputs::new();
    inputs.open(0);
    inputs.result(0, NEAR);
    inputs.result(0, Priority::LOCAL);
    assert_eq!((inputs.held.len(), inputs.live()), (1, 1));
    inputs.tick(20);
    assert_eq!(inputs.sent, [(0, Some(NEAR))]);
    assert_eq!(inputs.live(), 0);
}

#[test]
fn a_result_that_is_forwarded_at_once_drops_what_was_held() {
    let mut inputs = Inputs::new();
    inputs.open(0);
    inputs.result(0, Priority::LOCAL);
    inputs.result(0, FAR);
    assert_eq!(inputs.sent, [(0, Some(FAR))]);
    assert_eq!((inputs.held.is_empty(), inputs.live()), (true, 0));
}

#[test]
fn what_is_dropped_is_not_kept() {
    let mut inputs = Inputs::new();
    inputs.open(0);
    inputs.result(0, Priority::LOCAL);
    inputs.result(0, Priority::LOCAL);
    inputs.result(1, Priority::LOCAL);
    assert_eq!((inputs.held.len(), inputs.live()), (1, 1));
}

#[test]
fn values_of_two_timestamps_are_not_mixed() {
    let mut inputs = Inputs::new();
    inputs.open(0);
    inputs.open(1);
    inputs.result(1, Priority::LOCAL);
    inputs.result(0, NEAR);
    assert_eq!(inputs.held.len(), 2);
    // The near cloud's timer commits the best available result.
    inputs.tick(10);
    assert_eq!(inputs.sent, [(0, Some(NEAR)), (1, Some(Priority::LOCAL))]);
    assert_eq!((inputs.held.is_empty(), inputs.live()), (true, 0));
}

#[test]
fn nothing_is_sent_for_a_missed_timestamp() {
    let mut inputs = Inputs::new();
    inputs.open(0);
    inputs.fail(0, Priority::LOCAL);
    inputs.tick(20);
    assert_eq!(inputs.sent, [(0, None), (0, None)]);
    assert!(inputs.held.is_empty());
}
