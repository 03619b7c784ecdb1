//! [`Expected`], the deadline of least mean loss, and the functions that compute it.
//!
//! The book's chapter *Deadlines that are safe* derives the mean loss and where it is least (T3), and what the window and
//! the probes give (T6).

use core::time::Duration;

use crate::figure::Figure;
use crate::invalid::Invalid;
use crate::loss::{Loss, Source};
use crate::observations::Observations;
use crate::policy::{Chosen, End, Policy, Reason, Situation};
use crate::span::Span;
use crate::survival::{Observation, Step, Survival};

/// The deadline of least mean loss, by how the last `WINDOW` calls of the cloud ended.
///
/// It knows nothing of safety: let a [`Guard`](crate::Guard) [cap](Policy::caps) it. A cloud that is gone leaves nothing
/// to wait for, so the deadline becomes local's response, before which waiting costs no time.
///
/// A call that is given up at a short deadline cannot show that its result would have come soon after. So one message in
/// `probe_every` waits as long as the cap allows. `WINDOW` ends of calls after a cloud went or came back, the policy
/// knows only what came after that, at least one probe included.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Expected<L, const WINDOW: usize = 64> {
    loss: L,
    local_response: (Duration, Duration),
    probe_every: Option<u32>,
    observations: Observations<WINDOW>,
    /// Messages since the last probe.
    since: u32,
}

/// A deadline and what it costs.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Choice {
    /// The deadline.
    pub deadline: Duration,
    /// The mean loss of a message.
    pub loss: f64,
}

impl<L: Loss, const WINDOW: usize> Expected<L, WINDOW> {
    /// A policy that has seen no call yet; `local_response` is how long local takes.
    ///
    /// One message in `probe_every` is a probe, beginning with the first. Give none if the driver lets calls run on
    /// past their due instants and reports their true ends: then there is nothing to probe. Without either, a cloud that was
    /// slow or gone for a while is never waited for again; [adapters refuse that](Policy::needs_linger).
    ///
    /// # Errors
    /// If local's response or a figure of the loss is not plausible, or `probe_every` is 0 or greater than `WINDOW`.
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

    /// What a request under `cap` is expected to gain over none, in the loss's unit: local's loss less the least mean loss.
    ///
    /// 0 for a cloud that is gone, or of which nothing is known. A [`SendBudget`](crate::SendBudget) weighs it.
    #[must_use]
    pub fn gain(&self, situation: &Situation<'_>, cap: Duration) -> f64 {
        let local = self.loss.loss(situation, Source::Local, self.local_response.1);
        local - self.least(situation, cap).loss
    }

    /// What is known of the cloud.
    #[must_use]
    pub const fn observations(&self) -> &Observations<WINDOW> {
        &self.observations
    }

    /// What is lost.
    #[must_use]
    pub const fn loss(&self) -> &L {
        &self.loss
    }

    /// The same, for a loss that learns.
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
            // T6: only a long wait can show that the cloud would answer again.
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

/// T3: the deadline of least mean loss, from local's least response to `cap`; of several the shortest.
///
/// `local_response` is the least and the greatest. A message answered before the deadline has the cloud's result, any other
/// has local's: at the deadline, or at local's greatest response if that is later. Only local's least response and each
/// step need a look, once: between two steps a longer deadline gains nothing.
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

/// The mean loss under `deadline`; `local_response` is local's greatest.
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

/// The mean loss, step by step.
struct LossSteps<F> {
    /// The loss of results in time, times their share.
    in_time: f64,
    /// The share that is late.
    survival: f64,
    local_response: Duration,
    loss: F,
}

impl<F: Fn(Source, Duration) -> f64> LossSteps<F> {
    /// These results are in time.
    fn take(&mut self, step: Step) {
        self.in_time += step.mass * (self.loss)(Source::Cloud, step.response);
        self.survival = step.survival;
    }

    /// Everything later is late.
    fn choice(&self, deadline: Duration) -> Choice {
        let late = (self.loss)(Source::Local, deadline.max(self.local_response));
        Choice { deadline, loss: self.in_time + self.survival * late }
    }
}
