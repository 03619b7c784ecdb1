//! Which message a key stands for.

use std::collections::{HashMap, VecDeque};

/// How many answered messages are remembered, so that their late results differ from results of no message.
const ANSWERED: usize = 1024;

/// The timestamps of the open messages and of those answered last, by key.
///
/// `K` is the key that inputs and results have in common: the stamp, or an integer.
#[derive(Debug)]
pub(crate) struct Stamps<K> {
    by_key: HashMap<K, u64>,
    open: HashMap<u64, K>,
    /// In the order of their answers.
    answered: VecDeque<(K, u64)>,
    /// The greatest key so far.
    newest: Option<K>,
}

/// How an input's key compares with the keys before it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum KeyOrder {
    /// Greater than all before.
    Forwards,
    /// Not greater; the message is taken on all the same.
    Backwards,
    /// An open message has this key: their results could not be distinguished.
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

    /// How this key would compare.
    pub(crate) fn order(&self, key: K) -> KeyOrder {
        if self.by_key.get(&key).is_some_and(|t| self.open.contains_key(t)) {
            KeyOrder::Taken
        } else if self.newest.is_some_and(|newest| key <= newest) {
            KeyOrder::Backwards
        } else {
            KeyOrder::Forwards
        }
    }

    /// A message with this key is open now. If an answered one had the key, it is now the new one's.
    pub(crate) fn open(&mut self, key: K, t: u64) {
        self.by_key.insert(key, t);
        self.open.insert(t, key);
        self.newest = self.newest.max(Some(key));
    }

    /// The key of an open message.
    pub(crate) fn key(&self, t: u64) -> Option<K> {
        self.open.get(&t).copied()
    }

    /// The message was answered; returns its key, if it was open.
    pub(crate) fn answer(&mut self, t: u64) -> Option<K> {
        let key = self.open.remove(&t)?;
        self.answered.push_back((key, t));
        if self.answered.len() > ANSWERED
            && let Some((key, t)) = self.answered.pop_front()
        {
            self.forget(key, t);
        }
        Some(key)
    }

    /// The message was not taken on; returns its key, if it was open.
    pub(crate) fn refuse(&mut self, t: u64) -> Option<K> {
        let key = self.open.remove(&t)?;
        self.forget(key, t);
        Some(key)
    }

    /// The timestamp of the message with this key, if it is remembered.
    pub(crate) fn find(&self, key: K) -> Option<u64> {
        self.by_key.get(&key).copied()
    }

    /// Forgets the key unless another message has it by now.
    fn forget(&mut self, key: K, t: u64) {
        if self.by_key.get(&key) == Some(&t) {
            self.by_key.remove(&key);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// D1.
    #[test]
    fn a_key_is_taken_while_its_message_is_open_and_anew_after() {
        let mut stamps = Stamps::new();
        assert_eq!(stamps.order(7), KeyOrder::Forwards);
        stamps.open(7, 0);
        assert_eq!((stamps.order(7), stamps.find(7)), (KeyOrder::Taken, Some(0)));
        assert_eq!((stamps.order(6), stamps.order(8)), (KeyOrder::Backwards, KeyOrder::Forwards));
        assert_eq!((stamps.key(0), stamps.answer(0), stamps.key(0)), (Some(7), Some(7), None));
        assert_eq!((stamps.order(7), stamps.find(7)), (KeyOrder::Backwards, Some(0)));
        stamps.open(7, 1);
        assert_eq!(stamps.find(7), Some(1));
        assert_eq!(stamps.refuse(1), Some(7));
        assert_eq!(stamps.find(7), None);
    }

    /// D8.
    #[test]
    fn so_many_answered_ones_are_remembered_and_all_open_ones() {
        let mut stamps = Stamps::new();
        stamps.open(0, 0);
        for i in 1..=ANSWERED as u64 + 1 {
            stamps.open(i, i);
            stamps.answer(i);
        }
        assert_eq!((stamps.find(0), stamps.find(1), stamps.find(2)), (Some(0), None, Some(2)));
        assert_eq!(stamps.by_key.len(), ANSWERED + 1);
    }

    /// D1.
    #[test]
    fn a_key_that_was_given_away_is_not_forgotten_with_its_first_message() {
        let mut stamps = Stamps::new();
        stamps.open(5, 0);
        stamps.answer(0);
        stamps.open(5, 1);
        for i in 2..ANSWERED as u64 + 3 {
            stamps.open(i + 10, i);
            stamps.answer(i);
        }
        assert_eq!(stamps.find(5), Some(1));
    }
}
