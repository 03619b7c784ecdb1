//! [`Operator`], which users implement, its [`Config`], and [`spawn`], which starts it.
//!
//! `run` applies an operator to messages, [`drive`](crate::drive) has the event loop, and the core
//! decides.

use std::collections::VecDeque;
use std::io;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use fuseline_engine::{
    self as shared, Commit, Counting, Engine, EngineConfig, EngineConfigError, Latency, Recorder,
    Recording, Tally, Workload, lock,
};
use thiserror::Error;
use tokio::runtime::Handle;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use tracing::{Instrument, info_span};

use crate::drive::{Driver, Timers, finish};
use crate::items::Items;
use crate::local::Local;
use crate::outbox::Outbox;
use crate::run::Streams;
use crate::setup::{CloudHandler, Setup};
use crate::side::{SideRegistration, SideRunner};
use crate::side_counts::{SideCounts, SideTally};
use crate::stream::{Reader, stream};
use crate::workers::Workers;

/// A typed operator. For each message it sends one result: the best that comes in time. Under
/// progressive it also sends each better result as it comes (F9).
pub trait Operator {
    /// The type of messages. Local and the handlers share each message.
    type Input: Send + Sync + 'static;
    /// The type of results.
    type Output: Send + Sync + 'static;

    /// Registers the clouds, and returns how messages are computed on board.
    fn setup(
        self,
        setup: &mut Setup<Self::Input, Self::Output>,
    ) -> Local<Self::Input, Self::Output>;
}

/// Configures an operator.
#[derive(Clone, PartialEq, Debug)]
pub struct Config {
    /// The operator's name in logs, metrics and traces; `operator` by default.
    pub name: String,
    /// The greatest number of messages that may be open at once, 1 to 1024; 16 by default. Further
    /// messages are refused as `full` (F1).
    pub window: u16,
    /// The commit rule (F6, F9); eager by default.
    pub commit: Commit,
    /// The number of items that a reader of the output may lag behind; at least 1, 16 by default.
    /// While a reader lags further behind, the operator accepts no message, and finishes those that
    /// are open. So an output that is neither read nor dropped blocks the operator and everything
    /// that waits for its end.
    pub output_len: usize,
    /// The timers that wake the operator at a due instant; tokio's by default.
    pub timers: Timers,
    /// A timer that is served later than this, or a handler that runs longer without a pause, is
    /// counted and logged as a warning; 20 ms by default.
    pub lag_warning: Duration,
    /// The longest deadline that a request or local may have; 60 s by default. A longer deadline,
    /// such as milliseconds that were read as seconds, is refused. If it is local's, the operator
    /// does not start. An offer is refused as `deadline`, with a warning for each cloud's first
    /// (F2, A14). If a policy chooses deadlines, this is the greatest that it may choose.
    pub greatest_deadline: Duration,
    /// The file in which the run is recorded; none by default.
    pub trace: Option<Trace>,
    /// The latencies of the operators downstream, one after the other; none by default (E3).
    ///
    /// A message's requests end when only the time that these operators need with their clouds is
    /// left of its [end-to-end deadline](crate::Lineage::within). With a substitute, local ends
    /// when only the time that they need on board is left. A join's wait belongs to the time on
    /// board.
    pub reserve: Vec<Latency>,
    /// The record of how long each message and each local computation takes, for the reserve of the
    /// operators upstream; none by default.
    pub latency: Option<Latency>,
    /// `true` if each item carries its message, for [`Item::message`](crate::Item::message).
    /// `false` by default: then a message is freed as soon as local and the handlers are done with
    /// it.
    pub carry_messages: bool,
    /// The rate of messages that the operator must keep up with; not checked by default. If it is
    /// given, the operator starts only if its window, and its calls and local computations at once,
    /// suffice for that rate. Otherwise its policies and local could not keep their promises.
    pub workload: Option<Workload>,
}

/// Configures the recording of a run.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Trace {
    /// The file. An existing file is overwritten.
    pub path: PathBuf,
    /// The rotation and the compression.
    pub recording: Recording,
}

/// An operator that was started. Dropping this handle leaves the operator running.
#[derive(Debug)]
pub struct Running {
    task: JoinHandle<io::Result<()>>,
    stop: Mutex<Option<oneshot::Sender<()>>>,
    counting: Counting,
    sides: Vec<Arc<SideCounts>>,
}

/// The reason why an operator was not started.
#[derive(Debug, Error)]
pub enum SpawnError {
    /// There is no tokio runtime to run it.
    #[error("an operator must be started within a tokio runtime")]
    NoRuntime,
    /// A join has no [latest-value input](crate::Join::latest) with the name that
    /// [`origin_of`](crate::Join::origin_of) was given.
    #[error("{name:?} is not a latest-value input of this join; name one that is")]
    NoInput {
        /// The name.
        name: String,
    },
    /// The configuration or the clouds were refused, or the operator could not keep up with its
    /// [workload](Config::workload).
    #[error("the operator's configuration is refused: {0}")]
    Config(#[from] EngineConfigError),
    /// Local's deadline is above the [greatest](Config::greatest_deadline).
    #[error(
        "local's deadline of {deadline:?} is above the greatest, {greatest:?}; give a shorter \
         one, or a greater greatest_deadline"
    )]
    LocalDeadline {
        /// Local's deadline.
        deadline: Duration,
        /// The greatest deadline.
        greatest: Duration,
    },
    /// The gate of a side request could never open again.
    #[error("the gate of {name} needs a limit of at least 1 and a resume below it")]
    SideRequest {
        /// The side request's name.
        name: String,
    },
    /// [`output_len`](Config::output_len) is 0: no item could ever be written.
    #[error("the output has no room, because its readers may lag 0 items behind; give at least 1")]
    NoOutput,
    /// The trace's file cannot be created.
    #[error("the trace {path} cannot be written: {error}", path = path.display())]
    Trace {
        /// The file.
        path: PathBuf,
        /// The system's error.
        error: io::Error,
    },
    /// The [configured](Config::timers) timers are not available.
    #[error("there is no timer to wake the operator: {0}")]
    Timers(io::Error),
    /// A thread for local cannot be started.
    #[error("no thread can be started for the local computation: {0}")]
    Threads(io::Error),
}

/// The reason why an operator did not end well. Each variant has the counts.
#[derive(Debug, Error)]
pub enum JoinError {
    /// The operator ended, but its trace ended earlier. [`Tally::recording_error`] reported it when
    /// it happened.
    #[error("the trace ends early: {error}")]
    Trace {
        /// The error that ended the trace.
        error: io::Error,
        /// The counts, up to the operator's own end.
        tally: Box<Tally>,
    },
    /// The runtime was shut down first.
    #[error("the runtime was shut down before the operator ended")]
    Stopped {
        /// The counts up to that point.
        tally: Box<Tally>,
    },
}

/// Starts an operator on the current runtime, and returns its handle and its output stream.
///
/// The operator reads its messages from `input`. When `input` ends, the operator answers every open
/// message, and then ends its output and its trace. A message whose local computation never ends
/// stays open if local has no deadline (A9).
///
/// ```
/// use fuseline_tokio::{Config, Error, Local, Operator, Setup, spawn, stream};
///
/// struct Doubler;
///
/// impl Operator for Doubler {
///     type Input = u32;
///     type Output = u32;
///
///     fn setup(self, _setup: &mut Setup<u32, u32>) -> Local<u32, u32> {
///         Local::blocking(|number, _timestamp| Ok(number * 2))
///     }
/// }
///
/// # #[tokio::main(flavor = "current_thread")]
/// # async fn main() -> Result<(), Error> {
/// let (mut writer, input) = stream(8);
/// let (running, mut output) = spawn(Doubler, Config::default(), input)?;
/// writer.write(21)?;
/// drop(writer); // the last message
/// let item = output.read().await.expect("one item for each message");
/// assert_eq!(item.forwarded().expect("local's result").value, 42);
/// let tally = running.join().await?;
/// assert_eq!(tally.messages, 1);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// Returns an error if the operator cannot be started as configured. Nothing was started then.
pub fn spawn<P: Operator>(
    operator: P,
    config: Config,
    input: Reader<P::Input>,
) -> Result<(Running, Items<P::Output>), SpawnError> {
    let runtime = Handle::try_current().map_err(|_| SpawnError::NoRuntime)?;
    if config.output_len == 0 {
        return Err(SpawnError::NoOutput);
    }
    let mut setup = Setup::new();
    let local = operator.setup(&mut setup);
    start(&runtime, config, setup, local, input)
}

/// Starts an operator whose type is no longer needed. So operators with the same message types
/// share one copy of this function and of the task.
fn start<I: Send + Sync + 'static, O: Send + Sync + 'static>(
    runtime: &Handle,
    config: Config,
    setup: Setup<I, O>,
    local: Local<I, O>,
    input: Reader<I>,
) -> Result<(Running, Items<O>), SpawnError> {
    check_local(&config, &local)?;
    let has_policies = setup.clouds.iter().any(|cloud| cloud.policy.is_some());
    let named = setup.clouds.iter().map(|cloud| (cloud.priority, cloud.name.clone()));
    let clouds = named.zip(setup.message_handlers).map(|((priority, name), message_handler)| {
        CloudHandler { priority, name, message_handler }
    });
    let clouds = clouds.collect();
    let engine_config = EngineConfig {
        operator: config.name.clone(),
        window: config.window,
        commit: config.commit,
        clouds: setup.clouds,
        local: shared::Local {
            at_once: local.at_once,
            waiting: local.waiting,
            overflow: local.overflow,
            replaceable: if local.kind.is_made_anew() { local.replaceable } else { 0 },
            skip_answered: local.skip_answered,
            // A task or thread that has not ended is still running.
            may_lose_results: false,
        },
        lag_warning: config.lag_warning,
        greatest_deadline: config.greatest_deadline,
        has_substitutes: setup.substitutes.is_some(),
        takes_hints: setup.hints.is_some(),
        has_doubtful_ages: false,
        latency: config.latency,
        workload: config.workload,
    };
    let (header, annotations) = engine_config.header();
    let mut engine = Engine::new(engine_config)?;
    let sides = sides(&config.name, setup.sides)?;
    let workers = Workers::start(local.kind).map_err(SpawnError::Threads)?;
    if let Some(Trace { path, recording }) = config.trace {
        Recorder::create_annotated(&path, &header, &annotations, recording)
            .and_then(|recorder| engine.record(recorder))
            .map_err(|error| SpawnError::Trace { path, error })?;
    }
    let counting = engine.counts();
    let beside = sides.iter().map(SideRunner::counts).collect();
    let (writer, output) = stream(config.output_len);
    let (stop, stopped) = oneshot::channel();
    let streams = Streams {
        input,
        clouds,
        has_policies,
        situation: setup.situation,
        sides,
        hints: setup.hints,
        substitutes: setup.substitutes,
        states: setup.states,
        reserve: config.reserve,
        carried: config.carry_messages.then(VecDeque::new),
        workers,
        deadline: local.deadline,
        output: Outbox::new(writer, |item| item.lineage.clone()),
        counting: counting.clone(),
        stop: Some(stopped),
        is_open: true,
    };
    let driver = Driver::new(engine, streams, config.timers).map_err(SpawnError::Timers)?;
    let task = async move {
        let (streams, engine) = driver.run().await;
        drop(streams);
        finish(engine).await
    };
    let span = info_span!("operator", name = config.name);
    // Without this check, a span that nobody listens to would be entered at each wake.
    let task =
        if span.is_disabled() { runtime.spawn(task) } else { runtime.spawn(task.instrument(span)) };
    Ok((Running { task, stop: Mutex::new(Some(stop)), counting, sides: beside }, output))
}

impl Running {
    /// Returns the operator's counts so far.
    #[must_use]
    pub fn tally(&self) -> Tally {
        self.counting.tally()
    }

    /// Returns the counts of its side requests so far, in the order of registration.
    #[must_use]
    pub fn sides(&self) -> Vec<SideTally> {
        self.sides.iter().map(|counts| counts.tally()).collect()
    }

    /// Stops the operator at once: its calls are aborted, open messages stay unanswered, and the
    /// output ends. The trace is whole up to that point.
    pub fn stop(&self) {
        let stop = lock(&self.stop).take();
        // It may have been stopped before, or have ended.
        let _ = stop.map(|stop| stop.send(()));
    }

    /// Waits until the operator has ended and its trace is written. Returns its counts.
    ///
    /// The operator ends after its input has ended and every item has found room. So read the
    /// output meanwhile, or drop it.
    ///
    /// # Errors
    /// Returns an error if the trace could not be written whole, or if the runtime was shut down
    /// first.
    pub async fn join(self) -> Result<Tally, JoinError> {
        let ended = self.task.await;
        let tally = Box::new(self.counting.tally());
        match ended {
            Ok(Ok(())) => Ok(*tally),
            Ok(Err(error)) => Err(JoinError::Trace { error, tally }),
            Err(_) => Err(JoinError::Stopped { tally }),
        }
    }
}

impl Default for Config {
    fn default() -> Self {
        Self {
            name: "operator".into(),
            window: 16,
            commit: Commit::Eager,
            output_len: 16,
            timers: Timers::Tokio,
            lag_warning: Duration::from_millis(20),
            greatest_deadline: Duration::from_secs(60),
            trace: None,
            reserve: Vec::new(),
            latency: None,
            carry_messages: false,
            workload: None,
        }
    }
}

/// Returns the side requests, ready to be made.
fn sides<I>(
    operator: &str,
    registered: Vec<SideRegistration<I>>,
) -> Result<Vec<SideRunner<I>>, SpawnError> {
    let asker = |beside: SideRegistration<I>| {
        let name = beside.side.name.clone();
        SideRunner::new(operator, beside).ok_or(SpawnError::SideRequest { name })
    };
    registered.into_iter().map(asker).collect()
}

/// Refuses a deadline of local above the greatest, because it bounds the wait for a message as
/// requests' deadlines do (A14).
fn check_local<I, O>(config: &Config, local: &Local<I, O>) -> Result<(), SpawnError> {
    let greatest = config.greatest_deadline;
    match local.deadline {
        Some(deadline) if deadline > greatest => {
            Err(SpawnError::LocalDeadline { deadline, greatest })
        }
        Some(_) | None => Ok(()),
    }
}
