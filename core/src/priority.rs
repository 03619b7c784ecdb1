//! The priorities of sources, as the operator's owner numbers them, and sets of priorities.

use crate::source::{Source, Sources};

/// Ranks the results of a source: 0 is local, clouds have 1 to 65535, and the greater number wins.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(transparent))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Priority(u16);

impl Priority {
    /// The priority of local, which is the lowest.
    pub const LOCAL: Self = Self(0);

    /// Creates the priority with this number.
    #[must_use]
    pub const fn new(number: u16) -> Self {
        Self(number)
    }

    /// Returns the number.
    #[must_use]
    pub const fn as_u16(self) -> u16 {
        self.0
    }
}

/// A set of an operator's priorities. It may contain 0, which is local.
#[derive(Clone, Copy)]
pub struct Priorities<const CLOUDS: usize> {
    of_clouds: [Priority; CLOUDS],
    members: Sources,
}

impl<const CLOUDS: usize> Priorities<CLOUDS> {
    pub(crate) const fn new(of_clouds: [Priority; CLOUDS], members: Sources) -> Self {
        Self { of_clouds, members }
    }

    /// Returns `true` if the set is empty.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.members.is_empty()
    }

    /// Returns `true` if `priority` is a member.
    #[must_use]
    pub fn contains(&self, priority: Priority) -> bool {
        self.iter().any(|member| member == priority)
    }

    /// Returns the members in ascending order.
    pub fn iter(&self) -> impl Iterator<Item = Priority> {
        self.members.iter().map(|source| priority_of(&self.of_clouds, source))
    }

    /// Returns the same set as sources.
    #[must_use]
    pub const fn sources(&self) -> Sources {
        self.members
    }
}

/// Returns the priority of `source`. `of_clouds` are the clouds' priorities in ascending order.
pub(crate) fn priority_of(of_clouds: &[Priority], source: Source) -> Priority {
    let cloud = usize::from(source.index()).checked_sub(1);
    cloud.and_then(|cloud| of_clouds.get(cloud)).copied().unwrap_or(Priority::LOCAL)
}

impl<const CLOUDS: usize> PartialEq for Priorities<CLOUDS> {
    fn eq(&self, other: &Self) -> bool {
        self.iter().eq(other.iter())
    }
}

impl<const CLOUDS: usize> Eq for Priorities<CLOUDS> {}

impl<const CLOUDS: usize> core::fmt::Debug for Priorities<CLOUDS> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_set().entries(self.iter().map(Priority::as_u16)).finish()
    }
}

#[cfg(feature = "defmt")]
impl<const CLOUDS: usize> defmt::Format for Priorities<CLOUDS> {
    fn format(&self, f: defmt::Formatter<'_>) {
        for priority in self.iter() {
            defmt::write!(f, "{} ", priority.as_u16());
        }
    }
}
