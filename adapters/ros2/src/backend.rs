//! Where the node is at home: the middleware on which ROS sees it, with its parameters and reports.

mod dds;
#[cfg(feature = "zenoh")]
mod zenoh;

use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};

use ros2_client::Message;
use serde::Serialize;
use tokio::task::JoinSet;

use self::dds::Participant;
use crate::error::NodeError;
use crate::key::{MessageKey, Stamp};
#[cfg(feature = "zenoh")]
use crate::middleware::zenoh::ZenohSession;
use crate::middleware::{Graph, ReceivedPayload, time_of_day};
use crate::parameters::Value;
use crate::report::RosTime;
use crate::service::Requests;
use crate::settings::{Middleware, Qos, Settings};

/// A node as ROS sees it.
pub(crate) enum NodeBackend {
    /// In a participant of DDS.
    Dds(Box<Participant>),
    /// In a session of Zenoh.
    #[cfg(feature = "zenoh")]
    Zenoh(ZenohSession),
}

/// Publishes messages of one type; what cannot be sent is left out.
pub(crate) type MessagePublisher<M> = Box<dyn Fn(M) + Send + Sync>;

/// Gets each parameter that was set: its name and its value.
pub(crate) type ParameterCallback = Box<dyn Fn(&str, &Value) + Send + Sync>;

/// What the node says of itself reaches each subscriber that is there.
pub(crate) const REPORTS: Qos = Qos { reliable: true, transient_local: false, depth: 10 };

/// A type of a package of ROS.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct TypeName {
    pub(crate) package: &'static str,
    pub(crate) name: &'static str,
}

impl NodeBackend {
    /// Shows the node in what was joined for its own topics.
    pub(crate) fn show(settings: &Settings, graph: &Graph) -> Result<Self, NodeError> {
        match settings.middleware {
            Middleware::Dds => {
                let domain = graph.dds.as_ref().ok_or(NodeError::NotJoined("DDS"))?;
                Participant::show(settings, domain).map(|it| Self::Dds(Box::new(it)))
            }
            #[cfg(feature = "zenoh")]
            Middleware::Zenoh => {
                let session = graph.zenoh.as_ref().ok_or(NodeError::NotJoined("Zenoh"))?;
                Ok(Self::Zenoh(session.beside()))
            }
            #[cfg(not(feature = "zenoh"))]
            Middleware::Zenoh => Err(NodeError::NoZenoh),
        }
    }

    /// A publisher of the node's own.
    pub(crate) fn message_publisher<M>(
        &mut self,
        topic: &str,
        ty: TypeName,
        qos: Qos,
    ) -> Result<MessagePublisher<M>, NodeError>
    where
        M: Serialize + Send + Sync + 'static,
    {
        match self {
            Self::Dds(participant) => participant.message_publisher(topic, ty, qos),
            #[cfg(feature = "zenoh")]
            Self::Zenoh(session) => session.message_publisher(topic, ty, qos),
        }
    }

    /// A service of the node's own, below its name, served in `tasks` or in what was joined.
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
        match self {
            Self::Dds(participant) => participant.serve(service, ty, tasks),
            #[cfg(feature = "zenoh")]
            Self::Zenoh(session) => session.serve(service, ty, tasks),
        }
    }

    /// Once all is published and served. What keeps the node there is kept by what is returned, or runs in what was joined.
    pub(crate) fn settle(self, settings: &Settings) -> Result<DiscoveredNode, NodeError> {
        match self {
            Self::Dds(participant) => participant.settle(settings),
            #[cfg(feature = "zenoh")]
            Self::Zenoh(session) => session.settle(settings),
        }
    }
}

/// A node that is shown whole.
pub(crate) struct DiscoveredNode {
    /// The time that messages are stamped with.
    pub(crate) clock: Box<dyn Fn() -> RosTime + Send + Sync>,
    /// Gets each parameter that was set.
    pub(crate) set: ParameterCallback,
}

/// The topic of simulated time, its type, and what is required of it.
const CLOCK: (&str, &str, Qos) = (
    "/clock",
    "rosgraph_msgs/msg/Clock",
    Qos { reliable: false, transient_local: false, depth: 1 },
);

/// The time that the node's own messages are stamped with: of day, or what was last on `/clock`.
struct Clock {
    simulated: AtomicI64,
    is_simulated: AtomicBool,
}

impl Clock {
    fn new(settings: &Settings) -> Self {
        Self { simulated: AtomicI64::new(0), is_simulated: AtomicBool::new(settings.use_sim_time) }
    }

    /// Takes a time that came on the topic.
    fn take(&self, sample: ReceivedPayload) {
        // A `rosgraph_msgs/Clock` is one time, as a header's stamp is.
        let time = sample.ok().and_then(|it| MessageKey::Header.read(&it.body, it.big_endian).ok());
        if let Some(nanos) = time.and_then(Stamp::nanos) {
            self.simulated.store(nanos, Ordering::Relaxed);
        }
    }

    /// A parameter was set.
    fn set(&self, name: &str, value: &Value) {
        if let ("use_sim_time", Value::Bool(value)) = (name, value) {
            self.is_simulated.store(*value, Ordering::Relaxed);
        }
    }

    fn now(&self) -> RosTime {
        let is_simulated = self.is_simulated.load(Ordering::Relaxed);
        let simulated = self.simulated.load(Ordering::Relaxed);
        RosTime::of_nanos(if is_simulated { simulated } else { time_of_day() })
    }
}
