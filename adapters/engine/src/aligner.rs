//! Sets of messages of several inputs that come from one origin, each complete or given when it is due (E5, E6).
//!
//! There is no clock and no queue here: the adapter says what arrived and when, and asks what is due.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::lineage::Lineage;

/// Puts together what has one key, the origin's timestamp as a rule.
///
/// - inputs: [`arrive`](Self::arrive), [`end`](Self::end), [`tick`](Self::tick)
/// - after each of them: [`next_set`](Self::next_set) until there is none
/// - questions: [`next_due`](Self::next_due), [`is_over`](Self::is_over)
pub struct Aligner<S> {
    bounds: JoinBounds,
    inputs: Vec<AlignedInput>,
    /// By key; at most as many as the window allows.
    open: BTreeMap<u64, OpenSet<S>>,
    given: GivenKeys,
    ready: VecDeque<Joined<S>>,
}

/// How long and for how much a join waits.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct JoinBounds {
    /// How long a set waits after its first message.
    pub wait: Duration,
    /// How many sets may wait; at least 1. For one more the oldest is given as it is.
    pub window: usize,
    /// What is left of an end-to-end deadline when a set is given at the latest, for the operators downstream.
    pub reserve: Duration,
}

/// A set of messages that come from one origin.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Joined<S> {
    /// What its messages have in common: the origin's timestamp, if nothing else was said.
    pub key: u64,
    /// The messages.
    pub set: S,
    /// The inputs that nothing came from.
    pub missing: Vec<Arc<str>>,
    /// Why it was given.
    pub cause: JoinCause,
    /// That of the first input that is there, with the oldest capture and the earliest end-to-end deadline of all. If one
    /// capture is unknown, the set's is.
    pub lineage: Option<Arc<Lineage>>,
}

/// Why a set was given.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum JoinCause {
    /// Each input that has not ended is there.
    Complete,
    /// Its wait or the end-to-end deadline of a message was over.
    Due,
    /// There was no room for a new one.
    Full,
}

impl JoinCause {
    /// Returns the cause as a word.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Complete => "complete",
            Self::Due => "due",
            Self::Full => "full",
        }
    }
}

/// Why a message was not joined.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum JoinDropReason {
    /// Its origin has no timestamp.
    NoKey,
    /// Its set was given before, or is older than the last 1,024 that were.
    Late,
    /// The input's last message of this set has come.
    Duplicate,
}

impl JoinDropReason {
    /// Returns the reason as words.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::NoKey => "no key",
            Self::Late => "late",
            Self::Duplicate => "duplicate",
        }
    }
}

/// A message on its way into a set.
#[derive(Clone, Copy, Debug)]
pub struct JoinArrival<'a> {
    /// The input's index.
    pub input: usize,
    /// What it has in common with the others of its set.
    pub key: Option<u64>,
    /// What it comes from.
    pub lineage: Option<&'a Arc<Lineage>>,
    /// Whether no revision of it follows.
    pub is_last: bool,
}

#[derive(Debug)]
struct AlignedInput {
    name: Arc<str>,
    is_open: bool,
}

struct OpenSet<S> {
    set: S,
    opened: Instant,
    due: Instant,
    /// Whose messages are there, and whose last one is.
    lineages: BTreeMap<usize, Option<Arc<Lineage>>>,
    last: BTreeSet<usize>,
}

/// The keys of the sets that were given: the last [`REMEMBERED`], and all up to the greatest that was forgotten.
#[derive(Default)]
struct GivenKeys {
    keys: BTreeSet<u64>,
    floor: Option<u64>,
}

const REMEMBERED: usize = 1024;

impl<S: Default> Aligner<S> {
    /// A join of these inputs.
    pub fn new(inputs: impl IntoIterator<Item = impl Into<Arc<str>>>, bounds: JoinBounds) -> Self {
        let inputs = inputs.into_iter();
        let inputs = inputs.map(|name| AlignedInput { name: name.into(), is_open: true }).collect();
        let (open, given, ready) = (BTreeMap::new(), GivenKeys::default(), VecDeque::new());
        Self { bounds, inputs, open, given, ready }
    }

    /// A message came: `put` puts it into its set. A revision replaces what its input put there before.
    ///
    /// # Errors
    /// Why it was dropped; then nothing was put anywhere.
    pub fn arrive(
        &mut self,
        now: Instant,
        arrival: JoinArrival<'_>,
        put: impl FnOnce(&mut S),
    ) -> Result<(), JoinDropReason> {
        self.tick(now);
        let JoinArrival { input, key, lineage, is_last } = arrival;
        let key = key.ok_or(JoinDropReason::NoKey)?;
        // E6 once: a key that was given never opens again.
        if self.given.contains(key) {
            return Err(JoinDropReason::Late);
        }
        if !self.open.contains_key(&key) {
            self.make_room(now);
        }
        let wait_ends = now.checked_add(self.bounds.wait).unwrap_or_else(|| far(now));
        let open = self.open.entry(key).or_insert_with(|| OpenSet::new(now, wait_ends));
        if open.last.contains(&input) {
            return Err(JoinDropReason::Duplicate);
        }
        // E5: a set is given before its end-to-end deadline has too little left for those downstream.
        if let Some(due) = lineage.and_then(|lineage| lineage.due(now)) {
            let due = due.checked_sub(self.bounds.reserve).unwrap_or(now);
            open.due = open.due.min(due);
        }
        put(&mut open.set);
        open.lineages.insert(input, lineage.cloned());
        if is_last {
            open.last.insert(input);
        }
        self.give_if_complete(now, key);
        self.tick(now);
        Ok(())
    }

    /// Nothing more comes from this input: no set waits for it any longer.
    pub fn end(&mut self, now: Instant, input: usize) {
        if let Some(input) = self.inputs.get_mut(input) {
            input.is_open = false;
        }
        let keys: Vec<u64> = self.open.keys().copied().collect();
        for key in keys {
            self.give_if_complete(now, key);
        }
    }

    /// Sets what is left of end-to-end deadlines when sets are given, for messages from now on.
    pub const fn set_reserve(&mut self, reserve: Duration) {
        self.bounds.reserve = reserve;
    }

    /// Time went by: what is due is given, the earliest first.
    pub fn tick(&mut self, now: Instant) {
        while let Some((due, key)) = self.earliest(|open| open.due)
            && due <= now
        {
            self.give(now, key, JoinCause::Due);
        }
    }

    /// The next set that is to be given.
    pub fn next_set(&mut self) -> Option<Joined<S>> {
        self.ready.pop_front()
    }

    /// When the next set is due, if one waits.
    #[must_use]
    pub fn next_due(&self) -> Option<Instant> {
        self.earliest(|open| open.due).map(|(due, _)| due)
    }

    /// Whether each input has ended and every set was given.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.inputs.iter().all(|input| !input.is_open)
            && self.open.is_empty()
            && self.ready.is_empty()
    }

    /// E8 bounded: at most as many sets wait as the window allows.
    fn make_room(&mut self, now: Instant) {
        while self.open.len() >= self.bounds.window.max(1)
            && let Some((_, key)) = self.earliest(|open| open.opened)
        {
            self.give(now, key, JoinCause::Full);
        }
    }

    fn earliest(&self, instant: impl Fn(&OpenSet<S>) -> Instant) -> Option<(Instant, u64)> {
        self.open.iter().map(|(key, open)| (instant(open), *key)).min()
    }

    fn give_if_complete(&mut self, now: Instant, key: u64) {
        let is_there = |open: &OpenSet<S>| {
            let mut inputs = self.inputs.iter().enumerate();
            inputs.all(|(index, input)| !input.is_open || open.last.contains(&index))
        };
        if self.open.get(&key).is_some_and(is_there) {
            self.give(now, key, JoinCause::Complete);
        }
    }

    fn give(&mut self, now: Instant, key: u64, cause: JoinCause) {
        let Some(OpenSet { set, lineages, .. }) = self.open.remove(&key) else { return };
        self.given.insert(key);
        let inputs = self.inputs.iter().enumerate();
        let missing = inputs.filter(|(index, _)| !lineages.contains_key(index));
        let missing = missing.map(|(_, input)| Arc::clone(&input.name)).collect();
        let lineage = Lineage::joined(&lineages.values().map(Option::as_deref), now);
        self.ready.push_back(Joined { key, set, missing, cause, lineage });
    }
}

impl<S: Default> OpenSet<S> {
    fn new(opened: Instant, due: Instant) -> Self {
        Self { set: S::default(), opened, due, lineages: BTreeMap::new(), last: BTreeSet::new() }
    }
}

impl GivenKeys {
    fn contains(&self, key: u64) -> bool {
        self.floor.is_some_and(|floor| key <= floor) || self.keys.contains(&key)
    }

    fn insert(&mut self, key: u64) {
        self.keys.insert(key);
        if self.keys.len() > REMEMBERED {
            self.floor = self.keys.pop_first().max(self.floor);
        }
    }
}

impl Lineage {
    /// When the end-to-end deadline is over, if there is one; it counts from `now` if the capture is unknown.
    #[must_use]
    pub fn due(&self, now: impl Into<Instant>) -> Option<Instant> {
        self.captured.unwrap_or_else(|| now.into()).checked_add(self.within?)
    }

    /// That of several messages together: E7, it is as old as the oldest of them.
    fn joined<'a>(
        lineages: &(impl Iterator<Item = Option<&'a Self>> + Clone),
        now: Instant,
    ) -> Option<Arc<Self>> {
        let known = || lineages.clone().flatten();
        let first = known().next()?;
        let all: Option<Vec<Instant>> = lineages.clone().map(|it| it?.captured).collect();
        let captured = all.and_then(|all| all.into_iter().min());
        let due = known().filter_map(|lineage| lineage.due(now)).min();
        let within = due.map(|due| due.saturating_duration_since(captured.unwrap_or(now)));
        let mut joined = Self { origin: first.origin.clone(), captured, within, ..Self::default() };
        known().for_each(|lineage| joined.add_missing(&lineage.missing));
        Some(Arc::new(joined))
    }

    /// That of a set as it is given, `joined` so far, which lacks these inputs. If the set is of a latest-value input's message,
    /// it has that message's origin and capture, and is due as before.
    #[must_use]
    pub fn of_set(
        joined: Option<Arc<Self>>,
        missing: &[Arc<str>],
        latest: Option<&Self>,
        now: impl Into<Instant>,
    ) -> Option<Arc<Self>> {
        if missing.is_empty() && latest.is_none() {
            return joined;
        }
        let now = now.into();
        let mut lineage = joined.map(Arc::unwrap_or_clone).unwrap_or_default();
        if let Some(latest) = latest {
            let due = lineage.due(now);
            (lineage.origin, lineage.captured) = (latest.origin.clone(), latest.captured);
            let start = latest.captured.unwrap_or(now);
            lineage.within = due.map(|due| due.saturating_duration_since(start));
            lineage.add_missing(&latest.missing);
        }
        lineage.add_missing(missing);
        Some(Arc::new(lineage))
    }

    fn add_missing(&mut self, inputs: &[Arc<str>]) {
        for input in inputs {
            if !self.missing.contains(input) {
                self.missing.push(Arc::clone(input));
            }
        }
    }
}

/// An instant that no join waits for.
fn far(now: Instant) -> Instant {
    now + Duration::from_secs(60 * 60 * 24 * 365)
}
