//! Chooses the deadlines of offers, with at most one policy for each cloud.
//!
//! Policies are the user's code. They are never called about a request that will be refused (T6),
//! and a panic in one costs only that request (D7). `fuseline-deadline` defines them.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

use fuseline_deadline::{End, Policy, Situation};

use crate::tally::CurrentDeadline;

/// The policies of one operator, by the index of their cloud.
#[repr(C)]
pub(crate) struct Policies {
    /// The indices that have a policy, one bit each. Usually there is none, and then nothing else
    /// is read.
    with_policy: u16,
    clouds: Vec<CloudPolicy>,
    situation: Situation<'static>,
    /// The ages of requests. It is a field so that no offer allocates.
    ages: Vec<Duration>,
}

#[derive(Default)]
struct CloudPolicy {
    policy: Option<Box<dyn Policy + Send>>,
    /// The deadline of the latest offer.
    in_force: Option<CurrentDeadline>,
}

/// A policy panicked.
pub(crate) struct PolicyPanic;

impl Policies {
    /// Creates the policies of the clouds, in their order. Until the situation is set it is
    /// unknown, so policies take no risk.
    pub(crate) fn new(policies: impl Iterator<Item = Option<Box<dyn Policy + Send>>>) -> Self {
        let (local, mut with_policy) = (CloudPolicy::default(), 0);
        let mut clouds = vec![local];
        for policy in policies {
            with_policy |= u16::from(policy.is_some()) << clouds.len();
            clouds.push(CloudPolicy { policy, in_force: None });
        }
        Self { with_policy, clouds, situation: Situation::UNKNOWN, ages: Vec::new() }
    }

    pub(crate) const fn set_situation(&mut self, situation: Situation<'static>) {
        self.situation = situation;
    }

    /// Returns the deadline of an offer, at most `cap`, or `cap` itself if there is no policy.
    /// `write_ages` writes the ages of the cloud's unanswered requests.
    ///
    /// A policy's figures cover the whole way from the capture to the last output. The request
    /// cannot use the part `spent` of it (E3).
    ///
    /// # Errors
    /// Returns an error if the policy panics.
    pub(crate) fn choose(
        &mut self,
        index: usize,
        (cap, spent): (Duration, Duration),
        write_ages: impl FnOnce(&mut Vec<Duration>),
    ) -> Result<CurrentDeadline, PolicyPanic> {
        let Some(policy) = &mut self.clouds[index].policy else {
            return Ok(CurrentDeadline { deadline: cap, reason: None });
        };
        write_ages(&mut self.ages);
        let situation = Situation { under_way: &self.ages, ..self.situation };
        let whole = cap.saturating_add(spent);
        let chosen = catch_unwind(AssertUnwindSafe(|| policy.decide(&situation, whole).into()));
        let chosen: CurrentDeadline = chosen.map_err(|_| PolicyPanic)?;
        // The cap also holds for a policy, so the deadline that is shown is the one that the
        // request gets.
        let deadline = chosen.deadline.saturating_sub(spent).min(cap);
        Ok(CurrentDeadline { deadline, ..chosen })
    }

    /// Puts a deadline in force. Returns `true` if it differs from the previous one.
    pub(crate) fn put_in_force(&mut self, index: usize, chosen: CurrentDeadline) -> bool {
        self.clouds[index].in_force.replace(chosen) != Some(chosen)
    }

    /// Reports to the cloud's policy, if there is one, how a request ended.
    ///
    /// # Errors
    /// Returns an error if the policy panics.
    pub(crate) fn ended(&mut self, index: usize, end: End) -> Result<(), PolicyPanic> {
        if !self.has_policy(index) {
            return Ok(());
        }
        let Some(policy) = &mut self.clouds[index].policy else { return Ok(()) };
        catch_unwind(AssertUnwindSafe(|| policy.ended(end))).map_err(|_| PolicyPanic)
    }

    pub(crate) const fn has_policy(&self, index: usize) -> bool {
        self.with_policy & (1 << index) != 0
    }
}
