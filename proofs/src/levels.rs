//! Replaces the arrays of keys of the shipped window in proofs: each level has the four keys that include
//! own's.
//!
//! The three keys beside own's are any keys, or do not exist, so what is shown holds for each key on each
//! level. Only these four can be read, and an assertion forbids writing any but own's. On one level, which
//! may be any, own's key is the least of the four below it; on the other levels it is any key. So each level
//! is shown to be right by itself, whatever the others contain.

use core::cell::Cell;

use crate::cell_window::DueKey;

/// The number of levels of a window of 1024.
pub(crate) const MOST_LEVELS: usize = 5;

/// An array of keys: one level, or several levels one behind the other.
#[derive(Clone)]
pub(crate) struct Levels {
    pub(crate) groups: [Group; MOST_LEVELS],
    /// The number of levels.
    pub(crate) count: usize,
    /// The level whose key is the least of the four below it.
    pub(crate) right: usize,
}

/// Four keys of a level.
#[derive(Clone)]
pub(crate) struct Group {
    /// The place of own's key on its level.
    pub(crate) at: usize,
    /// The number of keys on the level.
    pub(crate) len: usize,
    /// Own's key, then the keys at the places whose numbers differ in bit 1, in bit 2, and in both.
    /// A key is never if its place does not exist.
    pub(crate) keys: [DueKey; 4],
    /// The number of keys that were read so far.
    pub(crate) reads: Cell<usize>,
}

impl Group {
    /// Returns a group that is on no level.
    pub(crate) fn none() -> Self {
        Self { at: 0, len: 0, keys: [DueKey::NEVER; 4], reads: Cell::new(0) }
    }

    pub(crate) const fn len(&self) -> usize {
        self.len
    }

    pub(crate) fn get(&self, at: usize) -> Option<&DueKey> {
        kani::assert(at ^ self.at < 4, "P9: no key but those of its four is read");
        self.reads.set(self.reads.get() + 1);
        if at < self.len { self.keys.get(at ^ self.at) } else { None }
    }

    pub(crate) fn get_mut(&mut self, at: usize) -> Option<&mut DueKey> {
        kani::assert(at == self.at, "P9: nothing but its own is written");
        (at < self.len).then_some(&mut self.keys[0])
    }
}

impl Levels {
    /// Returns own's key of the first level.
    pub(crate) fn get(&self, at: usize) -> Option<&DueKey> {
        kani::assert(at == self.groups[0].at, "P9: nothing but its own is looked at");
        (at < self.groups[0].len).then_some(&self.groups[0].keys[0])
    }

    pub(crate) fn get_mut(&mut self, at: usize) -> Option<&mut DueKey> {
        self.groups[0].get_mut(at)
    }

    /// Returns the first level.
    pub(crate) const fn as_slice(&self) -> &Group {
        &self.groups[0]
    }

    /// Returns all levels.
    pub(crate) fn as_mut_slice(&mut self) -> Above<'_> {
        Above(&mut self.groups[..self.count])
    }
}

/// A level and the levels behind it.
pub(crate) struct Above<'a>(&'a mut [Group]);

impl<'a> Above<'a> {
    pub(crate) fn split_at_mut_checked(self, len: usize) -> Option<(&'a mut Group, Self)> {
        let (level, rest) = self.0.split_first_mut()?;
        kani::assert(len == level.len, "P9: a level is taken whole, and nothing else");
        Some((level, Self(rest)))
    }
}
