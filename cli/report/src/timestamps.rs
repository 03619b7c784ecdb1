//! Values by timestamp, looked up line by line: most lines are about the timestamp of the line before.

use std::collections::HashMap;

/// A map by timestamp. It goes through its values in an order that depends on the calls alone.
pub(crate) struct TimestampMap<V> {
    /// Where each timestamp's value is.
    places: HashMap<u64, usize>,
    values: Vec<Option<(u64, V)>>,
    /// The places without a value.
    free: Vec<usize>,
    /// The timestamp looked up last, and where its value is if it still has one.
    last: (u64, usize),
}

impl<V> Default for TimestampMap<V> {
    fn default() -> Self {
        let (places, values, free) = (HashMap::new(), Vec::new(), Vec::new());
        Self { places, values, free, last: (0, 0) }
    }
}

impl<V> TimestampMap<V> {
    pub(crate) fn get(&self, t: u64) -> Option<&V> {
        self.value(*self.places.get(&t)?)
    }

    pub(crate) fn get_mut(&mut self, t: u64) -> Option<&mut V> {
        let place = self.find(t)?;
        self.value_mut(place)
    }

    /// The value, made if there is none.
    pub(crate) fn get_or_insert_with(&mut self, t: u64, make: impl FnOnce() -> V) -> &mut V {
        let place = self.find(t).unwrap_or_else(|| self.free.pop().unwrap_or(self.values.len()));
        if place == self.values.len() {
            self.values.push(None);
        }
        let Self { places, values, last, .. } = self;
        let (_, value) = values[place].get_or_insert_with(|| {
            places.insert(t, place);
            *last = (t, place);
            (t, make())
        });
        value
    }

    pub(crate) fn remove(&mut self, t: u64) -> Option<V> {
        let place = self.places.remove(&t)?;
        self.free.push(place);
        self.values[place].take().map(|(_, value)| value)
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = (u64, &V)> {
        self.values.iter().flatten().map(|(t, value)| (*t, value))
    }

    /// From the least timestamp to the greatest.
    pub(crate) fn sorted(&self) -> Vec<(u64, &V)> {
        let mut all: Vec<_> = self.iter().collect();
        all.sort_unstable_by_key(|(t, _)| *t);
        all
    }

    /// Takes out what `keeps` does not name.
    pub(crate) fn retain(&mut self, mut keeps: impl FnMut(u64, &mut V) -> bool) {
        for (place, entry) in self.values.iter_mut().enumerate() {
            if let Some((t, _)) = entry.take_if(|(t, value)| !keeps(*t, value)) {
                self.places.remove(&t);
                self.free.push(place);
            }
        }
    }

    /// Where a timestamp's value is, which is looked up last then.
    fn find(&mut self, t: u64) -> Option<usize> {
        let (last, place) = self.last;
        if last == t
            && self.values.get(place).is_some_and(|it| it.as_ref().is_some_and(|it| it.0 == t))
        {
            return Some(place);
        }
        let place = *self.places.get(&t)?;
        self.last = (t, place);
        Some(place)
    }

    fn value(&self, place: usize) -> Option<&V> {
        self.values.get(place)?.as_ref().map(|(_, value)| value)
    }

    fn value_mut(&mut self, place: usize) -> Option<&mut V> {
        self.values.get_mut(place)?.as_mut().map(|(_, value)| value)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[test]
    fn it_holds_what_an_ordered_map_holds() {
        let mut map = TimestampMap::<u64>::default();
        let mut other = BTreeMap::<u64, u64>::new();
        let mut number = 1_u64;
        for step in 0..20_000_u64 {
            number = number.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(step);
            let (t, kind) = ((number >> 40) % 50, (number >> 33) % 8);
            match kind {
                0 => assert_eq!(map.remove(t), other.remove(&t)),
                1 => assert_eq!(map.get_mut(t), other.get_mut(&t)),
                2 => assert_eq!(map.get(t), other.get(&t)),
                3 if t == 7 => {
                    map.retain(|t, value| !(t + *value).is_multiple_of(3));
                    other.retain(|t, value| !(t + *value).is_multiple_of(3));
                }
                _ => {
                    let made = map.get_or_insert_with(t, || step);
                    assert_eq!(made, other.entry(t).or_insert(step));
                    *made += 1;
                    *other.get_mut(&t).unwrap() += 1;
                }
            }
        }
        let sorted: Vec<_> = other.iter().map(|(t, value)| (*t, value)).collect();
        assert!(map.sorted() == sorted && !sorted.is_empty() && map.values.len() <= 50);
    }
}
