//! The open messages of one operator: when each was opened, its best available result, and the
//! sources that failed.
//!
//! This module follows the machine's answers and never decides which result is sent.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::budget::Budget;
use crate::item::{Ending, Failure, Item};
use crate::lineage::{Lineage, StampedValue};

/// The open messages in ascending order, and the opening instants of the last messages.
#[repr(C)]
pub(crate) struct OpenMessages<V> {
    open: VecDeque<OpenMessage<V>>,
    /// `true` if any message had an end-to-end deadline.
    has_budgets: bool,
    /// The timestamps and instants of the last [`REMEMBERED`] messages, even those that are no
    /// longer open; `None` if the operator takes no hints.
    last: Option<VecDeque<(u64, u64)>>,
    /// The timestamps and captures of the last [`REMEMBERED`] messages that have one; `None` if
    /// values are of their own messages.
    captures: Option<VecDeque<(u64, Instant)>>,
}

// With thousands of operators no message is in the cache, and an aligned one spans one cache line
// less.
#[repr(align(64))]
pub(crate) struct OpenMessage<V> {
    t: u64,
    pub(crate) opened: u64,
    /// The best result that was not sent. No other result can be forwarded (P3).
    pub(crate) held: Option<HeldValue<V>>,
    pub(crate) failures: Vec<Failure>,
    /// The number of its items.
    items: u32,
    lineage: Option<Arc<Lineage>>,
    /// The rest of its end-to-end deadline, if it has one.
    budget: Option<Budget>,
}

pub(crate) struct HeldValue<V> {
    pub(crate) p: u16,
    pub(crate) arrived: u64,
    pub(crate) value: StampedValue<V>,
}

/// The number of messages for which the age of a result or a value is known; the greatest window.
const REMEMBERED: usize = 1024;

impl<V> OpenMessages<V> {
    /// Creates an empty store. It remembers messages if hints are taken, and captures if values may
    /// be of earlier messages.
    pub(crate) fn new(takes_hints: bool, has_max_ages: bool) -> Self {
        let last = takes_hints.then(VecDeque::new);
        let captures = has_max_ages.then(VecDeque::new);
        Self { open: VecDeque::new(), has_budgets: false, last, captures }
    }

    /// Adds a message. Timestamps ascend (F1).
    pub(crate) fn open(
        &mut self,
        t: u64,
        at: u64,
        lineage: Option<Arc<Lineage>>,
        budget: Option<Budget>,
    ) {
        if let Some(last) = &mut self.last {
            push_bounded(last, (t, at));
        }
        let captured = lineage.as_ref().and_then(|lineage| lineage.captured);
        if let (Some(captures), Some(captured)) = (&mut self.captures, captured) {
            push_bounded(captures, (t, captured));
        }
        self.has_budgets |= budget.is_some();
        let (held, failures) = (None, Vec::new());
        let items = 0;
        let opened = at;
        self.open.push_back(OpenMessage { t, opened, held, failures, items, lineage, budget });
    }

    /// Notes an available result, and keeps it if it is the best, with the message that its value
    /// is of (F3, D2).
    pub(crate) fn hold(&mut self, t: u64, p: u16, arrived: u64, value: StampedValue<V>) {
        if let Some(open_message) = self.find(t)
            && open_message.held.as_ref().is_none_or(|held| held.p < p)
        {
            open_message.held = Some(HeldValue { p, arrived, value });
        }
    }

    pub(crate) fn find(&mut self, t: u64) -> Option<&mut OpenMessage<V>> {
        let index = self.index(t)?;
        self.open.get_mut(index)
    }

    /// Returns the message's next item. After its last item the message is no longer open.
    pub(crate) fn item(
        &mut self,
        t: u64,
        (decided, instant): (u64, Option<Instant>),
        ending: Ending<V>,
    ) -> Option<Item<V>> {
        let of = match &ending {
            Ending::Preliminary(forwarded) | Ending::Forwarded(forwarded) => forwarded.of,
            Ending::Final(_) | Ending::Missed | Ending::Refused(_) => None,
        };
        let earlier = of.filter(|of| *of != t).map(|of| self.captured(of));
        let message = self.find(t)?;
        let lineage = message.lineage.clone();
        // The age is the value's. If the value is of an earlier message, it is as old as that
        // message.
        let captured = earlier.unwrap_or_else(|| lineage.as_ref()?.captured);
        let age = instant.zip(captured).map(|(now, then)| now.saturating_duration_since(then));
        let item = Item {
            timestamp: t,
            opened: Duration::from_nanos(message.opened),
            decided: Duration::from_nanos(decided),
            revision: message.items,
            ending,
            failures: message.failures.clone(),
            lineage,
            age,
            substitute: None,
            carried: None,
        };
        message.items = message.items.saturating_add(1);
        if item.is_last()
            && let Some(index) = self.index(t)
        {
            self.open.remove(index);
        }
        Some(item)
    }

    /// Returns the rest of an open message's end-to-end deadline, if it has one.
    pub(crate) fn budget(&self, t: u64) -> Option<Budget> {
        if !self.has_budgets {
            return None;
        }
        self.open.get(self.index(t)?)?.budget
    }

    /// Returns the instant when the message was opened, if that is remembered.
    pub(crate) fn opened(&self, t: u64) -> Option<u64> {
        let last = self.last.as_ref()?;
        let index = last.binary_search_by_key(&t, |(t, _)| *t).ok()?;
        last.get(index).map(|(_, opened)| *opened)
    }

    pub(crate) fn len(&self) -> usize {
        self.open.len()
    }

    /// Returns the instant when the message was captured, if that is remembered.
    fn captured(&self, t: u64) -> Option<Instant> {
        let captures = self.captures.as_ref()?;
        let index = captures.binary_search_by_key(&t, |(t, _)| *t).ok()?;
        captures.get(index).map(|(_, captured)| *captured)
    }

    fn index(&self, t: u64) -> Option<usize> {
        // Usually the message is the oldest one.
        if self.open.front()?.t == t {
            return Some(0);
        }
        self.open.binary_search_by_key(&t, |open_message| open_message.t).ok()
    }
}

/// Adds an entry, and removes the oldest if there are too many.
fn push_bounded<T>(last: &mut VecDeque<T>, entry: T) {
    if last.len() == REMEMBERED {
        last.pop_front();
    }
    last.push_back(entry);
}
