//! A map from timestamps that remembers its last access, because most lines of a trace are about
//! the same timestamp as the line before.

use std::collections::BTreeMap;

/// Values by timestamp, in ascending order.
pub(crate) struct TimestampMap<T> {
    /// The index of each value.
    indices: BTreeMap<u64, usize>,
    values: Vec<T>,
    /// The timestamp that was used last, and the index of its value.
    last: Option<(u64, usize)>,
}

impl<T> Default for TimestampMap<T> {
    fn default() -> Self {
        Self { indices: BTreeMap::new(), values: Vec::new(), last: None }
    }
}

impl<T> TimestampMap<T> {
    /// Returns the value of a timestamp, which is created if there is none.
    pub(crate) fn or_insert_with(&mut self, t: u64, value: impl FnOnce() -> T) -> &mut T {
        let index = match self.find(t) {
            Some(index) => index,
            None => self.insert_new(t, value()),
        };
        self.last = Some((t, index));
        &mut self.values[index]
    }

    pub(crate) fn get(&self, t: u64) -> Option<&T> {
        self.values.get(self.find(t)?)
    }

    pub(crate) fn get_mut(&mut self, t: u64) -> Option<&mut T> {
        let index = self.find(t)?;
        self.last = Some((t, index));
        self.values.get_mut(index)
    }

    /// Returns all values, by ascending timestamps.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (u64, &T)> {
        self.indices.iter().map(|(t, index)| (*t, &self.values[*index]))
    }

    fn find(&self, t: u64) -> Option<usize> {
        match self.last {
            Some((last, index)) if last == t => Some(index),
            _ => self.indices.get(&t).copied(),
        }
    }

    fn insert_new(&mut self, t: u64, value: T) -> usize {
        let index = self.values.len();
        self.values.push(value);
        self.indices.insert(t, index);
        index
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// It behaves like a plain map, whatever was used last.
        #[test]
        fn it_holds_what_a_plain_map_holds(uses in prop::collection::vec((0..3_u8, 0..9_u64), 0..200)) {
            let (mut map, mut plain) = (TimestampMap::default(), BTreeMap::new());
            for (number, (act, t)) in (1_u64..).zip(uses) {
                match act {
                    0 | 1 => {
                        let own = *map.or_insert_with(t, || number);
                        prop_assert_eq!(own, *plain.entry(t).or_insert(number));
                    }
                    _ => {
                        if let Some(value) = map.get_mut(t) {
                            *value += 1;
                        }
                        plain.entry(t).and_modify(|value| *value += 1);
                    }
                }
                prop_assert!(map.iter().eq(plain.iter().map(|(t, value)| (*t, value))));
                prop_assert!((0..9).all(|t| map.get(t) == plain.get(&t)));
            }
        }
    }
}
