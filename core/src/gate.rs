//! The gate: admission of one cloud's requests by the length of its outgoing queue (F2g).

/// One cloud's gate: shuts at `limit` queued requests, opens again at `resume` or fewer.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Gate {
    pub(crate) limit: u64,
    pub(crate) resume: u64,
    pub(crate) shut: bool,
}

impl Gate {
    /// An open gate; none unless `resume < limit`.
    #[must_use]
    pub const fn new(limit: u64, resume: u64) -> Option<Self> {
        if resume < limit { Some(Self { limit, resume, shut: false }) } else { None }
    }

    /// F2g: opens or shuts the gate by `backlog`, the queue's length without the message that is offered; true if it is open now.
    pub const fn admits(&mut self, backlog: u64) -> bool {
        if self.shut {
            self.shut = backlog > self.resume;
        } else {
            self.shut = backlog >= self.limit;
        }
        !self.shut
    }

    /// Whether the gate is shut.
    #[must_use]
    pub const fn is_shut(&self) -> bool {
        self.shut
    }
}
