//! [`Policy`]: how a deadline is chosen for each message, from the [`Situation`] and from how earlier calls ended.
//!
//! [`Constant`] and [`Capped`] are here; [`Guard`](crate::Guard) and [`Expected`](crate::Expected) have modules of their own.

use core::time::Duration;

use crate::figure::Figure;
use crate::invalid::Invalid;
use crate::span::Span;
use crate::units::{Metres, MetresPerSecond};

/// Chooses the deadlines of one cloud's requests.
///
/// Keep one policy for each cloud. Call [`decide`](Self::decide) once for each message that is about to be sent, give the
/// deadline to the machine, and report how each call ended. It needs no clock, allocates nothing and never fails.
pub trait Policy {
    /// The deadline of the request that is about to be made, counted from the capture of its message, and at most `cap`.
    fn decide(&mut self, situation: &Situation<'_>, cap: Duration) -> Chosen;

    /// A call has ended.
    fn ended(&mut self, end: End);

    /// Whether its promise, as T1 and T2, is about one output a message: adapters refuse it under the progressive commit rule.
    fn assumes_one_output(&self) -> bool {
        false
    }

    /// Whether it learns of longer deadlines only from calls that run on past their due instants: adapters refuse it for a
    /// cloud whose calls do not linger.
    fn needs_linger(&self) -> bool {
        false
    }

    /// This policy's deadline as the cap of another's.
    ///
    /// The policy gets the cap rather than being cut off at it: the best deadline under a cap may be far below the best
    /// one without.
    fn caps<P: Policy>(self, policy: P) -> Capped<Self, P>
    where
        Self: Sized,
    {
        Capped { cap: self, policy }
    }
}

/// What a policy may know when it decides.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Situation<'a> {
    /// The vehicle's speed from this message's capture until it could brake for it.
    ///
    /// If the span is not a speed, for example not a number, below 0 or above 150 m/s, nothing is known and nothing is
    /// risked.
    pub speed: Span<MetresPerSecond>,
    /// The distance to the nearest place from which something may have come or may come into sight, if that is known:
    /// a corner, a parked van. A place counts until [`frames`](crate::Parameters::frames) frames after whatever is
    /// behind it is in sight.
    pub reveal: Option<Metres>,
    /// The age of each call under way, the oldest first. It may be left empty; policies then see an outage later.
    pub under_way: &'a [Duration],
}

/// How a call ended, and how long after the capture of its message.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum End {
    /// Its result came at this age, in time or late.
    Answered(Duration),
    /// It failed at this age: no result will come.
    Failed(Duration),
    /// It was given up at this age, by its timer or because its timestamp was retired: its result would have come later.
    Censored(Duration),
}

/// A deadline, and why it was chosen.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Chosen {
    /// The deadline.
    pub deadline: Duration,
    /// Why it was chosen.
    pub reason: Reason,
}

/// Why a deadline is in force.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Reason {
    /// It never changes.
    Constant,
    /// The guard allows no more.
    Guard(Case),
    /// It costs least, by what was observed.
    Expected {
        /// The mean loss of a message.
        loss: f64,
    },
    /// This message waits as long as allowed, to see what longer deadlines would bring.
    Probe,
    /// The cap is in force.
    Cap,
}

/// Which case of the guard holds.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Case {
    /// 1: local alone surely stops, with time to spare.
    LocalStops,
    /// 2: local alone surely does not stop, and the cloud still might.
    CloudAlone,
    /// 3: neither is sure; nothing may be later than local alone.
    Unsure,
}

/// The same deadline for every message. It knows nothing of safety.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Constant(pub Duration);

/// A policy under the cap of another; made by [`Policy::caps`].
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Capped<C, P> {
    cap: C,
    policy: P,
}

impl Situation<'_> {
    /// Nothing is known, and nothing is risked.
    pub const UNKNOWN: Self =
        Self { speed: Span::exactly(MetresPerSecond(f64::NAN)), reveal: None, under_way: &[] };

    /// A vehicle at `speed`, with nothing else known.
    #[must_use]
    pub fn at(speed: impl Into<Span<MetresPerSecond>>) -> Self {
        Self { speed: speed.into(), ..Self::UNKNOWN }
    }

    /// Whether something is known: policies do not fail for what is not, but wait no longer than local takes.
    ///
    /// # Errors
    /// The first figure that makes no sense.
    pub fn check(&self) -> Result<(), Invalid> {
        Figure::Speed.check(self.speed)?;
        self.reveal.map_or(Ok(()), |reveal| Figure::Reveal.check(Span::exactly(reveal)))
    }
}

impl Chosen {
    /// The deadline, or the cap if that is shorter.
    pub(crate) fn within(cap: Duration, deadline: Duration, reason: Reason) -> Self {
        if deadline <= cap {
            Self { deadline, reason }
        } else {
            Self { deadline: cap, reason: Reason::Cap }
        }
    }
}

impl Policy for Constant {
    fn decide(&mut self, _: &Situation<'_>, cap: Duration) -> Chosen {
        Chosen::within(cap, self.0, Reason::Constant)
    }

    fn ended(&mut self, _: End) {}
}

impl<C: Policy, P: Policy> Policy for Capped<C, P> {
    fn decide(&mut self, situation: &Situation<'_>, cap: Duration) -> Chosen {
        let cap = self.cap.decide(situation, cap);
        let decision = self.policy.decide(situation, cap.deadline);
        if decision.reason == Reason::Cap { cap } else { decision }
    }

    fn ended(&mut self, end: End) {
        self.cap.ended(end);
        self.policy.ended(end);
    }

    fn assumes_one_output(&self) -> bool {
        self.cap.assumes_one_output() || self.policy.assumes_one_output()
    }

    fn needs_linger(&self) -> bool {
        self.cap.needs_linger() || self.policy.needs_linger()
    }
}

impl<P: Policy + ?Sized> Policy for &mut P {
    fn decide(&mut self, situation: &Situation<'_>, cap: Duration) -> Chosen {
        (**self).decide(situation, cap)
    }

    fn ended(&mut self, end: End) {
        (**self).ended(end);
    }

    fn assumes_one_output(&self) -> bool {
        (**self).assumes_one_output()
    }

    fn needs_linger(&self) -> bool {
        (**self).needs_linger()
    }
}

impl Case {
    /// Its number: 1 to 3.
    #[must_use]
    pub const fn number(self) -> u8 {
        match self {
            Self::LocalStops => 1,
            Self::CloudAlone => 2,
            Self::Unsure => 3,
        }
    }
}

/// A number of seconds as a duration, rounded down to nanoseconds: 0 if it is not a time, the longest if it is too long.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the cast rounds down and stays within the range, which is what is wanted"
)]
pub(crate) const fn rounded_down(seconds: f64) -> Duration {
    Duration::from_nanos((seconds * 1e9) as u64)
}
