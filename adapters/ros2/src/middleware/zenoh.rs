//! Ends of topics over Zenoh, in the format of `rmw_zenoh`: serialized messages in and out.

pub(crate) mod config;
mod node;
mod types;
mod wire;

use std::any::Any;
use std::ops::Deref;
use std::sync::atomic::{AtomicI64, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock, mpsc};
use std::thread;

use bytes::Bytes;
use tokio::sync::oneshot;
use tokio::task::JoinSet;
use tokio::time::Instant;
use tracing::{info, warn};
use zenoh::bytes::ZBytes;
use zenoh::handlers::{RingChannel, RingChannelHandler};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Reliability};
use zenoh::query::{Query, Queryable};
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait};
use zenoh_ext::{
    AdvancedPublisher, AdvancedPublisherBuilderExt, AdvancedSubscriberBuilderExt, CacheConfig,
    HistoryConfig,
};

use self::types::Types;
use self::wire::{Attachment, Entity, TokenKind, TokenOwner, gid, group_key, hash_of, type_of};
use super::end::{Endpoint, Gid, dds_type};
use super::{DecodeError, Publish, ReceivedPayload, time_of_day};
use crate::error::NodeError;
use crate::raw::Payload;
use crate::settings::{Qos, Role, Settings};

/// The bounds on messages and bytes that wait for a slow link; one message may always wait.
const WAITING: (usize, usize) = (1024, 64 << 20);

/// At least this many messages of a topic may wait to be taken in, whatever its depth, so that a
/// burst loses none.
const BURST: usize = 64;

/// The node in its session.
pub(crate) struct ZenohSession {
    shared: Arc<SharedSession>,
    /// Subscribers, queryables and tokens; they end with this.
    held: Vec<Box<dyn Any + Send + Sync>>,
    /// The tasks that serve the ends; they end with this.
    pub(crate) tasks: JoinSet<()>,
    /// `true` if the session ends with this.
    is_first: bool,
}

struct SharedSession {
    session: Session,
    owner: TokenOwner,
    types: Types,
    /// Numbers the node's ends; the node itself is 0.
    ends: AtomicU64,
}

/// A publisher of serialized messages. A thread of its own publishes them, for a link that is too
/// slow holds it up.
pub(crate) struct SerializedPublisher {
    end: Arc<Endpoint>,
    queue: mpsc::Sender<Payload>,
    waiting: Arc<PublishBacklog>,
}

/// Counts the messages that wait to be published, and their bytes.
#[derive(Default)]
struct PublishBacklog {
    messages: AtomicUsize,
    bytes: AtomicUsize,
}

/// The publisher, once the type's hash is known.
struct TypedPublisher {
    writer: PublisherLink,
    source: Gid,
    sequence: AtomicI64,
    /// Peers see the publisher as long as it is there.
    _token: LivelinessToken,
}

enum PublisherLink {
    Volatile(Publisher<'static>),
    /// It keeps messages for subscribers that come later.
    TransientLocal(AdvancedPublisher<'static>),
}

impl ZenohSession {
    /// Opens a session, which the environment configures, and shows the node in it.
    pub(crate) async fn join(settings: &Settings) -> Result<Self, NodeError> {
        let config = config::from_environment()?;
        let (domain, node) = (settings.domain, settings.node.clone());
        // Zenoh waits for threads of its own here, which it refuses to do on a thread of this
        // runtime.
        let opened = apart(move || -> zenoh::Result<_> {
            let session = zenoh::open(config).wait()?;
            let routers = session.info().routers_zid().wait().count();
            let peers = session.info().peers_zid().wait().count();
            let owner = TokenOwner { domain, session: session.zid().to_string(), node };
            let token = session.liveliness().declare_token(owner.node_token()).wait()?;
            Ok((session, owner, token, routers, peers))
        });
        let (session, owner, token, routers, peers) = opened.await?;
        if routers + peers == 0 {
            warn!("Zenoh has reached neither a router nor a peer yet and keeps trying");
        } else {
            info!(routers, peers, "Zenoh has reached a router or a peer");
        }
        let (types, ends) = (Types::default(), AtomicU64::new(1));
        let shared = Arc::new(SharedSession { session, owner, types, ends });
        let held: Vec<Box<dyn Any + Send + Sync>> = vec![Box::new(token)];
        Ok(Self { shared, held, tasks: JoinSet::new(), is_first: true })
    }

    /// Returns the same session, for endpoints that close before it does.
    pub(crate) fn beside(&self) -> Self {
        let shared = Arc::clone(&self.shared);
        Self { shared, held: Vec::new(), tasks: JoinSet::new(), is_first: false }
    }

    /// Closes the ends, and the session if it began here.
    pub(crate) async fn leave(mut self) {
        self.tasks.shutdown().await;
        apart(move || drop(self)).await;
    }

    /// Returns the node's full name.
    pub(crate) fn node(&self) -> String {
        self.shared.owner.node.full()
    }

    /// Publishes on a topic.
    pub(crate) fn publisher(
        &mut self,
        topic: &str,
        ty: &str,
        qos: Qos,
    ) -> Result<SerializedPublisher, NodeError> {
        let end = self.end(topic, ty, TokenKind::Subscription)?;
        self.watch_rivals(&end)?;
        let (queue, payloads) = mpsc::channel::<Payload>();
        let waiting = Arc::new(PublishBacklog::default());
        let status_publisher: Arc<OnceLock<TypedPublisher>> = Arc::default();
        let (declared, shared) = (Arc::downgrade(&status_publisher), Arc::clone(&self.shared));
        let (name, type_name) = (topic.to_owned(), dds_type(ty));
        self.when_known(ty, move |hash| {
            // It may have closed meanwhile.
            let Some(declared) = declared.upgrade() else { return };
            let entity =
                Entity { kind: TokenKind::Publisher, name: &name, type_name: &type_name, hash };
            match shared.status_publisher(&entity, qos) {
                Ok(status_publisher) => drop(declared.set(status_publisher)),
                Err(error) => warn!(topic = name, %error, "Zenoh refuses to publish on the topic"),
            }
        })?;
        let (done, topic) = (Arc::clone(&waiting), topic.to_owned());
        thread::Builder::new()
            .name("zenoh publisher".into())
            .spawn(move || {
                for payload in payloads {
                    let bytes = payload.body.len();
                    // Without a hash there is no subscriber either, because its token would contain
                    // the hash.
                    if let Some(Err(error)) = status_publisher
                        .get()
                        .map(|status_publisher| status_publisher.publish(&payload))
                    {
                        warn!(topic, %error, "a message is not published");
                    }
                    done.messages.fetch_sub(1, Ordering::Relaxed);
                    done.bytes.fetch_sub(bytes, Ordering::Relaxed);
                }
            })
            .map_err(NodeError::System)?;
        Ok(SerializedPublisher { end, queue, waiting })
    }

    /// Subscribes to a topic; `take` gets each message, in its publisher's order.
    pub(crate) fn subscribe<F>(
        &mut self,
        topic: &str,
        ty: &str,
        qos: Qos,
        take: impl Fn(ReceivedPayload) -> F + Send + Sync + 'static,
    ) -> Result<Arc<Endpoint>, NodeError>
    where
        F: Future<Output = ()> + Send + 'static,
    {
        let end = self.end(topic, ty, TokenKind::Publisher)?;
        let type_name = dds_type(ty);
        let SharedSession { session, owner, types, .. } = &*self.shared;
        let key = owner.key(topic, &type_name, "*");
        let subscriber = |key: String| {
            let waiting = RingChannel::new(usize::from(qos.depth).max(BURST));
            session.declare_subscriber(key).with(waiting)
        };
        let samples = Arc::new(Samples {
            end: Arc::clone(&end),
            types: types.clone(),
            type_name: type_name.clone(),
            take,
        });
        if qos.transient_local {
            let history =
                HistoryConfig::default().detect_late_publishers().max_samples(qos.depth.into());
            let subscriber = subscriber(key).advanced().history(history).wait()?;
            self.tasks.spawn(samples.run(subscriber));
        } else {
            // A message has one of the two keys; which, may change when subscriptions come or go.
            for key in [group_key(&key), key] {
                let subscriber = subscriber(key).wait()?;
                self.tasks.spawn(Arc::clone(&samples).run(subscriber));
            }
        }
        let token: Arc<OnceLock<LivelinessToken>> = Arc::default();
        let (declared, shared, name) =
            (Arc::downgrade(&token), Arc::clone(&self.shared), topic.to_owned());
        self.held.push(Box::new(token));
        self.when_known(ty, move |hash| {
            let Some(declared) = declared.upgrade() else { return };
            let kind = TokenKind::Subscription;
            let entity = Entity { kind, name: &name, type_name: &type_name, hash };
            match shared.token(&entity, qos) {
                Ok((token, _)) => drop(declared.set(token)),
                Err(error) => warn!(topic = name, %error, "Zenoh refuses to show the subscription"),
            }
        })?;
        Ok(end)
    }

    /// Serves requests, of which the last `capacity` wait until they are taken. The service is
    /// there as long as the token.
    pub(crate) fn queryable(
        &mut self,
        name: &str,
        ty: &str,
        capacity: usize,
    ) -> Result<(Queryable<RingChannelHandler<Query>>, LivelinessToken), NodeError> {
        let type_name = dds_type(ty);
        let hash = self.shared.types.known(&type_name);
        let hash = hash.ok_or_else(|| NodeError::Zenoh(format!("{ty} has no known hash")))?;
        let SharedSession { session, owner, .. } = &*self.shared;
        let key = owner.key(name, &type_name, &hash);
        let queryable =
            session.declare_queryable(key).complete(true).with(RingChannel::new(capacity));
        let queryable = queryable.wait()?;
        let entity = Entity { kind: TokenKind::Service, name, type_name: &type_name, hash: &hash };
        let (token, _) = self.shared.token(&entity, Qos::of(Role::Publisher))?;
        Ok((queryable, token))
    }

    /// Makes an end whose peers are of this kind.
    fn end(&mut self, topic: &str, ty: &str, peers: TokenKind) -> Result<Arc<Endpoint>, NodeError> {
        let SharedSession { session, owner, types, .. } = &*self.shared;
        let (end, type_name) = (Arc::new(Endpoint::new(topic, ty)), dds_type(ty));
        let (endpoint, ours, types) = (Arc::clone(&end), owner.clone(), types.clone());
        let tokens = session
            .liveliness()
            .declare_subscriber(owner.tokens_of_topic(peers, topic))
            .history(true)
            .callback(move |token| {
                let key = token.key_expr().as_str();
                let Some((its_type, hash)) = type_of(key).filter(|_| !ours.owns(key)) else {
                    return;
                };
                if token.kind() == SampleKind::Delete {
                    return endpoint.change(gid(key), -1, None);
                }
                if its_type == type_name {
                    types.learn(its_type, hash);
                }
                let is_ours = types.known(its_type).is_none_or(|known| known == hash);
                let its_type =
                    if is_ours { its_type.to_owned() } else { format!("{its_type}, {hash}") };
                endpoint.change(gid(key), 1, Some(&its_type));
            })
            .wait()?;
        self.held.push(Box::new(tokens));
        Ok(end)
    }

    /// Reports who else publishes on the end's topic.
    fn watch_rivals(&mut self, end: &Arc<Endpoint>) -> Result<(), NodeError> {
        let SharedSession { session, owner, .. } = &*self.shared;
        let (endpoint, ours) = (Arc::clone(end), owner.clone());
        let tokens = session
            .liveliness()
            .declare_subscriber(owner.tokens_of_topic(TokenKind::Publisher, &end.topic))
            .history(true)
            .callback(move |token| {
                let key = token.key_expr().as_str();
                if !ours.owns(key) {
                    endpoint.rival(gid(key), token.kind() == SampleKind::Put);
                }
            })
            .wait()?;
        self.held.push(Box::new(tokens));
        Ok(())
    }

    fn when_known(
        &self,
        ty: &str,
        act: impl FnOnce(&str) + Send + 'static,
    ) -> Result<(), NodeError> {
        let SharedSession { session, owner, types, .. } = &*self.shared;
        Ok(types.when_known(session, owner, &dds_type(ty), Box::new(act))?)
    }
}

/// The receiver of a topic's messages.
struct Samples<T> {
    end: Arc<Endpoint>,
    types: Types,
    type_name: String,
    take: T,
}

impl<T, F> Samples<T>
where
    T: Fn(ReceivedPayload) -> F + Send + Sync + 'static,
    F: Future<Output = ()> + Send + 'static,
{
    async fn run(
        self: Arc<Self>,
        subscriber: impl Deref<Target = RingChannelHandler<zenoh::sample::Sample>>,
    ) {
        let Self { end, types, type_name, take } = &*self;
        while let Ok(sample) = subscriber.recv_async().await {
            // Another version of the type: `/diagnostics` reports that peer.
            let hash = hash_of(sample.key_expr().as_str());
            if types.known(type_name).is_some_and(|known| known != hash) {
                continue;
            }
            end.received(Instant::now());
            let bytes = Bytes::from(sample.payload().to_bytes().into_owned());
            let payload = Payload::from_serialized(&bytes);
            take(payload.ok_or_else(|| DecodeError("it is not plain CDR".into()))).await;
        }
    }
}

impl Drop for ZenohSession {
    fn drop(&mut self) {
        let (held, session) = (std::mem::take(&mut self.held), self.shared.session.clone());
        let is_first = self.is_first;
        // Runs where this runtime's threads must not wait for Zenoh's.
        let ended = thread::spawn(move || {
            drop(held);
            if is_first && let Err(error) = session.close().wait() {
                warn!(%error, "Zenoh's session did not close well");
            }
        });
        drop(ended.join());
    }
}

impl SharedSession {
    /// Shows an end to its peers; with what identifies it.
    fn token(&self, entity: &Entity, qos: Qos) -> zenoh::Result<(LivelinessToken, Gid)> {
        let number = self.ends.fetch_add(1, Ordering::Relaxed);
        let token = self.owner.token(number, entity, qos);
        let source = gid(&token);
        Ok((self.session.liveliness().declare_token(token).wait()?, source))
    }

    /// Publishes on a topic. Messages that a slow link does not accept are dropped, as `rmw_zenoh`
    /// does for histories of last messages.
    fn status_publisher(&self, entity: &Entity, qos: Qos) -> zenoh::Result<TypedPublisher> {
        let key = self.owner.key(entity.name, entity.type_name, entity.hash);
        let reliability =
            if qos.reliable { Reliability::Reliable } else { Reliability::BestEffort };
        let publisher = || {
            self.session
                .declare_publisher(key.clone())
                .congestion_control(CongestionControl::Drop)
                .reliability(reliability)
        };
        let cache = CacheConfig::default().max_samples(qos.depth.into());
        let transient_local = qos
            .transient_local
            .then(|| publisher().advanced().cache(cache).publisher_detection().wait())
            .transpose()
            // It needs timestamps, which the configuration may not have.
            .inspect_err(|error| {
                warn!(topic = entity.name, %error, "late subscribers will not get earlier messages");
            });
        let writer = match transient_local {
            Ok(Some(transient_local)) => PublisherLink::TransientLocal(transient_local),
            Ok(None) | Err(_) => PublisherLink::Volatile(publisher().wait()?),
        };
        let (token, source) = self.token(entity, qos)?;
        Ok(TypedPublisher { writer, source, sequence: AtomicI64::new(1), _token: token })
    }
}

impl TypedPublisher {
    fn publish(&self, payload: &Payload) -> zenoh::Result<()> {
        let sequence = self.sequence.fetch_add(1, Ordering::Relaxed);
        let attachment = Attachment { sequence, sent: time_of_day(), source: self.source };
        let (bytes, attachment) = (zbytes(payload), attachment.to_bytes());
        match &self.writer {
            PublisherLink::Volatile(publisher) => {
                publisher.put(bytes).attachment(attachment).wait()
            }
            PublisherLink::TransientLocal(transient_local) => {
                transient_local.put(bytes).attachment(attachment).wait()
            }
        }
    }
}

impl Publish for SerializedPublisher {
    fn publish(&self, payload: Payload) -> bool {
        let (messages, most) = (&self.waiting.messages, WAITING);
        let length = payload.body.len();
        let before = messages.fetch_add(1, Ordering::Relaxed);
        let bytes = self.waiting.bytes.fetch_add(length, Ordering::Relaxed);
        let has_room = before == 0 || (before < most.0 && bytes < most.1);
        if has_room && self.queue.send(payload).is_ok() {
            return true;
        }
        messages.fetch_sub(1, Ordering::Relaxed);
        self.waiting.bytes.fetch_sub(length, Ordering::Relaxed);
        false
    }

    fn end(&self) -> &Arc<Endpoint> {
        &self.end
    }
}

/// Returns the message with its encapsulation header; the body is not copied.
fn zbytes(payload: &Payload) -> ZBytes {
    let mut bytes = ZBytes::writer();
    bytes.append(payload.encapsulation().to_vec().into());
    bytes.append(payload.body.clone().into());
    bytes.finish()
}

/// Does something on a thread outside of this runtime, and waits for it.
async fn apart<T: Send + 'static>(act: impl FnOnce() -> T + Send + 'static) -> T {
    let (done, received) = oneshot::channel();
    let thread = thread::spawn(move || drop(done.send(act())));
    match received.await {
        Ok(done) => done,
        Err(_) => match thread.join() {
            Err(panic) => std::panic::resume_unwind(panic),
            Ok(()) => unreachable!("it says what it did, or panics"),
        },
    }
}
