//! Chooses the clouds' deadlines message by message: each cloud has a policy of
//! `fuseline-deadline`, with accuracy as its loss.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use fuseline_tokio::Commit;
use fuseline_tokio::deadline::{Accuracy, Chosen, End, Expected, Policy, Situation, Span};

use crate::run::plan::RunPlan;
use fuseline_evaluation::models::Model;

/// The number of ended calls to a cloud that are remembered: 3.2 s at ten frames a second. With the
/// libraries' default of 64, about two seconds at 30 frames a second, it would take twice as long
/// here until a cloud counts as gone.
const CALLS: usize = 32;
/// The gain of a cloud's result over local's in points of AP, if the accuracy of one of the two is
/// unknown.
const UNKNOWN_GAIN: f64 = 5.0;

/// Chooses the deadlines of all clouds for each message. Clones share the same state.
///
/// The least expected loss decides, which is the lost AP plus the price of waiting in points of AP.
/// It never probes, because calls linger until the longest deadline and so show their true ends.
#[derive(Clone)]
pub(crate) struct RunDeadlines(Arc<Mutex<DeadlineState>>);

struct DeadlineState {
    cap: Duration,
    commit: Commit,
    linger: Duration,
    /// The policies, one for each cloud.
    policies: Vec<Expected<Accuracy, CALLS>>,
    /// The deadlines chosen for the latest message, one for each cloud.
    chosen: Vec<Chosen>,
}

/// One cloud's part.
struct CloudDeadline {
    deadlines: RunDeadlines,
    index: usize,
}

impl RunDeadlines {
    /// Creates policies with the plan's deadline as the cap and with the plan's price.
    pub(crate) fn new(plan: &RunPlan) -> Self {
        let aps = plan.clouds.iter().map(|cloud| cloud.served.ap);
        Self::expected(plan.deadline(), plan.commit, &plan.local, aps, plan.price_per_ms)
    }

    fn expected(
        cap: Duration,
        commit: Commit,
        local: &Model,
        aps: impl IntoIterator<Item = Option<f64>>,
        price_per_ms: f64,
    ) -> Self {
        let (least, greatest) = local.runtimes();
        let response = Span::new(least, greatest);
        let policy = |cloud: Option<f64>| {
            let (local, cloud) = local.ap.zip(cloud).unwrap_or((0.0, UNKNOWN_GAIN));
            let loss = Accuracy { local, cloud, price_per_ms };
            Expected::new(loss, response, None).expect("the paper's runtimes are above 0")
        };
        let policies: Vec<_> = aps.into_iter().map(policy).collect();
        let linger = cap.saturating_sub(least);
        Self(Arc::new(Mutex::new(DeadlineState {
            cap,
            commit,
            linger,
            policies,
            chosen: Vec::new(),
        })))
    }

    /// Chooses the deadlines of all clouds for a new message. No policy needs to know more about
    /// the vehicle.
    pub(crate) fn next(&self) -> Situation<'static> {
        let situation = Situation::UNKNOWN;
        let DeadlineState { cap, commit, policies, chosen, .. } = &mut *self.state();
        *chosen = policies.iter_mut().map(|policy| policy.decide(&situation, *cap)).collect();
        // Under eager the first timer that finds an available result commits for all clouds (A4).
        // So the clouds share the longest deadline that is worth the wait for any of them.
        // Otherwise the timer of a cloud that is gone would end the wait for the others.
        if let (Commit::Eager, Some(longest)) =
            (*commit, chosen.iter().copied().max_by_key(|chosen| chosen.deadline))
        {
            chosen.fill(longest);
        }
        situation
    }

    /// Returns the policy of the cloud with this index. It gives the deadline that was chosen for
    /// the latest message.
    pub(crate) fn of(&self, index: usize) -> Box<dyn Policy + Send> {
        Box::new(CloudDeadline { deadlines: self.clone(), index })
    }

    /// Returns how long calls must linger to be seen until the longest deadline.
    pub(crate) fn linger(&self) -> Duration {
        self.state().linger
    }

    fn state(&self) -> MutexGuard<'_, DeadlineState> {
        // No policy panics, and even a panic would leave a sound state.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Policy for CloudDeadline {
    fn decide(&mut self, situation: &Situation<'_>, cap: Duration) -> Chosen {
        let state = &mut *self.deadlines.state();
        match state.chosen.get(self.index) {
            Some(chosen) => Chosen { deadline: chosen.deadline.min(cap), ..*chosen },
            None => state.policies[self.index].decide(situation, cap),
        }
    }

    fn ended(&mut self, end: End) {
        self.deadlines.state().policies[self.index].ended(end);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAP: Duration = ms(500);
    const LOCAL: Duration = Duration::from_micros(286_615);
    const SLOW: Option<u64> = Some(400);

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn local() -> Model {
        "DETR-ResNet-50@orin".parse().unwrap()
    }

    fn is_slow(deadline: Duration) -> bool {
        deadline == ms(400) + Duration::from_nanos(1)
    }

    struct Clouds {
        deadlines: RunDeadlines,
        policies: [Box<dyn Policy + Send>; 2],
    }

    impl Clouds {
        fn new(commit: Commit) -> Self {
            let aps = [Some(43.5), Some(51.3)];
            let deadlines = RunDeadlines::expected(CAP, commit, &local(), aps, 0.01);
            let policies = [0, 1].map(|index| deadlines.of(index));
            Self { deadlines, policies }
        }

        /// Sends a message to both clouds, which take this long. Returns its deadlines.
        fn send(&mut self, replies: [Option<u64>; 2]) -> [Duration; 2] {
            let situation = self.deadlines.next();
            let due = [0, 1].map(|i| self.policies[i].decide(&situation, CAP).deadline);
            for ((policy, reply), due) in self.policies.iter_mut().zip(replies).zip(due) {
                let until = due + self.deadlines.linger();
                policy.ended(match reply.map(ms) {
                    Some(reply) if reply < until => End::Answered(reply),
                    Some(_) | None => End::Censored(until),
                });
            }
            due
        }
    }

    #[test]
    fn clouds_that_are_faster_than_local_or_gone_cost_no_time() {
        let mut clouds = Clouds::new(Commit::Eager);
        for replies in [[Some(150), Some(200)], [Some(150), None], [None, None]].repeat(40) {
            assert_eq!(clouds.send(replies), [LOCAL; 2], "{replies:?}");
        }
    }

    #[test]
    fn a_slow_cloud_is_waited_for_until_it_is_gone_and_again_once_it_is_back() {
        let mut clouds = Clouds::new(Commit::Patient);
        let mut waits = Vec::new();
        for t in 0..192 {
            let reply = SLOW.filter(|_| !(64..128).contains(&t));
            waits.push(clouds.send([None, reply])[1]);
        }
        // After 32 ends of calls, nothing earlier is remembered.
        assert!(waits[1..65].iter().all(|wait| is_slow(*wait)), "{waits:?}");
        assert_eq!(waits[64 + CALLS..129], [LOCAL; 65 - CALLS]);
        assert!(waits[128 + CALLS..].iter().all(|wait| is_slow(*wait)), "{waits:?}");
    }

    #[test]
    fn under_eager_no_dead_clouds_timer_cuts_off_a_slow_one() {
        for (commit, is_shared) in [(Commit::Eager, true), (Commit::Patient, false)] {
            for is_better_dead in [false, true] {
                let mut clouds = Clouds::new(commit);
                let mut replies = [None, SLOW];
                replies.rotate_left(usize::from(is_better_dead));
                let mut both = (0..CALLS * 2).map(|_| clouds.send(replies)).last().unwrap();
                both.rotate_left(usize::from(is_better_dead));
                let [dead, slow] = both;
                assert!(is_slow(slow), "{slow:?}");
                assert!(if is_shared { is_slow(dead) } else { dead == LOCAL }, "{dead:?}");
            }
        }
    }

    #[test]
    fn a_model_without_figure_is_worth_waiting_for_too() {
        let deadlines = RunDeadlines::expected(CAP, Commit::Eager, &local(), [None], 0.01);
        deadlines.of(0).ended(End::Answered(ms(400)));
        let situation = deadlines.next();
        assert!(is_slow(deadlines.of(0).decide(&situation, CAP).deadline));
    }

    #[test]
    fn a_deadline_below_locals_response_stays_what_it_is() {
        let deadlines = RunDeadlines::expected(ms(80), Commit::Eager, &local(), [None], 0.01);
        let situation = deadlines.next();
        assert_eq!(deadlines.of(0).decide(&situation, ms(80)).deadline, ms(80));
        assert_eq!(deadlines.linger(), Duration::ZERO);
    }
}
