//! What the node says of itself, and its presence in ROS.

use std::sync::Arc;

use ros2_client::Log;
use tokio::sync::mpsc;
use tokio::task::JoinSet;

use crate::backend::{DiscoveredNode, MessagePublisher, NodeBackend, REPORTS, TypeName};
use crate::error::NodeError;
use crate::lifecycle::{LifecycleRequests, serve};
use crate::middleware::Graph;
use crate::parameters::services::{NodeParameters, ParameterServices};
use crate::report::{self, DiagnosticArray, DiagnosticStatus, RosTime};
use crate::rosout::PendingLogs;
use crate::settings::{Change, Current, Qos, Settings};

/// Publishes what the node reports.
pub(crate) trait PublishStatus: Send {
    /// Publishes what became of a message.
    fn status(&self, status: DiagnosticStatus);

    /// Publishes the state of the node.
    fn diagnostics(&self, status: Vec<DiagnosticStatus>);
}

/// The node's publishers of reports.
pub(crate) struct StatusPublisher {
    clock: Box<dyn Fn() -> RosTime + Send + Sync>,
    diagnostics: MessagePublisher<DiagnosticArray>,
    status: MessagePublisher<DiagnosticStatus>,
}

/// The node as ROS sees it, whether or not its topics are open.
pub(crate) struct NodeInterface {
    pub(crate) status_publisher: Arc<StatusPublisher>,
    pub(crate) settings: Current,
    /// What was set since it was last looked at.
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
        graph: &Graph,
        lines: Option<PendingLogs>,
    ) -> Result<NodeInterface, NodeError> {
        let (setter, changes) = mpsc::unbounded_channel();
        let current = Current::new(settings.clone());
        let mut tasks = JoinSet::new();
        let mut backend = NodeBackend::show(settings, graph)?;
        let of = |name| TypeName { package: "diagnostic_msgs", name };
        let diagnostics =
            backend.message_publisher(&settings.diagnostics, of("DiagnosticArray"), REPORTS)?;
        let status =
            backend.message_publisher(&settings.status, of("DiagnosticStatus"), REPORTS)?;
        let services = ParameterServices::offer(&mut backend, &mut tasks)?;
        let orders = settings.lifecycle.then(|| serve(&mut backend, &settings.node, &mut tasks));
        let orders = orders.transpose()?;
        if let Some(lines) = lines.filter(|_| settings.rosout) {
            let log = TypeName { package: "rcl_interfaces", name: "Log" };
            // As rcl publishes it: who comes later gets the last lines.
            let qos = Qos { reliable: true, transient_local: true, depth: 1000 };
            let log = backend.message_publisher("/rosout", log, qos)?;
            tasks.spawn(publish(lines, log, settings.node.name.clone()));
        }
        let DiscoveredNode { clock, set } = backend.settle(settings)?;
        let parameters = NodeParameters { settings: current.clone(), setter, set };
        tasks.spawn(services.run(parameters));
        let status_publisher = Arc::new(Self { clock, diagnostics, status });
        Ok(NodeInterface { status_publisher, settings: current, changes, orders, tasks })
    }
}

impl PublishStatus for Arc<StatusPublisher> {
    fn status(&self, status: DiagnosticStatus) {
        (self.status)(status);
    }

    fn diagnostics(&self, status: Vec<DiagnosticStatus>) {
        let header = report::RosHeader { stamp: (self.clock)(), frame_id: String::new() };
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
