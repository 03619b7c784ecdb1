//! What breaks, when and for how long: drawn from a seed.

use std::fmt;
use std::time::Duration;

use fuseline_testkit::Rng;

/// One way to break.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Disruption {
    /// `kill -9` of the cloud, started again at the end.
    Kill,
    /// SIGSTOP of the cloud, SIGCONT at the end.
    Stop,
    /// Each packet to and from the cloud is answered with a reset.
    Reset,
    /// Packets to and from the cloud are dropped without an answer, longer than pings wait.
    BlackHole,
    /// The cloud is reset, and its name cannot be resolved.
    Dns,
    /// The cloud comes back with a certificate that has expired, and at the end with a good one.
    Expired,
    /// Replies take 150 ms more, which is longer than their deadline.
    Latency,
    /// Replies take 40 ms more, which is shorter.
    Step,
    /// One packet in five is dropped, both ways.
    Loss,
    /// 1 Mbit/s for all clouds together.
    Slow,
    /// The wall clock is an hour back.
    ClockBack,
    /// The wall clock is an hour ahead.
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

    /// Whether no answer of the cloud can come in time meanwhile.
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

    /// Whether some calls at least fail with an error, and do not only wait.
    pub(crate) const fn is_reported(self) -> bool {
        matches!(self, Self::Kill | Self::Reset | Self::BlackHole | Self::Dns | Self::Expired)
    }

    /// Whether calls come to nothing, be it some of them.
    pub(crate) const fn breaks_calls(self) -> bool {
        self.silences() || matches!(self, Self::Loss | Self::Slow)
    }

    /// Whether it comes to all clouds alike.
    pub(crate) const fn is_of_all(self) -> bool {
        matches!(self, Self::Slow | Self::ClockBack | Self::ClockAhead)
    }

    /// Its word, here and in the record.
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

/// One disruption of one cloud for a while.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ScheduledDisruption {
    pub(crate) harm: Disruption,
    pub(crate) cloud: usize,
    pub(crate) lasts: Duration,
    /// How long it is calm afterwards.
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

/// One disruption after the other without an end; each round has every kind once.
pub(crate) fn schedule(seed: u64, clouds: usize) -> impl Iterator<Item = ScheduledDisruption> {
    let mut rng = Rng::with_seed(seed);
    let mut round = Vec::new();
    std::iter::from_fn(move || {
        if round.is_empty() {
            round = Disruption::ALL.to_vec();
            rng.shuffle(&mut round);
        }
        let harm = round.pop()?;
        // Silence for 5 s and 2 s for the answer to a ping: longer than both together.
        let ms = if harm == Disruption::BlackHole { 8_000..10_000 } else { 1_000..3_000 };
        let lasts = Duration::from_millis(rng.u64(ms));
        let calm = Duration::from_millis(rng.u64(300..1_500));
        Some(ScheduledDisruption { harm, cloud: rng.usize(0..clouds), lasts, calm })
    })
}
