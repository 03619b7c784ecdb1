//! Side requests. Their answers are not outputs, and the machine does not know of them.

/// A plan that the cloud made for something unlikely.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Plan {
    pub(crate) hypothesis: Hypothesis,
    /// The time for which it holds after it came, in ns.
    pub(crate) validity: u64,
}

/// An event that might happen, by its index.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Hypothesis(pub(crate) usize);

impl Hypothesis {
    pub(crate) const PERSON_ENTERS: Self = Self(0);
    pub(crate) const CAR_PULLS_OUT: Self = Self(1);
}

/// The answer to a call, and its delay in ns.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct PlanReply {
    pub(crate) takes: u64,
    pub(crate) plan: Plan,
}

/// Makes side requests. At most `limit` of them are under way, and each has a deadline. An answer
/// in time goes into the cache and nowhere else. An answer at the due instant is late.
#[derive(Debug)]
pub(crate) struct ContingencyCalls {
    /// No call is made while this many are under way.
    limit: usize,
    under_way: Vec<CloudCall>,
    cache: PlanCache,
}

#[derive(Clone, Copy, Debug)]
struct CloudCall {
    due: u64,
    /// The answer and the instant at which it comes, or `None` if it never comes.
    answer: Option<(u64, Plan)>,
}

/// The plans, each with the instant until which it holds.
#[derive(Default, Debug)]
struct PlanCache {
    plans: Vec<(Plan, u64)>,
}

impl ContingencyCalls {
    pub(crate) fn new(limit: usize) -> Self {
        Self { limit, under_way: Vec::new(), cache: PlanCache::default() }
    }

    /// Makes a call unless the gate is shut. Returns `true` if it was made.
    pub(crate) fn call(&mut self, now: u64, deadline: u64, answer: Option<PlanReply>) -> bool {
        self.pass(now);
        let is_open = self.under_way.len() < self.limit;
        if is_open {
            let answer = answer.map(|PlanReply { takes, plan }| (now.saturating_add(takes), plan));
            self.under_way.push(CloudCall { due: now.saturating_add(deadline), answer });
        }
        is_open
    }

    /// Returns `true` if a plan for this event is cached.
    pub(crate) fn holds(&mut self, now: u64, hypothesis: Hypothesis) -> bool {
        self.pass(now);
        let mut plans = self.cache.plans.iter();
        plans.any(|(plan, until)| plan.hypothesis == hypothesis && now < *until)
    }

    /// Lets time pass: caches answers that came in time, and removes calls that have ended.
    fn pass(&mut self, now: u64) {
        let Self { under_way, cache, .. } = self;
        under_way.retain(|call| match call.answer {
            Some((at, plan)) if at < call.due => {
                if at <= now {
                    cache.plans.push((plan, at.saturating_add(plan.validity)));
                }
                at > now
            }
            Some(_) | None => call.due > now,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAN: Plan = Plan { hypothesis: Hypothesis::PERSON_ENTERS, validity: 100 };

    fn requested(takes: u64) -> ContingencyCalls {
        let mut contingencies = ContingencyCalls::new(1);
        assert!(contingencies.call(0, 50, Some(PlanReply { takes, plan: PLAN })));
        contingencies
    }

    #[test]
    fn an_answer_at_its_due_instant_is_late() {
        assert!(requested(49).holds(60, Hypothesis::PERSON_ENTERS));
        assert!(!requested(50).holds(60, Hypothesis::PERSON_ENTERS));
    }

    #[test]
    fn a_plan_is_used_on_a_match_while_it_holds() {
        let mut contingencies = requested(40);
        assert!(!contingencies.holds(39, Hypothesis::PERSON_ENTERS));
        assert!(contingencies.holds(40, Hypothesis::PERSON_ENTERS));
        assert!(!contingencies.holds(40, Hypothesis::CAR_PULLS_OUT));
        assert!(contingencies.holds(139, Hypothesis::PERSON_ENTERS));
        assert!(!contingencies.holds(140, Hypothesis::PERSON_ENTERS));
    }

    #[test]
    fn the_gate_is_shut_while_a_call_is_under_way() {
        let mut contingencies = requested(40);
        assert!(!contingencies.call(39, 50, None));
        assert!(contingencies.call(40, 50, None));
        assert!(!contingencies.call(89, 50, None));
        assert!(contingencies.call(90, 50, None));
    }
}
