//! The node in a participant of DDS.

use std::sync::Arc;

use futures_util::StreamExt;
use ros2_client::dds::{Context, Node, ServiceMapping};
use ros2_client::qos::{Durability, History, WhenFull};
use ros2_client::{
    Message, MessageTypeName, Name, NodeName, NodeOptions, QosProfile, ServiceTypeName,
};
use serde::Serialize;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tracing::{debug, error};

use super::{Settled, Teller, TypeName};
use crate::error::NodeError;
use crate::middleware::Domain;
use crate::parameters::ros;
use crate::report::Time;
use crate::service::{Asked, Reply, Requests, WAITING};
use crate::settings::{Qos, Settings};

/// The node, and its full name.
pub(crate) struct Participant {
    node: Node,
    name: String,
}

impl Participant {
    pub(super) fn show(settings: &Settings, domain: &Domain) -> Result<Self, NodeError> {
        let context = Context::from_domain_participant(domain.participant.clone())
            .map_err(|error| NodeError::Ros(error.to_string()))?;
        let name = NodeName::new(&settings.node.namespace, &settings.node.name);
        let name = name.map_err(|error| NodeError::Ros(error.to_string()))?;
        // The node serves its parameters itself: these would be described by their values alone.
        let mut options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
        for parameter in &settings.declared {
            options =
                options.declare_parameter(&parameter.name, ros::value(&parameter.value).into());
        }
        let node = context.new_node(name, options);
        let node = node.map_err(|error| NodeError::Ros(format!("{error:?}")))?;
        Ok(Self { node, name: settings.node.full() })
    }

    pub(super) fn teller<M>(
        &mut self,
        topic: &str,
        ty: TypeName,
        qos: Qos,
    ) -> Result<Teller<M>, NodeError>
    where
        M: Serialize + Send + Sync + 'static,
    {
        let wrong = |error: &dyn std::fmt::Display| NodeError::Ros(format!("{topic}: {error}"));
        let name = Name::parse(topic).map_err(|error| wrong(&error))?;
        let durability =
            if qos.transient_local { Durability::TransientLocal } else { Durability::Volatile };
        let qos = QosProfile::publisher_default()
            .reliability_reliable(WhenFull::Fail)
            .durability(durability)
            .history(History::KeepLast { depth: qos.depth.into() });
        let ty = MessageTypeName::new(ty.package, ty.name);
        let of = self.node.create_topic(&name, ty, &qos).map_err(|error| wrong(&error))?;
        let publisher = self.node.create_publisher::<M>(&of, Some(qos));
        let publisher = publisher.map_err(|error| wrong(&error))?;
        let topic = topic.to_owned();
        Ok(Box::new(move |message| {
            if publisher.publish(message).is_err() {
                debug!(topic, "not sent");
            }
        }))
    }

    pub(super) fn serve<Q, R>(
        &mut self,
        service: &str,
        ty: TypeName,
        tasks: &mut JoinSet<()>,
    ) -> Result<Requests<Q, R>, NodeError>
    where
        Q: Message + Clone + Send + Sync + 'static,
        R: Message + Send + Sync + 'static,
    {
        let wrong = |error: &dyn std::fmt::Display| NodeError::Ros(format!("{service}: {error}"));
        let name = Name::new(&self.name, service).map_err(|error| wrong(&error))?;
        let ty = ServiceTypeName::new(ty.package, ty.name);
        let qos = QosProfile::publisher_default().reliability_reliable(WhenFull::Fail);
        // The mapping that clients of rmw_fastrtps have.
        let server = self
            .node
            .create_server::<Q, R>(ServiceMapping::Enhanced, &name, &ty, qos.clone(), qos)
            .map_err(|error| wrong(&error))?;
        let (server, (asked, requests)) = (Arc::new(server), mpsc::channel(WAITING));
        let service = service.to_owned();
        tasks.spawn(async move {
            let mut stream = server.receive_request_stream();
            while let Some(received) = stream.next().await {
                let Ok((id, request)) = received else {
                    debug!(service, "a request that cannot be read");
                    continue;
                };
                let (server, service) = (Arc::clone(&server), service.clone());
                let reply = Reply::new(move |answer| {
                    if server.send_response(id, answer).is_err() {
                        debug!(service, "answer not sent");
                    }
                });
                if asked.send(Asked { request, reply }).await.is_err() {
                    break;
                }
            }
        });
        Ok(requests)
    }

    pub(super) fn settle(
        mut self,
        _: &Settings,
        tasks: &mut JoinSet<()>,
    ) -> Result<Settled, NodeError> {
        let spinner = self.node.spinner().map_err(|error| NodeError::Ros(error.to_string()))?;
        tasks.spawn(async move {
            if let Err(error) = spinner.spin().await {
                error!(%error, "ROS sees the node no longer");
            }
        });
        let node = Arc::new(self.node);
        let clock = Arc::clone(&node);
        Ok(Settled {
            // The time of day, or simulated time.
            clock: Box::new(move || Time::of_nanos(clock.time_now().to_nanos())),
            set: Box::new(move |name, value| {
                // It says so on /parameter_events, and follows simulated time if it is to.
                if let Err(why) = node.set_parameter(name, ros::value(value).into()) {
                    debug!(name, why, "a change that is not told");
                }
            }),
        })
    }
}
