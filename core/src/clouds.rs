//! Checks a configuration and keeps the registered clouds in ascending priority.

use crate::answer::Outcome;
use crate::gate::Gate;
use crate::priority::{Priorities, Priority, priority_of};
use crate::slot::Decision;
use crate::source::{Source, Sources};

/// Configures one cloud.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Cloud {
    /// The cloud's rank, from 1 to 65535. No two clouds of an operator have the same priority.
    pub priority: Priority,
    /// The number of queued requests, at least 1, at which the gate shuts.
    pub limit: u64,
    /// The number of queued requests, less than `limit`, at or below which a shut gate opens.
    pub resume: u64,
}

impl Cloud {
    /// Creates a cloud whose gate resumes at `limit − 1`.
    #[must_use]
    pub const fn new(priority: Priority, limit: u64) -> Self {
        Self { priority, limit, resume: limit.saturating_sub(1) }
    }
}

/// The reason why a configuration was refused.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ConfigError {
    /// The window is 0 or exceeds the machine's capacity.
    Window {
        /// The window that was given.
        window: usize,
        /// The machine's capacity, which is its type parameter.
        capacity: usize,
    },
    /// The number of clouds exceeds the machine's capacity.
    TooManyClouds {
        /// The number of clouds that were given.
        clouds: usize,
        /// The machine's capacity, which is its type parameter.
        capacity: usize,
    },
    /// A cloud has priority 0, which belongs to local.
    LocalPriority,
    /// Two clouds have this priority (A10).
    DuplicatePriority(Priority),
    /// This cloud's gate has the limit 0 or does not resume below its limit (F2g).
    Gate(Priority),
}

impl core::fmt::Display for ConfigError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Window { window, capacity } => {
                write!(f, "a window of {window}; it must be from 1 to {capacity}")
            }
            Self::TooManyClouds { clouds, capacity } => {
                write!(f, "{clouds} clouds; there can be at most {capacity}")
            }
            Self::LocalPriority => f.write_str("a cloud with priority 0; that is local's"),
            Self::DuplicatePriority(p) => write!(f, "two clouds with priority {}", p.as_u16()),
            Self::Gate(p) => {
                write!(f, "cloud {}: its gate must resume below its limit", p.as_u16())
            }
        }
    }
}

impl core::error::Error for ConfigError {}

impl ConfigError {
    /// Returns `window` if it is from 1 to `WINDOW`, the capacity of a machine (1 to 1024).
    ///
    /// # Errors
    /// Returns [`ConfigError::Window`] if it is not.
    pub const fn check_window<const WINDOW: usize>(window: usize) -> Result<usize, Self> {
        const { assert!(WINDOW >= 1 && WINDOW <= 1024, "a window holds 1 to 1024 timestamps") }
        if window == 0 || window > WINDOW {
            return Err(Self::Window { window, capacity: WINDOW });
        }
        Ok(window)
    }
}

/// Keeps up to `CLOUDS` (0 to 15) registered clouds and their gates, and numbers the clouds as
/// sources.
///
/// [`Fusion`](crate::Fusion) keeps one. Use it directly only to build a machine that stores open
/// timestamps in another way.
///
/// - constructor: [`new`](Self::new)
/// - names: [`source`](Self::source), [`priority`](Self::priority),
///   [`priorities`](Self::priorities)
/// - gates: [`gate`](Self::gate), [`gate_mut`](Self::gate_mut)
/// - conversion of decisions: [`outcome`](Self::outcome)
// The arrays are in ascending priority, and index `i` is source `i + 1`. Entries from `len` on are
// unused.
#[derive(Clone, Copy)]
pub struct Clouds<const CLOUDS: usize> {
    pub(crate) priorities: [Priority; CLOUDS],
    pub(crate) gates: [Gate; CLOUDS],
    pub(crate) len: usize,
}

/// Fills the unused entries.
const NO_GATE: Gate = match Gate::new(1, 0) {
    Some(gate) => gate,
    None => unreachable!(),
};

impl<const CLOUDS: usize> Clouds<CLOUDS> {
    /// Registers these clouds with open gates. Their order does not matter (P10).
    ///
    /// # Errors
    /// Returns the first [`ConfigError`] that holds.
    pub fn new(clouds: &[Cloud]) -> Result<Self, ConfigError> {
        const { assert!(CLOUDS < Source::COUNT as usize, "a machine has at most 15 clouds") }
        let mut registered =
            Self { priorities: [Priority::LOCAL; CLOUDS], gates: [NO_GATE; CLOUDS], len: 0 };
        if clouds.len() > CLOUDS {
            return Err(ConfigError::TooManyClouds { clouds: clouds.len(), capacity: CLOUDS });
        }
        for cloud in clouds {
            registered.insert(*cloud)?;
        }
        Ok(registered)
    }

    /// Inserts a cloud so that the arrays stay in ascending order of priority.
    fn insert(&mut self, cloud: Cloud) -> Result<(), ConfigError> {
        if cloud.priority == Priority::LOCAL {
            return Err(ConfigError::LocalPriority);
        }
        // Equal priorities are refused because neither result would be the better one (A10).
        if self.source(cloud.priority).is_some() {
            return Err(ConfigError::DuplicatePriority(cloud.priority));
        }
        let Some(gate) = Gate::new(cloud.limit, cloud.resume) else {
            return Err(ConfigError::Gate(cloud.priority));
        };
        let mut next = (cloud.priority, gate);
        for (i, (priority, gate)) in self.priorities.iter_mut().zip(&mut self.gates).enumerate() {
            let stored = (priority, gate);
            if i == self.len {
                (*stored.0, *stored.1) = next;
                break;
            }
            if *stored.0 > next.0 {
                core::mem::swap(stored.0, &mut next.0);
                core::mem::swap(stored.1, &mut next.1);
            }
        }
        self.len = self.len.saturating_add(1);
        Ok(())
    }

    /// Returns the source with this priority, or `None` if no cloud is registered with it. Priority
    /// 0 is local.
    #[must_use]
    pub fn source(&self, priority: Priority) -> Option<Source> {
        if priority == Priority::LOCAL {
            return Some(Source::LOCAL);
        }
        let mut source = 1;
        for (i, registered) in self.priorities.iter().enumerate() {
            if i < self.len && *registered == priority {
                return Source::new(source);
            }
            source = u8::wrapping_add(source, 1);
        }
        None
    }

    /// Returns the priority of `source`, or 0 if the source is not registered.
    #[must_use]
    pub fn priority(&self, source: Source) -> Priority {
        priority_of(&self.priorities, source)
    }

    /// Returns the priorities of `members`.
    #[must_use]
    pub const fn priorities(&self, members: Sources) -> Priorities<CLOUDS> {
        Priorities::new(self.priorities, members)
    }

    /// Converts a decision about sources into an outcome with their priorities.
    #[inline]
    pub fn outcome(&self, decision: Decision) -> Outcome<CLOUDS> {
        match decision {
            Decision::Dropped(reason) => Outcome::Dropped(reason),
            Decision::Held => Outcome::Held,
            Decision::Waiting => Outcome::Waiting,
            Decision::Missed => Outcome::Missed,
            Decision::Preliminary { by, cancelled } => Outcome::Preliminary {
                by: priority_of(&self.priorities, by),
                cancelled: Priorities::new(self.priorities, cancelled),
            },
            Decision::Final { by } => Outcome::Final { by: priority_of(&self.priorities, by) },
            Decision::Forwarded { by, cancelled } => Outcome::Forwarded {
                by: priority_of(&self.priorities, by),
                cancelled: Priorities::new(self.priorities, cancelled),
            },
        }
    }

    /// Returns the sources of all registered clouds.
    pub(crate) fn all(&self) -> Sources {
        (1..=Source::COUNT)
            .filter(|i| usize::from(*i) <= self.len)
            .filter_map(Source::new)
            .collect()
    }

    /// Returns a cloud's gate, or `None` for local and for a source that is not registered.
    #[must_use]
    pub fn gate(&self, source: Source) -> Option<&Gate> {
        self.gates.get(..self.len)?.get(usize::from(source.index()).checked_sub(1)?)
    }

    /// Returns a cloud's gate for an offer to change, or `None` for local and for a source that is
    /// not registered.
    pub fn gate_mut(&mut self, source: Source) -> Option<&mut Gate> {
        self.gates.get_mut(..self.len)?.get_mut(usize::from(source.index()).checked_sub(1)?)
    }
}

impl<const CLOUDS: usize> core::fmt::Debug for Clouds<CLOUDS> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_map().entries(self.entries()).finish()
    }
}

impl<const CLOUDS: usize> PartialEq for Clouds<CLOUDS> {
    fn eq(&self, other: &Self) -> bool {
        self.entries().eq(other.entries())
    }
}

impl<const CLOUDS: usize> Eq for Clouds<CLOUDS> {}

impl<const CLOUDS: usize> core::hash::Hash for Clouds<CLOUDS> {
    fn hash<H: core::hash::Hasher>(&self, state: &mut H) {
        self.len.hash(state);
        for entry in self.entries() {
            entry.hash(state);
        }
    }
}

impl<const CLOUDS: usize> Clouds<CLOUDS> {
    pub(crate) fn entries(&self) -> impl Iterator<Item = (Priority, Gate)> {
        self.priorities.iter().copied().zip(self.gates.iter().copied()).take(self.len)
    }
}
