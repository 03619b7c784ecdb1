//! Tests the deadlines that clouds get, and the reports to their policies.

use std::future::pending;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::support::{ClosureOperator, RunResult, line, play};
use fuseline_tokio::deadline::{
    Accuracy, Chosen, Constant, End, Expected, Guard, MetresPerSecond, Parameters, Policy, Reason,
    Situation,
};
use fuseline_tokio::{
    Call, Config, EngineConfigError, Error, Local, Setup, SharedState, SpawnError, spawn, stream,
};
use tokio::time::{Instant, sleep};

const MS: Duration = Duration::from_millis(1);

/// The calls that a policy received, in their order.
type Log = Arc<Mutex<Vec<String>>>;

/// A policy that returns its deadlines one after the other, repeats the last one, and logs every
/// call.
struct RecordingPolicy {
    log: Log,
    deadlines: Vec<u32>,
}

impl Policy for RecordingPolicy {
    fn decide(&mut self, situation: &Situation<'_>, cap: Duration) -> Chosen {
        let Situation { speed, under_way, .. } = situation;
        let MetresPerSecond(speed) = speed.greatest;
        self.log.lock().unwrap().push(format!("at {speed} m/s up to {cap:?}, {under_way:?}"));
        let deadline = self.deadlines[0] * MS;
        if self.deadlines.len() > 1 {
            self.deadlines.remove(0);
        }
        Chosen { deadline, reason: Reason::Constant }
    }

    fn ended(&mut self, end: End) {
        self.log.lock().unwrap().push(format!("{end:?}"));
    }
}

/// An action of a cloud on a message, in ms from the request.
#[derive(Clone, Copy)]
enum ServiceAction {
    Answers(u32),
    Fails(u32),
    Hangs,
}
use ServiceAction::{Answers, Fails, Hangs};

/// Acts on a message. The value names the source, the message and the instant of the request.
async fn does(who: &str, does: ServiceAction, t: u64, start: Instant) -> Result<String, Error> {
    let requested = start.elapsed().as_millis();
    let value = format!("{who}'s of {t}, asked at {requested} ms,");
    match does {
        Answers(ms) => sleep(ms * MS).await,
        Fails(ms) => {
            sleep(ms * MS).await;
            return Err("on purpose".into());
        }
        Hangs => pending().await,
    }
    Ok(value)
}

/// Registers cloud `p`, which acts on each message as `action` says.
fn cloud(
    setup: &mut Setup<u64, String>,
    p: u16,
    action: fn(u64) -> ServiceAction,
    deadline: Duration,
) -> &mut fuseline_tokio::Cloud {
    let start = Instant::now();
    let handle =
        move |t, _: Call| async move { does(&format!("cloud {p}"), action(t), t, start).await };
    setup.use_cloud(handle, move |_, t| Some((t, deadline)), Ok, p)
}

fn local(ms: u32) -> Local<u64, String> {
    let start = Instant::now();
    Local::futures(64, move |_, t| does("local", Answers(ms), t, start))
}

async fn played(
    messages: &[u64],
    setup: impl FnOnce(&mut Setup<u64, String>) -> Local<u64, String>,
) -> RunResult {
    play(ClosureOperator(setup), Config { window: 64, ..Config::default() }, messages).await
}

fn noting(log: &Log, deadlines: &[u32]) -> Box<dyn Policy + Send> {
    Box::new(RecordingPolicy { log: Arc::clone(log), deadlines: deadlines.to_vec() })
}

#[tokio::test(start_paused = true)]
async fn a_policy_chooses_up_to_what_is_offered_and_knows_speed_and_calls_under_way() {
    let log = Log::default();
    let run = played(&[0, 30, 60], |setup| {
        setup
            .use_situation(|_, t| Situation::at(MetresPerSecond(if t == 1 { 18.0 } else { 11.0 })));
        cloud(setup, 1, |_| Hangs, 150 * MS).policy = Some(noting(&log, &[100, 50, 900]));
        local(20)
    });
    let run = run.await;
    assert_eq!(
        run.items,
        "80.000 ms: 1 local's of 1, asked at 30 ms, by timer from 50 ms\n\
         100.000 ms: 0 local's of 0, asked at 0 ms, by timer from 20 ms\n\
         210.000 ms: 2 local's of 2, asked at 60 ms, by timer from 80 ms\n"
    );
    let reported = [
        "at 11 m/s up to 150ms, []",
        "at 18 m/s up to 150ms, [30ms]",
        "at 11 m/s up to 150ms, [60ms, 30ms]",
        "Censored(50ms)",
        "Censored(100ms)",
        "Censored(150ms)",
    ];
    assert_eq!(*log.lock().unwrap(), reported);
}

/// Returns the cloud's action on message `t` of five. The messages come 200 ms apart, and each has
/// a deadline of 100 ms.
fn fates(t: u64) -> ServiceAction {
    [Answers(40), Fails(30), Answers(130), Answers(170), Hangs][usize::try_from(t).unwrap()]
}

/// Returns only the ends of calls.
fn ends(log: &Log) -> Vec<String> {
    log.lock().unwrap().iter().filter(|line| !line.starts_with("at")).cloned().collect()
}

#[tokio::test(start_paused = true)]
async fn a_policy_learns_how_each_call_ended_and_at_which_age() {
    let log = Log::default();
    let run = played(&[0, 200, 400, 600, 800], |setup| {
        cloud(setup, 1, fates, 100 * MS).policy = Some(noting(&log, &[100]));
        local(20)
    });
    let run = run.await;
    assert_eq!(
        ends(&log),
        ["Answered(40ms)", "Failed(30ms)", "Censored(100ms)", "Censored(100ms)", "Censored(100ms)"]
    );
    assert!(run.items.contains("40.000 ms: 0 cloud 1's of 0, asked at 0 ms, by arrival"));
}

#[tokio::test(start_paused = true)]
async fn a_call_that_lingers_shows_its_true_age_and_changes_no_output() {
    let outputs = async |linger, log: Log| {
        let run = played(&[0, 200, 400, 600, 800], |setup| {
            let cloud = cloud(setup, 1, fates, 100 * MS);
            cloud.policy = Some(noting(&log, &[100]));
            cloud.linger = linger;
            local(20)
        });
        run.await
    };
    let log = Log::default();
    let lingering = outputs(50 * MS, Arc::clone(&log)).await;
    assert_eq!(
        ends(&log),
        // The fourth call would answer at 170 ms, but it had lingered for its 50 ms by 150 ms.
        ["Answered(40ms)", "Failed(30ms)", "Answered(130ms)", "Censored(150ms)"]
    );
    assert_eq!(lingering.items, outputs(Duration::ZERO, Log::default()).await.items);
    assert!(lingering.trace.contains(r#""t":2,"p":1,"why":"superseded""#), "{}", lingering.trace);
}

#[tokio::test(start_paused = true)]
async fn a_cancelled_call_lingers_until_it_would_have_been_due_and_the_linger_after_it() {
    let log = Log::default();
    let run = played(&[0, 500, 1000], |setup| {
        // Cloud 2 answers at 60 ms, and cloud 1 is cancelled then.
        let action = |t| [Answers(90), Answers(260), Answers(10)][usize::try_from(t).unwrap()];
        let lower = cloud(setup, 1, action, 100 * MS);
        (lower.policy, lower.linger) = (Some(noting(&log, &[100])), 150 * MS);
        cloud(setup, 2, |_| Answers(60), 100 * MS);
        local(20)
    });
    let run = run.await;
    assert_eq!(ends(&log), ["Answered(90ms)", "Censored(250ms)", "Answered(10ms)"]);
    assert_eq!(run.tally.sources[1].cancelled, 2);
    assert!(run.items.contains("60.000 ms: 0 cloud 2's of 0, asked at 0 ms, by arrival"));
}

#[tokio::test(start_paused = true)]
async fn calls_that_linger_take_no_place_and_are_no_more_than_calls() {
    let log = Log::default();
    let run = played(&[0, 100, 200, 300], |setup| {
        let cloud = cloud(setup, 1, |t| if t == 3 { Answers(10) } else { Hangs }, 50 * MS);
        (cloud.policy, cloud.linger, cloud.calls) = (Some(noting(&log, &[50])), 1000 * MS, 1);
        local(20)
    });
    let run = run.await;
    // Each request is sent at once. The second and third calls that linger end the previous one.
    assert_eq!(ends(&log), ["Censored(150ms)", "Censored(150ms)", "Answered(10ms)"]);
    let last = "310.000 ms: 3 cloud 1's of 3, asked at 300 ms, by arrival from 310 ms\n";
    assert!(run.items.ends_with(last), "{}", run.items);
}

#[tokio::test(start_paused = true)]
async fn a_request_that_was_never_sent_is_censored_too() {
    let log = Log::default();
    played(&[0, 10], |setup| {
        let cloud = cloud(setup, 1, |_| Hangs, 100 * MS);
        (cloud.policy, cloud.calls) = (Some(noting(&log, &[100, 60])), 1);
        local(20)
    })
    .await;
    assert_eq!(ends(&log), ["Censored(60ms)", "Censored(100ms)"]);
}

#[tokio::test(start_paused = true)]
async fn a_policy_that_panics_makes_no_request_and_is_called_again() {
    struct FailingPolicy;
    impl Policy for FailingPolicy {
        fn decide(&mut self, situation: &Situation<'_>, cap: Duration) -> Chosen {
            assert!(situation.speed.greatest < MetresPerSecond(20.0), "on purpose");
            Constant(50 * MS).decide(situation, cap)
        }
        fn ended(&mut self, _: End) {
            panic!("on purpose")
        }
    }
    let run = played(&[0, 100], |setup| {
        setup
            .use_situation(|_, t| Situation::at(MetresPerSecond(if t == 0 { 22.0 } else { 18.0 })));
        cloud(setup, 1, |_| Answers(40), 100 * MS).policy = Some(Box::new(FailingPolicy));
        local(20)
    });
    assert_eq!(
        run.await.items,
        "20.000 ms: 0 local's of 0, asked at 0 ms, by arrival from 20 ms\n\
         140.000 ms: 1 cloud 1's of 1, asked at 100 ms, by arrival from 140 ms\n"
    );
}

#[tokio::test(start_paused = true)]
async fn without_a_policy_it_is_what_the_message_handler_says() {
    let run = played(&[0], |setup| {
        cloud(setup, 1, |_| Hangs, 70 * MS);
        local(20)
    })
    .await;
    assert_eq!(run.items, "70.000 ms: 0 local's of 0, asked at 0 ms, by timer from 20 ms\n");
    let in_force = run.tally.sources[1].in_force.unwrap();
    assert_eq!((in_force.deadline, in_force.why()), (70 * MS, "offered"));
    assert_eq!(run.tally.sources[0].in_force, None);
}

#[tokio::test(start_paused = true)]
async fn the_guard_waits_as_long_as_the_speed_allows_and_risks_nothing_without_one() {
    let guard = || Guard::new(Parameters::default()).unwrap();
    let speeds = [18.0, f64::NAN, 20.0];
    let run = played(&[0, 2000, 4000], |setup| {
        setup.use_situation(move |_, t| {
            Situation::at(MetresPerSecond(speeds[usize::try_from(t).unwrap()]))
        });
        cloud(setup, 1, |_| Hangs, Duration::MAX).policy = Some(Box::new(guard()));
        local(300)
    });
    let run = run.await;
    // The deadlines are 0.6506 s at 18 m/s, local's response without a speed, and 0.3117 s at 20
    // m/s.
    let due = |line: &str| line.split("\"due\":").nth(1).map(|due| due[..6].to_owned());
    let dues: Vec<_> = run.trace.lines().filter(|line| line.contains("request")).map(due).collect();
    let expected = ["650555", "230170", "431166"].map(|due| Some(due.to_owned()));
    assert_eq!(dues, expected, "{}", run.trace);
    assert_eq!(run.tally.sources[1].in_force.unwrap().why(), "local-stops");
}

#[tokio::test]
async fn a_policy_that_neither_probes_nor_sees_calls_linger_is_refused_with_the_remedy() {
    let loss = Accuracy { local: 42.0, cloud: 58.0, price_per_ms: 0.01 };
    let expected = |every| Expected::<_, 16>::new(loss, 20 * MS, every).unwrap();
    let start = |policy: Box<dyn Policy + Send>, linger| {
        let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
            let west = cloud(setup, 1, |_| Hangs, Duration::MAX);
            (west.name, west.policy, west.linger) = ("west".into(), Some(policy), linger);
            local(20)
        });
        spawn(operator, Config::default(), stream(1).1).map(drop)
    };
    let shared = SharedState::new(expected(None));
    for policy in [
        Box::new(expected(None)) as Box<dyn Policy + Send>,
        Box::new(Constant(50 * MS).cap(expected(None))),
        Box::new(shared),
    ] {
        let error = start(policy, Duration::ZERO).unwrap_err();
        assert!(matches!(error, SpawnError::Config(EngineConfigError::Linger { .. })), "{error}");
        assert!(error.to_string().contains("west") && error.to_string().contains("probe_every"));
    }
    assert!(start(Box::new(expected(None)), 400 * MS).is_ok());
    assert!(start(Box::new(expected(Some(16))), Duration::ZERO).is_ok());
}

#[tokio::test(start_paused = true)]
async fn an_expecting_policy_stops_waiting_for_a_cloud_that_is_gone_and_finds_it_when_it_returns() {
    let loss = Accuracy { local: 42.0, cloud: 58.0, price_per_ms: 0.01 };
    let expected = Expected::<_, 16>::new(loss, Duration::from_millis(20), Some(8)).unwrap();
    let policy = Constant(400 * MS).cap(expected);
    let (mut camera, frames) = stream(8);
    let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
        // The cloud is gone from message 40 to message 79.
        let action = |t| if (40..80).contains(&t) { Hangs } else { Answers(150) };
        cloud(setup, 1, action, Duration::MAX).policy = Some(Box::new(policy));
        local(20)
    });
    let (_running, mut output) = spawn(operator, Config::default(), frames).unwrap();
    let mut took = Vec::new();
    for t in 0..120 {
        camera.write(t).unwrap();
        let item = output.read().await.unwrap();
        took.push((item.latency().as_millis(), line(&item).contains("cloud 1's")));
    }
    assert!(took[16..40].iter().all(|took| *took == (150, true)), "{took:?}");
    // From sixteen ends after the outage began, the policy waits only for a probe, which is one
    // message in eight.
    let waits = took[56..80].iter().filter(|(ms, _)| *ms > 20).count();
    assert_eq!(waits, 3, "{took:?}");
    assert!(took[97..].iter().all(|took| *took == (150, true)), "{took:?}");
}
