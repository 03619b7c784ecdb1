//! The node in a session of Zenoh.

use std::sync::Arc;

use ros2_client::Message;
use ros2_client::builtin_interfaces;
use ros2_client::parameters::raw::{Parameter, ParameterEvent};
use serde::Serialize;
use tokio::sync::mpsc;
use tokio::task::{JoinSet, spawn_blocking};
use tracing::debug;
use zenoh::Wait;

use super::{CLOCK, Clock, DiscoveredNode, MessagePublisher, REPORTS, TypeName};
use crate::error::NodeError;
use crate::middleware::Publish;
use crate::middleware::time_of_day;
use crate::middleware::zenoh::ZenohSession;
use crate::middleware::zenoh::wire::Attachment;
use crate::parameters::{Value, ros};
use crate::raw::Payload;
use crate::service::{PendingRequest, Requests, ServiceReply, WAITING};
use crate::settings::{Qos, Settings};

/// How many requests of a service may wait in the session; the oldest are left out.
const REQUESTS: usize = 64;

impl ZenohSession {
    pub(super) fn message_publisher<M>(
        &mut self,
        topic: &str,
        ty: TypeName,
        qos: Qos,
    ) -> Result<MessagePublisher<M>, NodeError>
    where
        M: Serialize + Send + Sync + 'static,
    {
        let ty = format!("{}/msg/{}", ty.package, ty.name);
        let outlet = self.outlet(topic, &ty, qos)?;
        Ok(Box::new(move |message| {
            if !Payload::of(&message).is_some_and(|payload| outlet.publish(payload)) {
                debug!(topic = outlet.end().topic, "not sent");
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
        Q: Message + Send + Sync + 'static,
        R: Message + Send + Sync + 'static,
    {
        let name = format!("{}/{service}", self.node());
        let ty = format!("{}/srv/{}", ty.package, ty.name);
        let (queries, token) = self.queryable(&name, &ty, REQUESTS)?;
        let (requested, requests) = mpsc::channel(WAITING);
        tasks.spawn(async move {
            // The service is there as long as this runs.
            let _token = token;
            while let Ok(query) = queries.recv_async().await {
                let id = query.attachment().map(|bytes| bytes.to_bytes().into_owned());
                let id = id.and_then(|bytes| Attachment::from_bytes(&bytes));
                let payload = query.payload().map(|bytes| bytes.to_bytes().into_owned().into());
                let payload = payload.and_then(|bytes| Payload::from_serialized(&bytes));
                let (Some(id), Some(request)) = (id, payload.and_then(|it| it.read())) else {
                    debug!(name, "a request that cannot be read");
                    continue;
                };
                let reply = ServiceReply::new(move |answer: R| {
                    let Some(payload) = Payload::of(&answer) else { return };
                    let attachment = Attachment { sent: time_of_day(), ..id }.to_bytes();
                    spawn_blocking(move || {
                        let bytes = payload.to_serialized();
                        let reply = query.reply(query.key_expr(), &bytes[..]);
                        if let Err(error) = reply.attachment(attachment).wait() {
                            debug!(%error, "answer not sent");
                        }
                    });
                });
                if requested.send(PendingRequest { request, reply }).await.is_err() {
                    break;
                }
            }
        });
        Ok(requests)
    }

    pub(super) fn settle(mut self, settings: &Settings) -> Result<DiscoveredNode, NodeError> {
        let clock = Arc::new(Clock::new(settings));
        let (topic, ty, qos) = CLOCK;
        let taking = Arc::clone(&clock);
        self.inlet(topic, ty, qos, move |sample| {
            taking.take(sample);
            std::future::ready(())
        })?;
        let ty = TypeName { package: "rcl_interfaces", name: "ParameterEvent" };
        let events = self.message_publisher::<ParameterEvent>("/parameter_events", ty, REPORTS)?;
        let node = self.node();
        let setting = Arc::clone(&clock);
        // The ends stay open as long as the time is published.
        let session = std::sync::Mutex::new(self);
        Ok(DiscoveredNode {
            clock: Box::new(move || {
                let _ = &session;
                clock.now()
            }),
            set: Box::new(move |name, value| {
                setting.set(name, value);
                events(ParameterEvent {
                    stamp: builtin_interfaces::Time::now(),
                    node: node.clone(),
                    new_parameters: Vec::new(),
                    changed_parameters: vec![Parameter {
                        name: name.to_owned(),
                        value: ros::value(value),
                    }],
                    deleted_parameters: Vec::new(),
                });
            }),
        })
    }
}
