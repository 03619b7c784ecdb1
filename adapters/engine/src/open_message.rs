//! The open messages of one operator: when each came, its best available result, and which sources failed.
//!
//! Nothing here decides which result is sent; it follows the machine's answers.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::budget::Budget;
use crate::item::{Ending, Failure, Item};
use crate::lineage::{Lineage, StampedValue};

/// The open messages, by ascending timestamp, and when the last ones were opened.
#[repr(C)]
pub(crate) struct OpenMessages<V> {
    open: VecDeque<OpenMessage<V>>,
    /// Whether any message had an end-to-end deadline.
    has_budgets: bool,
    /// Timestamps and instants of the last [`REMEMBERED`] messages, answered ones too; none if the
    /// operator takes no hints.
    last: Option<VecDeque<(u64, u64)>>,
    /// Timestamps and captures of the last [`REMEMBERED`] messages that have one; none if values are of their own messages.
    captures: Option<VecDeque<(u64, Instant)>>,
}

// Of one operator among thousands it is in none of the processor's caches: aligned, it takes a line less.
#[repr(align(64))]
pub(crate) struct OpenMessage<V> {
    t: u64,
    pub(crate) opened: u64,
    /// The best result that was not sent; no other can go (P3).
    pub(crate) held: Option<HeldValue<V>>,
    pub(crate) failures: Vec<Failure>,
    /// How many items were made of it.
    items: u32,
    lineage: Option<Arc<Lineage>>,
    /// What is left of its end-to-end deadline, if it has one.
    budget: Option<Budget>,
}

pub(crate) struct HeldValue<V> {
    pub(crate) p: u16,
    pub(crate) arrived: u64,
    pub(crate) value: StampedValue<V>,
}

/// For how many messages the age of a result or a value is known: the greatest window.
const REMEMBERED: usize = 1024;

impl<V> OpenMessages<V> {
    /// None; they are remembered when hints are taken, and their captures when values of earlier ones are.
    pub(crate) fn new(takes_hints: bool, has_max_ages: bool) -> Self {
        let last = takes_hints.then(VecDeque::new);
        let captures = has_max_ages.then(VecDeque::new);
        Self { open: VecDeque::new(), has_budgets: false, last, captures }
    }

    /// F1: timestamps ascend.
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

    /// F3: a result is available; it is kept if it is the best, with its own message (D2 its own value).
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

    /// The message's next item. With the last one it is no longer open.
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
        // Ages never lie: a value of an earlier message is as old as that one.
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

    /// What is left of an open message's end-to-end deadline, if it has one.
    pub(crate) fn budget(&self, t: u64) -> Option<Budget> {
        if !self.has_budgets {
            return None;
        }
        self.open.get(self.index(t)?)?.budget
    }

    /// When the message was opened, if that is remembered.
    pub(crate) fn opened(&self, t: u64) -> Option<u64> {
        let last = self.last.as_ref()?;
        let index = last.binary_search_by_key(&t, |(t, _)| *t).ok()?;
        last.get(index).map(|(_, opened)| *opened)
    }

    pub(crate) fn len(&self) -> usize {
        self.open.len()
    }

    /// When the message was captured, if that is remembered.
    fn captured(&self, t: u64) -> Option<Instant> {
        let captures = self.captures.as_ref()?;
        let index = captures.binary_search_by_key(&t, |(t, _)| *t).ok()?;
        captures.get(index).map(|(_, captured)| *captured)
    }

    fn index(&self, t: u64) -> Option<usize> {
        // Mostly it is the oldest.
        if self.open.front()?.t == t {
            return Some(0);
        }
        self.open.binary_search_by_key(&t, |open_message| open_message.t).ok()
    }
}

/// One more of the last messages.
fn push_bounded<T>(last: &mut VecDeque<T>, entry: T) {
    if last.len() == REMEMBERED {
        last.pop_front();
    }
    last.push_back(entry);
}
