//! A managed node: it opens its topics when it is configured, takes messages in while it is active,
//! and closes them when it is cleaned up.

use std::sync::Arc;

use fuseline_engine::{Tally, lock};
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
    // The node's presence in ROS outlives its topics, which over DDS have a participant of their
    // own.
    let mut backend = Graph::join(settings, |it| it == settings.middleware).await?;
    let NodeInterface { status_publisher, settings, mut changes, orders, mut tasks } =
        StatusPublisher::join(settings, &mut backend, lines)?;
    let mut ended = Ok(Tally::default());
    if let Some(mut orders) = orders {
        while let Some(order) = unconfigured(&mut orders, &mut changes, stop).await {
            if order.task == LifecycleTask::ShutDown {
                finalized(order, stop).await;
                break;
            }
            let settings = lock(&settings).clone();
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
        let recorded = node::recorded(settings)?;
        Ok((recorded, backend.beside(settings).await?))
    };
    let ((engine, created), mut graph) = match opened.await {
        Ok(opened) => opened,
        Err(error) => return Err(refused(order, error)),
    };
    let ended = match node::open(settings, engine, &mut graph, status_publisher, outside) {
        Ok(open) => {
            created.keep();
            order.done(TransitionResult::Success);
            open.run()
                .await
                .inspect_err(|error| error!(%error, "the node could not be closed properly"))
        }
        Err(error) => Err(refused(order, error)),
    };
    graph.leave().await;
    ended
}

/// Waits until the finalized node is to end. Its services answer meanwhile.
async fn finalized(order: LifecycleRequest, stop: &mut Stop) {
    order.done(TransitionResult::Success);
    if !stop.is_requested() {
        stop.requested().await;
    }
}
