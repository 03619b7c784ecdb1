//! The node: what it opens, and its voice.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::SystemTime;

use fuseline_operator::{
    self as shared, ConfigError, Engine, Header, Local, Mcap, Recorder, Recording, Tally,
};
use ros2_client::qos::WhenFull;
use ros2_client::{
    Context, Log, MessageTypeName, Name, NodeName, NodeOptions, ParameterValue, Publisher,
    QosProfile,
};
use rustdds::dds::CreateError;
use thiserror::Error;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tracing::{debug, error, info};

use crate::dds::Domain;
use crate::fusion::{Arrival, Events, Fusion, Memory};
use crate::parameters::Value;
use crate::report::{self, DiagnosticArray, DiagnosticStatus, Time};
use crate::rosout::Lines;
use crate::settings::{Change, Role, Settings};
use crate::source::{self, GrpcError, Source, Strays, Way};
use crate::stop::Stop;

/// How many results may wait for the node at once; more stay in the readers, the oldest drop out.
const ARRIVALS: usize = 64;

/// Why a node does not run, or did not end well.
#[derive(Debug, Error)]
pub enum NodeError {
    /// What its parameters make is no machine.
    #[error("the parameters are refused: {0}")]
    Config(#[from] ConfigError),
    /// A file of a recording cannot be made.
    #[error("{path} cannot be written: {error}", path = path.display())]
    Recording {
        /// The file.
        path: PathBuf,
        /// Why not.
        error: std::io::Error,
    },
    /// A cloud's server cannot be called.
    #[error("the cloud {cloud}: {error}")]
    Grpc {
        /// The cloud's name.
        cloud: String,
        /// Why not.
        error: GrpcError,
    },
    /// DDS refuses an end of a topic, or the domain.
    #[error("DDS: {0}")]
    Dds(#[from] CreateError),
    /// ROS refuses the node or an end of a topic.
    #[error("ROS: {0}")]
    Ros(String),
    /// The system refuses what every program has.
    #[error("the system refuses: {0}")]
    System(std::io::Error),
    /// The run was not recorded whole.
    #[error("the trace is not whole: {0}")]
    Trace(std::io::Error),
}

/// How the node speaks of itself.
pub(crate) struct Voice {
    /// Its full name.
    pub(crate) node: String,
    ros: ros2_client::Node,
    diagnostics: Publisher<DiagnosticArray>,
    status: Publisher<DiagnosticStatus>,
}

/// Runs the node until told to stop; answers its counts. What is in `lines`, if anything, goes to
/// `/rosout`.
///
/// To be called within a tokio runtime.
///
/// # Errors
/// If it cannot be started as it is set, or its trace could not be written whole.
pub async fn run(
    settings: &Settings,
    stop: &mut Stop,
    lines: Option<Lines>,
) -> Result<Tally, NodeError> {
    let mut engine = engine(settings)?;
    let counting = engine.counts();
    let mut domain = Domain::join(settings.domain, settings.localhost_only)?;
    let (setter, changes) = mpsc::unbounded_channel();
    let (voice, mut tasks) = Voice::new(settings, &domain, setter, lines)?;

    let (arrived, arrivals) = mpsc::channel(ARRIVALS);
    let sources = sources(settings, &mut domain, &arrived)?;
    let stream = &settings.output;
    let qos = settings.qos(&stream.topic, Role::Publisher);
    let output = domain.outlet(&stream.topic, &stream.type_name, qos)?;
    let (taken, inputs) = mpsc::channel(1);
    let input = &settings.input;
    let qos = settings.qos(&input.topic, Role::Subscription);
    let input_end = domain.inlet(&input.topic, &input.type_name, qos, move |sample| {
        let taken = taken.clone();
        async move { drop(taken.send(sample).await) }
    })?;
    let (decided, deadlines) = mpsc::channel(1);
    if let Some(topic) = &settings.deadline_topic {
        let qos = settings.qos(topic, Role::Subscription);
        domain.inlet(topic, "std_msgs/msg/Float64", qos, move |sample| {
            let decided = decided.clone();
            async move { drop(decided.send(sample).await) }
        })?;
    }

    record(&mut engine, settings)?;
    let fusion = Fusion {
        engine,
        sources,
        output,
        input: input_end,
        input_key: settings.input.key,
        output_key: settings.output.key,
        deadline: settings.deadline,
        voice,
        arrived,
        memory: Memory::new(counting),
    };
    let period = settings.diagnostics_period;
    let events = Events { inputs, arrivals, deadlines, changes, period };
    info!(
        node = settings.node.full(),
        domain = settings.domain,
        input = settings.input.topic,
        output = settings.output.topic,
        clouds = settings.clouds.len(),
        "fusing"
    );
    let ran = fusion.run(events, stop).await;
    tasks.shutdown().await;
    domain.leave().await;
    let tally = ran.map_err(NodeError::Trace)?;
    info!(messages = tally.messages, forwarded = tally.forwarded(), missed = tally.missed, "ended");
    Ok(tally)
}

/// The operator, with nothing open.
fn engine(settings: &Settings) -> Result<Engine<crate::Payload, crate::Payload>, ConfigError> {
    let at_once: Vec<usize> = settings.clouds.iter().map(|cloud| cloud.in_flight.into()).collect();
    let local = Local {
        at_once: settings.local.in_flight.into(),
        waiting: settings.local.waiting.into(),
        skip_answered: false,
    };
    Engine::new(&header(settings), &at_once, local)
}

fn header(settings: &Settings) -> Header {
    let clouds = settings.clouds.iter().map(|cloud| shared::Cloud {
        p: cloud.priority,
        name: Some(cloud.name.clone()),
        limit: cloud.limit,
        resume: cloud.resume,
    });
    Header {
        operator: Some(settings.node.full()),
        window: settings.window,
        commit: settings.commit,
        clouds: clouds.collect(),
    }
}

fn record<V, R>(engine: &mut Engine<V, R>, settings: &Settings) -> Result<(), NodeError> {
    let header = header(settings);
    let wrong = |path: &Path| {
        let path = path.to_owned();
        move |error| NodeError::Recording { path, error }
    };
    if let Some(path) = &settings.trace {
        Recorder::create(path, &header, Recording::default())
            .and_then(|recorder| engine.record(recorder))
            .map_err(wrong(path))?;
    }
    if let Some(path) = &settings.mcap {
        let epoch = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let epoch = u64::try_from(epoch.as_nanos()).unwrap_or(0);
        Mcap::create(path, &header, epoch)
            .and_then(|mcap| engine.record(mcap))
            .map_err(wrong(path))?;
    }
    Ok(())
}

/// Local and the clouds, with their ends of topics or their servers.
fn sources(
    settings: &Settings,
    domain: &mut Domain,
    arrived: &mpsc::Sender<Arrival>,
) -> Result<Vec<Source>, NodeError> {
    let local = &settings.local;
    let mut sources = vec![Source {
        priority: 0,
        name: "local".into(),
        way: topics(domain, settings, &local.input, &local.output, arrived, 0)?,
        enabled: true,
        deadline: Some(local.deadline),
        strays: Strays::default(),
    }];
    for (place, cloud) in (1..).zip(&settings.clouds) {
        let way = match &cloud.way {
            crate::settings::Way::Topics { input, output } => {
                topics(domain, settings, input, output, arrived, place)?
            }
            crate::settings::Way::Grpc(grpc) => {
                let name = &cloud.name;
                let wrong = |error| NodeError::Grpc { cloud: name.clone(), error };
                Way::Grpc(source::call(grpc).map_err(wrong)?)
            }
        };
        sources.push(Source {
            priority: cloud.priority,
            name: cloud.name.clone(),
            way,
            enabled: cloud.enabled,
            deadline: cloud.deadline,
            strays: Strays::default(),
        });
    }
    Ok(sources)
}

fn topics(
    domain: &mut Domain,
    settings: &Settings,
    requests: &str,
    results: &str,
    arrived: &mpsc::Sender<Arrival>,
    place: usize,
) -> Result<Way, CreateError> {
    let qos = settings.qos(requests, Role::Publisher);
    let requests = domain.outlet(requests, &settings.input.type_name, qos)?;
    let qos = settings.qos(results, Role::Subscription);
    let arrived = arrived.clone();
    let results = domain.inlet(results, &settings.output.type_name, qos, move |sample| {
        let arrived = arrived.clone();
        async move { drop(arrived.send(Arrival::Sample { place, sample }).await) }
    })?;
    Ok(Way::Topics { requests, results })
}

impl Voice {
    /// The node as ROS sees it: its parameters and what it says of itself; and the tasks that serve the
    /// parameters and publish the log.
    fn new(
        settings: &Settings,
        domain: &Domain,
        setter: mpsc::UnboundedSender<Change>,
        lines: Option<Lines>,
    ) -> Result<(Self, JoinSet<()>), NodeError> {
        let wrong = |error: &dyn std::fmt::Display| NodeError::Ros(error.to_string());
        let context = Context::from_domain_participant(domain.participant.clone())
            .map_err(|error| wrong(&error))?;
        let name = NodeName::new(&settings.node.namespace, &settings.node.name);
        let name = name.map_err(|error| wrong(&error))?;
        let is_declared = Arc::new(AtomicBool::new(false));
        let mut ros = context
            .new_node(name, options(settings, setter, &is_declared))
            .map_err(|error| wrong(&format!("{error:?}")))?;
        is_declared.store(true, Ordering::Relaxed);
        let diagnostics = publisher(&mut ros, &settings.diagnostics, "DiagnosticArray")?;
        let status = publisher(&mut ros, &settings.status, "DiagnosticStatus")?;
        let spinner = ros.spinner().map_err(|error| wrong(&error))?;
        let mut tasks = JoinSet::new();
        if let Some(lines) = lines.filter(|_| settings.rosout) {
            let topic = context.get_rosout_topic();
            let log = ros.create_publisher(&topic, None).map_err(|error| wrong(&error))?;
            tasks.spawn(publish(lines, log, settings.node.name.clone()));
        }
        tasks.spawn(async move {
            if let Err(error) = spinner.spin().await {
                error!(%error, "the node's parameters are served no longer");
            }
        });
        Ok((Self { node: settings.node.full(), ros, diagnostics, status }, tasks))
    }

    /// Says what became of a message.
    pub(crate) fn status(&self, status: DiagnosticStatus) {
        if let Err(error) = self.status.publish(status) {
            debug!(?error, "status not sent");
        }
    }

    /// Says how the node is.
    pub(crate) fn diagnostics(&self, status: Vec<DiagnosticStatus>) {
        let header = report::Header { stamp: self.stamp(), frame_id: String::new() };
        if let Err(error) = self.diagnostics.publish(DiagnosticArray { header, status }) {
            debug!(?error, "diagnostics not sent");
        }
    }

    /// The time of day, or of the simulation.
    fn stamp(&self) -> Time {
        let nanos = self.ros.time_now().to_nanos();
        let sec = nanos.div_euclid(1_000_000_000);
        Time {
            sec: i32::try_from(sec).unwrap_or(i32::MAX),
            nanosec: u32::try_from(nanos.rem_euclid(1_000_000_000)).unwrap_or(0),
        }
    }
}

/// Publishes the log.
async fn publish(mut lines: Lines, log: Publisher<Log>, name: String) {
    while let Some(line) = lines.0.recv().await {
        let message = Log {
            stamp: ros2_client::builtin_interfaces::Time::now(),
            level: line.level as u8,
            name: name.clone(),
            msg: line.text,
            file: line.file.into(),
            function: String::new(),
            line: line.line,
        };
        // Its place is on standard error, too.
        drop(log.publish(message));
    }
}

/// What ROS is told of the node: its parameters, and which of them may be set.
///
/// Declaring sets each parameter once, to what it is anyway: nothing is looked at until `is_declared`.
fn options(
    settings: &Settings,
    setter: mpsc::UnboundedSender<Change>,
    is_declared: &Arc<AtomicBool>,
) -> NodeOptions {
    let mut options = NodeOptions::new().enable_rosout(false);
    for parameter in &settings.declared {
        options = options.declare_parameter(&parameter.name, to_ros(&parameter.value));
    }
    let check = {
        let (settings, is_declared) = (settings.clone(), Arc::clone(is_declared));
        move |name: &str, value: &ParameterValue| {
            if !is_declared.load(Ordering::Relaxed) {
                return Ok(None);
            }
            let value = from_ros(value).ok_or("no parameter of this node has this type")?;
            settings.check_change(name, &value).map(Some).map_err(|error| error.to_string())
        }
    };
    let validate = check.clone();
    options
        .parameter_validator(Box::new(move |name, value| validate(name, value).map(drop)))
        .parameter_set_action(Box::new(move |name, value| {
            if let Some(change) = check(name, value)? {
                // The node may be ending.
                let _ = setter.send(change);
            }
            Ok(())
        }))
}

fn publisher<M: serde::Serialize>(
    ros: &mut ros2_client::Node,
    topic: &str,
    ty: &str,
) -> Result<Publisher<M>, NodeError> {
    let wrong = |error: &dyn std::fmt::Display| NodeError::Ros(format!("{topic}: {error}"));
    let name = Name::parse(topic).map_err(|error| wrong(&error))?;
    let qos = QosProfile::publisher_default().reliability_reliable(WhenFull::Fail);
    let ty = MessageTypeName::new("diagnostic_msgs", ty);
    let topic_of = ros.create_topic(&name, ty, &qos).map_err(|error| wrong(&error))?;
    ros.create_publisher(&topic_of, Some(qos)).map_err(|error| wrong(&error))
}

fn to_ros(value: &Value) -> ParameterValue {
    match value.clone() {
        Value::Bool(value) => ParameterValue::Boolean(value),
        Value::Integer(value) => ParameterValue::Integer(value),
        Value::Double(value) => ParameterValue::Double(value),
        Value::String(value) => ParameterValue::String(value),
        Value::Bools(values) => ParameterValue::BooleanArray(values),
        Value::Integers(values) => ParameterValue::IntegerArray(values),
        Value::Doubles(values) => ParameterValue::DoubleArray(values),
        Value::Strings(values) => ParameterValue::StringArray(values),
    }
}

fn from_ros(value: &ParameterValue) -> Option<Value> {
    match value.clone() {
        ParameterValue::Boolean(value) => Some(Value::Bool(value)),
        ParameterValue::Integer(value) => Some(Value::Integer(value)),
        ParameterValue::Double(value) => Some(Value::Double(value)),
        ParameterValue::String(value) => Some(Value::String(value)),
        ParameterValue::BooleanArray(values) => Some(Value::Bools(values)),
        ParameterValue::IntegerArray(values) => Some(Value::Integers(values)),
        ParameterValue::DoubleArray(values) => Some(Value::Doubles(values)),
        ParameterValue::StringArray(values) => Some(Value::Strings(values)),
        ParameterValue::NotSet | ParameterValue::ByteArray(_) => None,
    }
}
