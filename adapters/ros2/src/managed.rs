//! A managed node: it opens its topics when it is configured, takes messages in while it is active, and closes them when
//! it is cleaned up.

use std::path::Path;
use std::sync::Arc;

use fuseline_engine::Tally;
use tokio::sync::mpsc;
use tracing::error;

use crate::error::NodeError;
use crate::lifecycle::{LifecycleRequest, LifecycleRequests, LifecycleTask, TransitionResult};
use crate::middleware::Graph;
use crate::node::{self, ExternalInputs};
use crate::rosout::PendingLogs;
use crate::settings::{Change, Settings};
use crate::status_publisher::{NodeInterface, StatusPublisher};
use crate::stop::Stop;

/// Runs the node until it is stopped; returns the counts of the last time that it was configured.
///
/// # Errors
/// If ROS refuses the node, or the last trace could not be written whole.
pub(crate) async fn run(
    settings: &Settings,
    stop: &mut Stop,
    lines: Option<PendingLogs>,
) -> Result<Tally, NodeError> {
    // What ROS sees of it outlives its topics: over DDS these have a participant of their own.
    let backend = Graph::join(settings, |it| it == settings.middleware).await?;
    let NodeInterface { status_publisher, settings, mut changes, orders, mut tasks } =
        StatusPublisher::join(settings, &backend, lines)?;
    let mut ended = Ok(Tally::default());
    if let Some(mut orders) = orders {
        let mut time = 1;
        while let Some(order) = unconfigured(&mut orders, &mut changes, stop).await {
            if order.task == LifecycleTask::ShutDown {
                finalized(order, stop).await;
                break;
            }
            let settings = numbered(settings.now(), time);
            let outside = ExternalInputs {
                changes: &mut changes,
                orders: Some(&mut orders),
                stop: &mut *stop,
            };
            ended = configured(&settings, &backend, Arc::clone(&status_publisher), outside, order)
                .await;
            match orders.last.take() {
                Some(order) if order.task == LifecycleTask::ShutDown => {
                    finalized(order, stop).await;
                    break;
                }
                Some(order) => {
                    time += 1;
                    order.done(if ended.is_ok() {
                        TransitionResult::Success
                    } else {
                        TransitionResult::Error
                    });
                }
                None if stop.is_requested() => break,
                // It could not be configured, and said why.
                None => ended = Ok(Tally::default()),
            }
        }
    }
    drop(status_publisher);
    tasks.shutdown().await;
    backend.leave().await;
    ended
}

/// Waits for an order; none if the node is to end.
async fn unconfigured(
    orders: &mut LifecycleRequests,
    changes: &mut mpsc::UnboundedReceiver<Change>,
    stop: &mut Stop,
) -> Option<LifecycleRequest> {
    // It may have been requested while the last order was carried out.
    while !stop.is_requested() {
        tokio::select! {
            () = stop.requested() => return None,
            order = orders.reported.recv() => return order,
            // They are in the settings already.
            Some(_) = changes.recv() => {}
        }
    }
    None
}

/// Opens what the settings name, and runs until it is to be closed again.
async fn configured(
    settings: &Settings,
    backend: &Graph,
    status_publisher: Arc<StatusPublisher>,
    outside: ExternalInputs<'_>,
    order: LifecycleRequest,
) -> Result<Tally, NodeError> {
    let refused = |order: LifecycleRequest, error: NodeError| {
        error!(%error, "the node cannot be configured");
        order.done(TransitionResult::Failure);
        error
    };
    let opened = async {
        node::check(settings)?;
        let engine = node::recorded(settings)?;
        Ok((engine, backend.beside(settings).await?))
    };
    let (engine, mut graph) = match opened.await {
        Ok(opened) => opened,
        Err(error) => return Err(refused(order, error)),
    };
    let ended = match node::open(settings, engine, &mut graph, status_publisher, outside) {
        Ok(open) => {
            order.done(TransitionResult::Success);
            open.run().await.inspect_err(|error| error!(%error, "the node was not closed well"))
        }
        Err(error) => Err(refused(order, error)),
    };
    graph.leave().await;
    ended
}

/// It answers its services until it is to end.
async fn finalized(order: LifecycleRequest, stop: &mut Stop) {
    order.done(TransitionResult::Success);
    if !stop.is_requested() {
        stop.requested().await;
    }
}

/// The first time traces have the names of the settings; later `trace.jsonl` is `trace-2.jsonl`, and so on.
fn numbered(mut settings: Settings, time: u32) -> Settings {
    let named = |path: &Path| {
        let file = path.file_name().unwrap_or_default().to_string_lossy();
        let (stem, rest) = file.split_once('.').unwrap_or((&file, ""));
        let dot = if rest.is_empty() { "" } else { "." };
        path.with_file_name(format!("{stem}-{time}{dot}{rest}"))
    };
    if time > 1 {
        settings.trace = settings.trace.as_deref().map(named);
        settings.mcap = settings.mcap.as_deref().map(named);
    }
    settings
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arguments::Arguments;

    #[test]
    fn each_configuration_after_the_first_has_traces_of_its_own() {
        let settings = |trace: &str, mcap: &str| {
            let names = [("trace.file", trace), ("trace.mcap", mcap)];
            let names = names.map(|(name, path)| format!("{name}:={path}"));
            let [trace, mcap] = &names;
            let types = ["input.type:=a/msg/A", "output.type:=a/msg/A"];
            let keys = ["input.key:=uint64", "output.key:=uint64"];
            let more = types.into_iter().chain(keys).chain([&**trace, &**mcap]);
            let more = more.flat_map(|value| ["-p".to_owned(), value.to_owned()]);
            let args = ["--ros-args".to_owned()].into_iter().chain(more);
            let arguments = Arguments::parse(args.map(Into::into)).unwrap();
            Settings::from(&arguments, |_| None).unwrap()
        };
        for (trace, mcap, time, expected) in [
            ("/log/a.jsonl", "b.mcap", 1, ["/log/a.jsonl", "b.mcap"]),
            ("/log/a.jsonl", "b.mcap", 2, ["/log/a-2.jsonl", "b-2.mcap"]),
            ("/log.d/a", "b.x.mcap", 13, ["/log.d/a-13", "b-13.x.mcap"]),
        ] {
            let Settings { trace, mcap, .. } = numbered(settings(trace, mcap), time);
            assert_eq!([trace, mcap], expected.map(|path| Some(path.into())));
        }
        let Settings { trace, mcap, .. } = numbered(settings("''", "''"), 2);
        assert_eq!((trace, mcap), (None, None));
    }
}
