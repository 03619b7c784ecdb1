//! Tests side requests and hints, which help local with later messages, and the state that they
//! share with local.

use std::future::pending;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::support::{ClosureOperator, line, play};
use fuseline_tokio::{
    Call, Config, DropReason, Error, Local, Running, Setup, SharedState, SideTally, SpawnError,
    spawn, stream,
};
use tokio::time::{Instant, sleep, sleep_until};

const MS: Duration = Duration::from_millis(1);

/// An action of a service on a message, in ms from the request.
#[derive(Clone, Copy)]
enum ServiceAction {
    Answers(u32),
    Fails(u32),
    Panics(u32),
    Hangs,
}
use ServiceAction::{Answers, Fails, Hangs, Panics};

type Plan = SharedState<String>;

/// Acts on a request for a plan. The plan names its message and the instant of the request.
async fn plan(does: ServiceAction, t: u64, start: Instant) -> Result<String, Error> {
    let requested = start.elapsed().as_millis();
    match does {
        Answers(ms) => sleep(ms * MS).await,
        Fails(ms) => {
            sleep(ms * MS).await;
            return Err("on purpose".into());
        }
        Panics(ms) => {
            sleep(ms * MS).await;
            panic!("on purpose")
        }
        Hangs => pending().await,
    }
    Ok(format!("plan of {t} from {requested} ms"))
}

/// Returns a local computation that takes 20 ms. Its result names the plan that it had when it
/// began.
fn local(plan: &Plan) -> Local<u64, String> {
    let plan = plan.clone();
    Local::futures(64, move |_, t| {
        let had = plan.with(|plan| plan.clone());
        async move {
            sleep(20 * MS).await;
            Ok(format!("local's of {t} by {had}"))
        }
    })
}

/// Registers a side request with a deadline of 100 ms that stores each plan.
fn planner(setup: &mut Setup<u64, String>, last_plan: &Plan, action: fn(u64) -> ServiceAction) {
    let start = Instant::now();
    let last_plan = last_plan.clone();
    let handle = move |t, call: Call| {
        call.sent(10);
        plan(action(t), t, start)
    };
    let response_handler = move |plan| {
        last_plan.with(|last_plan| *last_plan = plan);
        Ok(())
    };
    setup.use_side_request(handle, |_, t| Some((t, 100 * MS)), response_handler);
}

/// Plays messages at these milliseconds. Returns the items and the tallies of the side requests.
async fn watched(
    messages: &[u64],
    config: Config,
    setup: impl FnOnce(&mut Setup<u64, String>) -> Local<u64, String>,
) -> (Vec<String>, Vec<SideTally>) {
    let (mut camera, frames) = stream(64);
    let (running, mut output): (Running, _) =
        spawn(ClosureOperator(setup), config, frames).unwrap();
    let (start, messages) = (Instant::now(), messages.to_vec());
    tokio::spawn(async move {
        for (t, ms) in (0..).zip(messages) {
            sleep_until(start + Duration::from_millis(ms)).await;
            camera.write(t).unwrap();
        }
        sleep(1000 * MS).await;
    });
    let mut items = Vec::new();
    while let Some(item) = output.read().await {
        items.push(line(&item));
    }
    (items, running.sides())
}

#[tokio::test(start_paused = true)]
async fn an_answer_serves_later_messages_and_is_no_output() {
    let setup = |setup: &mut Setup<u64, String>| {
        let last_plan = Plan::new("none".into());
        planner(setup, &last_plan, |_| Answers(50));
        local(&last_plan)
    };
    let (items, sides) = watched(&[0, 30, 60], Config::default(), setup).await;
    assert_eq!(
        items,
        [
            "20.000 ms: 0 local's of 0 by none by arrival from 20 ms",
            "50.000 ms: 1 local's of 1 by none by arrival from 50 ms",
            "80.000 ms: 2 local's of 2 by plan of 0 from 0 ms by arrival from 80 ms",
        ]
    );
    let expected = SideTally {
        name: "side-1".into(),
        requested: 3,
        refused: 0,
        answered: 3,
        failed: 0,
        expired: 0,
        handler_failed: 0,
        sent_bytes: 30,
    };
    assert_eq!(sides, [expected]);
}

#[tokio::test(start_paused = true)]
async fn what_fails_panics_or_comes_when_it_is_due_changes_nothing() {
    let action = |t| {
        [Fails(10), Panics(10), Answers(100), Hangs, Answers(99), Hangs]
            [usize::try_from(t).unwrap()]
    };
    let last_plan = Plan::new("none".into());
    let shared = last_plan.clone();
    let setup = move |setup: &mut Setup<u64, String>| {
        planner(setup, &last_plan, action);
        local(&last_plan)
    };
    let (items, sides) = watched(&[0, 200, 400, 600, 800, 1000], Config::default(), setup).await;
    let expected = (0..6).map(|t| {
        let plan = if t == 5 { "plan of 4 from 800 ms" } else { "none" };
        let at = 200 * t + 20;
        format!("{at}.000 ms: {t} local's of {t} by {plan} by arrival from {at} ms")
    });
    assert_eq!(items, expected.collect::<Vec<_>>());
    let [SideTally { requested: 6, answered: 1, failed: 2, expired: 3, .. }] = sides[..] else {
        panic!("{sides:?}")
    };
    assert_eq!(shared.with(|plan| plan.clone()), "plan of 4 from 800 ms");
}

#[tokio::test(start_paused = true)]
async fn a_plan_requested_as_of_a_cloud_would_hold_locals_output_back() {
    let start = Instant::now();
    let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
        let handle = move |t, _: Call| plan(Hangs, t, start);
        setup.use_cloud(handle, |_, t| Some((t, 100 * MS)), Ok, 1);
        local(&Plan::new("none".into()))
    });
    let played = play(operator, Config::default(), &[0]).await;
    assert_eq!(played.items, "100.000 ms: 0 local's of 0 by none by timer from 20 ms\n");
}

/// A side request with a deadline of 0 is refused, as a cloud's request is (F2).
#[tokio::test(start_paused = true)]
async fn a_side_request_without_time_is_refused() {
    let setup = |setup: &mut Setup<u64, String>| {
        let answer = |t: u64, _: Call| async move { Ok::<_, Error>(t) };
        setup.use_side_request(answer, |_, t| Some((t, Duration::ZERO)), |_| Ok(()));
        local(&Plan::new("none".into()))
    };
    let (_, sides) = watched(&[0, 30], Config::default(), setup).await;
    let SideTally { requested, refused, answered, expired, .. } = sides[0];
    assert_eq!((requested, refused, answered, expired), (0, 2, 0, 0));
}

#[tokio::test(start_paused = true)]
async fn asides_wait_for_a_place_and_beyond_the_gates_limit_they_are_refused_until_it_opens() {
    let reported = Arc::new(Mutex::new(Vec::new()));
    let shared = Arc::clone(&reported);
    let setup = move |setup: &mut Setup<u64, String>| {
        let handle = move |t: u64, call: Call| {
            reported.lock().unwrap().push((t, call.deadline));
            async move {
                sleep(60 * MS).await;
                Ok(())
            }
        };
        let side = setup.use_side_request(handle, |_, t| Some((t, 100 * MS)), Ok);
        (side.calls, side.limit, side.resume) = (1, 2, 0);
        local(&Plan::new("none".into()))
    };
    // 0 is called, 1 and 2 wait, and 3 is refused. 1 is called at 60 ms with 50 ms left, so it ends
    // at 110 ms, when it is due. Then 2 is called with 10 ms left. At 115 ms nothing waits any
    // more.
    let (items, sides) = watched(&[0, 10, 20, 30, 70, 115], Config::default(), setup).await;
    assert_eq!(items.len(), 6);
    let SideTally { requested, refused, answered, expired, .. } = sides[0];
    assert_eq!((requested, refused, answered, expired), (4, 2, 2, 2));
    assert_eq!(*shared.lock().unwrap(), [(0, 100 * MS), (1, 50 * MS), (2, 10 * MS), (5, 95 * MS)]);
}

#[tokio::test(start_paused = true)]
async fn a_service_that_is_gone_for_a_while_costs_no_output_and_serves_again_when_it_returns() {
    let setup = |setup: &mut Setup<u64, String>| {
        let last_plan = Plan::new("none".into());
        planner(setup, &last_plan, |t| if (10..40).contains(&t) { Hangs } else { Answers(5) });
        local(&last_plan)
    };
    let messages: Vec<u64> = (0..60).map(|t| 33 * t).collect();
    let (items, sides) = watched(&messages, Config::default(), setup).await;
    for (t, item) in items.iter().enumerate() {
        let last = if t < 11 { t.checked_sub(1) } else { Some(if t < 41 { 9 } else { t - 1 }) };
        let plan =
            last.map_or("none".into(), |last| format!("plan of {last} from {} ms", 33 * last));
        let at = 33 * t + 20;
        assert_eq!(
            *item,
            format!("{at}.000 ms: {t} local's of {t} by {plan} by arrival from {at} ms")
        );
    }
    let SideTally { requested, answered, expired, .. } = sides[0];
    assert_eq!((items.len(), requested, answered, expired), (60, 60, 30, 30));
}

#[tokio::test(start_paused = true)]
async fn a_message_handler_that_panics_is_counted_and_the_next_message_has_its_request() {
    let setup = |setup: &mut Setup<u64, String>| {
        let handler = |_: &u64, t: u64| {
            assert_ne!(t, 1, "on purpose");
            Some(((), 100 * MS))
        };
        setup.use_side_request(|(), _| async { Ok(()) }, handler, Ok);
        local(&Plan::new("none".into()))
    };
    let (items, sides) = watched(&[0, 30, 60], Config::default(), setup).await;
    assert_eq!(items.len(), 3);
    let SideTally { requested, answered, failed, handler_failed, .. } = sides[0];
    assert_eq!((requested, answered, failed, handler_failed), (2, 2, 0, 1));
}

#[tokio::test(start_paused = true)]
async fn no_aside_is_made_for_a_message_that_was_refused() {
    let setup = |setup: &mut Setup<u64, String>| {
        let last_plan = Plan::new("none".into());
        planner(setup, &last_plan, |_| Answers(5));
        local(&last_plan)
    };
    let config = Config { window: 1, ..Config::default() };
    let (items, sides) = watched(&[0, 10, 30], config, setup).await;
    assert_eq!(items[0], "10.000 ms: 1 refused full");
    assert_eq!(sides[0].requested, 2);
}

#[tokio::test(start_paused = true)]
async fn asides_are_dropped_when_the_operator_ends() {
    struct RecordingPolicy(Arc<Mutex<bool>>);
    impl Drop for RecordingPolicy {
        fn drop(&mut self) {
            *self.0.lock().unwrap() = true;
        }
    }
    let dropped = Arc::new(Mutex::new(false));
    let shared = Arc::clone(&dropped);
    let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
        let handle = move |(), _| {
            let noting = RecordingPolicy(Arc::clone(&dropped));
            async move {
                let _noting = noting;
                pending().await
            }
        };
        setup.use_side_request(handle, |_, _| Some(((), 3600 * 1000 * MS)), Ok);
        local(&Plan::new("none".into()))
    });
    play(operator, Config::default(), &[0]).await;
    tokio::task::yield_now().await;
    assert!(*shared.lock().unwrap());
}

#[tokio::test]
async fn an_aside_whose_gate_could_never_open_is_refused() {
    let operator = ClosureOperator(|setup: &mut Setup<u64, String>| {
        let last_plan = Plan::default();
        planner(setup, &last_plan, |_| Hangs);
        setup.use_side_request(|(), _| async { Ok(()) }, |_, _| None, Ok).resume = 31;
        local(&last_plan)
    });
    let error = spawn(operator, Config::default(), stream(1).1).unwrap_err();
    assert!(matches!(&error, SpawnError::SideRequest { name } if name == "side-2"), "{error}");
}

/// Adds a cloud with a deadline of 30 ms, which answers after `ms` and may linger for 100 ms.
fn slow_cloud(setup: &mut Setup<u64, String>, ms: u32) {
    let start = Instant::now();
    let handle = move |t, _: Call| async move {
        let requested = start.elapsed().as_millis();
        sleep(ms * MS).await;
        Ok(format!("cloud's of {t}, asked at {requested} ms"))
    };
    setup.use_cloud(handle, |_, t| Some((t, 30 * MS)), Ok, 1).linger = 100 * MS;
}

#[tokio::test(start_paused = true)]
async fn a_result_that_comes_too_late_is_a_hint_for_the_next_messages_and_no_output() {
    let operator = ClosureOperator(|setup: &mut Setup<u64, String>| {
        let last = Plan::new("nothing".into());
        slow_cloud(setup, 50);
        let last_plan = last.clone();
        setup.on_late_result(move |hint| {
            let age = hint.age.as_millis();
            last_plan.with(|last_plan| {
                *last_plan = format!("{} {age} ms old, {}", hint.value, hint.why);
            });
        });
        local(&last)
    });
    let played = play(operator, Config::default(), &[0, 40, 60]).await;
    assert_eq!(
        played.items,
        "30.000 ms: 0 local's of 0 by nothing by timer from 20 ms\n\
         70.000 ms: 1 local's of 1 by nothing by timer from 60 ms\n\
         90.000 ms: 2 local's of 2 by cloud's of 0, asked at 0 ms 50 ms old, superseded by timer \
         from 80 ms\n"
    );
}

#[tokio::test(start_paused = true)]
async fn hints_are_late_and_superseded_results_of_any_source_with_their_age() {
    let hints = Arc::new(Mutex::new(Vec::new()));
    let shared = Arc::clone(&hints);
    let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
        setup.on_late_result(move |hint| {
            let source = hint.source.to_string();
            hints.lock().unwrap().push((hint.timestamp, source, hint.value, hint.age, hint.why));
            assert_ne!(hint.timestamp, 0, "on purpose");
        });
        slow_cloud(setup, 50);
        let quick = |t, _: Call| async move {
            sleep(10 * MS).await;
            Ok(format!("quick's of {t}"))
        };
        // The second message has only local and the slow cloud. Local takes 60 ms.
        let message_handler = |_: &u64, t| (t != 1).then_some((t, 100 * MS));
        setup.use_cloud(quick, message_handler, Ok, 2);
        Local::futures(8, |_, t| async move {
            sleep(60 * MS).await;
            Ok(format!("local's of {t}"))
        })
    });
    let played = play(operator, Config::default(), &[0, 200, 400]).await;
    assert!(played.items.contains("260.000 ms: 1 local's of 1 by arrival"), "{}", played.items);
    let words = |(t, who, action, age, why): (u64, &str, &str, u32, DropReason)| {
        (t, who.to_owned(), action.to_owned(), age * MS, why)
    };
    let (late, superseded) = (DropReason::Late, DropReason::Superseded);
    let expected = [
        (0, "cloud-1", "cloud's of 0, asked at 0 ms", 50, superseded),
        (0, "local", "local's of 0", 60, superseded),
        (1, "cloud-1", "cloud's of 1, asked at 200 ms", 50, late),
    ]
    .map(words);
    assert_eq!(*shared.lock().unwrap(), expected);
}

#[test]
fn what_is_common_outlives_a_panic() {
    let common = SharedState::new(1);
    let other = common.clone();
    let panicked = std::thread::spawn(move || {
        other.with(|number| {
            *number = 2;
            panic!("on purpose");
        });
    });
    assert!(panicked.join().is_err());
    assert_eq!(common.with(|number| *number), 2);
}
