//! Sorts the items of one operator by timestamp. An item waits only up to a bound for the items of
//! earlier timestamps (E9).

use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;
use std::time::{Duration, Instant};

/// Keeps each item until it is its turn or it is due.
///
/// After each input, take the items that are ready with [`next_ready`](Self::next_ready).
///
/// ```
/// use fuseline_engine::{Ordered, Reorderer};
/// use std::time::{Duration, Instant};
///
/// let mut reorderer = Reorderer::new(Duration::from_millis(50), Duration::ZERO);
/// let now = Instant::now();
/// reorderer.arrive(now, (1, true), None, "second");
/// assert!(reorderer.next_ready().is_none());
/// reorderer.arrive(now, (0, true), None, "first");
/// assert!(matches!(reorderer.next_ready(), Some(Ordered::Item("first"))));
/// assert!(matches!(reorderer.next_ready(), Some(Ordered::Item("second"))));
/// ```
pub struct Reorderer<T> {
    wait: Duration,
    reserve: Duration,
    /// All timestamps below this one have ended or were passed over.
    next: u64,
    waiting: BTreeMap<(u64, u64), WaitingItem<T>>,
    /// Distinguishes the revisions of one timestamp.
    count: u64,
    ready: VecDeque<Ordered<T>>,
}

/// An item or a report, in order.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Ordered<T> {
    /// An item whose turn it is.
    Item(T),
    /// These timestamps had not ended when a later one was due. Their items will be late.
    PassedOver(Range<u64>),
    /// An item of a timestamp that was passed over.
    Late(T),
}

struct WaitingItem<T> {
    due: Instant,
    is_last: bool,
    item: T,
}

/// The greatest number of items that wait (E8).
const MOST: usize = 1024;

impl<T> Reorderer<T> {
    /// Creates a reorderer in which an item waits for earlier ones for at most `wait`. The wait
    /// also ends when only `reserve` is left of the item's end-to-end deadline.
    #[must_use]
    pub const fn new(wait: Duration, reserve: Duration) -> Self {
        Self { wait, reserve, next: 0, waiting: BTreeMap::new(), count: 0, ready: VecDeque::new() }
    }

    /// Adds an item of `timestamp`. `is_last` is `true` if no revision of it follows, and `due` is
    /// its end-to-end deadline, if it has one.
    pub fn arrive(
        &mut self,
        now: Instant,
        (timestamp, is_last): (u64, bool),
        due: Option<Instant>,
        item: T,
    ) {
        self.tick(now);
        if timestamp < self.next {
            self.ready.push_back(Ordered::Late(item));
            return;
        }
        let wait_ends = now.checked_add(self.wait);
        let budget_ends = due.map(|due| due.checked_sub(self.reserve).unwrap_or(now));
        let due = wait_ends.into_iter().chain(budget_ends).min().unwrap_or(now);
        self.waiting.insert((timestamp, self.count), WaitingItem { due, is_last, item });
        self.count += 1;
        self.release();
        if self.waiting.len() > MOST
            && let Some((timestamp, _)) = self.waiting.keys().next().copied()
        {
            self.pass_over(timestamp);
        }
        self.tick(now);
    }

    /// Releases the items that are due by `now`, and everything that waits before them.
    pub fn tick(&mut self, now: Instant) {
        let due = |waiting: &BTreeMap<_, WaitingItem<T>>| {
            let mut all = waiting.iter().rev();
            all.find(|(_, waiting)| waiting.due <= now).map(|((timestamp, _), _)| *timestamp)
        };
        if let Some(timestamp) = due(&self.waiting) {
            while let Some((first, _)) = self.waiting.keys().next().copied()
                && first <= timestamp
            {
                self.pass_over(first);
            }
        }
    }

    /// Releases everything that waits, because nothing more comes.
    pub fn end(&mut self) {
        while let Some((first, _)) = self.waiting.keys().next().copied() {
            self.pass_over(first);
        }
    }

    /// Returns the next item or report, or `None`.
    pub fn next_ready(&mut self) -> Option<Ordered<T>> {
        self.ready.pop_front()
    }

    /// Returns the instant when the next item is due, or `None` if none waits.
    #[must_use]
    pub fn next_due(&self) -> Option<Instant> {
        self.waiting.values().map(|waiting| waiting.due).min()
    }

    /// Makes it `timestamp`'s turn, whatever is missing before it.
    fn pass_over(&mut self, timestamp: u64) {
        if self.next < timestamp {
            self.ready.push_back(Ordered::PassedOver(self.next..timestamp));
            self.next = timestamp;
        }
        self.release();
    }

    /// Releases the items whose turn it is.
    fn release(&mut self) {
        while let Some(first) = self.waiting.first_entry()
            && first.key().0 <= self.next
        {
            let timestamp = first.key().0;
            let WaitingItem { is_last, item, .. } = first.remove();
            if timestamp < self.next {
                self.ready.push_back(Ordered::Late(item));
                continue;
            }
            self.ready.push_back(Ordered::Item(item));
            if is_last {
                self.next = self.next.saturating_add(1);
            }
        }
    }
}
