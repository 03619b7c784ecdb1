//! One slot's state in one word: the four sets and the slot's generation.

use fuseline_core::{Commit, Slot, Sources};

/// Two bits for each source, and the slot's generation. The low bits of the word are the first bits
/// of all sources. Their second bits follow, and then the generation, which is odd while the slot
/// is open. The table shows the second bit on the left.
///
/// | bits | a cloud is | local is |
/// |---|---|---|
/// | 00 | not requested | pending, without a deadline |
/// | 01 | pending | pending, its deadline armed |
/// | 10 | cached | cached |
/// | 11 | closed | closed |
///
/// The word does not store which clouds are armed, because that follows from the commit rule.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct PackedSlot<const CLOUDS: usize>(u64);

impl<const CLOUDS: usize> PackedSlot<CLOUDS> {
    /// The number of sources: local and the clouds.
    #[expect(clippy::cast_possible_truncation, reason = "there are at most 15 clouds")]
    const SOURCES: u32 = (CLOUDS as u32).wrapping_add(1);
    const FIRST_BITS: u64 = 1_u64.wrapping_shl(Self::SOURCES).wrapping_sub(1);

    pub(crate) const fn from_bits(bits: u64) -> Self {
        Self(bits)
    }

    pub(crate) const fn bits(self) -> u64 {
        self.0
    }

    /// Counts how often the slot was opened and retired. The count wraps.
    pub(crate) const fn generation(self) -> u64 {
        self.0.wrapping_shr(Self::SOURCES.wrapping_mul(2))
    }

    pub(crate) const fn is_open(self) -> bool {
        self.generation() & 1 == 1
    }

    /// Returns the word of this free slot after it is opened with this state.
    pub(crate) fn opened(self, slot: Slot) -> Self {
        self.next_generation().with(slot)
    }

    /// Returns the word of this open slot after a step to this state.
    pub(crate) fn stepped(self, slot: Slot) -> Self {
        if slot.is_open() { self.with(slot) } else { self.next_generation() }
    }

    /// Returns the state of an open slot.
    pub(crate) fn slot(self, commit: Commit) -> Slot {
        let (first, second) =
            (Self::sources(self.0), Self::sources(self.0.wrapping_shr(Self::SOURCES)));
        let requested = first.union(second).union(Sources::LOCAL);
        let cached = second.difference(first);
        let pending = requested.difference(second);
        let of_clouds = match commit {
            Commit::Eager => pending.union(cached).clouds(),
            Commit::Patient | Commit::Progressive => pending.clouds(),
        };
        let of_local = first.difference(second).intersection(Sources::LOCAL);
        let slot = Slot::from_sets(commit, requested, pending, of_clouds.union(of_local), cached);
        debug_assert!(slot.is_ok(), "words are made of states");
        slot.unwrap_or(Slot::RETIRED)
    }

    /// Returns the word with this generation and this state.
    fn with(self, slot: Slot) -> Self {
        let closed = slot.requested().difference(slot.pending()).difference(slot.cached());
        let armed_limit = slot.armed().intersection(Sources::LOCAL);
        let first = slot.pending().clouds().union(armed_limit).union(closed);
        let second = slot.cached().union(closed);
        let bits = u64::from(first.bits()) | u64::from(second.bits()).wrapping_shl(Self::SOURCES);
        Self(self.generation().wrapping_shl(Self::SOURCES.wrapping_mul(2)) | bits)
    }

    fn next_generation(self) -> Self {
        Self(self.generation().wrapping_add(1).wrapping_shl(Self::SOURCES.wrapping_mul(2)))
    }

    #[expect(clippy::cast_possible_truncation, reason = "there are at most 16 sources")]
    const fn sources(bits: u64) -> Sources {
        Sources::from_bits((bits & Self::FIRST_BITS) as u16)
    }
}

#[cfg(test)]
mod tests;
