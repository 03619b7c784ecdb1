//! Sets of priorities.

/// How many priorities there are to model: 0 to one less.
pub(crate) const PRIORITIES: usize = 8;

/// A set of priorities below [`PRIORITIES`], one bit each; what is beyond is never a member.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub(crate) struct Set(u8);

impl Set {
    pub(crate) const LOCAL: Self = Self(1);

    pub(crate) fn insert(&mut self, p: u64) {
        self.0 |= bit(p);
    }

    /// Takes `p` out; whether it was a member.
    pub(crate) fn remove(&mut self, p: u64) -> bool {
        let was = self.contains(p);
        self.0 &= !bit(p);
        was
    }

    pub(crate) fn contains(self, p: u64) -> bool {
        self.0 & bit(p) != 0
    }

    pub(crate) fn is_empty(self) -> bool {
        self.0 == 0
    }

    pub(crate) fn len(self) -> u32 {
        self.0.count_ones()
    }

    /// The members in ascending order.
    pub(crate) fn iter(self) -> impl DoubleEndedIterator<Item = u64> {
        (0..PRIORITIES as u64).filter(move |p| self.contains(*p))
    }

    pub(crate) fn greatest(self) -> Option<u64> {
        self.iter().next_back()
    }

    pub(crate) fn any_above(self, p: u64) -> bool {
        self.iter().any(|member| member > p)
    }
}

fn bit(p: u64) -> u8 {
    u32::try_from(p).ok().and_then(|p| 1_u8.checked_shl(p)).unwrap_or(0)
}
