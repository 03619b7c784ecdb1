//! Joins messages of several inputs that come from one origin. A set is given when it is complete,
//! when it is due, or to make room for another (E5, E6, E8).
//!
//! This module has no clock and no queue. The adapter reports what arrived and when, and asks for
//! what is due.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::lineage::Lineage;

/// Joins the messages that have the same key, which is usually the origin's timestamp.
///
/// - inputs: [`arrive`](Self::arrive), [`set_latest`](Self::set_latest), [`end`](Self::end),
///   [`tick`](Self::tick)
/// - after each of them: [`next_set`](Self::next_set) until it returns `None`
/// - queries: [`next_due`](Self::next_due), [`is_over`](Self::is_over)
///
/// ```
/// use fuseline_engine::{Aligner, JoinArrival, JoinBounds};
/// use std::time::{Duration, Instant};
///
/// let bounds = JoinBounds { wait: Duration::from_millis(20), window: 16, reserve: Duration::ZERO };
/// let mut aligner = Aligner::<[Option<&str>; 2]>::new(["left", "right"], bounds);
/// let now = Instant::now();
/// for (input, image) in ["left image", "right image"].into_iter().enumerate() {
///     let arrival = JoinArrival { input, key: Some(7), lineage: None, is_last: true };
///     aligner.arrive(now, arrival, |set| set[input] = Some(image)).expect("the set is open");
/// }
/// let joined = aligner.next_set(now).expect("both inputs are there");
/// assert_eq!((joined.key, joined.set), (7, [Some("left image"), Some("right image")]));
/// ```
pub struct Aligner<S> {
    bounds: JoinBounds,
    inputs: Vec<AlignedInput>,
    latest: Vec<(LatestInput, Option<LatestMessage<S>>)>,
    /// The open sets by key, at most as many as the window allows.
    open: BTreeMap<u64, OpenSet<S>>,
    given: GivenKeys,
    ready: VecDeque<Joined<S>>,
}

/// Bounds how long and for how many sets a join waits.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct JoinBounds {
    /// The time that a set waits after its first message.
    pub wait: Duration,
    /// The greatest number of sets that may wait, at least 1. If another set begins, the oldest is
    /// given incomplete.
    pub window: usize,
    /// The part of an end-to-end deadline that must be left for the operators downstream when a set
    /// is given.
    pub reserve: Duration,
}

/// Describes an input that gives each set its latest message, such as the vehicle's position. No
/// set waits for this input.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct LatestInput {
    /// The input's name.
    pub name: Arc<str>,
    /// The greatest age at which a message is used. It counts from the message's capture, or from
    /// its arrival if the capture is unknown.
    pub max_age: Duration,
    /// `true` if each set belongs to a message of this input. If a message is present, the set's
    /// lineage has that message's origin and capture. The aligned inputs still determine when the
    /// set's end-to-end deadline is due.
    pub is_origin: bool,
}

/// A set of messages that come from one origin.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Joined<S> {
    /// The key that its messages share, which is usually the origin's timestamp.
    pub key: u64,
    /// The messages, as the inputs' `put` functions stored them.
    pub set: S,
    /// The inputs that contributed no message.
    pub missing: Vec<Arc<str>>,
    /// The reason why the set was given.
    pub cause: JoinCause,
    /// The lineage of the first aligned input that is present, with the oldest capture and the
    /// earliest end-to-end deadline of all inputs that are present. If one capture is unknown, the
    /// set's capture is unknown. See also [`LatestInput::is_origin`].
    pub lineage: Option<Arc<Lineage>>,
}

/// The reason why a set was given.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum JoinCause {
    /// The set has a message of each input that has not ended.
    Complete,
    /// The set's wait, or the end-to-end deadline of one of its messages, ended.
    Due,
    /// There was no room for a new set.
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

/// The reason why a message was not joined.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum JoinDropReason {
    /// Its origin has no timestamp.
    NoKey,
    /// Its set was already given, or is older than the last 1,024 sets.
    Late,
    /// The input's last message of this set has already come.
    Duplicate,
}

impl JoinDropReason {
    /// Returns the reason in words.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::NoKey => "no key",
            Self::Late => "late",
            Self::Duplicate => "duplicate",
        }
    }
}

/// A message that arrives for a set.
#[derive(Clone, Copy, Debug)]
pub struct JoinArrival<'a> {
    /// The index of the aligned input, in the order in which the inputs were given.
    pub input: usize,
    /// The key that the message shares with the others of its set.
    pub key: Option<u64>,
    /// The message's lineage.
    pub lineage: Option<&'a Arc<Lineage>>,
    /// `true` if no revision of the message follows.
    pub is_last: bool,
}

#[derive(Debug)]
struct AlignedInput {
    name: Arc<str>,
    is_open: bool,
}

struct LatestMessage<S> {
    lineage: Option<Arc<Lineage>>,
    arrived: Instant,
    put: Box<dyn Fn(&mut S) + Send + Sync>,
}

struct OpenSet<S> {
    set: S,
    opened: Instant,
    due: Instant,
    /// The lineages by input, and `true` for each input whose last message is present.
    lineages: BTreeMap<usize, Option<Arc<Lineage>>>,
    last: BTreeSet<usize>,
}

/// The keys of the sets that were given: the last [`REMEMBERED`], and all up to the greatest that
/// was forgotten.
#[derive(Default)]
struct GivenKeys {
    keys: BTreeSet<u64>,
    floor: Option<u64>,
}

const REMEMBERED: usize = 1024;

impl<S: Default> Aligner<S> {
    /// Creates a join of these inputs.
    pub fn new(inputs: impl IntoIterator<Item = impl Into<Arc<str>>>, bounds: JoinBounds) -> Self {
        let inputs = inputs.into_iter();
        let inputs = inputs.map(|name| AlignedInput { name: name.into(), is_open: true }).collect();
        let (open, given, ready) = (BTreeMap::new(), GivenKeys::default(), VecDeque::new());
        Self { bounds, inputs, latest: Vec::new(), open, given, ready }
    }

    /// Adds inputs that give each set their latest message.
    #[must_use]
    pub fn with_latest(mut self, inputs: impl IntoIterator<Item = LatestInput>) -> Self {
        self.latest.extend(inputs.into_iter().map(|input| (input, None)));
        self
    }

    /// Adds a message to its set by calling `put`. A revision replaces what its input put there
    /// before.
    ///
    /// # Errors
    /// Returns the reason why the message was dropped. `put` was not called then.
    pub fn arrive(
        &mut self,
        now: Instant,
        arrival: JoinArrival<'_>,
        put: impl FnOnce(&mut S),
    ) -> Result<(), JoinDropReason> {
        self.tick(now);
        let JoinArrival { input, key, lineage, is_last } = arrival;
        let key = key.ok_or(JoinDropReason::NoKey)?;
        // A key that was given never opens again (E6).
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
        // The set is due early enough to leave the operators downstream their reserve (E5).
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

    /// Replaces the latest message of an input that [`with_latest`](Self::with_latest) added.
    /// `input` is its index among those inputs. `put` is called with each set that gets the
    /// message.
    pub fn set_latest(
        &mut self,
        now: impl Into<Instant>,
        input: usize,
        lineage: Option<Arc<Lineage>>,
        put: impl Fn(&mut S) + Send + Sync + 'static,
    ) {
        if let Some((_, message)) = self.latest.get_mut(input) {
            *message = Some(LatestMessage { lineage, arrived: now.into(), put: Box::new(put) });
        }
    }

    /// Ends an aligned input: no set waits for it any longer.
    pub fn end(&mut self, now: Instant, input: usize) {
        if let Some(input) = self.inputs.get_mut(input) {
            input.is_open = false;
        }
        let keys: Vec<u64> = self.open.keys().copied().collect();
        for key in keys {
            self.give_if_complete(now, key);
        }
    }

    /// Sets the part of an end-to-end deadline that is left to the operators downstream. It applies
    /// to messages from now on.
    pub const fn set_reserve(&mut self, reserve: Duration) {
        self.bounds.reserve = reserve;
    }

    /// Gives the sets that are due by `now`, the earliest first.
    pub fn tick(&mut self, now: Instant) {
        while let Some((due, key)) = self.earliest(|open| open.due)
            && due <= now
        {
            self.give(now, key, JoinCause::Due);
        }
    }

    /// Returns the next set that is ready, or `None`. The set gets the latest message of each
    /// latest-value input, unless that message is too old at `now`.
    pub fn next_set(&mut self, now: impl Into<Instant>) -> Option<Joined<S>> {
        let mut joined = self.ready.pop_front()?;
        let (now, mut origin) = (now.into(), None);
        for (input, message) in &self.latest {
            let Some(message) = message.as_ref().filter(|it| input.is_fresh(it, now)) else {
                joined.missing.push(Arc::clone(&input.name));
                continue;
            };
            (message.put)(&mut joined.set);
            if input.is_origin {
                origin = message.lineage.as_deref();
            }
        }
        joined.lineage = Lineage::of_set(joined.lineage, &joined.missing, origin, now);
        Some(joined)
    }

    /// Returns the instant at which the next set is due, or `None` if none waits.
    #[must_use]
    pub fn next_due(&self) -> Option<Instant> {
        self.earliest(|open| open.due).map(|(due, _)| due)
    }

    /// Returns `true` if every aligned input has ended and every set was given.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.inputs.iter().all(|input| !input.is_open)
            && self.open.is_empty()
            && self.ready.is_empty()
    }

    /// Makes room, so that at most as many sets wait as the window allows (E8).
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

impl LatestInput {
    fn is_fresh<S>(&self, message: &LatestMessage<S>, now: Instant) -> bool {
        let captured = message.lineage.as_ref().and_then(|lineage| lineage.captured);
        now.saturating_duration_since(captured.unwrap_or(message.arrived)) <= self.max_age
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
    /// Returns the instant at which the end-to-end deadline ends, if there is one. It counts from
    /// `now` if the capture is unknown.
    #[must_use]
    pub fn due(&self, now: impl Into<Instant>) -> Option<Instant> {
        self.captured.unwrap_or_else(|| now.into()).checked_add(self.within?)
    }

    /// Joins the lineages of several messages. The result is as old as the oldest message (E7).
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

    /// Returns the lineage of a set as it is given. `joined` is its lineage so far, and `missing`
    /// names the inputs that it lacks.
    ///
    /// If the set belongs to a message of a latest-value input, it has that message's origin and
    /// capture, and its due instant stays the same.
    fn of_set(
        joined: Option<Arc<Self>>,
        missing: &[Arc<str>],
        latest: Option<&Self>,
        now: Instant,
    ) -> Option<Arc<Self>> {
        if missing.is_empty() && latest.is_none() {
            return joined;
        }
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

/// Returns the instant a year after `now`, which stands for never.
fn far(now: Instant) -> Instant {
    now + Duration::from_secs(60 * 60 * 24 * 365)
}
