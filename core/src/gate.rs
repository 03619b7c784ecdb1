//! The gate, which admits one cloud's requests by the length of its outgoing queue (F2g).

/// Admits one cloud's requests. The gate shuts at `limit` queued requests, and opens again at
/// `resume` or fewer.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Gate {
    pub(crate) limit: u64,
    pub(crate) resume: u64,
    pub(crate) shut: bool,
}

impl Gate {
    /// Creates an open gate. Returns `None` if `resume` is not less than `limit`.
    #[must_use]
    pub const fn new(limit: u64, resume: u64) -> Option<Self> {
        if resume < limit { Some(Self { limit, resume, shut: false }) } else { None }
    }

    /// Opens or shuts the gate and returns `true` if it is open afterwards (F2g).
    ///
    /// `backlog` is the length of the queue without the message that is offered.
    pub const fn admits(&mut self, backlog: u64) -> bool {
        if self.shut {
            self.shut = backlog > self.resume;
        } else {
            self.shut = backlog >= self.limit;
        }
        !self.shut
    }

    /// Returns `true` if the gate is shut.
    #[must_use]
    pub const fn is_shut(&self) -> bool {
        self.shut
    }
}
