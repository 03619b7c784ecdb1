//! What replaces the arrays of keys of the shipped window in proofs: of each level the four keys that own's is among.
//!
//! The three beside own's are anything, or are not there: so what is shown holds of each key on each level. Nothing but own's may be
//! written, which is asserted, and only these four are there to be read. On one level, which may be any, the first of four is what it
//! must be; elsewhere it is anything. So each level is shown right by itself, whatever the others hold.

use core::cell::Cell;

use crate::cell_window::DueKey;

/// As many levels as a window of 1024 has.
pub(crate) const MOST_LEVELS: usize = 5;

/// An array of keys: one level, or several one behind the other.
#[derive(Clone)]
pub(crate) struct Levels {
    pub(crate) groups: [Group; MOST_LEVELS],
    /// How many of them there are.
    pub(crate) count: usize,
    /// The one whose key is the first of the four below it.
    pub(crate) right: usize,
}

/// Four keys of a level.
#[derive(Clone)]
pub(crate) struct Group {
    /// Where own's is on its level.
    pub(crate) at: usize,
    /// How many keys the level has.
    pub(crate) len: usize,
    /// Own's, and that in the place whose number differs in the bits 1, 2, and both: never, if there is none.
    pub(crate) keys: [DueKey; 4],
    /// How many keys were read so far.
    pub(crate) reads: Cell<usize>,
}

impl Group {
    /// Of no level.
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
    /// Own's key of the first level.
    pub(crate) fn get(&self, at: usize) -> Option<&DueKey> {
        kani::assert(at == self.groups[0].at, "P9: nothing but its own is looked at");
        (at < self.groups[0].len).then_some(&self.groups[0].keys[0])
    }

    pub(crate) fn get_mut(&mut self, at: usize) -> Option<&mut DueKey> {
        self.groups[0].get_mut(at)
    }

    /// The first level.
    pub(crate) const fn as_slice(&self) -> &Group {
        &self.groups[0]
    }

    /// All levels.
    pub(crate) fn as_mut_slice(&mut self) -> Above<'_> {
        Above(&mut self.groups[..self.count])
    }
}

/// A level, and those behind it.
pub(crate) struct Above<'a>(&'a mut [Group]);

impl<'a> Above<'a> {
    pub(crate) fn split_at_mut_checked(self, len: usize) -> Option<(&'a mut Group, Self)> {
        let (level, rest) = self.0.split_first_mut()?;
        kani::assert(len == level.len, "P9: a level is taken whole, and nothing else");
        Some((level, Self(rest)))
    }
}
