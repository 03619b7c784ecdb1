//! Remembers what was received lately, so that nothing is taken twice.
//!
//! While the node is in its domain with two participants, both receive what a peer sends, and
//! neither receives all.

use std::collections::{BTreeSet, VecDeque};

/// The newest identities, each a writer's and a sequence number, say.
#[derive(Debug)]
pub(crate) struct RecentIds<I> {
    ids: BTreeSet<I>,
    /// The oldest first.
    order: VecDeque<I>,
    capacity: usize,
}

impl<I: Copy + Ord> RecentIds<I> {
    /// Remembers the last `capacity`.
    pub(crate) const fn new(capacity: usize) -> Self {
        Self { ids: BTreeSet::new(), order: VecDeque::new(), capacity }
    }

    /// Remembers it; false if it is remembered already.
    pub(crate) fn insert(&mut self, id: I) -> bool {
        let is_new = self.ids.insert(id);
        if is_new {
            self.order.push_back(id);
            if self.order.len() > self.capacity
                && let Some(oldest) = self.order.pop_front()
            {
                self.ids.remove(&oldest);
            }
        }
        is_new
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// D13.
    #[test]
    fn each_is_new_once_in_whatever_order_two_participants_receive_them() {
        let mut ids = RecentIds::new(8);
        // The second participant has the third sample before the first one has the lost second one.
        let received = [('a', 1), ('a', 3), ('a', 2), ('a', 3), ('b', 1), ('a', 1)];
        assert_eq!(received.map(|id| ids.insert(id)), [true, true, true, false, true, false]);
    }

    #[test]
    fn no_more_are_remembered_than_there_is_room_for() {
        let mut ids = RecentIds::new(2);
        assert!([1, 2, 3].into_iter().all(|id| ids.insert(id)));
        assert_eq!((ids.ids.len(), ids.order.len()), (2, 2));
        assert_eq!([3, 2, 1].map(|id| ids.insert(id)), [false, false, true]);
    }
}
