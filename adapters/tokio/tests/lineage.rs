//! Tests lineage through operators: the origin and the age of an output, and the message that its
//! value is of (A51, D2).

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::support::ClosureOperator;
use fuseline_tokio::{
    Call, Config, Error, Item, Items, Lineage, Local, Operator, Recording, Running, SharedState,
    StampedValue, Trace, spawn, stream,
};
use fuseline_traces::judge;
use tokio::time::{Instant, sleep};

const MS: Duration = Duration::from_millis(1);

/// An operator that reads another operator's items. Local takes 20 ms.
struct Tracker;

impl Operator for Tracker {
    type Input = Item<String>;
    type Output = String;

    fn setup(
        self,
        _: &mut fuseline_tokio::Setup<Item<String>, String>,
    ) -> Local<Item<String>, String> {
        Local::futures(9, |item: std::sync::Arc<Item<String>>, _| async move {
            sleep(20 * MS).await;
            Ok(format!("track of {}", item.timestamp))
        })
    }
}

fn config(name: &str, folder: &Path) -> (Config, PathBuf) {
    let path = folder.join(name);
    let trace = Some(Trace { path: path.clone(), recording: Recording::default() });
    (Config { name: name.into(), trace, ..Config::default() }, path)
}

async fn trace(running: Running, path: &Path) -> String {
    running.join().await.unwrap();
    let verdict = judge("trace", BufReader::new(File::open(path).unwrap())).unwrap();
    assert!(verdict.violations.is_empty(), "{verdict}");
    std::fs::read_to_string(path).unwrap()
}

fn opens(trace: &str) -> Vec<&str> {
    trace.lines().filter(|line| line.contains("\"open\"")).collect()
}

#[tokio::test(start_paused = true)]
async fn the_last_output_of_a_chain_knows_what_it_comes_from_and_how_old_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let start = Instant::now();
    let (mut camera, frames) = stream(8);
    let (detector, first) = config("detector", folder.path());
    let (tracker, second) = config("tracker", folder.path());
    // The second message takes longer than the others.
    let detecting = ClosureOperator(|_: &mut _| {
        Local::futures(9, |frame: std::sync::Arc<u64>, _| async move {
            sleep(if *frame == 1 { 50 * MS } else { 10 * MS }).await;
            Ok(format!("boxes of {frame}"))
        })
    });
    let (detecting, boxes) = spawn(detecting, detector, frames).unwrap();
    let (tracking, mut tracks): (_, Items<String>) = spawn(Tracker, tracker, boxes).unwrap();
    sleep(100 * MS).await;
    let captured = start + 70 * MS;
    for frame in 0..3 {
        let lineage = Lineage::new("camera/front", 40 + frame, captured).within(500 * MS);
        camera.write_with(frame, lineage).unwrap();
    }
    camera.write(3).unwrap();
    drop(camera);
    let mut seen = Vec::new();
    while let Some(item) = tracks.read().await {
        let lineage = item.lineage.as_deref();
        let origin = lineage.and_then(|lineage| lineage.origin.clone());
        if let Some(lineage) = lineage {
            assert_eq!(lineage.captured, Some(captured.into_std()), "it is passed on as it is");
            assert_eq!(lineage.age(Instant::now()), item.age, "it is read when it is decided");
        }
        seen.push((
            item.timestamp,
            origin.map(|it| it.seq.unwrap()),
            item.age.map(|it| it.as_millis()),
        ));
    }
    let expected = [
        (0, Some(40), Some(60)),
        (1, Some(42), Some(60)),
        (2, None, None),
        (3, Some(41), Some(100)),
    ];
    assert_eq!(seen, expected);
    let (first, second) = (trace(detecting, &first).await, trace(tracking, &second).await);
    let lineage = |at: u64, t: u64, age: u64, seq: u64| {
        format!(
            r#"{{"ev":"open","at":{at}000000,"t":{t},"deadline":{}000000,"within":500000000,"age":{age}000000,"origin":"camera/front","seq":{seq}}}"#,
            500 - age
        )
    };
    assert_eq!(opens(&first)[1], lineage(100, 1, 30, 41));
    assert_eq!(opens(&first)[3], r#"{"ev":"open","at":100000000,"t":3,"deadline":1000000000}"#);
    assert_eq!(opens(&second)[1], lineage(110, 1, 40, 42));
    assert_eq!(opens(&second)[3], lineage(150, 3, 80, 41));
}

/// A stamped cloud states the message that its value is of, and a value that is too old is a
/// failure (D2).
#[tokio::test(start_paused = true)]
async fn a_stamped_cloud_says_of_which_message_its_value_is_and_one_that_is_too_old_is_a_failure() {
    let folder = tempfile::tempdir().unwrap();
    let (config, path) = config("detector", folder.path());
    // From the second message on, the cloud returns the previous message's reply, as if one reply
    // had been left unread on the connection. For the fourth message it returns an even older one.
    let last = SharedState::new(Vec::new());
    let mixed_up = ClosureOperator(move |setup: &mut fuseline_tokio::Setup<u64, String>| {
        let handle = move |frame: u64, call: Call| {
            let last = last.clone();
            async move {
                assert!(call.lineage.is_some(), "a call knows what its message comes from");
                sleep(MS).await;
                let replies = last.with(|last: &mut Vec<u64>| {
                    last.push(frame);
                    last.clone()
                });
                let late = replies.len().saturating_sub(if frame < 3 { 2 } else { 3 });
                Ok::<_, Error>(replies[late])
            }
        };
        let response_handler = |reply: u64| {
            Ok(StampedValue { value: format!("of {reply}"), of: Some(reply), meant_for: None })
        };
        let message_handler = |frame: &u64, _| Some((*frame, 100 * MS));
        let cloud = setup.use_stamped_cloud(handle, message_handler, response_handler, 1);
        cloud.max_age = 1;
        Local::futures(9, |_, _| async {
            sleep(5 * MS).await;
            Ok("local".into())
        })
    });
    let (mut camera, frames) = stream(8);
    let (running, mut output) = spawn(mixed_up, config, frames).unwrap();
    let mut seen = Vec::new();
    for frame in 0..4 {
        camera.write_with(frame, Lineage::new("camera", frame, Instant::now())).unwrap();
        let item = output.read().await.unwrap();
        let forwarded = item.forwarded().unwrap();
        seen.push((forwarded.value.clone(), forwarded.of, item.age.unwrap().as_millis()));
        sleep(10 * MS).await;
    }
    drop(camera);
    // Message 1 gets the value of message 0, which was captured 11 ms earlier.
    let expected =
        [("of 0", Some(0), 1), ("of 0", Some(0), 12), ("of 1", Some(1), 12), ("local", None, 5)];
    assert_eq!(seen, expected.map(|(value, of, age)| (value.to_owned(), of, age)));
    let trace = trace(running, &path).await;
    let header = trace.lines().next().unwrap();
    assert!(header.contains(r#""max_age":1"#), "{header}");
    assert!(trace.contains(r#"{"ev":"emit","at":12000000,"t":1,"p":1,"of":0}"#), "{trace}");
    assert!(trace.contains(r#"{"ev":"fail","at":"#), "{trace}");
}

/// A server's action that is meant for another tick is a failure (D18).
#[tokio::test(start_paused = true)]
async fn spliced_action_is_a_failure() {
    let folder = tempfile::tempdir().unwrap();
    let (config, path) = config("policy", folder.path());
    let policy = ClosureOperator(|setup: &mut fuseline_tokio::Setup<u64, String>| {
        let handle =
            |tick: u64, _: Call| async move { Ok::<_, Error>(if tick == 2 { 9 } else { tick }) };
        let response_handler = |tick: u64| {
            let meant_for = (tick != 3).then_some(tick);
            Ok(StampedValue { value: format!("for {tick}"), of: None, meant_for })
        };
        let message_handler = |tick: &u64, _| Some((*tick, 100 * MS));
        setup.use_stamped_cloud(handle, message_handler, response_handler, 1);
        Local::futures(9, |_, _| async { Ok("on board".into()) })
    });
    let (mut ticks, messages) = stream(8);
    let (running, mut output) = spawn(policy, config, messages).unwrap();
    let mut sent = Vec::new();
    for tick in 0..4 {
        ticks.write(tick).unwrap();
        let item = output.read().await.unwrap();
        sent.push((item.value().unwrap().clone(), item.failures.len()));
    }
    drop(ticks);
    let expected = [("for 0", 0), ("for 1", 0), ("on board", 1), ("for 3", 0)];
    assert_eq!(sent, expected.map(|(value, failures)| (value.to_owned(), failures)));
    let trace = trace(running, &path).await;
    let said = |line: &&str| line.contains(r#""emit""#) && line.contains(r#""for":"#);
    let emits: Vec<_> = trace.lines().filter(said).collect();
    assert!(emits.len() == 2 && emits[1].ends_with(r#""t":1,"p":1,"for":1}"#), "{trace}");
}
