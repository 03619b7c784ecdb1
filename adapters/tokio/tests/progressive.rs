//! Tests the progressive commit rule: each better result is sent at once, and the last one is
//! marked (F9, D1). Every trace is judged.

use std::future::pending;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::support::{ClosureOperator, RunResult, line, play};
use fuseline_tokio::deadline::{Accuracy, Constant, Expected, Guard, Parameters, Policy};
use fuseline_tokio::{
    Commit, Config, Ending, EngineConfigError, Error, Item, Items, Join, JoinConfig,
    JoinDropReason, Lineage, Local, Operator, Reader, Recording, Setup, SpawnError, Trace, spawn,
    stream,
};
use fuseline_traces::judge;
use tokio::time::{Instant, sleep};

const MS: Duration = Duration::from_millis(1);

/// An action of a source on a message.
#[derive(Clone, Copy)]
enum Reply {
    After(u32),
    Panics(u32),
    Never,
}
use Reply::{After, Never, Panics};

/// Acts on a message. The value names the source and the message.
async fn reply(source: &str, t: u64, reply: Reply) -> Result<String, Error> {
    match reply {
        After(ms) => sleep(ms * MS).await,
        Panics(ms) => {
            sleep(ms * MS).await;
            panic!("on purpose")
        }
        Never => pending().await,
    }
    Ok(format!("{source}'s of {t}"))
}

/// Returns an operator whose local takes 20 ms, with clouds of priorities from 1 on. Each cloud has
/// a deadline of 100 ms.
fn operator<const N: usize>(
    clouds: [fn(u64) -> Reply; N],
) -> impl Operator<Input = u64, Output = String> {
    ClosureOperator(move |setup: &mut Setup<u64, String>| {
        for (priority, does) in (1..).zip(clouds) {
            let handle = move |t, _| async move { reply(&format!("{priority}"), t, does(t)).await };
            setup.use_cloud(handle, |_, t| Some((t, 100 * MS)), Ok, priority);
        }
        Local::futures(64, |_, t| reply("local", t, After(20)))
    })
}

fn progressive() -> Config {
    Config { commit: Commit::Progressive, ..Config::default() }
}

async fn played<const N: usize>(clouds: [fn(u64) -> Reply; N], messages_ms: &[u64]) -> RunResult {
    play(operator(clouds), progressive(), messages_ms).await
}

#[tokio::test(start_paused = true)]
async fn each_better_result_is_an_item_at_once_and_the_last_one_is_marked() {
    let played =
        played([|_| After(50), |_| After(40), |t| After(if t == 0 { 90 } else { 30 })], &[0, 10])
            .await;
    assert_eq!(
        played.items,
        "20.000 ms: 0 local's of 0 preliminary 0\n\
         30.000 ms: 1 local's of 1 preliminary 0\n\
         40.000 ms: 0 2's of 0 preliminary 1\n\
         40.000 ms: 1 3's of 1 by arrival from 40 ms\n\
         90.000 ms: 0 3's of 0 by arrival from 90 ms\n"
    );
    let counts: Vec<_> = played
        .tally
        .sources
        .iter()
        .map(|it| (it.preliminary, it.forwarded(), it.cancelled))
        .collect();
    assert_eq!(counts, [(2, 0, 0), (0, 0, 2), (1, 0, 1), (0, 2, 0)]);
    assert_eq!(played.trace.matches(r#""ev":"final""#).count(), 2);
}

/// If no better result comes, a timer or a failure makes the result that was sent before final (D7,
/// F9).
#[tokio::test(start_paused = true)]
async fn when_no_better_result_comes_what_was_sent_is_final_by_a_timer_or_a_failure() {
    let played = played([|t| if t == 0 { Never } else { Panics(30) }], &[0, 200]).await;
    assert_eq!(
        played.items,
        "20.000 ms: 0 local's of 0 preliminary 0\n100.000 ms: 0 final 1: local\n\
         220.000 ms: 1 local's of 1 preliminary 0\n230.000 ms: 1 final 1: local\n"
    );
    assert_eq!((played.tally.forwarded(), played.tally.sources[0].finals), (2, 2));
}

/// A call that panics between two outputs takes none back, and the next output reports it (D7).
#[tokio::test(start_paused = true)]
async fn a_call_that_panics_between_two_outputs_takes_none_back_and_is_reported_with_the_next_one()
{
    let (mut camera, frames) = stream(8);
    let clouds: [fn(u64) -> Reply; 2] = [|_| Panics(30), |_| After(60)];
    let (running, mut output) = spawn(operator(clouds), progressive(), frames).unwrap();
    camera.write(0).unwrap();
    drop(camera);
    let mut read = Vec::new();
    while let Some(item) = output.read().await {
        let failed: Vec<_> = item.failures.iter().map(|it| it.source.priority).collect();
        read.push((line(&item), failed));
    }
    let expected = [
        ("20.000 ms: 0 local's of 0 preliminary 0", vec![]),
        ("60.000 ms: 0 2's of 0 by arrival from 60 ms", vec![1]),
    ];
    assert_eq!(read, expected.map(|(line, failed)| (line.to_owned(), failed)));
    assert_eq!(running.join().await.unwrap().forwarded(), 1);
}

/// A stop between two outputs leaves the trace complete, and no item is marked as last (D10).
#[tokio::test(start_paused = true)]
async fn a_stop_between_two_outputs_leaves_the_trace_whole_and_no_item_marked_last() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trace.jsonl");
    let trace = Some(Trace { path: path.clone(), recording: Recording::default() });
    let (mut camera, frames) = stream(8);
    let config = Config { trace, ..progressive() };
    let clouds: [fn(u64) -> Reply; 1] = [|_| Never];
    let (running, mut output) = spawn(operator(clouds), config, frames).unwrap();
    let mut last = output.new_reader().last_only();
    camera.write(0).unwrap();
    let item = output.read().await.unwrap();
    assert!(matches!(item.ending, Ending::Preliminary(_)) && !item.is_last());
    running.stop();
    assert!(output.read().await.is_none() && last.read().await.is_none());
    let tally = running.join().await.unwrap();
    assert_eq!((tally.messages, tally.forwarded(), tally.sources[0].preliminary), (1, 0, 1));
    let written = std::fs::read_to_string(path).unwrap();
    let verdict = judge("trace", written.as_bytes()).unwrap();
    assert!(verdict.violations.is_empty() && written.lines().count() == 7, "{verdict}\n{written}");
}

/// A reader of only last items reads one for each message, with its value (D1).
#[tokio::test(start_paused = true)]
async fn a_reader_of_last_items_alone_reads_one_for_each_message_with_its_value() {
    let (mut camera, frames) = stream(8);
    let clouds: [fn(u64) -> Reply; 2] =
        [|t| if t == 1 { Never } else { After(50) }, |t| if t == 0 { After(70) } else { Never }];
    let (_, output) = spawn(operator(clouds), progressive(), frames).unwrap();
    let mut every = output.new_reader();
    let read = |mut reader: Reader<Item<String>>| async move {
        let mut lines = Vec::new();
        while let Some(item) = reader.read().await {
            lines.push(line(&item));
        }
        lines
    };
    let last = tokio::spawn(read(output.last_only()));
    (0..3).for_each(|t| assert_eq!(camera.write(t), Ok(t)));
    drop(camera);
    let mut items = 0;
    while every.read().await.is_some() {
        items += 1;
    }
    assert_eq!(items, 3 + 2 + 1 + 2);
    let expected = [
        "70.000 ms: 0 2's of 0 by arrival from 70 ms",
        "100.000 ms: 1 local's of 1 by arrival from 20 ms",
        "100.000 ms: 2 1's of 2 by arrival from 50 ms",
    ];
    assert_eq!(last.await.unwrap(), expected);
}

/// An operator that reads only another's last items gets one message for each.
#[tokio::test(start_paused = true)]
async fn last_items_alone_are_the_messages_of_the_next_operator() {
    struct Tracker(Arc<Mutex<Vec<String>>>);
    impl Operator for Tracker {
        type Input = Item<String>;
        type Output = u64;

        fn setup(self, _: &mut Setup<Self::Input, u64>) -> Local<Self::Input, u64> {
            Local::future(move |item: Arc<Item<String>>, t| {
                self.0.lock().unwrap().push(item.forwarded().unwrap().value.clone());
                async move { Ok(t) }
            })
        }
    }
    let (mut camera, frames) = stream(8);
    let clouds: [fn(u64) -> Reply; 1] = [|t| if t == 0 { Never } else { After(30) }];
    let (_, detections) = spawn(operator(clouds), progressive(), frames).unwrap();
    let received = Arc::default();
    let tracker = Tracker(Arc::clone(&received));
    let (running, mut tracks) = spawn(tracker, Config::default(), detections.last_only()).unwrap();
    camera.write(0).unwrap();
    camera.write(1).unwrap();
    drop(camera);
    while tracks.read().await.is_some() {}
    assert_eq!(running.join().await.unwrap().forwarded(), 2);
    assert_eq!(*received.lock().unwrap(), ["1's of 1", "local's of 0"]);
}

/// Only the newest item of each message waits for a reader that lags, in the order of the decisions
/// (D8, D1).
#[tokio::test(start_paused = true)]
async fn a_reader_that_lags_reads_the_newest_item_of_each_message_and_none_twice() {
    let (mut camera, frames) = stream(8);
    let config = Config { output_len: 1, window: 2, ..progressive() };
    let clouds: [fn(u64) -> Reply; 2] = [|_| After(40), |t| if t == 0 { Never } else { After(60) }];
    let (running, mut output) = spawn(operator(clouds), config, frames).unwrap();
    for t in 0..2 {
        camera.write(t).unwrap();
    }
    sleep(30 * MS).await;
    camera.write(2).unwrap();
    drop(camera);
    sleep(1000 * MS).await;
    // The third message was not accepted while nobody read.
    assert_eq!(running.tally().messages, 2);
    let mut read = Vec::new();
    while let Some(item) = output.read().await {
        read.push(line(&item));
    }
    assert_eq!(
        read[..3],
        [
            "20.000 ms: 0 local's of 0 preliminary 0",
            "60.000 ms: 1 2's of 1 by arrival from 60 ms",
            "100.000 ms: 0 1's of 0 by arrival from 40 ms",
        ]
    );
    assert!(read[3..].iter().all(|line| line.contains("of 2 ")) && read.len() > 3, "{read:?}");
    assert!(read.last().unwrap().contains("2's of 2 by arrival"), "{read:?}");
    let tally = running.join().await.unwrap();
    assert_eq!(tally.sources.iter().map(|it| it.preliminary).sum::<u64>(), 6);
}

/// A guard is refused under progressive, because its promise assumes one output for each message
/// (T1, T2).
#[tokio::test]
async fn a_guard_is_refused_with_the_remedy_and_other_policies_are_not() {
    let guard = || Guard::new(Parameters::default()).unwrap();
    let loss = Accuracy { local: 42.0, cloud: 58.0, price_per_ms: 0.01 };
    let expected = || Expected::<_, 16>::new(loss, 20 * MS, Some(16)).unwrap();
    let start = |policy: Box<dyn Policy + Send>, commit| {
        let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
            let cloud = setup.use_cloud(
                |t, _| reply("west", t, After(50)),
                |_, t| Some((t, 100 * MS)),
                Ok,
                1,
            );
            cloud.name = "west".into();
            cloud.policy = Some(policy);
            Local::future(|_, t| reply("local", t, After(20)))
        });
        spawn(operator, Config { commit, ..Config::default() }, stream(1).1).map(drop)
    };
    for policy in [
        Box::new(guard()) as Box<dyn Policy + Send>,
        Box::new(guard().cap(expected())),
        Box::new(Constant(50 * MS).cap(guard())),
    ] {
        let error = start(policy, Commit::Progressive).unwrap_err();
        assert!(
            matches!(error, SpawnError::Config(EngineConfigError::OneOutput { .. })),
            "{error}"
        );
        assert!(error.to_string().contains("west") && error.to_string().contains("commit patient"));
    }
    assert!(start(Box::new(guard()), Commit::Patient).is_ok());
    assert!(start(Box::new(expected()), Commit::Progressive).is_ok());
    assert!(start(Box::new(Constant(50 * MS)), Commit::Progressive).is_ok());
}

/// Joins only the revisions. Returns the sets, and how many messages came too late.
async fn joined(wait: Duration, revisions: Items<String>) -> (Vec<String>, u64) {
    let mut join = Join::new(JoinConfig { wait, ..JoinConfig::default() });
    join.items("boxes", revisions, |set: &mut Option<String>, item| *set = item.value().cloned());
    let (running, mut sets) = join.spawn().unwrap();
    let mut given = Vec::new();
    while let Some(set) = sets.read().await {
        given.push(set.set.clone().unwrap());
    }
    let late = ("boxes".into(), JoinDropReason::Late);
    (given, running.join().await.dropped.remove(&late).unwrap_or_default())
}

/// An aligned input takes the last revision, or the latest one when its set is due. A revision that
/// comes later opens no other set (E5, E6).
#[tokio::test(start_paused = true)]
async fn a_join_takes_the_last_revision_that_comes_before_its_set_is_due() {
    let (mut camera, frames) = stream(9);
    let clouds = operator([|t| After(if t == 0 { 50 } else { 10 }), |_| After(60)]);
    let (_running, revisions) = spawn(clouds, progressive(), frames).unwrap();
    let patient = tokio::spawn(joined(100 * MS, revisions.new_reader()));
    let hasty = tokio::spawn(joined(35 * MS, revisions));
    camera.write_with(0, Lineage::new("camera", 7, Instant::now())).unwrap();
    drop(camera);
    assert_eq!(patient.await.unwrap(), (vec!["2's of 0".to_owned()], 0));
    assert_eq!(hasty.await.unwrap(), (vec!["1's of 0".to_owned()], 1));
}

/// A latest-value input takes each revision, and a final item without a value removes none (E5).
#[tokio::test(start_paused = true)]
async fn a_latest_input_takes_each_revision_and_none_from_a_mark() {
    let (mut camera, frames) = stream(9);
    let broken = operator([|_| After(30), |_| Panics(50)]);
    let (_running, revisions) = spawn(broken, progressive(), frames).unwrap();
    let (mut clock, ticks) = stream(9);
    let mut join = Join::<Option<String>>::new(JoinConfig::default());
    join.aligned("tick", ticks, |_, _: Arc<()>, _| {});
    join.latest_items("boxes", revisions, 1000 * MS, |set, item| *set = item.value().cloned());
    let (_join, mut sets) = join.spawn().unwrap();
    camera.write_with(0, Lineage::new("camera", 7, Instant::now())).unwrap();
    let mut seen = Vec::new();
    for seq in 0..4 {
        sleep(if seq == 0 { 10 * MS } else { 15 * MS }).await;
        clock.write_with((), Lineage::new("tick", seq, Instant::now())).unwrap();
        let set = sets.read().await.unwrap();
        seen.push(set.set.clone().unwrap_or_else(|| set.missing.join(", ")));
    }
    assert_eq!(seen, ["boxes", "local's of 0", "1's of 0", "1's of 0"]);
}
