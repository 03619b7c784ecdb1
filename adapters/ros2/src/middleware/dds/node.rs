//! The node as ROS sees it over DDS: in a participant, and in the next one after a rejoin.

use std::sync::{Arc, Mutex};

use fuseline_engine::lock;
use futures_util::{StreamExt, pin_mut};
use ros2_client::dds::{Context, Node, Server, ServiceMapping};
use ros2_client::qos::{Durability, History, WhenFull};
use ros2_client::{
    Message, MessageTypeName, Name, NodeName, NodeOptions, QosProfile, RmwRequestId,
    ServiceTypeName,
};
use serde::Serialize;
use tokio::sync::{mpsc, oneshot};
use tracing::{debug, error};

use super::rejoin::{DomainHandle, InUse, NewEntity, RecentIds};
use crate::error::NodeError;
use crate::middleware::{MessagePublisher, TypeName};
use crate::service::{PendingRequest, Requests, ServiceReply, WAITING};
use crate::settings::{Qos, Settings};

/// The depth of a service, as in ROS: requests that come while a participant is not in use yet wait
/// here.
const SERVICE_DEPTH: usize = 10;

/// At most this many requests are remembered, so that a request that came to two participants is
/// answered once. `rustdds` may keep more requests than the depth while a server is not in use yet.
const REMEMBERED: usize = 1024;

/// The node, in each participant that it has, and its full name.
pub(crate) struct RosNode {
    domain: DomainHandle,
    pending: PendingNode,
    name: String,
}

/// The node of a participant while its publishers and services are created.
type PendingNode = Arc<Mutex<Option<Node>>>;

impl RosNode {
    pub(crate) fn new(settings: &Settings, domain: DomainHandle) -> Result<Self, NodeError> {
        let name = NodeName::new(&settings.node.namespace, &settings.node.name);
        let name = name.map_err(|error| NodeError::Ros(error.to_string()))?;
        let pending = PendingNode::default();
        let next = pending.clone();
        domain.create(move |joined| {
            let context = Context::from_domain_participant(joined.participant.clone())
                .map_err(|error| NodeError::Ros(error.to_string()))?;
            // The node serves its parameters and publishes its log itself.
            let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
            let node = context.new_node(name.clone(), options);
            let node = node.map_err(|error| NodeError::Ros(format!("{error:?}")))?;
            lock(&next).replace(node);
            Ok(NewEntity::new(|| ()))
        })?;
        Ok(Self { domain, pending, name: settings.node.full() })
    }

    pub(crate) fn message_publisher<M>(
        &mut self,
        topic: &str,
        ty: TypeName,
        qos: Qos,
    ) -> Result<MessagePublisher<M>, NodeError>
    where
        M: Serialize + Send + Sync + 'static,
    {
        let wrong = refusal(topic);
        let name = Name::parse(topic).map_err(|error| wrong(&error))?;
        let durability =
            if qos.transient_local { Durability::TransientLocal } else { Durability::Volatile };
        let qos = QosProfile::publisher_default()
            .reliability_reliable(WhenFull::Fail)
            .durability(durability)
            .history(History::KeepLast { depth: qos.depth.into() });
        let ty = MessageTypeName::new(ty.package, ty.name);
        let publisher = Arc::new(InUse::default());
        let (pending, in_use) = (Arc::clone(&self.pending), Arc::clone(&publisher));
        self.domain.create(move |_| {
            let next = with_node(&pending, |node| {
                let of = node.create_topic(&name, ty.clone(), &qos).map_err(|it| wrong(&it))?;
                let publisher = node.create_publisher::<M>(&of, Some(qos.clone()));
                publisher.map_err(|error| wrong(&error))
            })?;
            let in_use = Arc::clone(&in_use);
            Ok(NewEntity::new(move || in_use.replace(next)))
        })?;
        let topic = topic.to_owned();
        Ok(Box::new(move |message| {
            if !publisher.with(|it| it.publish(message).is_ok()).unwrap_or(false) {
                debug!(topic, "a message is not sent");
            }
        }))
    }

    pub(crate) fn serve<Q, R>(
        &mut self,
        service: &str,
        ty: TypeName,
    ) -> Result<Requests<Q, R>, NodeError>
    where
        Q: Message + Clone + Send + Sync + 'static,
        R: Message + Send + Sync + 'static,
    {
        let wrong = refusal(service);
        let name = Name::new(&self.name, service).map_err(|error| wrong(&error))?;
        let ty = ServiceTypeName::new(ty.package, ty.name);
        let qos = QosProfile::publisher_default()
            .reliability_reliable(WhenFull::Fail)
            .history(History::KeepLast { depth: SERVICE_DEPTH });
        let (requested, requests) = mpsc::channel(WAITING);
        let service = Arc::new(Service {
            name: service.to_owned(),
            requested,
            recent: Mutex::new(RecentIds::new(REMEMBERED)),
            server: InUse::default(),
        });
        let pending = Arc::clone(&self.pending);
        self.domain.create(move |joined| {
            let server = with_node(&pending, |node| {
                // The mapping that clients of rmw_fastrtps have.
                let mapping = ServiceMapping::Enhanced;
                let server =
                    node.create_server::<Q, R>(mapping, &name, &ty, qos.clone(), qos.clone());
                server.map_err(|error| wrong(&error))
            })?;
            let (server, (start, started)) = (Arc::new(server), oneshot::channel());
            let serving = Arc::clone(&service).serve(Arc::clone(&server), started, joined.closed());
            joined.readers.spawn(serving);
            let service = Arc::clone(&service);
            Ok(NewEntity::new(move || {
                // The receiver is gone only if the participant is.
                let _ = start.send(());
                service.server.replace(server)
            }))
        })?;
        Ok(requests)
    }

    /// Completes the node: all of it is published and served. Each participant has its node as long
    /// as it is in use.
    pub(crate) fn complete(self) -> Result<(), NodeError> {
        let Self { domain, pending, .. } = self;
        let node = Arc::new(InUse::default());
        domain.create(move |joined| {
            let mut next = lock(&pending).take().ok_or(NodeError::NotJoined("ROS"))?;
            let spinner = next.spinner().map_err(|error| NodeError::Ros(error.to_string()))?;
            joined.tasks.spawn(async move {
                if let Err(error) = spinner.spin().await {
                    error!(%error, "the node has disappeared from ROS's graph");
                }
            });
            let node = Arc::clone(&node);
            Ok(NewEntity::new(move || node.replace(next)))
        })
    }
}

/// A service of the node's, whichever participant its requests come to.
struct Service<Q: Message, R: Message> {
    name: String,
    requested: mpsc::Sender<PendingRequest<Q, R>>,
    recent: Mutex<RecentIds<RmwRequestId>>,
    server: InUse<Arc<Server<Q, R>>>,
}

impl<Q, R> Service<Q, R>
where
    Q: Message + Clone + Send + Sync + 'static,
    R: Message + Send + Sync + 'static,
{
    /// Takes the requests that come to one participant, from its start until that is closed.
    async fn serve(
        self: Arc<Self>,
        server: Arc<Server<Q, R>>,
        start: oneshot::Receiver<()>,
        closed: impl Future<Output = ()>,
    ) {
        // Before, the client has met the former server, but perhaps not yet this one to be answered
        // by.
        if start.await.is_err() {
            return;
        }
        let stream = server.receive_request_stream();
        pin_mut!(stream, closed);
        loop {
            let received = tokio::select! {
                biased;
                () = &mut closed => return,
                received = stream.next() => received,
            };
            let (id, request) = match received {
                Some(Ok(received)) => received,
                Some(Err(_)) => {
                    debug!(service = self.name, "a request cannot be read");
                    continue;
                }
                None => return,
            };
            if !lock(&self.recent).insert(id) {
                continue;
            }
            let service = Arc::clone(&self);
            let reply = ServiceReply::new(move |answer| {
                let sent = service.server.with(|it| it.send_response(id, answer).is_ok());
                if !sent.unwrap_or(false) {
                    debug!(service = service.name, "an answer is not sent");
                }
            });
            if self.requested.send(PendingRequest { request, reply }).await.is_err() {
                return;
            }
        }
    }
}

/// Returns a function that makes an error about a topic or service.
fn refusal(name: &str) -> impl Fn(&dyn std::fmt::Display) -> NodeError + use<> {
    let name = name.to_owned();
    move |error| NodeError::Ros(format!("{name}: {error}"))
}

fn with_node<T>(
    pending: &PendingNode,
    access: impl FnOnce(&mut Node) -> Result<T, NodeError>,
) -> Result<T, NodeError> {
    access(lock(pending).as_mut().ok_or(NodeError::NotJoined("ROS"))?)
}
