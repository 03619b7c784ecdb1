//! Explores all interleavings of a few threads that bring values, with at most three preemptions.
//! The caller that gets `Forwarded` gets the winner's value, and no value is lost. Run with
//! `RUSTFLAGS="--cfg loom"`.
#![cfg(loom)]

#[path = "common/turn.rs"]
mod turn;

use std::sync::atomic::{AtomicBool as Flag, Ordering};

use fuseline_core::{Cloud, Commit, Deadline, Instant, Outcome, Priority, Timestamp};
use fuseline_threads::{Call, CallOutcome, Message, Shared, ValueOwner};
use loom::model::Builder;
use loom::thread::{self, JoinHandle};
use turn::CallOrder;

const CLOUD: Priority = Priority::new(1);

/// The commit rules that send one output.
const ONE_OUTPUT: &[Commit] = &[Commit::Eager, Commit::Patient];
const PROGRESSIVE: &[Commit] = &[Commit::Progressive];

fn explore(rules: &[Commit], run: impl Fn(Commit) + Sync + Send + Copy + 'static) {
    for commit in rules.iter().copied() {
        let mut builder = Builder::new();
        builder.preemption_bound = Some(3);
        builder.check(move || run(commit));
    }
}

const fn at(nanos: u64) -> Instant {
    Instant::from_nanos(nanos)
}

fn is_forwarded<const CLOUDS: usize>(outcome: &Outcome<CLOUDS>) -> bool {
    matches!(outcome, Outcome::Forwarded { .. } | Outcome::Preliminary { .. })
}

type Intake = ValueOwner<'static, &'static str, 1, 1>;
type Reply = CallOutcome<&'static str, 1>;

/// A message whose local result another thread brings at 9, and whose request to the cloud is due
/// at 10.
struct Race {
    intake: Intake,
    message: Message<'static, &'static str, 1, 1>,
    call: Call<'static, &'static str, 1, 1>,
    local: JoinHandle<Reply>,
    turn: CallOrder,
}

impl Race {
    fn new(commit: Commit) -> Self {
        let shared = Shared::new(1, commit, &[Cloud::new(CLOUD, 1)]).unwrap();
        let mut intake = Intake::new(Box::leak(Box::new(shared)));
        let (message, local) = intake.open(at(0), Timestamp::new(0), None).unwrap();
        let (_, call) = intake.offer(at(0), &message, CLOUD, Deadline::from_nanos(10), 0);
        let turn = CallOrder::default();
        let their_turn = turn.clone();
        let local = thread::spawn(move || {
            their_turn.take();
            local.result(at(9), "local")
        });
        turn.take();
        Self { intake, message, call: call.unwrap().0, local, turn }
    }
}

/// Returns `true` if a caller that forwards has a value, and a caller whose result was dropped has
/// got its own value back.
fn is_complete(reply: &Reply) -> bool {
    let fired = reply.fired.is_some_and(|firing| is_forwarded(&firing.outcome));
    let is_dropped = matches!(reply.outcome, Outcome::Dropped(_));
    (fired || is_forwarded(&reply.outcome)) == reply.forwarded.is_some()
        && is_dropped == reply.unused.is_some()
}

/// The timer forwards local's value, or local's own call does (P1, F7).
#[test]
fn p1_the_timer_forwards_the_value_that_was_held() {
    explore(ONE_OUTPUT, |commit| {
        let Race { message, call, local: other, .. } = Race::new(commit);
        let expired = message.expire(at(10));
        let reply = other.join().unwrap();
        assert!(is_complete(&reply));
        let by_timer = expired.and_then(|(_, value)| value);
        assert_eq!(by_timer.xor(reply.forwarded), Some("local"));
        let late = call.result(at(10), "cloud");
        assert!(is_complete(&late) && late.unused == Some("cloud"));
    });
}

/// The cloud's value is forwarded if it has come. Each other value comes back or stays in its cell
/// (P3).
#[test]
fn p3_local_and_a_cloud_race_with_their_values() {
    explore(ONE_OUTPUT, |commit| {
        let Race { call, local: other, .. } = Race::new(commit);
        let cloud = call.result(at(9), "cloud");
        let local = other.join().unwrap();
        assert!(is_complete(&cloud) && is_complete(&local));
        assert_eq!((cloud.forwarded, local.forwarded), (Some("cloud"), None));
        assert!(local.unused == Some("local") || local.outcome == Outcome::Held);
    });
}

/// A value for a retired message never meets a later message in its slot (F3).
#[test]
fn f3_a_stale_value_races_the_reuse_of_its_place() {
    explore(ONE_OUTPUT, |commit| {
        let Race { mut intake, message, call, local: stale, turn } = Race::new(commit);
        let first = call.result(at(5), "cloud");
        assert_eq!(first.forwarded, Some("cloud"));
        drop(message);
        turn.take();
        let (_, local) = intake.open(at(6), Timestamp::new(1), None).unwrap();
        turn.take();
        let second = local.result(at(7), "local");
        assert_eq!(second.forwarded, Some("local"));
        let stale = stale.join().unwrap();
        assert!(is_complete(&first) && is_complete(&second) && is_complete(&stale));
        assert_eq!(stale.forwarded, None);
    });
}

/// Under progressive local's value is sent with its own call, and the timer sends nothing (P1).
#[test]
fn p1_progressive_timer_sends_no_value() {
    static BY_TIMER: Flag = Flag::new(false);
    explore(PROGRESSIVE, |commit| {
        let Race { message, call, local: other, .. } = Race::new(commit);
        let (firing, by_timer) = message.expire(at(10)).expect("nobody else ticks");
        let reply = other.join().unwrap();
        assert!(is_complete(&reply));
        assert_eq!((by_timer, reply.forwarded), (None, Some("local")));
        // The second of the two retires the message.
        let is_final = matches!(firing.outcome, Outcome::Final { .. });
        assert_eq!(is_final, matches!(reply.outcome, Outcome::Preliminary { .. }));
        BY_TIMER.fetch_or(is_final, Ordering::Relaxed);
        let late = call.result(at(10), "cloud");
        assert!(is_complete(&late) && late.unused == Some("cloud"));
    });
    assert!(BY_TIMER.load(Ordering::Relaxed), "the timer never made it final");
}

/// Under progressive the cloud's value is always sent, and local's if it came first (P3).
#[test]
fn p3_progressive_sends_rising_values() {
    static BOTH: Flag = Flag::new(false);
    explore(PROGRESSIVE, |commit| {
        let Race { call, local: other, .. } = Race::new(commit);
        let cloud = call.result(at(9), "cloud");
        let local = other.join().unwrap();
        assert!(is_complete(&cloud) && is_complete(&local));
        assert_eq!(cloud.forwarded, Some("cloud"));
        assert!(matches!(cloud.outcome, Outcome::Forwarded { .. }), "nothing outranks it");
        assert_eq!(local.forwarded.xor(local.unused), Some("local"));
        BOTH.fetch_or(local.forwarded.is_some(), Ordering::Relaxed);
    });
    assert!(BOTH.load(Ordering::Relaxed), "local never came first");
}
