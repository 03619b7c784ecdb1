//! Matches keys to messages.

use std::collections::{HashMap, VecDeque};

/// The number of answered messages that are remembered. Their late results differ from results of
/// no message, and no other message is accepted under their keys.
pub(crate) const ANSWERED: usize = 1024;

/// Holds the timestamps of the open messages and of those answered last, by key.
///
/// `K` is the key that inputs and results share: the stamp, or an integer. A key belongs to one
/// message at most. Otherwise a source that answers late could give a message the value of an
/// earlier one (D2).
#[derive(Debug)]
pub(crate) struct Stamps<K> {
    by_key: HashMap<K, u64>,
    open: HashMap<u64, K>,
    /// In the order of their answers.
    answered: VecDeque<K>,
    /// The greatest key so far.
    newest: Option<K>,
}

/// Compares an input's key with the keys before it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum KeyOrder {
    /// The key is greater than all before.
    Forwards,
    /// The key is not greater, but belongs to no remembered message, so the message is accepted.
    Backwards,
    /// A remembered message has this key, so the results of both could not be distinguished.
    Taken,
}

impl<K: Copy + Eq + Ord + std::hash::Hash> Stamps<K> {
    pub(crate) fn new() -> Self {
        Self {
            by_key: HashMap::new(),
            open: HashMap::new(),
            answered: VecDeque::new(),
            newest: None,
        }
    }

    /// Compares this key with the keys before it.
    pub(crate) fn order(&self, key: K) -> KeyOrder {
        if self.by_key.contains_key(&key) {
            KeyOrder::Taken
        } else if self.newest.is_some_and(|newest| key <= newest) {
            KeyOrder::Backwards
        } else {
            KeyOrder::Forwards
        }
    }

    /// Opens a message under a key that is not taken.
    pub(crate) fn open(&mut self, key: K, t: u64) {
        self.by_key.insert(key, t);
        self.open.insert(t, key);
        self.newest = self.newest.max(Some(key));
    }

    /// Returns the key of an open message.
    pub(crate) fn key(&self, t: u64) -> Option<K> {
        self.open.get(&t).copied()
    }

    /// Notes that the message was answered. Returns its key, if it was open.
    pub(crate) fn answer(&mut self, t: u64) -> Option<K> {
        let key = self.open.remove(&t)?;
        self.answered.push_back(key);
        if self.answered.len() > ANSWERED
            && let Some(oldest) = self.answered.pop_front()
        {
            self.by_key.remove(&oldest);
        }
        Some(key)
    }

    /// Notes that the message was not accepted. Returns its key, if it was open.
    pub(crate) fn refuse(&mut self, t: u64) -> Option<K> {
        let key = self.open.remove(&t)?;
        self.by_key.remove(&key);
        Some(key)
    }

    /// Returns the timestamp of the message with this key, if it is remembered.
    pub(crate) fn find(&self, key: K) -> Option<u64> {
        self.by_key.get(&key).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// D2.
    #[test]
    fn key_is_taken_while_it_is_remembered() {
        let mut stamps = Stamps::new();
        assert_eq!(stamps.order(7), KeyOrder::Forwards);
        stamps.open(7, 0);
        assert_eq!((stamps.order(7), stamps.find(7)), (KeyOrder::Taken, Some(0)));
        assert_eq!((stamps.order(6), stamps.order(8)), (KeyOrder::Backwards, KeyOrder::Forwards));
        assert_eq!((stamps.key(0), stamps.answer(0), stamps.key(0)), (Some(7), Some(7), None));
        assert_eq!((stamps.order(7), stamps.find(7)), (KeyOrder::Taken, Some(0)));
        for t in 1..=ANSWERED as u64 {
            assert_eq!(stamps.order(7), KeyOrder::Taken, "after {t} messages");
            stamps.open(t + 10, t);
            stamps.answer(t);
        }
        assert_eq!((stamps.order(7), stamps.find(7)), (KeyOrder::Backwards, None));
    }

    /// No source got a request, so no result can belong to another message (D1).
    #[test]
    fn key_of_a_refused_message_is_free() {
        let mut stamps = Stamps::new();
        stamps.open(7, 0);
        assert_eq!((stamps.refuse(0), stamps.find(7)), (Some(7), None));
        assert_eq!(stamps.order(7), KeyOrder::Backwards);
    }

    /// D8.
    #[test]
    fn remembers_1024_answered_and_all_open() {
        let mut stamps = Stamps::new();
        stamps.open(0, 0);
        for i in 1..=ANSWERED as u64 + 1 {
            stamps.open(i, i);
            stamps.answer(i);
        }
        assert_eq!((stamps.find(0), stamps.find(1), stamps.find(2)), (Some(0), None, Some(2)));
        assert_eq!(stamps.by_key.len(), ANSWERED + 1);
    }
}
