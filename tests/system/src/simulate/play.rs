//! Plays a scenario with the shipped operator on tokio's paused clock, which advances only while
//! all tasks sleep.

use std::fs;
use std::io;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use fuseline_testkit::shrink;
use fuseline_tokio::{Config, Items, JoinError, Recording, Running, Tally, Trace, spawn, stream};
use metrics_util::CompositeKey;
use metrics_util::debugging::{DebugValue, DebuggingRecorder};
use tokio::runtime::Builder;
use tokio::task::JoinHandle;
use tokio::time::{sleep_until, timeout};

use crate::simulate::checks::Facts;
use crate::simulate::log::{Log, SimulationState};
use crate::simulate::peers::{Script, audience, camera, stall};
use crate::simulate::scenario::{Disk, Finish, Scenario};
use crate::simulate::shrink::simplifications;
use crate::simulate::simulator::{Drawn, Simulated};
use crate::simulate::value::ResultValue;

/// A virtual time that is longer than any run.
const FOR_EVER: Duration = Duration::from_secs(100_000);

/// The outcome of a scenario.
pub(crate) struct RunResult {
    pub(crate) log: Log,
    /// The trace, joined from its parts.
    pub(crate) trace: Vec<u8>,
    pub(crate) ended: OperatorEnd,
    /// `None` if nobody kept the operator to its end.
    pub(crate) tally: Option<Tally>,
    pub(crate) metrics: Vec<(CompositeKey, DebugValue)>,
    /// The greatest numbers of messages and of values at once.
    pub(crate) most: [usize; 2],
    /// The tasks, messages and values that are left at the end.
    pub(crate) remaining: [usize; 3],
}

/// States how the operator ended.
#[derive(PartialEq, Debug)]
pub(crate) enum OperatorEnd {
    Well,
    /// Its trace ended earlier.
    Early,
    /// The runtime was dropped.
    Crashed,
    /// Its task panicked.
    Panicked,
    /// It never ended.
    Never,
    /// It was not started.
    NotStarted(String),
}

impl Drawn for Scenario {
    const OPTION: &str = "seed";
    const PANICS: &str = "d7_no_panic_comes_through";

    fn draw(seed: u64) -> Self {
        Self::of_seed(seed)
    }

    fn play(&self, folder: &Path) -> io::Result<Simulated> {
        let played = play(self, folder)?;
        let findings = Facts::new(self, &played).findings();
        let last = played.log.items.iter().flatten().map(|read| read.at).max().unwrap_or(0);
        let life = Duration::from_nanos(played.log.stopped.unwrap_or(last));
        let RunResult { log, trace, ended, tally, most, remaining, .. } = played;
        let messages = log.written.len() as u64;
        let external_log = Box::new((log, ended, tally, most, remaining));
        let external_log = Some(external_log as Box<_>);
        Ok(Simulated { findings, messages, life, trace, external_log, ..Simulated::default() })
    }

    fn smallest(&self, mut breaks: impl FnMut(&Self) -> io::Result<bool>) -> io::Result<Self> {
        let breaks = |it: &Self| Ok(!it.frames.is_empty() && breaks(it)?);
        shrink(self.clone(), simplifications, breaks)
    }

    fn text(&self) -> String {
        self.to_string()
    }
}

/// Plays a scenario. Its files go to the empty `folder`.
///
/// # Errors
/// Returns an error if the folder cannot be used.
pub(crate) fn play(scenario: &Scenario, folder: &Path) -> io::Result<RunResult> {
    let path = prepare(scenario, folder)?;
    let recorder = DebuggingRecorder::new();
    let snapshotter = recorder.snapshotter();
    let runtime = Builder::new_current_thread().enable_time().start_paused(true).build()?;
    let (simulation, held) = runtime.block_on(async {
        let simulation = Arc::new(SimulationState::new(scenario));
        let (writer, input) = stream(scenario.input_len);
        let script = Script(Arc::clone(&simulation));
        let start = || spawn(script, config(scenario, path.clone()), input);
        let started =
            if scenario.metered { metrics::with_local_recorder(&recorder, start) } else { start() };
        let held = match started {
            Ok((running, items)) => {
                tokio::spawn(camera(Arc::clone(&simulation), writer));
                tokio::spawn(stall(Arc::clone(&simulation)));
                // It is a task, because others may have their turn at its instant before and after
                // it.
                tokio::spawn(run(Arc::clone(&simulation), running, items)).await?
            }
            Err(error) => (OperatorEnd::NotStarted(error.to_string()), None),
        };
        Ok::<_, io::Error>((simulation, held))
    })?;
    let (ended, tally) = held;
    let tasks = runtime.metrics().num_alive_tasks();
    drop(runtime);
    let log = std::mem::take(&mut *simulation.log());
    let metered = snapshotter.snapshot().into_vec().into_iter();
    Ok(RunResult {
        log,
        trace: put_together(&path)?,
        ended,
        tally,
        metrics: metered.map(|(key, _, _, value)| (key, value)).collect(),
        most: [simulation.frames.most(), simulation.values.most()],
        remaining: [tasks, simulation.frames.now(), simulation.values.now()],
    })
}

type PlayResult = (OperatorEnd, Option<Tally>);

async fn run(
    simulation: Arc<SimulationState>,
    running: Running,
    items: Items<ResultValue>,
) -> PlayResult {
    let reading = tokio::spawn(audience(Arc::clone(&simulation), 0, items));
    let mut counts = None;
    let ended = match simulation.scenario.end {
        Finish::Crash(at) => {
            sleep_until(simulation.at(at)).await;
            let now = simulation.now();
            let mut log = simulation.log();
            log.stop(now);
            log.over = Some(now);
            return (OperatorEnd::Crashed, None);
        }
        Finish::Alone => {
            drop(running);
            finished(reading).await
        }
        Finish::Input => join(running, &mut counts).await,
        Finish::Stop(at) => {
            sleep_until(simulation.at(at)).await;
            simulation.log().stop(simulation.now());
            running.stop();
            join(running, &mut counts).await
        }
    };
    // Readers read to the end, and local continues. This waits until a fixed instant, because
    // virtual time may advance while the recorder's thread ends, which takes real time.
    sleep_until(simulation.at(FOR_EVER * 2)).await;
    let now = simulation.now();
    simulation.log().over = Some(now);
    (ended, counts)
}

async fn join(running: Running, counts: &mut Option<Tally>) -> OperatorEnd {
    let ended = timeout(FOR_EVER, running.join()).await;
    let (ended, tally) = match ended {
        Ok(Ok(tally)) => (OperatorEnd::Well, tally),
        Ok(Err(JoinError::Trace { tally, .. })) => (OperatorEnd::Early, *tally),
        Ok(Err(JoinError::Stopped { tally })) => (OperatorEnd::Panicked, *tally),
        Err(_) => return OperatorEnd::Never,
    };
    *counts = Some(tally);
    ended
}

async fn finished(reading: JoinHandle<()>) -> OperatorEnd {
    match timeout(FOR_EVER, reading).await {
        Ok(Ok(())) => OperatorEnd::Well,
        Ok(Err(_)) => OperatorEnd::Panicked,
        Err(_) => OperatorEnd::Never,
    }
}

fn config(scenario: &Scenario, path: PathBuf) -> Config {
    let rotate = match scenario.disk {
        Disk::Whole(rotate) => rotate,
        Disk::FullAfter(_, bytes) => Some(bytes),
    };
    Config {
        name: "simulated".into(),
        window: scenario.window,
        commit: scenario.commit,
        output_len: scenario.output_len,
        greatest_deadline: Duration::MAX,
        trace: Some(Trace { path, recording: Recording { rotate, ..Recording::default() } }),
        ..Config::default()
    }
}

/// Fills the disk if the scenario says so: a part of the trace is `/dev/full`.
fn prepare(scenario: &Scenario, folder: &Path) -> io::Result<PathBuf> {
    if let Disk::FullAfter(parts, _) = scenario.disk {
        symlink("/dev/full", folder.join(format!("trace.{parts}.jsonl")))?;
    }
    Ok(folder.join("trace.jsonl"))
}

/// Joins the parts of a trace, without the later headers.
fn put_together(path: &Path) -> io::Result<Vec<u8>> {
    let mut trace = fs::read(path)?;
    for part in 1.. {
        let part = fuseline_traces::Recorder::part(path, part);
        if !part.is_file() {
            return Ok(trace);
        }
        let part = fs::read(part)?;
        let header = part.iter().position(|byte| *byte == b'\n').map_or(0, |end| end + 1);
        trace.extend_from_slice(&part[header..]);
    }
    Ok(trace)
}
