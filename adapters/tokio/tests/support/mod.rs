//! Operators that follow a script, on a paused clock that advances when all tasks are idle.

use std::fmt::Write as _;
use std::fs::File;
use std::future::pending;
use std::io::BufReader;
use std::path::Path;
use std::time::Duration;

use fuseline_tokio::{
    Call, Config, Ending, Error, Item, Items, Local, Operator, Running, Setup, Tally, Trace,
    Writer, spawn, stream,
};
use fuseline_traces::judge;
use tokio::time::{Instant, sleep, sleep_until};

/// An action of a source on a message. Times are milliseconds from the request.
#[derive(Clone, Copy, Debug)]
pub(crate) enum SourceAction {
    Answers(u64),
    Fails(u64),
    Panics(u64),
    Never,
}

/// Removes local's deadline of a second, which a computation on a real clock may exceed on a busy
/// host.
pub(crate) fn without_deadline<I, O>(mut local: Local<I, O>) -> Local<I, O> {
    local.deadline = None;
    local
}

/// An operator whose sources follow a script for each timestamp.
pub(crate) struct Script {
    pub(crate) local: fn(u64) -> SourceAction,
    pub(crate) deadline: Option<Duration>,
    pub(crate) clouds: Vec<CloudScript>,
}

/// One cloud's part.
#[derive(Clone, Copy)]
pub(crate) struct CloudScript {
    pub(crate) priority: u16,
    pub(crate) deadline_ms: u64,
    pub(crate) act: fn(u64) -> SourceAction,
    pub(crate) limit: u64,
    pub(crate) calls: usize,
}

/// The outcome of a script.
pub(crate) struct RunResult {
    /// One line for each item, in the order of their arrival.
    pub(crate) items: String,
    pub(crate) tally: Tally,
    pub(crate) trace: String,
}

impl Script {
    /// Creates a script with only local, which answers after 20 ms.
    pub(crate) fn new() -> Self {
        Self { local: |_| SourceAction::Answers(20), deadline: None, clouds: Vec::new() }
    }

    /// Adds a cloud.
    pub(crate) fn cloud(
        mut self,
        priority: u16,
        deadline_ms: u64,
        act: fn(u64) -> SourceAction,
    ) -> Self {
        self.clouds.push(CloudScript { priority, deadline_ms, act, limit: 31, calls: 8 });
        self
    }
}

impl Operator for Script {
    type Input = u64;
    type Output = String;

    fn setup(self, setup: &mut Setup<u64, String>) -> Local<u64, String> {
        for part in self.clouds {
            let handle = move |_message: u64, call: Call| {
                call.sent(100);
                act((part.act)(call.timestamp), format!("cloud {}", part.priority))
            };
            let deadline = Duration::from_millis(part.deadline_ms);
            let cloud =
                setup.use_cloud(handle, move |m, _| Some((*m, deadline)), Ok, part.priority);
            (cloud.limit, cloud.calls) = (Some(part.limit), part.calls);
        }
        let local = self.local;
        let mut local = Local::futures(64, move |_, t| act(local(t), "local".into()));
        local.deadline = self.deadline;
        local
    }
}

/// An operator whose setup is a closure.
pub(crate) struct ClosureOperator<F>(pub(crate) F);

impl<F: FnOnce(&mut Setup<u64, String>) -> Local<u64, String>> Operator for ClosureOperator<F> {
    type Input = u64;
    type Output = String;

    fn setup(self, setup: &mut Setup<u64, String>) -> Local<u64, String> {
        self.0(setup)
    }
}

async fn act(act: SourceAction, name: String) -> Result<String, Error> {
    match act {
        SourceAction::Answers(ms) => sleep(Duration::from_millis(ms)).await,
        SourceAction::Fails(ms) => {
            sleep(Duration::from_millis(ms)).await;
            return Err("on purpose".into());
        }
        SourceAction::Panics(ms) => {
            sleep(Duration::from_millis(ms)).await;
            panic!("on purpose")
        }
        SourceAction::Never => pending().await,
    }
    Ok(name)
}

/// Sends a message at each of these milliseconds, waits for the end, and judges the trace.
pub(crate) async fn play<P>(operator: P, config: Config, messages_ms: &[u64]) -> RunResult
where
    P: Operator<Input = u64, Output = String>,
{
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trace.jsonl");
    let trace = Some(Trace { path: path.clone(), recording: fuseline_tokio::Recording::default() });
    let (writer, input) = stream(1024);
    let start = Instant::now();
    let (running, output) = spawn(operator, Config { trace, ..config }, input).unwrap();
    played((writer, start), messages_ms.to_vec(), (running, output), &path).await
}

/// Does the part of [`play`] that does not depend on the operator's type.
async fn played(
    (mut writer, start): (Writer<u64>, Instant),
    messages_ms: Vec<u64>,
    (running, mut output): (Running, Items<String>),
    path: &Path,
) -> RunResult {
    tokio::spawn(async move {
        for (i, ms) in messages_ms.into_iter().enumerate() {
            sleep_until(start + Duration::from_millis(ms)).await;
            writer.write(i as u64).unwrap();
        }
    });
    let mut items = String::new();
    while let Some(item) = output.read().await {
        writeln!(items, "{}", line(&item)).unwrap();
    }
    let tally = running.join().await.unwrap();
    let verdict = judge("trace", BufReader::new(File::open(path).unwrap())).unwrap();
    assert!(verdict.violations.is_empty(), "{:#?}", verdict.violations);
    RunResult { items, tally, trace: std::fs::read_to_string(path).unwrap() }
}

/// Plays a script with the default configuration.
pub(crate) async fn play_default(script: Script, messages_ms: &[u64]) -> RunResult {
    play(script, Config::default(), messages_ms).await
}

/// Describes an item: when it was decided, its timestamp, and its outcome.
pub(crate) fn line(item: &Item<String>) -> String {
    let (at, t) = (item.decided.as_micros(), item.timestamp);
    let at = format!("{}.{:03}", at / 1000, at % 1000);
    match &item.ending {
        Ending::Preliminary(f) => format!("{at} ms: {t} {} preliminary {}", f.value, item.revision),
        Ending::Final(source) => format!("{at} ms: {t} final {}: {source}", item.revision),
        Ending::Forwarded(f) => {
            format!("{at} ms: {t} {} by {} from {} ms", f.value, f.trigger, f.arrived.as_millis())
        }
        Ending::Missed => format!("{at} ms: {t} missed"),
        Ending::Refused(why) => format!("{at} ms: {t} refused {why}"),
    }
}
