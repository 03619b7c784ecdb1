//! Publishes the node's statuses and diagnostics, and its presence in ROS.

use std::sync::{Arc, Mutex};

use ros2_client::Log;
use ros2_client::parameters::raw::{Parameter, ParameterEvent};
use tokio::sync::mpsc;
use tokio::task::JoinSet;

use crate::clock::{CLOCK, Clock};
use crate::error::NodeError;
use crate::lifecycle::{LifecycleRequests, serve};
use crate::middleware::{Graph, MessagePublisher, REPORTS, TypeName};
use crate::parameters::services::{NodeParameters, ParameterCallback, ParameterServices};
use crate::parameters::{Value, ros};
use crate::report::{self, DiagnosticArray, DiagnosticStatus};
use crate::rosout::PendingLogs;
use crate::settings::{Change, Qos, Settings};

/// Publishes what the node reports.
pub(crate) trait PublishStatus: Send {
    /// Publishes what became of a message.
    fn status(&self, status: DiagnosticStatus);

    /// Publishes the state of the node.
    fn diagnostics(&self, status: Vec<DiagnosticStatus>);
}

/// The node's publishers of reports.
pub(crate) struct StatusPublisher {
    clock: Arc<Clock>,
    diagnostics: MessagePublisher<DiagnosticArray>,
    status: MessagePublisher<DiagnosticStatus>,
}

/// The node as ROS sees it, whether or not its topics are open.
pub(crate) struct NodeInterface {
    pub(crate) status_publisher: Arc<StatusPublisher>,
    /// The settings with what was set since the start.
    pub(crate) settings: Arc<Mutex<Settings>>,
    /// Returns the parameters that were set since the last call.
    pub(crate) changes: mpsc::UnboundedReceiver<Change>,
    /// The requests to a managed node's lifecycle; a plain one has none.
    pub(crate) orders: Option<LifecycleRequests>,
    /// They serve parameters and lifecycle, and publish the log.
    pub(crate) tasks: JoinSet<()>,
}

impl StatusPublisher {
    /// Joins ROS, with the node's parameters, what it reports, and its lifecycle if it is managed.
    pub(crate) fn join(
        settings: &Settings,
        graph: &mut Graph,
        lines: Option<PendingLogs>,
    ) -> Result<NodeInterface, NodeError> {
        let (setter, changes) = mpsc::unbounded_channel();
        let current = Arc::new(Mutex::new(settings.clone()));
        let mut tasks = JoinSet::new();
        graph.show(settings)?;
        let of = |name| TypeName { package: "diagnostic_msgs", name };
        let diagnostics =
            graph.message_publisher(&settings.diagnostics, of("DiagnosticArray"), REPORTS)?;
        let status = graph.message_publisher(&settings.status, of("DiagnosticStatus"), REPORTS)?;
        let services = ParameterServices::offer(graph, &mut tasks)?;
        let orders = settings.lifecycle.then(|| serve(graph, &settings.node, &mut tasks));
        let orders = orders.transpose()?;
        let of = |name| TypeName { package: "rcl_interfaces", name };
        if let Some(lines) = lines.filter(|_| settings.rosout) {
            // As in rcl, later subscribers get the last lines.
            let qos = Qos { reliable: true, transient_local: true, depth: 1000 };
            let log = graph.message_publisher("/rosout", of("Log"), qos)?;
            tasks.spawn(publish(lines, log, settings.node.name.clone()));
        }
        let events = graph.message_publisher("/parameter_events", of("ParameterEvent"), REPORTS)?;
        let clock = Arc::new(Clock::new(settings.use_sim_time));
        let (taking, setting) = (Arc::clone(&clock), Arc::clone(&clock));
        let (topic, ty, qos) = CLOCK;
        graph.subscribe(settings.middleware, topic, ty, qos, move |sample| {
            taking.take(sample);
            std::future::ready(())
        })?;
        graph.complete()?;
        let node = settings.node.full();
        let set: ParameterCallback = Box::new(move |name, value| {
            setting.set(name, value);
            events(changed(&node, name, value));
        });
        let parameters = NodeParameters { settings: Arc::clone(&current), setter, set };
        tasks.spawn(services.run(parameters));
        let status_publisher = Arc::new(Self { clock, diagnostics, status });
        Ok(NodeInterface { status_publisher, settings: current, changes, orders, tasks })
    }
}

/// Returns the event that a parameter was set.
fn changed(node: &str, name: &str, value: &Value) -> ParameterEvent {
    let changed = Parameter { name: name.to_owned(), value: ros::value(value) };
    ParameterEvent {
        stamp: ros2_client::builtin_interfaces::Time::now(),
        node: node.to_owned(),
        new_parameters: Vec::new(),
        changed_parameters: vec![changed],
        deleted_parameters: Vec::new(),
    }
}

impl PublishStatus for Arc<StatusPublisher> {
    fn status(&self, status: DiagnosticStatus) {
        (self.status)(status);
    }

    fn diagnostics(&self, status: Vec<DiagnosticStatus>) {
        let header = report::RosHeader { stamp: self.clock.now(), frame_id: String::new() };
        (self.diagnostics)(DiagnosticArray { header, status });
    }
}

/// Publishes the log.
async fn publish(mut lines: PendingLogs, log: MessagePublisher<Log>, name: String) {
    while let Some(line) = lines.0.recv().await {
        // The log is on standard error, too.
        log(Log {
            stamp: ros2_client::builtin_interfaces::Time::now(),
            level: line.level as u8,
            name: name.clone(),
            msg: line.text,
            file: line.file.into(),
            function: String::new(),
            line: line.line,
        });
    }
}
