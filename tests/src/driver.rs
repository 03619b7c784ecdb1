//! The core with a clock that stands still until a test moves it.

use fuseline_core::{
    Admission, At, Cloud, Commit, Deadline, Firing, Fusion, Instant, Opening, Outcome, Priority,
    Ready, Timestamp,
};

/// The core's machine for up to 15 clouds and 1024 timestamps, with a manual clock at 0.
///
/// Numbers are nanoseconds, and timestamps and priorities as in a trace.
pub struct CoreDriver {
    fusion: Box<Fusion<15, 1024>>,
    now: u64,
}

/// A firing of a machine of this size.
pub type Fired = Firing<15>;

impl CoreDriver {
    /// Creates a machine whose clouds have these priorities and wide open gates.
    ///
    /// # Panics
    /// Panics if the configuration is refused.
    #[must_use]
    pub fn new(window: usize, commit: Commit, clouds: &[u16]) -> Self {
        let clouds: Vec<Cloud> =
            clouds.iter().map(|p| Cloud::new(Priority::new(*p), u64::MAX)).collect();
        Self::with(window, commit, &clouds)
    }

    /// Creates a machine with these clouds.
    ///
    /// # Panics
    /// Panics if the configuration is refused.
    #[must_use]
    pub fn with(window: usize, commit: Commit, clouds: &[Cloud]) -> Self {
        let fusion = Fusion::new(window, commit, clouds).expect("a sound configuration");
        Self { fusion: Box::new(fusion), now: 0 }
    }

    /// Moves the clock to `now`. Returns the firings on the way.
    pub fn tick(&mut self, now: u64) -> Vec<Fired> {
        self.now = now;
        let mut firings = Vec::new();
        while let At::Fired(firing) = self.fusion.at(Instant::from_nanos(now)) {
            firings.push(firing);
        }
        firings
    }

    /// Opens `t` now (F1).
    pub fn open(&mut self, t: u64, deadline: Option<u64>) -> Opening {
        self.ready().open(Timestamp::new(t), deadline.map(Deadline::from_nanos))
    }

    /// Offers `(t, p)` now with an empty queue (F2).
    pub fn offer(&mut self, t: u64, p: u16, deadline: u64) -> Admission {
        self.queue(t, p, deadline, 0)
    }

    /// Offers `(t, p)` now with `backlog` requests queued (F2, F2g).
    pub fn queue(&mut self, t: u64, p: u16, deadline: u64, backlog: u64) -> Admission {
        let deadline = Deadline::from_nanos(deadline);
        self.ready().offer(Timestamp::new(t), Priority::new(p), deadline, backlog)
    }

    /// Opens `t` now; it must be accepted.
    ///
    /// # Panics
    /// Panics if it is refused.
    pub fn opened(&mut self, t: u64, deadline: Option<u64>) {
        assert_eq!(self.open(t, deadline), Opening::Accepted, "open {t}");
    }

    /// Offers `(t, p)` now with an empty queue; it must be admitted.
    ///
    /// # Panics
    /// Panics if it is refused.
    pub fn requested(&mut self, t: u64, p: u16, deadline: u64) {
        let admission = self.offer(t, p, deadline);
        assert!(matches!(admission, Admission::Admitted { .. }), "({t}, {p}): {admission:?}");
    }

    /// Gives the result of `p` for `t` now (F3).
    pub fn result(&mut self, t: u64, p: u16) -> Outcome<15> {
        self.ready().result(Timestamp::new(t), Priority::new(p))
    }

    /// Reports that no result of `p` for `t` will come (F4).
    pub fn fail(&mut self, t: u64, p: u16) -> Outcome<15> {
        self.ready().fail(Timestamp::new(t), Priority::new(p))
    }

    /// Returns the machine, for queries.
    #[must_use]
    pub const fn fusion(&self) -> &Fusion<15, 1024> {
        &self.fusion
    }

    /// Returns the next due instant.
    #[must_use]
    pub fn next_due(&self) -> Option<u64> {
        self.fusion.next_due().map(Instant::as_nanos)
    }

    fn ready(&mut self) -> Ready<'_, 15, 1024> {
        match self.fusion.at(Instant::from_nanos(self.now)) {
            At::Ready(ready) => ready,
            At::Fired(firing) => panic!("{firing:?} although nothing moved the clock"),
        }
    }
}
