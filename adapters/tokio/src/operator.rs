//! [`Operator`], which users implement, its [`Config`], and [`spawn`], which starts it.
//!
//! What it does with messages is in `run`, the event loop in [`drive`](crate::drive), the decisions in the core.

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

/// A typed operator: for each input message it forwards one result, the best that is in time; under progressive also each one
/// that is better than those before it, as it comes (F9).
pub trait Operator {
    /// A message; shared by local and the handlers.
    type Input: Send + Sync + 'static;
    /// A result.
    type Output: Send + Sync + 'static;

    /// Registers the clouds and returns how messages are computed locally.
    fn setup(
        self,
        setup: &mut Setup<Self::Input, Self::Output>,
    ) -> Local<Self::Input, Self::Output>;
}

/// An operator's configuration.
#[derive(Clone, PartialEq, Debug)]
pub struct Config {
    /// The operator's name in logs, metrics and traces; `operator` by default.
    pub name: String,
    /// How many messages may be open at once, 1 to 1024; 16 by default. One more is refused `full`
    /// (F1).
    pub window: u16,
    /// The commit rule (F6, F9); eager by default.
    pub commit: Commit,
    /// How many items a reader of the output may lag behind; at least 1, 16 by default. While one lags
    /// further, no message is taken in; what is open goes on. So an output that is neither read nor
    /// dropped holds up the operator and whatever waits for its end.
    pub output_len: usize,
    /// Whose timers wake it at a due instant; tokio's by default.
    pub timers: Timers,
    /// How late a timer may be served, and how long a handler may run without a pause, before it is counted and
    /// logged as a warning; 20 ms by default.
    pub lag_warning: Duration,
    /// The longest deadline that a request or local may have; a minute by default. A longer one, such as milliseconds read as
    /// seconds, is refused: of local at the start, of an offer as `deadline`, with a warning at the first (F2, A14). Where a
    /// policy chooses, it is the most that it may choose.
    pub greatest_deadline: Duration,
    /// Where the run is recorded; nowhere by default.
    pub trace: Option<Trace>,
    /// E3: how long the operators downstream take, one after the other; nothing by default.
    ///
    /// A message's requests end when what they take with their clouds is left of its
    /// [end-to-end deadline](crate::Lineage::within). With a substitute, local ends when what they need on board is left. A
    /// join's wait belongs to what is needed on board.
    pub reserve: Vec<Latency>,
    /// Where this operator records how long each message and each local computation takes, for the reserve of those
    /// upstream; nowhere by default.
    pub latency: Option<Latency>,
    /// Whether each item carries its message, for [`Item::message`](crate::Item::message); not by default: a message is then
    /// let go of once local and the handlers are done with it.
    pub carry_messages: bool,
    /// What the operator must keep up with; not checked by default. If given, an operator with too
    /// small a window or too few calls or local computations is not started: its policies and local
    /// could not do what they promise.
    pub workload: Option<Workload>,
}

/// Where and how a run is recorded.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Trace {
    /// The file; it is overwritten.
    pub path: PathBuf,
    /// Rotation and compression.
    pub recording: Recording,
}

/// An operator that was started. Dropping it leaves the operator running.
#[derive(Debug)]
pub struct Running {
    task: JoinHandle<io::Result<()>>,
    stop: Mutex<Option<oneshot::Sender<()>>>,
    counting: Counting,
    sides: Vec<Arc<SideCounts>>,
}

/// Why an operator was not started.
#[derive(Debug, Error)]
pub enum SpawnError {
    /// There is no tokio runtime to run it.
    #[error("an operator must be started within a tokio runtime")]
    NoRuntime,
    /// A join has no [latest-value input](crate::Join::latest) with the name that its sets are said to be of.
    #[error("{name:?} is not a latest-value input of this join; name one that is")]
    NoInput {
        /// The name.
        name: String,
    },
    /// The configuration and these clouds make no operator, or it could not keep up with its [workload](Config::workload).
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
        /// The greatest.
        greatest: Duration,
    },
    /// A side request's gate could never open again.
    #[error("the gate of {name} needs a limit of at least 1 and a resume below it")]
    SideRequest {
        /// The side request's name.
        name: String,
    },
    /// [`output_len`](Config::output_len) is 0: no item could ever be written.
    #[error(
        "an output of which readers may lag 0 items behind has no room for any; give at least 1"
    )]
    NoOutput,
    /// The trace's file cannot be created.
    #[error("the trace {path} cannot be written: {error}", path = path.display())]
    Trace {
        /// The file.
        path: PathBuf,
        /// Why not.
        error: io::Error,
    },
    /// There is no timer as [configured](Config::timers).
    #[error("no timer to wake the operator: {0}")]
    Timers(io::Error),
    /// A thread for local cannot be started.
    #[error("no thread for the local computation: {0}")]
    Threads(io::Error),
}

/// Why an operator did not end well; its counts are kept all the same.
#[derive(Debug, Error)]
pub enum JoinError {
    /// It ended, but its trace ended earlier. [`Tally::recording_error`] said so when it happened.
    #[error("the trace ends early: {error}")]
    Trace {
        /// Why.
        error: io::Error,
        /// Its counts, to its own end.
        tally: Box<Tally>,
    },
    /// The runtime was shut down first.
    #[error("the runtime was shut down before the operator ended")]
    Stopped {
        /// Its counts up to that point.
        tally: Box<Tally>,
    },
}

/// Starts an operator on the current runtime, and returns its handle and its output stream.
///
/// The operator reads its messages from `input`. When `input` ends, the operator answers every open message, and then ends
/// its output and its trace. A message whose local computation never ends stays open if local has no deadline (A9).
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

/// Knows the operator's messages and not its type, so that all with the same ones have one copy of it and of the task.
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
    // A span that nobody listens to would be entered at each wake.
    let task =
        if span.is_disabled() { runtime.spawn(task) } else { runtime.spawn(task.instrument(span)) };
    Ok((Running { task, stop: Mutex::new(Some(stop)), counting, sides: beside }, output))
}

impl Running {
    /// The operator's counts so far.
    #[must_use]
    pub fn tally(&self) -> Tally {
        self.counting.tally()
    }

    /// The counts of its side requests so far, in the order of registration.
    #[must_use]
    pub fn sides(&self) -> Vec<SideTally> {
        self.sides.iter().map(|counts| counts.tally()).collect()
    }

    /// Ends the operator at once: calls are aborted, open messages stay unanswered, the output
    /// ends. The trace is whole up to that point.
    pub fn stop(&self) {
        let stop = lock(&self.stop).take();
        // It may have been stopped before, or have ended.
        let _ = stop.map(|stop| stop.send(()));
    }

    /// Waits until the operator has ended and its trace is written; returns its counts.
    ///
    /// It ends after its input has ended and every item has found room, so read the output meanwhile
    /// or drop it.
    ///
    /// # Errors
    /// If the trace could not be written whole, or the runtime was shut down first.
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

/// The side requests, ready to be made.
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

/// A14: local's deadline bounds the wait for a message as those of requests do.
fn check_local<I, O>(config: &Config, local: &Local<I, O>) -> Result<(), SpawnError> {
    let greatest = config.greatest_deadline;
    match local.deadline {
        Some(deadline) if deadline > greatest => {
            Err(SpawnError::LocalDeadline { deadline, greatest })
        }
        Some(_) | None => Ok(()),
    }
}
