//! The middleware under the node's topics: DDS, Zenoh, or both in one node.

mod dds;
mod end;
#[cfg(feature = "zenoh")]
pub(crate) mod zenoh;

use std::sync::Arc;
use std::time::SystemTime;

use thiserror::Error;

pub(crate) use self::dds::{Domain, DomainHandle, InUse, NewEntity, RecentIds};
pub(crate) use self::end::Endpoint;
#[cfg(feature = "zenoh")]
use self::zenoh::ZenohSession;
use crate::error::NodeError;
use crate::raw::Payload;
use crate::settings::{Middleware, Qos, Settings};

/// What came on a topic.
pub(crate) type ReceivedPayload = Result<Payload, DecodeError>;

/// Why what came is no message.
#[derive(Clone, PartialEq, Eq, Debug, Error)]
#[error("{0}")]
pub(crate) struct DecodeError(pub(crate) String);

/// Sends serialized messages to a topic's subscribers.
pub(crate) trait Publish: Send + Sync {
    /// Publishes without waiting; false if it cannot, as a reliable subscriber is too far behind.
    fn publish(&self, payload: Payload) -> bool;

    /// How many subscribers there are.
    fn matched(&self) -> usize {
        self.end().matched()
    }

    /// The topic's end.
    fn end(&self) -> &Arc<Endpoint>;
}

/// Where the node's topics are opened; they close when it is left.
pub(crate) struct Graph {
    pub(crate) dds: Option<Domain>,
    #[cfg(feature = "zenoh")]
    pub(crate) zenoh: Option<ZenohSession>,
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
            #[cfg(feature = "zenoh")]
            zenoh: if needs(Middleware::Zenoh) {
                Some(ZenohSession::join(settings).await?)
            } else {
                None
            },
        })
    }

    /// The same for topics that close before this does: a session of Zenoh is shared.
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
    pub(crate) fn outlet(
        &mut self,
        middleware: Middleware,
        topic: &str,
        ty: &str,
        qos: Qos,
    ) -> Result<Box<dyn Publish>, NodeError> {
        match middleware {
            Middleware::Dds => Ok(Box::new(self.dds()?.handle().outlet(topic, ty, qos)?)),
            #[cfg(feature = "zenoh")]
            Middleware::Zenoh => Ok(Box::new(self.zenoh()?.outlet(topic, ty, qos)?)),
            #[cfg(not(feature = "zenoh"))]
            Middleware::Zenoh => Err(NodeError::NoZenoh),
        }
    }

    /// Subscribes to a topic; `take` gets each message, in its publisher's order.
    pub(crate) fn inlet<F>(
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
            Middleware::Dds => self.dds()?.handle().inlet(topic, ty, qos, take),
            #[cfg(feature = "zenoh")]
            Middleware::Zenoh => self.zenoh()?.inlet(topic, ty, qos, take),
            #[cfg(not(feature = "zenoh"))]
            Middleware::Zenoh => Err(NodeError::NoZenoh),
        }
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

/// Now, in nanoseconds.
pub(crate) fn time_of_day() -> i64 {
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    i64::try_from(now.as_nanos()).unwrap_or(i64::MAX)
}
