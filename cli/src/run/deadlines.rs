//! How long the clouds may take, message by message.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use fuseline_deadline::{Accuracy, End, Expected, Policy, Situation, Span};
use fuseline_tokio::Commit;
use tokio::time::Instant;

use crate::models::Model;
use crate::run::plan::{DeadlinePolicy, Plan};

/// One message in so many waits as long as is allowed, to see what longer deadlines would bring.
const PROBE_EVERY: u32 = 16;
/// What a cloud's result counts above local's where one of the two has no figure, in points of AP.
const UNKNOWN_GAIN: f64 = 5.0;

/// Chooses the deadlines of all clouds, and is told how each call ended. Clones are the same one.
#[derive(Clone)]
pub(crate) struct Deadlines(Arc<Mutex<State>>);

struct State {
    cap: Duration,
    commit: Commit,
    /// By cloud; none if every deadline is the cap.
    policies: Vec<Expected<Accuracy>>,
    /// Those of the latest message, by cloud.
    latest: Option<(u64, Vec<Duration>)>,
}

/// A request that tells its end: what nobody answers counts as given up when this is dropped.
pub(crate) struct Watched {
    deadlines: Deadlines,
    cloud: usize,
    began: Instant,
    /// How long it may take.
    pub(crate) deadline: Duration,
    is_told: bool,
}

impl Deadlines {
    /// Those that the plan asks for.
    pub(crate) fn new(plan: &Plan) -> Self {
        let (cap, commit) = (plan.deadline(), plan.commit);
        match plan.policy {
            DeadlinePolicy::Constant => Self::of_policies(cap, commit, Vec::new()),
            DeadlinePolicy::Expected => {
                let aps = plan.clouds.iter().map(|cloud| cloud.served.ap);
                Self::expected(cap, commit, &plan.local, aps, plan.price)
            }
        }
    }

    /// Those of least expected loss, up to `cap`: AP lost, and `price` points of AP for each second
    /// of waiting. `aps` are the clouds'.
    fn expected(
        cap: Duration,
        commit: Commit,
        local: &Model,
        aps: impl IntoIterator<Item = Option<f64>>,
        price: f64,
    ) -> Self {
        let (least, greatest) = local.runtimes();
        let response = Span::new(least.as_secs_f64(), greatest.as_secs_f64());
        let policy = |cloud: Option<f64>| {
            let (local, cloud) = local.ap.zip(cloud).unwrap_or((0.0, UNKNOWN_GAIN));
            let loss = Accuracy { local, cloud, price_per_ms: price / 1000.0 };
            let probes = Some(PROBE_EVERY);
            Expected::new(loss, response, probes).expect("the paper's runtimes are above 0")
        };
        Self::of_policies(cap, commit, aps.into_iter().map(policy).collect())
    }

    fn of_policies(cap: Duration, commit: Commit, policies: Vec<Expected<Accuracy>>) -> Self {
        Self(Arc::new(Mutex::new(State { cap, commit, policies, latest: None })))
    }

    /// A message's request to the cloud in this place, made now.
    pub(crate) fn watch(&self, cloud: usize, timestamp: u64) -> Watched {
        let deadline = self.of(cloud, timestamp);
        Watched { deadlines: self.clone(), cloud, began: Instant::now(), deadline, is_told: false }
    }

    fn of(&self, cloud: usize, timestamp: u64) -> Duration {
        let state = &mut *self.state();
        let known = state.latest.take().filter(|(latest, _)| *latest == timestamp);
        let (_, deadlines) = state.latest.insert(known.unwrap_or_else(|| {
            let all = choose(&mut state.policies, state.cap, state.commit);
            (timestamp, all)
        }));
        deadlines.get(cloud).copied().unwrap_or(state.cap)
    }

    fn ended(&self, cloud: usize, end: End) {
        if let Some(policy) = self.state().policies.get_mut(cloud) {
            policy.ended(end);
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // No policy panics; what one would leave behind is whole.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The deadlines of one message, by cloud.
///
/// Under eager the first timer that finds something in hand commits for all clouds (A4). So they
/// share the longest deadline that is worth it for one of them: the timer of a cloud that is gone
/// fires no sooner than the others' results are expected, or else before local's is there.
fn choose(policies: &mut [Expected<Accuracy>], cap: Duration, commit: Commit) -> Vec<Duration> {
    // The loss asks for no speed.
    let situation = Situation::at(0.0);
    let own: Vec<Duration> =
        policies.iter_mut().map(|policy| policy.decide(&situation, cap).deadline).collect();
    match (commit, own.iter().max()) {
        (Commit::Eager, Some(longest)) => vec![*longest; own.len()],
        _ => own,
    }
}

impl Watched {
    /// Its result is here.
    pub(crate) fn answered(self) {
        self.tell(End::Answered);
    }

    /// It failed. At its deadline that is another way to be given up.
    pub(crate) fn failed(self) {
        if self.began.elapsed() < self.deadline {
            self.tell(End::Failed);
        }
    }

    fn tell(mut self, end: fn(Duration) -> End) {
        self.is_told = true;
        self.deadlines.ended(self.cloud, end(self.began.elapsed()));
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        if !self.is_told {
            self.deadlines.ended(self.cloud, End::Censored(self.began.elapsed()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAP: Duration = ms(500);

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn deadlines(commit: Commit) -> Deadlines {
        let local: Model = "DETR-ResNet-50@orin".parse().unwrap();
        Deadlines::expected(CAP, commit, &local, [Some(43.5), Some(51.3)], 10.0)
    }

    fn least() -> Duration {
        let local: Model = "DETR-ResNet-50@orin".parse().unwrap();
        local.runtimes().0
    }

    /// Sends this message to both clouds, which take so long; says its deadlines.
    async fn send(deadlines: &Deadlines, t: u64, replies: [Option<u64>; 2]) -> [Duration; 2] {
        let requests = [0, 1].map(|cloud| deadlines.watch(cloud, t));
        let due = [requests[0].deadline, requests[1].deadline];
        let mut calls = tokio::task::JoinSet::new();
        for ((request, reply), due) in requests.into_iter().zip(replies).zip(due) {
            calls.spawn(async move {
                match reply.map(ms) {
                    Some(reply) if reply < due => {
                        tokio::time::sleep(reply).await;
                        request.answered();
                    }
                    Some(_) | None => {
                        tokio::time::sleep(due).await;
                        request.failed();
                    }
                }
            });
        }
        calls.join_all().await;
        due
    }

    #[tokio::test(start_paused = true)]
    async fn clouds_that_are_faster_than_local_or_gone_cost_no_time() {
        let deadlines = deadlines(Commit::Eager);
        assert_eq!(send(&deadlines, 0, [Some(150), Some(200)]).await, [CAP; 2], "the first probe");
        for (t, replies) in (1..80).zip([[Some(150), Some(200)], [Some(150), None]].repeat(40)) {
            let expected = if t % 16 == 0 { CAP } else { least() };
            assert_eq!(send(&deadlines, t, replies).await, [expected; 2], "message {t}");
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_slow_cloud_is_waited_for_until_it_is_gone_and_again_once_it_is_back() {
        let deadlines = deadlines(Commit::Patient);
        let mut waits = Vec::new();
        for t in 0..256 {
            let reply = Some(400).filter(|_| !(64..160).contains(&t));
            waits.push(send(&deadlines, t, [None, reply]).await[1]);
        }
        let is_long = |wait: &&Duration| **wait > ms(400);
        assert!(waits[1..64].iter().all(|wait| is_long(&wait)), "{waits:?}");
        // 64 ends after it went nothing is remembered from before: two messages are probes.
        assert_eq!(waits[128..160].iter().filter(is_long).count(), 2, "{waits:?}");
        assert_eq!(waits[128..160].iter().filter(|wait| **wait == least()).count(), 30);
        // Found with the next probe, which is one of 16 messages.
        assert!(waits[160..177].iter().any(|wait| is_long(&wait)), "{waits:?}");
        assert!(waits[177..].iter().all(|wait| is_long(&wait)), "{waits:?}");
    }

    #[tokio::test(start_paused = true)]
    async fn under_eager_no_dead_clouds_timer_cuts_off_a_slow_one() {
        for (commit, is_shared) in [(Commit::Eager, true), (Commit::Patient, false)] {
            let deadlines = deadlines(commit);
            for t in 0..=80 {
                send(&deadlines, t, [None, Some(400)]).await;
            }
            let [dead, slow] = send(&deadlines, 81, [None, Some(400)]).await;
            assert!(slow > ms(400) && slow < ms(405), "{slow:?}");
            assert_eq!(dead, if is_shared { slow } else { least() }, "{commit:?}");
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_cloud_that_fails_at_once_is_not_waited_for() {
        let deadlines = deadlines(Commit::Patient);
        for t in 0..64 {
            let slow = send(&deadlines, t, [Some(1), Some(400)]).await[1];
            assert!(t % 16 == 0 || slow > ms(400), "{slow:?}");
        }
        for t in 64..=128 {
            deadlines.watch(1, t).failed();
        }
        assert_eq!(send(&deadlines, 129, [Some(1), None]).await[1], least());
    }

    #[test]
    fn a_constant_never_changes() {
        let deadlines = Deadlines::of_policies(ms(120), Commit::Eager, Vec::new());
        drop(deadlines.watch(1, 0));
        assert_eq!([deadlines.of(0, 0), deadlines.of(1, 0), deadlines.of(0, 9)], [ms(120); 3]);
    }

    #[test]
    fn a_model_without_figure_is_worth_waiting_for_too() {
        let local: Model = "DETR-ResNet-50@orin".parse().unwrap();
        let deadlines = Deadlines::expected(CAP, Commit::Eager, &local, [None], 10.0);
        assert_eq!(deadlines.of(0, 0), CAP);
        deadlines.ended(0, End::Answered(ms(400)));
        assert_eq!(deadlines.of(0, 1), ms(400) + Duration::from_nanos(1));
    }
}
