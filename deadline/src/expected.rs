//! [`Expected`], the deadline of least mean loss, and the functions that compute it.
//!
//! The book's chapter *Deadlines that are safe* derives the mean loss, and where it is least (T3).
//! It also explains the effect of the window and the probes (T6).

use core::time::Duration;

use crate::figure::Figure;
use crate::invalid::Invalid;
use crate::loss::{Loss, Source};
use crate::observations::Observations;
use crate::policy::{Chosen, End, Policy, Reason, Situation};
use crate::span::Span;
use crate::survival::{Observation, Step, Survival};

/// Chooses the deadline of least mean loss, from how the last `WINDOW` calls of the cloud ended.
///
/// This policy knows nothing of safety: let a [`Guard`](crate::Guard) [cap](Policy::cap) it. If the
/// cloud is gone, waiting gains nothing. The deadline then becomes local's response, because
/// waiting that long costs no time.
///
/// A call that is given up at a short deadline cannot show that its result would have come soon
/// after. So one message in `probe_every` waits as long as the cap allows. Once `WINDOW` calls have
/// ended after the cloud went or returned, the policy knows only the new state. At least one of
/// these calls was a probe.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Expected<L, const WINDOW: usize = 64> {
    loss: L,
    local_response: (Duration, Duration),
    probe_every: Option<u32>,
    observations: Observations<WINDOW>,
    /// The number of messages since the last probe.
    since: u32,
}

/// A deadline and its mean loss.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Choice {
    /// The deadline, counted from the capture of the message.
    pub deadline: Duration,
    /// The mean loss of a message.
    pub loss: f64,
}

impl<L: Loss, const WINDOW: usize> Expected<L, WINDOW> {
    /// Creates a policy that has seen no call yet. `local_response` is the time that local takes.
    ///
    /// One message in `probe_every` is a probe, beginning with the first. Pass `None` if calls run
    /// on past their due instants and the driver reports their true ends: then probes are not
    /// needed. With neither, the policy never waits again for a cloud that was slow or gone for a
    /// while, and [adapters refuse it](Policy::needs_linger).
    ///
    /// # Errors
    /// Returns an [`Invalid`] if local's response or a figure of the loss is not plausible, or if
    /// `probe_every` is 0 or greater than `WINDOW`.
    pub fn new(
        loss: L,
        local_response: impl Into<Span<Duration>>,
        probe_every: Option<u32>,
    ) -> Result<Self, Invalid> {
        let local_response = local_response.into();
        Figure::LocalResponse.check(local_response)?;
        loss.check()?;
        if let Some(every) = probe_every
            && (every == 0 || every as usize > WINDOW)
        {
            return Err(Invalid::Probes { every, window: WINDOW });
        }
        let Span { least, greatest } = local_response;
        Ok(Self {
            loss,
            local_response: (least, greatest),
            probe_every,
            observations: Observations::new(),
            since: u32::MAX,
        })
    }

    /// Returns the expected gain of a request under `cap`: local's loss minus the least mean loss,
    /// in the loss's unit.
    ///
    /// The gain is 0 if the cloud is gone or unknown. A [`SendBudget`](crate::SendBudget) compares
    /// such gains.
    #[must_use]
    pub fn gain(&self, situation: &Situation<'_>, cap: Duration) -> f64 {
        let local = self.loss.loss(situation, Source::Local, self.local_response.1);
        local - self.least(situation, cap).loss
    }

    /// Returns the calls that are remembered.
    #[must_use]
    pub const fn observations(&self) -> &Observations<WINDOW> {
        &self.observations
    }

    /// Returns the loss.
    #[must_use]
    pub const fn loss(&self) -> &L {
        &self.loss
    }

    /// Returns the loss, so that a loss that learns can be updated.
    pub const fn loss_mut(&mut self) -> &mut L {
        &mut self.loss
    }

    fn least(&self, situation: &Situation<'_>, cap: Duration) -> Choice {
        let steps = Survival::new(self.observations.sorted(), situation.under_way);
        least_loss(steps, self.local_response, cap, |source, response| {
            self.loss.loss(situation, source, response)
        })
    }
}

impl<L: Loss, const WINDOW: usize> Policy for Expected<L, WINDOW> {
    fn decide(&mut self, situation: &Situation<'_>, cap: Duration) -> Chosen {
        self.since = self.since.saturating_add(1);
        if self.probe_every.is_some_and(|every| self.since >= every) {
            // Only a long wait can show that the cloud returns results again (T6).
            self.since = 0;
            return Chosen { deadline: cap, reason: Reason::Probe };
        }
        let Choice { deadline, loss } = self.least(situation, cap);
        Chosen::within(cap, deadline, Reason::Expected { loss })
    }

    fn ended(&mut self, end: End) {
        self.observations.add(end);
    }

    fn needs_linger(&self) -> bool {
        self.probe_every.is_none()
    }
}

/// Returns the deadline of least mean loss between local's least response and `cap`. If several
/// deadlines have that loss, returns the shortest (T3).
///
/// `local_response` has local's least and greatest response. If the cloud's result comes before the
/// deadline, it is the output. Otherwise local's result is the output, at the deadline or at
/// local's greatest response, whichever is later. The search looks only at local's least response
/// and just after each step, because between two steps a longer deadline gains nothing.
pub fn least_loss<'a, I: Iterator<Item = Observation> + 'a>(
    steps: Survival<'a, I>,
    local_response: (Duration, Duration),
    cap: Duration,
    loss: impl Fn(Source, Duration) -> f64,
) -> Choice {
    let (shortest, local_response) = local_response;
    let mut means = LossSteps { in_time: 0.0, survival: 1.0, local_response, loss };
    let mut steps = steps.peekable();
    let shortest = shortest.min(cap);
    while let Some(step) = steps.next_if(|step| step.response < shortest) {
        means.take(step);
    }
    let mut best = means.choice(shortest);
    for step in steps {
        let deadline = step.response.saturating_add(Duration::from_nanos(1));
        if deadline > cap {
            break;
        }
        means.take(step);
        let choice = means.choice(deadline);
        if choice.loss < best.loss {
            best = choice;
        }
    }
    best
}

/// Returns the mean loss under `deadline`. `local_response` is local's greatest.
pub fn mean_loss<'a, I: Iterator<Item = Observation> + 'a>(
    steps: Survival<'a, I>,
    local_response: Duration,
    deadline: Duration,
    loss: impl Fn(Source, Duration) -> f64,
) -> f64 {
    let mut means = LossSteps { in_time: 0.0, survival: 1.0, local_response, loss };
    steps.take_while(|step| step.response < deadline).for_each(|step| means.take(step));
    means.choice(deadline).loss
}

/// Sums up the mean loss, step by step.
struct LossSteps<F> {
    /// The loss of the results in time, weighted by their share.
    in_time: f64,
    /// The share of results that are late.
    survival: f64,
    local_response: Duration,
    loss: F,
}

impl<F: Fn(Source, Duration) -> f64> LossSteps<F> {
    /// Counts the results of this step as in time.
    fn take(&mut self, step: Step) {
        self.in_time += step.mass * (self.loss)(Source::Cloud, step.response);
        self.survival = step.survival;
    }

    /// Counts all results of later steps as late.
    fn choice(&self, deadline: Duration) -> Choice {
        let late = (self.loss)(Source::Local, deadline.max(self.local_response));
        Choice { deadline, loss: self.in_time + self.survival * late }
    }
}
