//! The items of one operator in the order of their timestamps, each waiting for earlier ones no longer than a bound (E9).

use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;
use std::time::{Duration, Instant};

/// Keeps what comes before its turn, until it is its turn or it is due.
///
/// After each input, take what is ready with [`next_ready`](Self::next_ready).
pub struct Reorderer<T> {
    wait: Duration,
    reserve: Duration,
    /// All timestamps below it have ended or were passed over.
    next: u64,
    waiting: BTreeMap<(u64, u64), WaitingItem<T>>,
    /// Tells the revisions of one timestamp apart.
    count: u64,
    ready: VecDeque<Ordered<T>>,
}

/// What comes out in order.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Ordered<T> {
    /// An item whose turn it is.
    Item(T),
    /// These timestamps had not ended when a later one was due: what comes of them is late.
    PassedOver(Range<u64>),
    /// An item of a timestamp that was passed over.
    Late(T),
}

struct WaitingItem<T> {
    due: Instant,
    is_last: bool,
    item: T,
}

/// E8 bounded: how many items wait at most.
const MOST: usize = 1024;

impl<T> Reorderer<T> {
    /// An item waits for earlier ones for `wait`, and no longer than until `reserve` is left of its end-to-end deadline.
    #[must_use]
    pub const fn new(wait: Duration, reserve: Duration) -> Self {
        Self { wait, reserve, next: 0, waiting: BTreeMap::new(), count: 0, ready: VecDeque::new() }
    }

    /// An item of `timestamp` came; its end-to-end deadline, if there is one, is `due`.
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

    /// Time went by: what is due goes, and all that waits before it.
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

    /// Nothing more comes: all that waits goes.
    pub fn end(&mut self) {
        while let Some((first, _)) = self.waiting.keys().next().copied() {
            self.pass_over(first);
        }
    }

    /// The next item or report.
    pub fn next_ready(&mut self) -> Option<Ordered<T>> {
        self.ready.pop_front()
    }

    /// When the next item is due, if one waits.
    #[must_use]
    pub fn next_due(&self) -> Option<Instant> {
        self.waiting.values().map(|waiting| waiting.due).min()
    }

    /// It is `timestamp`'s turn, whatever is missing before it.
    fn pass_over(&mut self, timestamp: u64) {
        if self.next < timestamp {
            self.ready.push_back(Ordered::PassedOver(self.next..timestamp));
            self.next = timestamp;
        }
        self.release();
    }

    /// What has its turn goes.
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
