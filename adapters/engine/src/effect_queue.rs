//! The effects of an engine that the adapter has not yet carried out.

use std::collections::VecDeque;

use crate::effect::Effect;

/// Effects in the order of the decisions. Effects with a value are rare, and more than three times
/// as large as the others. They are stored separately to save memory accesses: with thousands of
/// operators nothing is in the cache.
pub(crate) struct EffectQueue<V, R> {
    order: VecDeque<QueuedEffect<R>>,
    with_value: VecDeque<Effect<V, R>>,
}

enum QueuedEffect<R> {
    Start {
        priority: u16,
        timestamp: u64,
        until: Option<u64>,
        request: R,
    },
    Abort {
        priority: u16,
        timestamp: u64,
    },
    Replace {
        timestamp: u64,
    },
    /// The next effect that has a value.
    WithValue,
}

impl<V, R> EffectQueue<V, R> {
    pub(crate) const fn new() -> Self {
        Self { order: VecDeque::new(), with_value: VecDeque::new() }
    }

    pub(crate) fn push(&mut self, effect: Effect<V, R>) {
        self.order.push_back(match effect {
            Effect::Start { priority, timestamp, until, request } => {
                QueuedEffect::Start { priority, timestamp, until, request }
            }
            Effect::Abort { priority, timestamp } => QueuedEffect::Abort { priority, timestamp },
            Effect::Replace { timestamp } => QueuedEffect::Replace { timestamp },
            Effect::Output(_) | Effect::Hint(_) => {
                self.with_value.push_back(effect);
                QueuedEffect::WithValue
            }
        });
    }

    #[inline]
    pub(crate) fn pop(&mut self) -> Option<Effect<V, R>> {
        match self.order.pop_front()? {
            QueuedEffect::Start { priority, timestamp, until, request } => {
                Some(Effect::Start { priority, timestamp, until, request })
            }
            QueuedEffect::Abort { priority, timestamp } => {
                Some(Effect::Abort { priority, timestamp })
            }
            QueuedEffect::Replace { timestamp } => Some(Effect::Replace { timestamp }),
            QueuedEffect::WithValue => self.with_value.pop_front(),
        }
    }
}
