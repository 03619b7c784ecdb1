//! [`Policy`]: chooses a deadline for each message, from the [`Situation`] and from how earlier calls ended.
//!
//! This module has [`Constant`] and [`Capped`]; [`Guard`](crate::Guard) and
//! [`Expected`](crate::Expected) have modules of their own.

use core::time::Duration;

use crate::figure::Figure;
use crate::invalid::Invalid;
use crate::span::Span;
use crate::units::{Metres, MetresPerSecond};

/// Chooses the deadlines of one cloud's requests.
///
/// Keep one policy for each cloud. Call [`decide`](Self::decide) once for each message before its
/// request is sent, pass the deadline to the machine, and report how each call ended. A policy
/// needs no clock, allocates nothing and never fails.
pub trait Policy {
    /// Returns the deadline of the next request, counted from the capture of its message. It is at
    /// most `cap`.
    fn decide(&mut self, situation: &Situation<'_>, cap: Duration) -> Chosen;

    /// Reports that a call has ended.
    fn ended(&mut self, end: End);

    /// Returns `true` if the policy's promise, such as T1 or T2, requires one output for each
    /// message. Adapters then refuse the policy under the progressive commit rule.
    fn assumes_one_output(&self) -> bool {
        false
    }

    /// Returns `true` if the policy learns of longer deadlines only from calls that run on past
    /// their due instants. Adapters then refuse it for a cloud whose calls do not linger.
    fn needs_linger(&self) -> bool {
        false
    }

    /// Makes this policy's deadline the cap of `policy`.
    ///
    /// The other policy is given the cap and chooses the best deadline up to it. That deadline may
    /// lie far below the cap, although the best deadline of all lies above it.
    fn cap<P: Policy>(self, policy: P) -> Capped<Self, P>
    where
        Self: Sized,
    {
        Capped { cap: self, policy }
    }
}

/// Describes the vehicle's situation at the time of a decision.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Situation<'a> {
    /// The vehicle's speed, from this message's capture until it could brake for it.
    ///
    /// If an end of the span is not a speed from 0 to 150 m/s, the situation counts as unknown, and
    /// a guard takes no risk.
    pub speed: Span<MetresPerSecond>,
    /// The distance to the nearest place where something may come into sight or has just come, such
    /// as a corner or a parked van. `None` if it is unknown. A place counts until
    /// [`frames`](crate::Parameters::frames) frames after whatever is behind it is in sight.
    pub reveal: Option<Metres>,
    /// The age of each call under way, the oldest first. The list may be empty; policies then
    /// notice an outage later.
    pub under_way: &'a [Duration],
}

/// The end of a call, with its age: the time since the capture of its message.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum End {
    /// Its result came at this age, in time or late.
    Answered(Duration),
    /// It failed at this age: no result will come.
    Failed(Duration),
    /// It was given up at this age, because its timer fired or its timestamp was retired. Its
    /// result had not come by then.
    Censored(Duration),
}

/// A deadline and the reason for it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Chosen {
    /// The deadline, counted from the capture of the message.
    pub deadline: Duration,
    /// The reason for it.
    pub reason: Reason,
}

/// The reason for a deadline.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Reason {
    /// The deadline is constant.
    Constant,
    /// The guard allows no longer deadline.
    Guard(Case),
    /// This deadline has the least mean loss, by what was observed.
    Expected {
        /// The mean loss of a message.
        loss: f64,
    },
    /// This message waits as long as allowed, to observe how late results are.
    Probe,
    /// The cap is shorter than the deadline that the policy would choose.
    Cap,
}

/// The case of the guard that holds.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Case {
    /// Case 1: local alone surely stops, with time to spare.
    LocalStops,
    /// Case 2: local alone surely does not stop, and the cloud still might.
    CloudAlone,
    /// Case 3: neither is sure, so no output may be later than local alone.
    Unsure,
}

/// Chooses the same deadline for every message. It knows nothing of safety.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Constant(pub Duration);

/// A policy under the cap of another policy. [`Policy::cap`] makes it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Capped<C, P> {
    cap: C,
    policy: P,
}

impl Situation<'_> {
    /// The situation when nothing is known. A guard then takes no risk.
    pub const UNKNOWN: Self =
        Self { speed: Span::exactly(MetresPerSecond(f64::NAN)), reveal: None, under_way: &[] };

    /// Returns the situation of a vehicle at `speed` when nothing else is known.
    #[must_use]
    pub fn at(speed: impl Into<Span<MetresPerSecond>>) -> Self {
        Self { speed: speed.into(), ..Self::UNKNOWN }
    }

    /// Checks whether the situation makes sense. If it does not, policies do not fail: a guard, and
    /// losses that need the speed, then give local's least response.
    ///
    /// # Errors
    /// Returns an [`Invalid`] for the first figure that is not plausible.
    pub fn check(&self) -> Result<(), Invalid> {
        Figure::Speed.check(self.speed)?;
        self.reveal.map_or(Ok(()), |reveal| Figure::Reveal.check(Span::exactly(reveal)))
    }
}

impl Chosen {
    /// Returns the deadline, or the cap if the cap is shorter.
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
    /// Returns the number of the case, 1 to 3.
    #[must_use]
    pub const fn number(self) -> u8 {
        match self {
            Self::LocalStops => 1,
            Self::CloudAlone => 2,
            Self::Unsure => 3,
        }
    }
}

/// Converts seconds to a duration, rounded down to nanoseconds. Returns 0 if the number is not a
/// time, and the longest duration if it is too great.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the cast rounds down and stays within the range, which is what is wanted"
)]
pub(crate) const fn rounded_down(seconds: f64) -> Duration {
    Duration::from_nanos((seconds * 1e9) as u64)
}
