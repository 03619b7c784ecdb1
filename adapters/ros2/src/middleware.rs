//! The middleware under the node's topics: DDS, Zenoh, or both in one node.

mod dds;
mod end;
#[cfg(feature = "zenoh")]
pub(crate) mod zenoh;

use std::sync::Arc;
use std::time::SystemTime;

use ros2_client::Message;
use serde::Serialize;
use thiserror::Error;
use tokio::task::JoinSet;

use self::dds::{Domain, RosNode};
pub(crate) use self::end::Endpoint;
#[cfg(feature = "zenoh")]
use self::zenoh::ZenohSession;
use crate::error::NodeError;
use crate::raw::Payload;
use crate::service::Requests;
use crate::settings::{Middleware, Qos, Settings};

/// A sample that came on a topic.
pub(crate) type ReceivedPayload = Result<Payload, DecodeError>;

/// The reason why a sample is not a message.
#[derive(Clone, PartialEq, Eq, Debug, Error)]
#[error("{0}")]
pub(crate) struct DecodeError(pub(crate) String);

/// Sends serialized messages to a topic's subscribers.
pub(crate) trait Publish: Send + Sync {
    /// Publishes without waiting; false if it cannot, as a reliable subscriber is too far behind.
    fn publish(&self, payload: Payload) -> bool;

    /// Returns the number of subscribers.
    fn matched(&self) -> usize {
        self.end().matched()
    }

    /// Returns the topic's end.
    fn end(&self) -> &Arc<Endpoint>;
}

/// Publishes messages of one type; what cannot be sent is left out.
pub(crate) type MessagePublisher<M> = Box<dyn Fn(M) + Send + Sync>;

/// The node's own messages reach each present subscriber.
pub(crate) const REPORTS: Qos = Qos { reliable: true, transient_local: false, depth: 10 };

/// A type of a package of ROS.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct TypeName {
    pub(crate) package: &'static str,
    pub(crate) name: &'static str,
}

/// The middleware in which the node's topics are opened. They close when it is left.
pub(crate) struct Graph {
    dds: Option<Domain>,
    /// The node as ROS sees it over DDS, until it is complete; over Zenoh it is the session.
    node: Option<RosNode>,
    #[cfg(feature = "zenoh")]
    zenoh: Option<ZenohSession>,
}

impl Graph {
    /// Joins what these need.
    ///
    /// # Errors
    /// One of them cannot be joined, or is not built in.
    #[cfg_attr(
        not(feature = "zenoh"),
        expect(clippy::unused_async, reason = "a session of Zenoh is waited for")
    )]
    pub(crate) async fn join(
        settings: &Settings,
        needs: impl Fn(Middleware) -> bool,
    ) -> Result<Self, NodeError> {
        let dds = needs(Middleware::Dds)
            .then(|| Domain::join(settings.domain, settings.localhost_only))
            .transpose()?;
        Ok(Self {
            dds,
            node: None,
            #[cfg(feature = "zenoh")]
            zenoh: if needs(Middleware::Zenoh) {
                Some(ZenohSession::join(settings).await?)
            } else {
                None
            },
        })
    }

    /// Returns the same middleware for topics that close before it: a session of Zenoh is shared.
    pub(crate) async fn beside(&self, settings: &Settings) -> Result<Self, NodeError> {
        let needs = |middleware| settings.needs(middleware);
        #[cfg(feature = "zenoh")]
        if let Some(session) = &self.zenoh {
            let mut graph = Self::join(settings, |it| it == Middleware::Dds && needs(it)).await?;
            graph.zenoh = Some(session.beside());
            return Ok(graph);
        }
        Self::join(settings, needs).await
    }

    /// Publishes on a topic.
    pub(crate) fn publisher(
        &mut self,
        middleware: Middleware,
        topic: &str,
        ty: &str,
        qos: Qos,
    ) -> Result<Box<dyn Publish>, NodeError> {
        match middleware {
            Middleware::Dds => Ok(Box::new(self.dds()?.handle().publisher(topic, ty, qos)?)),
            #[cfg(feature = "zenoh")]
            Middleware::Zenoh => Ok(Box::new(self.zenoh()?.publisher(topic, ty, qos)?)),
            #[cfg(not(feature = "zenoh"))]
            Middleware::Zenoh => Err(NodeError::NoZenoh),
        }
    }

    /// Subscribes to a topic; `take` gets each message, in its publisher's order.
    pub(crate) fn subscribe<F>(
        &mut self,
        middleware: Middleware,
        topic: &str,
        ty: &str,
        qos: Qos,
        take: impl Fn(ReceivedPayload) -> F + Send + Sync + 'static,
    ) -> Result<Arc<Endpoint>, NodeError>
    where
        F: Future<Output = ()> + Send + 'static,
    {
        match middleware {
            Middleware::Dds => self.dds()?.handle().subscribe(topic, ty, qos, take),
            #[cfg(feature = "zenoh")]
            Middleware::Zenoh => self.zenoh()?.subscribe(topic, ty, qos, take),
            #[cfg(not(feature = "zenoh"))]
            Middleware::Zenoh => Err(NodeError::NoZenoh),
        }
    }

    /// Shows the node in its own middleware. Its publishers and services follow, and then
    /// [`complete`](Self::complete).
    pub(crate) fn show(&mut self, settings: &Settings) -> Result<(), NodeError> {
        if settings.middleware == Middleware::Dds {
            self.node = Some(RosNode::new(settings, self.dds()?.handle())?);
        }
        Ok(())
    }

    /// Returns a publisher of the node's own.
    pub(crate) fn message_publisher<M>(
        &mut self,
        topic: &str,
        ty: TypeName,
        qos: Qos,
    ) -> Result<MessagePublisher<M>, NodeError>
    where
        M: Serialize + Send + Sync + 'static,
    {
        match &mut self.node {
            Some(node) => node.message_publisher(topic, ty, qos),
            #[cfg(feature = "zenoh")]
            None => self.zenoh()?.message_publisher(topic, ty, qos),
            #[cfg(not(feature = "zenoh"))]
            None => Err(NodeError::NoZenoh),
        }
    }

    /// Serves a service of the node's own, below its name, and returns its requests. Over Zenoh it
    /// is served in `tasks`.
    #[cfg_attr(not(feature = "zenoh"), expect(unused_variables, reason = "they serve Zenoh"))]
    pub(crate) fn serve<Q, R>(
        &mut self,
        service: &str,
        ty: TypeName,
        tasks: &mut JoinSet<()>,
    ) -> Result<Requests<Q, R>, NodeError>
    where
        Q: Message + Clone + Send + Sync + 'static,
        R: Message + Send + Sync + 'static,
    {
        match &mut self.node {
            Some(node) => node.serve(service, ty),
            #[cfg(feature = "zenoh")]
            None => self.zenoh()?.serve(service, ty, tasks),
            #[cfg(not(feature = "zenoh"))]
            None => Err(NodeError::NoZenoh),
        }
    }

    /// Completes the node: all of it is published and served.
    pub(crate) fn complete(&mut self) -> Result<(), NodeError> {
        self.node.take().map_or(Ok(()), RosNode::complete)
    }

    /// Leaves: ends of topics close before what they are in.
    pub(crate) async fn leave(self) {
        if let Some(domain) = self.dds {
            domain.leave().await;
        }
        #[cfg(feature = "zenoh")]
        if let Some(session) = self.zenoh {
            session.leave().await;
        }
    }

    fn dds(&self) -> Result<&Domain, NodeError> {
        self.dds.as_ref().ok_or(NodeError::NotJoined("DDS"))
    }

    #[cfg(feature = "zenoh")]
    fn zenoh(&mut self) -> Result<&mut ZenohSession, NodeError> {
        self.zenoh.as_mut().ok_or(NodeError::NotJoined("Zenoh"))
    }
}

/// Returns the time of day, in nanoseconds.
pub(crate) fn time_of_day() -> i64 {
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    i64::try_from(now.as_nanos()).unwrap_or(i64::MAX)
}
