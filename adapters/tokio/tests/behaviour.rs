//! Tests how operators treat calls, handlers and threads, and how they work together.

use std::future::pending;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Barrier, Mutex};
use std::time::Duration;

use crate::support::SourceAction::{Answers, Never};
use crate::support::{ClosureOperator, Script, line, play, without_deadline};
use fuseline_tokio::{
    Call, Config, Ending, Error, Item, Local, Operator, Setup, SpawnError, Trace, WriteError,
    spawn, stream,
};
use futures_util::{FutureExt, StreamExt};
use tokio::time::{Instant, advance, sleep};

const MS: Duration = Duration::from_millis(1);

async fn after(ms: u32, value: &str) -> Result<String, Error> {
    sleep(ms * MS).await;
    Ok(value.into())
}

fn local_after(ms: u32) -> Local<u64, String> {
    Local::futures(64, move |_, _| after(ms, "local"))
}

/// Records the instant when it is dropped.
struct Dropped(Arc<Mutex<Vec<(u16, Duration)>>>, u16, Instant);

impl Drop for Dropped {
    fn drop(&mut self) {
        self.0.lock().unwrap().push((self.1, self.2.elapsed()));
    }
}

/// A cancelled call, and a call whose timer fired, are dropped at once (D6).
#[tokio::test(start_paused = true)]
async fn a_cancelled_call_and_one_whose_timer_fired_are_dropped_at_once() {
    let dropped = Arc::new(Mutex::new(Vec::new()));
    let shared = Arc::clone(&dropped);
    let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
        let start = Instant::now();
        for (priority, deadline, answers) in [(1, 500, None), (2, 10, None), (3, 500, Some(30))] {
            let dropped = Arc::clone(&dropped);
            let handle = move |(), _| {
                let guard = Dropped(Arc::clone(&dropped), priority, start);
                async move {
                    let _guard = guard;
                    match answers {
                        Some(ms) => after(ms, "cloud").await,
                        None => pending().await,
                    }
                }
            };
            setup.use_cloud(handle, move |_, _| Some(((), deadline * MS)), Ok, priority);
        }
        local_after(20)
    });
    let played = play(operator, Config::default(), &[0]).await;
    assert_eq!(played.items, "30.000 ms: 0 cloud by arrival from 30 ms\n");
    let mut shared = shared.lock().unwrap().clone();
    shared.sort_unstable();
    assert_eq!(shared, [(1, 30 * MS), (2, 10 * MS), (3, 30 * MS)]);
}

/// Each of 250 simultaneous calls is woken and aborted independently (D6).
#[tokio::test(start_paused = true)]
async fn of_many_calls_at_once_each_ends_for_its_own_message() {
    let operator = ClosureOperator(|setup: &mut Setup<u64, String>| {
        let all = |_: &u64, _| Some(((), 100 * MS));
        setup.use_cloud(|(), _| after(50, "second"), all, Ok, 1).calls = 100;
        let even = |message: &u64, _| message.is_multiple_of(2).then_some(((), 100 * MS));
        setup.use_cloud(|(), _| after(30, "best"), even, Ok, 2).calls = 100;
        Local::futures(100, |_, _| after(20, "local"))
    });
    let config = Config { window: 100, ..Config::default() };
    let played = play(operator, config, &[0; 100]).await;
    let mut items: Vec<_> = played.items.lines().collect();
    items.sort_unstable();
    let mut expected: Vec<_> = (0..100)
        .map(|t| match t % 2 {
            0 => format!("30.000 ms: {t} best by arrival from 30 ms"),
            _ => format!("50.000 ms: {t} second by arrival from 50 ms"),
        })
        .collect();
    expected.sort_unstable();
    assert_eq!(items, expected);
}

/// A response handler that panics or returns an error makes the result a failure at its arrival
/// (D7).
#[tokio::test(start_paused = true)]
async fn a_response_handler_that_panics_or_errs_is_a_failure_when_the_response_arrives() {
    let operator = ClosureOperator(|setup: &mut Setup<u64, String>| {
        let handle = |message, _| async move {
            sleep(50 * MS).await;
            Ok(message)
        };
        let response_handler = |message| match message {
            0 => panic!("on purpose"),
            1 => Err("on purpose".into()),
            _ => Ok("cloud".into()),
        };
        setup.use_cloud(handle, |m, _| Some((*m, 100 * MS)), response_handler, 1);
        local_after(20)
    });
    let played = play(operator, Config::default(), &[0, 100, 200]).await;
    assert_eq!(
        played.items,
        "50.000 ms: 0 local by failure from 20 ms\n150.000 ms: 1 local by failure from 120 ms\n\
         250.000 ms: 2 cloud by arrival from 250 ms\n"
    );
}

/// A result counts at the instant when its response handler has ended, not when the response
/// arrived (D3).
#[tokio::test(start_paused = true)]
async fn a_result_whose_response_handler_takes_until_it_is_due_is_late() {
    for (busy, becomes) in [
        (9, "29.000 ms: 0 cloud by arrival from 29 ms\n"),
        (10, "30.000 ms: 0 local by timer from 10 ms\n"),
        (80, "100.000 ms: 0 local by timer from 10 ms\n"),
    ] {
        let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
            let response_handler = move |response| {
                // The clock advances while this handler blocks the only thread.
                advance(busy * MS).now_or_never();
                Ok(response)
            };
            setup.use_cloud(
                |(), _| after(20, "cloud"),
                |_, _| Some(((), 30 * MS)),
                response_handler,
                1,
            );
            local_after(10)
        });
        assert_eq!(play(operator, Config::default(), &[0]).await.items, becomes, "{busy} ms");
    }
}

/// A call gets the time that is left, and a request that waited too long is never sent (D5).
#[tokio::test(start_paused = true)]
async fn a_call_has_the_time_left_and_one_that_waited_too_long_is_never_made() {
    let reported = Arc::new(Mutex::new(Vec::new()));
    let shared = Arc::clone(&reported);
    let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
        let handle = move |(), call: Call| {
            reported.lock().unwrap().push((call.timestamp, call.deadline));
            pending()
        };
        // The first call occupies the only place for 60 ms.
        let message_handler = |m: &u64, _| {
            let deadline = match m {
                0 => 60,
                1 => 50,
                _ => 100,
            };
            Some(((), deadline * MS))
        };
        let cloud = setup.use_cloud(handle, message_handler, Ok, 1);
        (cloud.calls, cloud.limit) = (1, Some(31));
        local_after(20)
    });
    play(operator, Config::default(), &[0, 0, 10]).await;
    assert_eq!(*shared.lock().unwrap(), [(0, 60 * MS), (2, 50 * MS)]);
}

#[tokio::test(start_paused = true)]
async fn a_local_computation_outlives_its_message_and_is_superseded() {
    let ended = Arc::new(AtomicU64::new(0));
    let shared = Arc::clone(&ended);
    let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
        setup.use_cloud(|(), _| after(10, "cloud"), |_, _| Some(((), 50 * MS)), Ok, 1);
        Local::futures(2, move |_, _| {
            let ended = Arc::clone(&ended);
            async move {
                sleep(30 * MS).await;
                ended.fetch_add(1, Ordering::Relaxed);
                Ok("local".into())
            }
        })
    });
    let played = play(operator, Config::default(), &[0, 100]).await;
    // The second message was still being computed when the operator ended.
    assert_eq!(shared.load(Ordering::Relaxed), 1);
    assert!(played.trace.contains(r#""p":0,"why":"superseded""#), "{}", played.trace);
}

#[tokio::test(start_paused = true)]
async fn beyond_what_may_wait_local_fails_and_the_cloud_alone_answers() {
    let operator = ClosureOperator(|setup: &mut Setup<u64, String>| {
        setup.use_cloud(|(), _| after(50, "cloud"), |_, _| Some(((), 100 * MS)), Ok, 1);
        let mut local = Local::future(|_, _| after(1000, "local"));
        local.waiting = Some(1);
        local
    });
    let played = play(operator, Config::default(), &[0, 1, 2]).await;
    assert_eq!(played.items.lines().filter(|line| line.contains("cloud")).count(), 3);
    assert_eq!(played.tally.sources[0].failed, 1);
    assert!(played.trace.contains(r#"{"ev":"fail","at":2000000,"t":1,"p":0}"#), "{}", played.trace);
}

#[tokio::test(start_paused = true)]
async fn answered_messages_are_computed_unless_set_to_skip_them() {
    for (skip_answered, expected) in [(false, vec![0, 1, 2, 3]), (true, vec![0, 3])] {
        let computed = Arc::new(Mutex::new(Vec::new()));
        let shared = Arc::clone(&computed);
        let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
            // The cloud answers all but the last message while local computes the first.
            let message_handler = |m: &u64, _| (*m < 3).then_some(((), 50 * MS));
            setup.use_cloud(|(), _| after(10, "cloud"), message_handler, Ok, 1);
            let mut local = Local::future(move |message: Arc<u64>, _| {
                computed.lock().unwrap().push(*message);
                after(100, "local")
            });
            local.skip_answered = skip_answered;
            local
        });
        play(operator, Config::default(), &[0, 1, 2, 90]).await;
        assert_eq!(*shared.lock().unwrap(), expected);
    }
}

#[tokio::test(start_paused = true)]
async fn operators_join_into_a_graph_and_readers_share_a_stream() {
    struct Tracker;
    impl Operator for Tracker {
        type Input = Item<String>;
        type Output = String;

        fn setup(self, _: &mut Setup<Self::Input, String>) -> Local<Self::Input, String> {
            Local::future(|item: Arc<Item<String>>, t| async move {
                sleep(5 * MS).await;
                Ok(format!("track {t} of [{}]", line(&item)))
            })
        }
    }
    let (mut camera, frames) = stream(8);
    let other_frames = frames.new_reader();
    let act = |t| if t == 0 { Never } else { Answers(30) };
    let detector = Script::new().cloud(1, 100, act);
    let (_, detections) = spawn(detector, Config::default(), frames).unwrap();
    let (_, mut log) = spawn(Script::new(), Config::default(), other_frames).unwrap();
    let (_, mut tracks) = spawn(Tracker, Config::default(), detections).unwrap();
    camera.write(0).unwrap();
    camera.write(1).unwrap();
    drop(camera);
    // The second message's detection comes first. The tracker numbers the items in the order of
    // their arrival.
    let tracked = tracks.read().await.unwrap();
    let words = "35.000 ms: 0 track 0 of [30.000 ms: 1 cloud 1 by arrival from 30 ms] by arrival \
                 from 35 ms";
    assert_eq!(line(&tracked), words);
    assert_eq!(tracks.read().await.unwrap().timestamp, 1);
    assert!(tracks.read().await.is_none());
    assert_eq!(log.read().await.unwrap().timestamp, 0);
    assert_eq!(log.read().await.unwrap().timestamp, 1);
    assert!(log.read().await.is_none());
}

/// Stopping aborts calls, ends the output, and leaves the trace complete (D10).
#[tokio::test(start_paused = true)]
async fn stopping_aborts_calls_ends_the_output_and_leaves_the_trace_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trace.jsonl");
    let trace = Some(Trace { path: path.clone(), recording: fuseline_tokio::Recording::default() });
    let dropped = Arc::new(Mutex::new(Vec::new()));
    let shared = Arc::clone(&dropped);
    let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
        let handle = move |(), _| {
            let guard = Dropped(Arc::clone(&dropped), 1, Instant::now());
            async move {
                let _guard = guard;
                pending().await
            }
        };
        setup.use_cloud(handle, |_, _| Some(((), 500 * MS)), Ok, 1);
        Local::future(|_, _| pending())
    });
    let (mut camera, frames) = stream(8);
    let (running, mut output) =
        spawn(operator, Config { trace, ..Config::default() }, frames).unwrap();
    camera.write(0).unwrap();
    sleep(10 * MS).await;
    running.stop();
    assert!(output.read().await.is_none());
    assert_eq!(running.join().await.unwrap().messages, 1);
    assert_eq!(camera.write(1), Err(WriteError::Closed(1)));
    tokio::task::yield_now().await;
    assert_eq!(shared.lock().unwrap().len(), 1);
    let written = std::fs::read_to_string(path).unwrap();
    assert_eq!(written.lines().count(), 5, "{written}");
    // The last tick says that the run is over (A44).
    let last = concat!(
        "{\"ev\":\"request\",\"at\":0,\"t\":0,\"p\":1,\"due\":500000000}\n",
        "{\"ev\":\"tick\",\"at\":10000000}\n"
    );
    assert!(written.ends_with(last), "{written}");
}

#[test]
fn a_dropped_runtime_leaves_the_trace_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trace.jsonl");
    let trace = Some(Trace { path: path.clone(), recording: fuseline_tokio::Recording::default() });
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let running = runtime.block_on(async {
        let (mut camera, frames) = stream(8);
        let script = Script::new().cloud(1, 60_000, |_| Never);
        let (running, _) = spawn(script, Config { trace, ..Config::default() }, frames).unwrap();
        camera.write(0).unwrap();
        while running.tally().sources[1].admitted == 0 {
            tokio::task::yield_now().await;
        }
        running
    });
    drop(runtime);
    let written = std::fs::read_to_string(path).unwrap();
    assert_eq!(written.lines().count(), 4, "{written}");
    let other = tokio::runtime::Builder::new_current_thread().build().unwrap();
    other.block_on(running.join()).expect_err("it was not let end");
}

/// A reader that lags delays new messages, and no message is lost (D8).
#[tokio::test(start_paused = true)]
async fn a_reader_that_lags_holds_back_new_messages_and_loses_none() {
    let (camera, frames) = stream(1);
    let config = Config { output_len: 1, window: 2, ..Config::default() };
    let (running, mut output) = spawn(Script::new(), config, frames).unwrap();
    let messages = futures_util::stream::iter(0..8).then(async |i| {
        sleep(30 * MS).await;
        i
    });
    let camera = tokio::spawn(camera.write_all(messages));
    sleep(1000 * MS).await;
    // One item is on the stream and one waits. No further message was accepted.
    assert_eq!(running.tally().messages, 2);
    for t in 0..8 {
        let item = output.read().await.unwrap();
        assert_eq!(item.timestamp, t);
        assert!(matches!(item.ending, Ending::Forwarded(_)));
    }
    assert!(output.read().await.is_none());
    assert_eq!(camera.await.unwrap(), Ok(8));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn on_several_threads_a_call_that_blocks_its_own_holds_up_no_message() {
    let (release, blocked) = std::sync::mpsc::channel::<()>();
    let blocked = Arc::new(Mutex::new(Some(blocked)));
    let dropped = Arc::new(Mutex::new(Vec::new()));
    let shared = Arc::clone(&dropped);
    let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
        let start = Instant::now();
        let handle = move |t: u64, _| {
            let blocked = blocked.lock().unwrap().take();
            let guard = Dropped(Arc::clone(&dropped), 1, start);
            async move {
                let _guard = guard;
                match (blocked, t) {
                    (Some(blocked), _) => blocked.recv().unwrap_err(),
                    (None, 1) => panic!("on purpose"),
                    (None, 2) => return Ok("cloud".into()),
                    (None, _) => pending().await,
                };
                Err("it was let go".into())
            }
        };
        setup.use_cloud(handle, |_, t| Some((t, 30 * MS)), Ok, 1);
        Local::future(|_, t| async move { Ok(format!("local's of {t}")) })
    });
    let (mut camera, frames) = stream(8);
    let (running, mut output) = spawn(operator, Config::default(), frames).unwrap();
    let mut values = Vec::new();
    for frame in 0..4 {
        camera.write(frame).unwrap();
        let item = output.read().await.unwrap();
        let forwarded = item.forwarded().unwrap();
        values.push(forwarded.value.clone());
    }
    assert_eq!(values, ["local's of 0", "local's of 1", "cloud", "local's of 3"]);
    drop((camera, release));
    assert_eq!(running.join().await.unwrap().forwarded(), 4);
    // The last call was dropped when its timer fired, and the first ended by itself.
    while shared.lock().unwrap().len() < 4 {
        tokio::task::yield_now().await;
    }
}

#[tokio::test(start_paused = true)]
async fn an_operator_ends_when_its_last_items_are_read_long_after_they_were_decided() {
    let (mut camera, frames) = stream(8);
    let config = Config { output_len: 1, ..Config::default() };
    let (running, mut output) = spawn(Script::new(), config, frames).unwrap();
    for frame in 0..3 {
        camera.write(frame).unwrap();
    }
    drop(camera);
    sleep(1000 * MS).await;
    for t in 0..3 {
        assert_eq!(output.read().await.unwrap().timestamp, t);
    }
    assert!(output.read().await.is_none());
    assert_eq!(running.join().await.unwrap().forwarded(), 3);
}

#[tokio::test(start_paused = true)]
async fn a_camera_and_the_reader_of_its_output_in_one_task_never_wait_for_each_other() {
    let (mut camera, frames) = stream(1);
    let config = Config { output_len: 1, window: 2, ..Config::default() };
    let (running, mut output) = spawn(Script::new(), config, frames).unwrap();
    let mut ticks = tokio::time::interval(10 * MS);
    let (mut lost, mut read) = (0, 0);
    for frame in 0..50 {
        ticks.tick().await;
        // For a while nobody reads, although frames come.
        if !(10..30).contains(&frame) {
            while let Ok(Some(_)) = tokio::time::timeout(Duration::ZERO, output.read()).await {
                read += 1;
            }
        }
        match camera.write(frame) {
            Ok(_) => {}
            Err(WriteError::Full(_)) => lost += 1,
            Err(WriteError::Closed(_)) => panic!("the operator ended"),
        }
    }
    drop(camera);
    while output.read().await.is_some() {
        read += 1;
    }
    assert!(lost > 10, "{lost}");
    assert_eq!(read + lost, 50);
    let tally = running.join().await.unwrap();
    assert_eq!(tally.messages + tally.refused.values().sum::<u64>(), read);
}

#[tokio::test]
async fn threads_compute_as_many_messages_at_once_as_there_are() {
    let barrier = Arc::new(Barrier::new(4));
    let operator = ClosureOperator(move |_: &mut Setup<u64, String>| {
        without_deadline(Local::threads(4, move || {
            let barrier = Arc::clone(&barrier);
            let mut computed = 0;
            move |_: &u64, _| {
                // The barrier opens only if four threads wait at once.
                barrier.wait();
                computed += 1;
                Ok(format!("the thread's number {computed}"))
            }
        }))
    });
    let (mut camera, frames) = stream(8);
    let (_, mut output) = spawn(operator, Config::default(), frames).unwrap();
    for i in 0..8 {
        camera.write(i).unwrap();
    }
    drop(camera);
    let mut last = 0;
    while let Some(item) = output.read().await {
        let value = &item.forwarded().unwrap().value;
        last += u64::from(value == "the thread's number 2");
    }
    assert_eq!(last, 4);
}

#[tokio::test]
async fn a_thread_that_panics_goes_on_with_the_next_message() {
    let operator = ClosureOperator(|_: &mut Setup<u64, String>| {
        without_deadline(Local::blocking(|message: &u64, _| {
            assert_ne!(*message, 0, "on purpose");
            Ok("local".into())
        }))
    });
    let (mut camera, frames) = stream(8);
    let (_, mut output) = spawn(operator, Config::default(), frames).unwrap();
    camera.write(0).unwrap();
    camera.write(1).unwrap();
    assert_eq!(output.read().await.unwrap().ending, Ending::Missed);
    assert_eq!(output.read().await.unwrap().forwarded().unwrap().value, "local");
}

#[tokio::test]
async fn what_cannot_be_is_refused_before_anything_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trace.jsonl");
    let trace = Some(Trace { path: path.clone(), recording: fuseline_tokio::Recording::default() });
    let twins = Script::new().cloud(1, 10, |_| Never).cloud(1, 10, |_| Never);
    let config = Config { trace, ..Config::default() };
    let error = spawn(twins, config, stream(1).1).unwrap_err();
    assert!(matches!(error, SpawnError::Config(_)), "{error}");
    assert!(error.to_string().contains("two clouds with priority 1"), "{error}");
    assert!(!path.exists());

    let window = Config { window: 0, ..Config::default() };
    assert!(matches!(spawn(Script::new(), window, stream(1).1), Err(SpawnError::Config(_))));

    let nothing = Config { output_len: 0, ..Config::default() };
    assert!(matches!(spawn(Script::new(), nothing, stream(1).1), Err(SpawnError::NoOutput)));

    let nowhere = Some(Trace {
        path: folder.path().join("no/such/folder"),
        recording: fuseline_tokio::Recording::default(),
    });
    let nowhere = Config { trace: nowhere, ..Config::default() };
    assert!(matches!(spawn(Script::new(), nowhere, stream(1).1), Err(SpawnError::Trace { .. })));
}
