//! Publishes what the node logs on `/rosout` as well.

use std::fmt::{Debug, Write};

use ros2_client::log::LogLevel;
use tokio::sync::mpsc;
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;

/// The number of lines that may wait. Further ones are only in the log on standard error.
const LINES: usize = 256;

/// A layer of `tracing` that keeps what is logged for the node to publish.
pub struct Rosout(mpsc::Sender<LogLine>);

/// The lines that were logged and not yet published.
pub struct PendingLogs(pub(crate) mpsc::Receiver<LogLine>);

/// One line of the log.
pub(crate) struct LogLine {
    pub(crate) level: LogLevel,
    pub(crate) text: String,
    pub(crate) file: &'static str,
    pub(crate) line: u32,
}

impl Rosout {
    /// Returns the layer, and the log lines that [`run`](crate::run) publishes.
    #[must_use]
    pub fn new() -> (Self, PendingLogs) {
        let (sender, lines) = mpsc::channel(LINES);
        (Self(sender), PendingLogs(lines))
    }
}

impl<S: Subscriber> Layer<S> for Rosout {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let level = match *event.metadata().level() {
            Level::ERROR => LogLevel::Error,
            Level::WARN => LogLevel::Warn,
            Level::INFO => LogLevel::Info,
            _ => LogLevel::Debug,
        };
        let mut text = LogText::default();
        event.record(&mut text);
        let file = event.metadata().file().unwrap_or_default();
        let line = event.metadata().line().unwrap_or_default();
        // Without a node nobody takes the line; when too many wait, it is not worth waiting for.
        drop(self.0.try_send(LogLine { level, text: text.0, file, line }));
    }
}

/// The message, then its fields.
#[derive(Default)]
struct LogText(String);

impl Visit for LogText {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        // Writing to a string cannot fail.
        let _ = if field.name() == "message" {
            let fields = std::mem::take(&mut self.0);
            write!(self.0, "{value:?}{fields}")
        } else {
            write!(self.0, " {field}={value:?}")
        };
    }
}
