//! What the node says of itself, and its presence in ROS.

use std::sync::Arc;

use ros2_client::Log;
use tokio::sync::mpsc;
use tokio::task::JoinSet;

use crate::error::NodeError;
use crate::home::{Home, Settled, TOLD, Teller, TypeName};
use crate::lifecycle::{Orders, serve};
use crate::middleware::Graph;
use crate::parameters::services::{Parameters, Services};
use crate::report::{self, DiagnosticArray, DiagnosticStatus, Time};
use crate::rosout::Lines;
use crate::settings::{Change, Current, Qos, Settings};

/// Publishes what the node reports.
pub(crate) trait Speak: Send {
    /// Publishes what became of a message.
    fn status(&self, status: DiagnosticStatus);

    /// Publishes the state of the node.
    fn diagnostics(&self, status: Vec<DiagnosticStatus>);
}

/// The node's publishers of reports.
pub(crate) struct Voice {
    clock: Box<dyn Fn() -> Time + Send + Sync>,
    diagnostics: Teller<DiagnosticArray>,
    status: Teller<DiagnosticStatus>,
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

impl Voice {
    /// Joins ROS, with the node's parameters, what it reports, and its lifecycle if it is managed.
    pub(crate) fn join(
        settings: &Settings,
        graph: &Graph,
        lines: Option<Lines>,
    ) -> Result<Presence, NodeError> {
        let (setter, changes) = mpsc::unbounded_channel();
        let current = Current::new(settings.clone());
        let mut tasks = JoinSet::new();
        let mut home = Home::show(settings, graph)?;
        let of = |name| TypeName { package: "diagnostic_msgs", name };
        let diagnostics = home.teller(&settings.diagnostics, of("DiagnosticArray"), TOLD)?;
        let status = home.teller(&settings.status, of("DiagnosticStatus"), TOLD)?;
        let services = Services::offer(&mut home, &mut tasks)?;
        let orders = settings.lifecycle.then(|| serve(&mut home, &settings.node, &mut tasks));
        let orders = orders.transpose()?;
        if let Some(lines) = lines.filter(|_| settings.rosout) {
            let log = TypeName { package: "rcl_interfaces", name: "Log" };
            // As rcl publishes it: who comes later gets the last lines.
            let kept = Qos { reliable: true, transient_local: true, depth: 1000 };
            let log = home.teller("/rosout", log, kept)?;
            tasks.spawn(publish(lines, log, settings.node.name.clone()));
        }
        let Settled { clock, set } = home.settle(settings)?;
        let parameters = Parameters { settings: current.clone(), setter, set };
        tasks.spawn(services.run(parameters));
        let voice = Arc::new(Self { clock, diagnostics, status });
        Ok(Presence { voice, settings: current, changes, orders, tasks })
    }
}

impl Speak for Arc<Voice> {
    fn status(&self, status: DiagnosticStatus) {
        (self.status)(status);
    }

    fn diagnostics(&self, status: Vec<DiagnosticStatus>) {
        let header = report::Header { stamp: (self.clock)(), frame_id: String::new() };
        (self.diagnostics)(DiagnosticArray { header, status });
    }
}

/// Publishes the log.
async fn publish(mut lines: Lines, log: Teller<Log>, name: String) {
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
