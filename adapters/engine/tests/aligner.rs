//! Tests sets of several inputs: complete, due, bounded, each given once, and as old as their
//! oldest message (E5, E6, E7, E8).

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use fuseline_engine::{
    Aligner, JoinArrival, JoinBounds, JoinCause, JoinDropReason, Joined, LatestInput, Lineage,
};
use proptest::prelude::*;

const MS: Duration = Duration::from_millis(1);
const BOUNDS: JoinBounds = JoinBounds { wait: Duration::from_millis(50), window: 4, reserve: MS };
const LEFT: usize = 0;
const RIGHT: usize = 1;

/// A join of two cameras.
struct Cameras {
    aligner: Aligner<Vec<String>>,
    start: Instant,
}

impl Cameras {
    fn new() -> Self {
        Self { aligner: Aligner::new(["left", "right"], BOUNDS), start: Instant::now() }
    }

    /// With a plan of which each set gets the latest.
    fn with_plan(is_origin: bool) -> Self {
        let Self { aligner, start } = Self::new();
        let plan = LatestInput { name: "plan".into(), max_age: 50 * MS, is_origin };
        Self { aligner: aligner.with_latest([plan]), start }
    }

    fn at(&self, ms: u32) -> Instant {
        self.start + ms * MS
    }

    /// Gives frame `key` of a camera, which is captured at that instant.
    fn frame(&mut self, at_ms: u32, input: usize, key: u64) -> Result<(), JoinDropReason> {
        let lineage = Lineage::new(["left", "right"][input], key, self.at(at_ms));
        self.message(at_ms, input, Some(lineage), true)
    }

    fn message(
        &mut self,
        at_ms: u32,
        input: usize,
        lineage: Option<Lineage>,
        is_last: bool,
    ) -> Result<(), JoinDropReason> {
        let now = self.at(at_ms);
        let lineage = lineage.map(Arc::new);
        let key = lineage.as_ref().and_then(|it| it.origin.as_ref()?.seq);
        let arrival = JoinArrival { input, key, lineage: lineage.as_ref(), is_last };
        self.aligner.arrive(now, arrival, |set| set.push(format!("{input} at {at_ms}")))
    }

    fn tick(&mut self, at_ms: u32) {
        self.aligner.tick(self.at(at_ms));
    }

    fn given(&mut self) -> Vec<Joined<Vec<String>>> {
        self.given_at(0)
    }

    fn given_at(&mut self, ms: u32) -> Vec<Joined<Vec<String>>> {
        let now = self.at(ms);
        std::iter::from_fn(|| self.aligner.next_set(now)).collect()
    }

    /// Returns the key, the cause and the number of missing inputs of each set.
    fn brief(&mut self) -> Vec<(u64, JoinCause, usize)> {
        self.given().into_iter().map(|set| (set.key, set.cause, set.missing.len())).collect()
    }
}

/// A complete set is given at once, and an incomplete one when it is due (E5).
#[test]
fn gives_complete_sets_at_once_and_others_when_due() {
    let mut run = Cameras::new();
    run.frame(0, LEFT, 7).unwrap();
    run.frame(5, LEFT, 8).unwrap();
    assert_eq!(run.given(), []);
    run.frame(10, RIGHT, 7).unwrap();
    let set = run.given().remove(0);
    assert_eq!((set.key, set.cause, &*set.missing), (7, JoinCause::Complete, &[][..]));
    assert_eq!(set.set, ["0 at 0", "1 at 10"]);
    assert_eq!(run.aligner.next_due(), Some(run.at(55)));
    run.aligner.tick(run.start + Duration::from_nanos(54_999_999));
    assert_eq!(run.given(), []);
    run.tick(55);
    let set = run.given().remove(0);
    assert_eq!((set.key, set.cause, &*set.missing[0]), (8, JoinCause::Due, "right"));
    // A message that comes for it later opens nothing (E6).
    assert_eq!(run.frame(56, RIGHT, 8), Err(JoinDropReason::Late));
    assert_eq!(run.frame(56, RIGHT, 7), Err(JoinDropReason::Late));
    assert_eq!(run.aligner.next_due(), None);
}

/// A set is given while its end-to-end deadline still leaves the reserve (E5).
#[test]
fn set_is_given_while_the_reserve_is_left() {
    let mut run = Cameras::new();
    let lineage = Lineage::new("left", 1, run.start).within(30 * MS);
    run.message(10, LEFT, Some(lineage), true).unwrap();
    assert_eq!(run.aligner.next_due(), Some(run.at(29)));
    // A later message of the set may have an earlier deadline.
    let lineage = Lineage::new("left", 2, run.at(10)).within(90 * MS);
    run.message(10, LEFT, Some(lineage), false).unwrap();
    let lineage = Lineage::new("right", 2, run.start).within(25 * MS);
    run.message(11, RIGHT, Some(lineage), true).unwrap();
    assert_eq!(run.aligner.next_due(), Some(run.at(24)));
    // A set whose budget is used up is given at once.
    let lineage = Lineage::new("left", 3, run.start).within(11 * MS);
    run.message(11, LEFT, Some(lineage), true).unwrap();
    assert_eq!(run.brief(), [(3, JoinCause::Due, 1)]);
}

/// A set has the last of several revisions, or the latest one so far when the set is due (E5).
#[test]
fn last_revision_completes_the_set() {
    let mut run = Cameras::new();
    let camera = |key| Some(Lineage::new("left", key, Instant::now()));
    run.frame(0, RIGHT, 1).unwrap();
    run.message(1, LEFT, camera(1), false).unwrap();
    run.message(2, LEFT, camera(1), false).unwrap();
    assert_eq!(run.given(), []);
    run.message(3, LEFT, camera(1), true).unwrap();
    assert_eq!(run.brief(), [(1, JoinCause::Complete, 0)]);
    run.message(4, LEFT, camera(2), false).unwrap();
    run.message(5, LEFT, camera(2), true).unwrap();
    assert_eq!(run.message(6, LEFT, camera(2), true), Err(JoinDropReason::Duplicate));
    run.message(7, LEFT, camera(3), false).unwrap();
    run.frame(8, RIGHT, 3).unwrap();
    run.tick(60);
    assert_eq!(run.brief(), [(2, JoinCause::Due, 1), (3, JoinCause::Due, 0)]);
}

/// No set waits for an input that has ended (E5).
#[test]
fn an_input_that_ends_is_waited_for_no_longer() {
    let mut run = Cameras::new();
    run.frame(0, LEFT, 1).unwrap();
    run.aligner.end(run.at(1), RIGHT);
    run.frame(2, LEFT, 2).unwrap();
    assert_eq!(run.brief(), [(1, JoinCause::Complete, 1), (2, JoinCause::Complete, 1)]);
    assert!(!run.aligner.is_over());
    run.aligner.end(run.at(3), LEFT);
    assert!(run.aligner.is_over());
}

/// The oldest set makes room for one more (E8).
#[test]
fn the_oldest_set_makes_room_for_one_more() {
    let mut run = Cameras::new();
    for key in [9, 3, 4, 5, 6] {
        run.frame(0, LEFT, key).unwrap();
    }
    // Among sets opened at one instant, the one with the least key is given.
    assert_eq!(run.brief(), [(3, JoinCause::Full, 1)]);
    assert_eq!(run.message(0, LEFT, None, true), Err(JoinDropReason::NoKey));
}

/// Sets that were given are remembered, in bounded memory, however long ago it was (E6, E8).
#[test]
fn no_key_opens_again_however_long_ago_it_was_given() {
    let mut run = Cameras::new();
    for key in 0..3000 {
        run.frame(0, LEFT, key).unwrap();
        run.frame(0, RIGHT, key).unwrap();
    }
    assert_eq!(run.given().len(), 3000);
    for key in 0..3000 {
        assert_eq!(run.frame(0, LEFT, key), Err(JoinDropReason::Late));
    }
}

/// A set is as old as its oldest message (E7).
#[test]
fn set_is_as_old_as_its_oldest_message() {
    let mut run = Cameras::new();
    let old = Lineage::new("right", 1, run.start).within(40 * MS);
    let new = Lineage::new("left", 1, run.at(5)).within(20 * MS);
    run.message(6, RIGHT, Some(old), true).unwrap();
    run.message(7, LEFT, Some(new), true).unwrap();
    let lineage = run.given().remove(0).lineage.unwrap();
    assert_eq!(lineage.origin.as_ref().map(|it| &*it.stream), Some("left"));
    assert_eq!(lineage.captured, Some(run.start));
    assert_eq!(lineage.due(run.at(8)), Some(run.at(25)));
    // If one age is unknown, the set's age is unknown.
    let unknown = Lineage { captured: None, ..Lineage::new("right", 2, run.start) };
    run.message(8, RIGHT, Some(unknown), true).unwrap();
    run.frame(9, LEFT, 2).unwrap();
    assert_eq!(run.given()[0].lineage.as_ref().unwrap().captured, None);
}

/// A set names what is missing, and may belong to a latest-value message (E5, E7).
#[test]
fn set_names_missing_inputs_and_may_be_latest() {
    let plan = |captured| Lineage { captured, missing: vec!["map".into()], ..Lineage::default() };
    // The plan's capture, and those of the set, its due instant and what it lacks.
    let set_with = |lineage: Option<Lineage>| {
        let mut run = Cameras::with_plan(true);
        if let Some(lineage) = lineage {
            let lineage = Some(Arc::new(lineage));
            run.aligner.set_latest(run.at(30), 0, lineage, |set| set.push("plan".into()));
        }
        let missing = vec!["radar".into()];
        let left = Lineage { missing, ..Lineage::new("left", 1, run.start) }.within(100 * MS);
        run.message(6, LEFT, Some(left), true).unwrap();
        run.tick(60);
        let Joined { lineage, missing, set, .. } = run.given_at(60).remove(0);
        let lineage = lineage.unwrap();
        let since = |at: Instant| at.duration_since(run.start).as_millis();
        let (captured, due) = (lineage.captured.map(since), lineage.due(run.at(60)).map(since));
        (set.len(), missing.join(" "), captured, due, lineage.missing.join(" "))
    };
    let start = Cameras::new().start;
    let (of_set, of_plan) = ("radar right".to_owned(), "radar map right".to_owned());
    assert_eq!(set_with(None), (1, "right plan".into(), Some(0), Some(100), of_set + " plan"));
    let (count, missing, _, due, lacks) = set_with(Some(plan(Some(start + 20 * MS))));
    assert_eq!((count, &*missing, due, &lacks), (2, "right", Some(100), &of_plan));
    // Without a capture the end-to-end deadline counts from now.
    assert_eq!(set_with(Some(plan(None))), (2, "right".into(), None, Some(100), of_plan));
}

/// A latest message is used up to its greatest age, which counts from its capture or arrival (E5,
/// E7).
#[test]
fn latest_message_is_used_up_to_its_age() {
    for captured in [true, false] {
        for (at_ms, count) in [(30, 2), (80, 2), (81, 1)] {
            let mut run = Cameras::with_plan(false);
            let lineage = captured.then(|| Arc::new(Lineage::new("plan", 1, run.at(30))));
            let arrived = run.at(if captured { 33 } else { 30 });
            run.aligner.set_latest(arrived, 0, lineage, |set| set.push("plan".into()));
            run.frame(20, LEFT, 7).unwrap();
            run.aligner.end(run.at(20), RIGHT);
            let set = run.given_at(at_ms).remove(0);
            assert_eq!((set.set.len(), set.missing.len()), (count, 3 - count), "{at_ms} ms");
            // The set belongs to its camera.
            assert_eq!(set.lineage.unwrap().captured, Some(run.at(20)));
        }
    }
}

proptest! {
    /// For any messages in any order, each key is given at most once, and by its due instant. It is
    /// complete if everything came, and at most as many sets wait as there is room for (E1, E5, E6,
    /// E8).
    #[test]
    fn whatever_comes_each_key_is_given_once_and_in_time(
        messages in prop::collection::vec((0_u32..9, 0_usize..3, 0_u64..12, any::<bool>()), 1..200),
    ) {
        let bounds = JoinBounds { wait: 20 * MS, window: 3, reserve: Duration::ZERO };
        let mut aligner = Aligner::<BTreeSet<usize>>::new(["a", "b", "c"], bounds);
        let mut now = Instant::now();
        let mut given = BTreeSet::new();
        let mut opened = std::collections::BTreeMap::new();
        for (wait, input, key, is_last) in messages {
            now += wait * MS;
            let arrival = JoinArrival { input, key: Some(key), lineage: None, is_last };
            if aligner.arrive(now, arrival, |set| { set.insert(input); }).is_ok() {
                prop_assert!(!given.contains(&key), "{key} opened twice");
                opened.entry(key).or_insert(now);
            }
            prop_assert!(aligner.next_due().is_none_or(|due| due > now));
            while let Some(set) = aligner.next_set(now) {
                prop_assert!(given.insert(set.key), "{} was given twice", set.key);
                prop_assert_eq!(set.missing.len() + set.set.len(), 3);
                let opened = opened.remove(&set.key).unwrap();
                prop_assert!(set.cause != JoinCause::Due || opened + bounds.wait <= now);
                prop_assert!(set.cause != JoinCause::Complete || set.missing.is_empty());
            }
            prop_assert!(opened.len() <= bounds.window);
            prop_assert!(opened.values().all(|opened| *opened + bounds.wait > now));
        }
    }
}
