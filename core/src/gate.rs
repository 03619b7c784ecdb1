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
    /// An open gate, or none unless `resume < limit`.
    #[must_use]
    pub const fn new(limit: u64, resume: u64) -> Option<Self> {
        if resume < limit { Some(Self { limit, resume, shut: false }) } else { None }
    }

    /// F2g: moves the gate by the length of the queue, without the message asked for, and says whether it is now open.
    pub const fn admits(&mut self, backlog: u64) -> bool {
        if self.shut {
            self.shut = backlog > self.resume;
        } else {
            self.shut = backlog >= self.limit;
        }
        !self.shut
    }

    /// Whether the gate was left shut.
    #[must_use]
    pub const fn is_shut(&self) -> bool {
        self.shut
    }
}
