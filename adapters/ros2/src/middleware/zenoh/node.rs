//! The node's own publishers and services in a session of Zenoh.

use ros2_client::Message;
use serde::Serialize;
use tokio::sync::mpsc;
use tokio::task::{JoinSet, spawn_blocking};
use tracing::debug;
use zenoh::Wait;

use super::ZenohSession;
use super::wire::Attachment;
use crate::error::NodeError;
use crate::middleware::{MessagePublisher, Publish, TypeName, time_of_day};
use crate::raw::Payload;
use crate::service::{PendingRequest, Requests, ServiceReply, WAITING};
use crate::settings::Qos;

/// The number of requests of a service that may wait in the session; the oldest are dropped.
const REQUESTS: usize = 64;

impl ZenohSession {
    pub(crate) fn message_publisher<M>(
        &mut self,
        topic: &str,
        ty: TypeName,
        qos: Qos,
    ) -> Result<MessagePublisher<M>, NodeError>
    where
        M: Serialize + Send + Sync + 'static,
    {
        let ty = format!("{}/msg/{}", ty.package, ty.name);
        let publisher = self.publisher(topic, &ty, qos)?;
        Ok(Box::new(move |message| {
            if !Payload::of(&message).is_some_and(|payload| publisher.publish(payload)) {
                debug!(topic = publisher.end().topic, "a message is not sent");
            }
        }))
    }

    pub(crate) fn serve<Q, R>(
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
                    debug!(name, "a request cannot be read");
                    continue;
                };
                let reply = ServiceReply::new(move |answer: R| {
                    let Some(payload) = Payload::of(&answer) else { return };
                    let attachment = Attachment { sent: time_of_day(), ..id }.to_bytes();
                    spawn_blocking(move || {
                        let bytes = payload.to_serialized();
                        let reply = query.reply(query.key_expr(), &bytes[..]);
                        if let Err(error) = reply.attachment(attachment).wait() {
                            debug!(%error, "an answer is not sent");
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
}
