//! The sources of results, and sets of them.

/// Numbers where a result comes from: source 0 is local, and sources 1 to 15 are the configured
/// clouds in ascending priority.
///
/// The greater of two sources outranks the other.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Source(u8);

impl Source {
    /// The greatest number of sources in a [`Slot`](crate::Slot): local and 15 clouds.
    pub const COUNT: u8 = 16;
    /// Local, which every cloud outranks.
    pub const LOCAL: Self = Self(0);

    /// Returns the source with this index, or `None` if the index is 16 or more.
    #[must_use]
    pub const fn new(index: u8) -> Option<Self> {
        if index < Self::COUNT { Some(Self(index)) } else { None }
    }

    /// Returns 0 for local, or a cloud's number among the clouds in ascending priority, from 1.
    #[must_use]
    pub const fn index(self) -> u8 {
        self.0
    }

    const fn bit(self) -> u16 {
        1_u16.wrapping_shl(self.0 as u32)
    }
}

/// A set of [`Source`]s, with one bit for each.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sources(u16);

impl Sources {
    /// The empty set.
    pub const EMPTY: Self = Self(0);
    /// The set that contains only local.
    pub const LOCAL: Self = Self(1);

    /// Creates the set whose members are the set bits of `bits`. Bit 0 is local.
    #[must_use]
    pub const fn from_bits(bits: u16) -> Self {
        Self(bits)
    }

    /// Returns the set as bits. Bit 0 is local.
    #[must_use]
    pub const fn bits(self) -> u16 {
        self.0
    }

    /// Returns this set with `source` added.
    #[must_use]
    pub const fn with(self, source: Source) -> Self {
        Self(self.0 | source.bit())
    }

    /// Returns this set with `source` removed.
    #[must_use]
    pub const fn without(self, source: Source) -> Self {
        Self(self.0 & !source.bit())
    }

    /// Returns the members of either set.
    #[must_use]
    pub const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Returns the members of both sets.
    #[must_use]
    pub const fn intersection(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// Returns the members of this set that are not in `other`.
    #[must_use]
    pub const fn difference(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// Returns the members other than local.
    #[must_use]
    pub const fn clouds(self) -> Self {
        self.difference(Self::LOCAL)
    }

    /// Returns `true` if the set is empty.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Returns `true` if `source` is a member.
    #[must_use]
    pub const fn contains(self, source: Source) -> bool {
        self.0 & source.bit() != 0
    }

    /// Returns `true` if every member of `other` is a member of this set.
    #[must_use]
    pub const fn contains_all(self, other: Self) -> bool {
        other.0 & !self.0 == 0
    }

    /// Returns `true` if some member outranks `source`.
    #[must_use]
    pub const fn any_above(self, source: Source) -> bool {
        // A member above `source` sets a bit above the bit of `source`. The set is then greater
        // than the number with all bits up to the bit of `source`.
        self.0 > source.bit() | source.bit().wrapping_sub(1)
    }

    /// Returns the members that outrank `source`.
    #[must_use]
    pub const fn above(self, source: Source) -> Self {
        Self(self.0 & !(source.bit() | source.bit().wrapping_sub(1)))
    }

    /// Returns the members in ascending order.
    pub fn iter(self) -> impl Iterator<Item = Source> {
        let mut rest = self;
        core::iter::from_fn(move || {
            let least = rest.least()?;
            rest = rest.without(least);
            Some(least)
        })
    }

    /// Returns the member that outranks all others, or `None` if the set is empty.
    #[must_use]
    pub const fn greatest(self) -> Option<Source> {
        match self.0.checked_ilog2() {
            #[expect(clippy::cast_possible_truncation, reason = "a u16 has its bits at 0 to 15")]
            Some(index) => Some(Source(index as u8)),
            None => None,
        }
    }

    /// Returns the member that all others outrank, or `None` if the set is empty.
    #[must_use]
    pub const fn least(self) -> Option<Source> {
        if self.is_empty() {
            return None;
        }
        #[expect(clippy::cast_possible_truncation, reason = "a u16 has its bits at 0 to 15")]
        Some(Source(self.0.trailing_zeros() as u8))
    }
}

impl FromIterator<Source> for Sources {
    fn from_iter<I: IntoIterator<Item = Source>>(sources: I) -> Self {
        sources.into_iter().fold(Self::EMPTY, Self::with)
    }
}

impl core::fmt::Debug for Sources {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_set().entries(self.iter().map(Source::index)).finish()
    }
}
