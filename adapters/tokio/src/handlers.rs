//! Wraps a message handler of your own so that it sends only requests that are worth their bytes.

use std::sync::OnceLock;
use std::time::Duration;

use fuseline_deadline::{Chosen, End, Policy, SendBudget, Situation};
use fuseline_engine::nanos;
use tokio::time::Instant;

use crate::shared::SharedState;

/// Returns a message handler that sends a message only if it is worth its bytes. `estimate` returns
/// the size of a message's request and the gain that its answer is expected to bring. The budget
/// decides, and all operators of a vehicle may share it. `stream` is this handler's number in the
/// budget.
///
/// Make this the innermost handler, because a request pays its bytes even if an outer handler
/// discards it. To gain from this handler, share a policy with the cloud, such as a
/// [`SharedState`]:
///
/// ```
/// # use std::time::Duration;
/// # use fuseline_tokio::deadline::{Accuracy, Expected, SendBudget, Situation};
/// # use fuseline_tokio::{SharedState, handlers::within_budget};
/// # struct Frame { image: Vec<u8> }
/// # const DEADLINE: Duration = Duration::from_millis(500);
/// let loss = Accuracy { local: 42.0, cloud: 51.3, price_per_ms: 0.01 };
/// let policy: SharedState<Expected<_>> =
///     SharedState::new(Expected::new(loss, Duration::from_millis(302), None)?);
/// // 10 Mbit/s for two clouds; one message in 30 that are passed over is sent, to see whether that pays again.
/// let budget = SharedState::new(SendBudget::<2>::new(1_250_000, DEADLINE, Some(30)));
/// let estimates = policy.clone();
/// let estimate = move |frame: &Frame, _| {
///     let gain = estimates.with(|policy| policy.gain(&Situation::UNKNOWN, DEADLINE));
///     (frame.image.len() as u64, gain)
/// };
/// let send = |frame: &Frame, _| Some((frame.image.clone(), DEADLINE));
/// let message_handler = within_budget(budget.clone(), 0, estimate, send);
/// // let cloud = setup.use_cloud(handle, message_handler, …);
/// // (cloud.policy, cloud.linger) = (Some(Box::new(policy)), DEADLINE);
/// # let (_, _): (Box<dyn fuseline_tokio::deadline::Policy + Send>, _) = (Box::new(policy), message_handler);
/// # Ok::<(), fuseline_tokio::deadline::Invalid>(())
/// ```
pub fn within_budget<M, R, const STREAMS: usize>(
    budget: SharedState<SendBudget<STREAMS>>,
    stream: usize,
    mut estimate: impl FnMut(&M, u64) -> (u64, f64),
    mut handler: impl FnMut(&M, u64) -> Option<(R, Duration)>,
) -> impl FnMut(&M, u64) -> Option<(R, Duration)> {
    move |message, timestamp| {
        let (bytes, gain) = estimate(message, timestamp);
        let now = now();
        let is_worth_it = budget.with(|budget| budget.offer(stream, now, bytes, gain));
        if is_worth_it { handler(message, timestamp) } else { None }
    }
}

/// Returns the time in nanoseconds on a clock that all budgets of the process share.
fn now() -> u64 {
    static START: OnceLock<Instant> = OnceLock::new();
    nanos(START.get_or_init(Instant::now).elapsed())
}

/// Lets a cloud's deadlines and a message handler share one policy and its estimates.
impl<P: Policy> Policy for SharedState<P> {
    fn decide(&mut self, situation: &Situation<'_>, cap: Duration) -> Chosen {
        self.with(|policy| policy.decide(situation, cap))
    }

    fn ended(&mut self, end: End) {
        self.with(|policy| policy.ended(end));
    }

    fn assumes_one_output(&self) -> bool {
        self.with(|policy| policy.assumes_one_output())
    }

    fn needs_linger(&self) -> bool {
        self.with(|policy| policy.needs_linger())
    }
}

#[cfg(test)]
mod tests {
    use std::iter;

    use super::*;

    const DEADLINE: Duration = Duration::from_millis(500);

    #[expect(
        clippy::trivially_copy_pass_by_ref,
        clippy::unnecessary_wraps,
        reason = "it is a message handler"
    )]
    fn send(message: &u64, _: u64) -> Option<(u64, Duration)> {
        Some((*message, DEADLINE))
    }

    #[tokio::test(start_paused = true)]
    async fn two_operators_share_a_budget_and_the_worthier_comes_first() {
        // The budget allows 1000 bytes in each tenth of a second.
        let budget = SharedState::new(SendBudget::<2>::new(10_000, DEADLINE, None));
        let mut worthy = within_budget(budget.clone(), 0, |_: &u64, _| (600, 2.0), send);
        let mut other = within_budget(budget, 1, |_: &u64, _| (600, 1.0), send);
        let mut counts = [0, 0];
        for t in iter::successors(Some(0), |t| Some(t + 1)).take(31) {
            counts[0] += u32::from(worthy(&t, t).is_some());
            counts[1] += u32::from(other(&t, t).is_some());
            tokio::time::advance(Duration::from_millis(100)).await;
        }
        // The less worthy operator gets the 400 bytes that are left each time, once the other one
        // has saved for two messages.
        assert_eq!(counts, [30, 19]);
    }
}
