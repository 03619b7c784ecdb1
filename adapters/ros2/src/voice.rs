//! The node as ROS sees it: its parameters, and what it reports.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ros2_client::qos::WhenFull;
use ros2_client::{
    Context, Log, MessageTypeName, Name, NodeName, NodeOptions, ParameterValue, Publisher,
    QosProfile,
};
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tracing::{debug, error};

use crate::dds::Domain;
use crate::error::NodeError;
use crate::lifecycle::{Orders, serve};
use crate::parameters::Value;
use crate::report::{self, DiagnosticArray, DiagnosticStatus, Time};
use crate::rosout::Lines;
use crate::settings::{Change, Settings};

/// Publishes what the node reports.
pub(crate) trait Speak: Send {
    /// Publishes what became of a message.
    fn status(&self, status: DiagnosticStatus);

    /// Publishes the state of the node.
    fn diagnostics(&self, status: Vec<DiagnosticStatus>);
}

/// The node's publishers of reports.
pub(crate) struct Voice {
    ros: ros2_client::Node,
    diagnostics: Publisher<DiagnosticArray>,
    status: Publisher<DiagnosticStatus>,
}

/// The node as ROS sees it, whether or not its topics are open.
pub(crate) struct Presence {
    pub(crate) voice: Arc<Voice>,
    pub(crate) settings: Current,
    /// What was set since it was last looked at.
    pub(crate) changes: mpsc::UnboundedReceiver<Change>,
    /// What a managed node is told; a plain one is told nothing.
    pub(crate) orders: Option<Orders>,
    /// They serve parameters and lifecycle, and publish the log.
    pub(crate) tasks: JoinSet<()>,
}

/// The settings with what was set since the start.
#[derive(Clone)]
pub(crate) struct Current(Arc<Mutex<Settings>>);

impl Current {
    pub(crate) fn now(&self) -> Settings {
        self.locked().clone()
    }

    /// A change is made whole, so even a poisoned lock holds sound settings.
    fn locked(&self) -> MutexGuard<'_, Settings> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Voice {
    /// Joins ROS, with the node's parameters, what it reports, and its lifecycle if it is managed.
    pub(crate) fn join(
        settings: &Settings,
        domain: &Domain,
        lines: Option<Lines>,
    ) -> Result<Presence, NodeError> {
        let wrong = |error: &dyn std::fmt::Display| NodeError::Ros(error.to_string());
        let context = Context::from_domain_participant(domain.participant.clone())
            .map_err(|error| wrong(&error))?;
        let name = NodeName::new(&settings.node.namespace, &settings.node.name);
        let name = name.map_err(|error| wrong(&error))?;
        let is_declared = Arc::new(AtomicBool::new(false));
        let (setter, changes) = mpsc::unbounded_channel();
        let current = Current(Arc::new(Mutex::new(settings.clone())));
        let mut ros = context
            .new_node(name, options(settings, &current, setter, &is_declared))
            .map_err(|error| wrong(&format!("{error:?}")))?;
        is_declared.store(true, Ordering::Relaxed);
        let diagnostics = publisher(&mut ros, &settings.diagnostics, "DiagnosticArray")?;
        let status = publisher(&mut ros, &settings.status, "DiagnosticStatus")?;
        let spinner = ros.spinner().map_err(|error| wrong(&error))?;
        let mut tasks = JoinSet::new();
        let orders = settings.lifecycle.then(|| serve(&mut ros, &settings.node, &mut tasks));
        let orders = orders.transpose()?;
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
        let voice = Arc::new(Self { ros, diagnostics, status });
        Ok(Presence { voice, settings: current, changes, orders, tasks })
    }

    /// The time of day, or simulated time.
    fn stamp(&self) -> Time {
        let nanos = self.ros.time_now().to_nanos();
        let sec = nanos.div_euclid(1_000_000_000);
        Time {
            sec: i32::try_from(sec).unwrap_or(i32::MAX),
            nanosec: u32::try_from(nanos.rem_euclid(1_000_000_000)).unwrap_or(0),
        }
    }
}

impl Speak for Arc<Voice> {
    fn status(&self, status: DiagnosticStatus) {
        if let Err(error) = self.status.publish(status) {
            debug!(?error, "status not sent");
        }
    }

    fn diagnostics(&self, status: Vec<DiagnosticStatus>) {
        let header = report::Header { stamp: self.stamp(), frame_id: String::new() };
        if let Err(error) = self.diagnostics.publish(DiagnosticArray { header, status }) {
            debug!(?error, "diagnostics not sent");
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
        // The log is on standard error, too.
        drop(log.publish(message));
    }
}

/// The options with which the node joins ROS: its parameters, and which of them may be set.
///
/// Declaring sets each parameter once, to its own value: changes are ignored until `is_declared`.
fn options(
    settings: &Settings,
    current: &Current,
    setter: mpsc::UnboundedSender<Change>,
    is_declared: &Arc<AtomicBool>,
) -> NodeOptions {
    let mut options = NodeOptions::new().enable_rosout(false);
    for parameter in &settings.declared {
        options = options.declare_parameter(&parameter.name, to_ros(&parameter.value));
    }
    let check = {
        let (current, is_declared) = (current.clone(), Arc::clone(is_declared));
        move |name: &str, value: &ParameterValue| {
            if !is_declared.load(Ordering::Relaxed) {
                return Ok(None);
            }
            let value = from_ros(value).ok_or("no parameter of this node has this type")?;
            current.locked().check_change(name, &value).map(Some).map_err(|error| error.to_string())
        }
    };
    let (validate, current) = (check.clone(), current.clone());
    options
        .parameter_validator(Box::new(move |name, value| validate(name, value).map(drop)))
        .parameter_set_action(Box::new(move |name, value| {
            if let Some(change) = check(name, value)? {
                current.locked().apply(change);
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
