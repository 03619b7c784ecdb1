//! Draws disruptions from a seed: the kind, the cloud, the duration, and the calm afterwards.

use std::fmt;
use std::time::Duration;

use fuseline_testkit::Rng;

/// A kind of disruption.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Disruption {
    /// Kills the cloud with `kill -9`, and starts it again at the end.
    Kill,
    /// Stops the cloud with SIGSTOP, and continues it with SIGCONT at the end.
    Stop,
    /// Answers each packet to and from the cloud with a reset.
    Reset,
    /// Drops packets to and from the cloud without an answer, for longer than pings wait.
    BlackHole,
    /// Resets the cloud, and its name cannot be resolved.
    Dns,
    /// Restarts the cloud with an expired certificate, and at the end with a good one.
    Expired,
    /// Delays results by 150 ms, which is longer than their deadline.
    Latency,
    /// Delays results by 40 ms, which is shorter than their deadline.
    Step,
    /// Drops one packet in five in both directions.
    Loss,
    /// Limits all clouds together to 1 Mbit/s.
    Slow,
    /// Sets the wall clock back by an hour.
    ClockBack,
    /// Sets the wall clock ahead by an hour.
    ClockAhead,
}

impl Disruption {
    pub(crate) const ALL: [Self; 12] = [
        Self::Kill,
        Self::Stop,
        Self::Reset,
        Self::BlackHole,
        Self::Dns,
        Self::Expired,
        Self::Latency,
        Self::Step,
        Self::Loss,
        Self::Slow,
        Self::ClockBack,
        Self::ClockAhead,
    ];

    /// Returns `true` if no result of the cloud can come in time during the disruption.
    pub(crate) const fn silences(self) -> bool {
        matches!(
            self,
            Self::Kill
                | Self::Stop
                | Self::Reset
                | Self::BlackHole
                | Self::Dns
                | Self::Expired
                | Self::Latency
        )
    }

    /// Returns `true` if at least some calls fail with an error instead of only waiting.
    pub(crate) const fn is_reported(self) -> bool {
        matches!(self, Self::Kill | Self::Reset | Self::BlackHole | Self::Dns | Self::Expired)
    }

    /// Returns `true` if at least some calls have no result.
    pub(crate) const fn breaks_calls(self) -> bool {
        self.silences() || matches!(self, Self::Loss | Self::Slow)
    }

    /// Returns `true` if it affects all clouds in the same way.
    pub(crate) const fn is_of_all(self) -> bool {
        matches!(self, Self::Slow | Self::ClockBack | Self::ClockAhead)
    }

    /// Returns its name, which the record uses too.
    pub(crate) const fn as_str(self) -> &'static str {
        match self {
            Self::Kill => "kill",
            Self::Stop => "stop",
            Self::Reset => "reset",
            Self::BlackHole => "black-hole",
            Self::Dns => "dns",
            Self::Expired => "expired",
            Self::Latency => "latency",
            Self::Step => "step",
            Self::Loss => "loss",
            Self::Slow => "slow",
            Self::ClockBack => "clock-back",
            Self::ClockAhead => "clock-ahead",
        }
    }
}

/// A disruption of one cloud for some time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ScheduledDisruption {
    pub(crate) harm: Disruption,
    pub(crate) cloud: usize,
    pub(crate) lasts: Duration,
    /// The length of the calm period afterwards.
    pub(crate) calm: Duration,
}

impl fmt::Display for ScheduledDisruption {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ", self.harm.as_str())?;
        if !self.harm.is_of_all() {
            write!(f, "of cloud-{} ", self.cloud)?;
        }
        write!(f, "for {:.1} s", self.lasts.as_secs_f64())
    }
}

/// Returns disruptions without end, one after the other. Each round has every kind once.
pub(crate) fn schedule(seed: u64, clouds: usize) -> impl Iterator<Item = ScheduledDisruption> {
    let mut rng = Rng::with_seed(seed);
    let mut round = Vec::new();
    std::iter::from_fn(move || {
        if round.is_empty() {
            round = Disruption::ALL.to_vec();
            rng.shuffle(&mut round);
        }
        let harm = round.pop()?;
        // Silence for 5 s and 2 s for the answer to a ping detect a dead connection. This lasts
        // longer than both together.
        let ms = if harm == Disruption::BlackHole { 8_000..10_000 } else { 1_000..3_000 };
        let lasts = Duration::from_millis(rng.u64(ms));
        let calm = Duration::from_millis(rng.u64(300..1_500));
        Some(ScheduledDisruption { harm, cloud: rng.usize(0..clouds), lasts, calm })
    })
}
