//! A node on topics within this process, which a test drives.

use std::sync::atomic::{AtomicBool, AtomicUsize};
use std::sync::{Mutex, MutexGuard};

use fuseline_engine::Tally;

use super::*;
use crate::error::NodeError;
use crate::in_process::{self, NodeSenders, PublishedTopic, ReceivedTopic, Surroundings, settings};
use crate::report::DiagnosticStatus;

/// Returns a message: its key, then text.
pub(super) fn payload(key: u64, text: &str) -> Payload {
    let mut body = key.to_le_bytes().to_vec();
    body.extend_from_slice(text.as_bytes());
    Payload { big_endian: false, body: body.into() }
}

fn key(payload: &Payload) -> u64 {
    u64::from_le_bytes(*payload.body.first_chunk().unwrap())
}

fn text(body: &Bytes) -> String {
    String::from_utf8(body[8..].to_vec()).unwrap()
}

/// The output of the node.
#[derive(Default)]
pub(super) struct NodeOutput {
    pub(super) lines: Vec<String>,
    pub(super) diagnostics: Vec<Vec<DiagnosticStatus>>,
}

/// A node on topics. Its local is a model behind topics, and its clouds are called.
pub(super) struct Node {
    pub(super) start: Instant,
    pub(super) peers: Arc<Peers>,
    pub(super) counting: Counting,
    pub(super) running: tokio::task::JoinHandle<Result<Tally, NodeError>>,
}

/// Everything around the node.
pub(super) struct Peers {
    start: Instant,
    pub(super) senders: NodeSenders,
    /// The plans of local and of the clouds.
    plans: Vec<Plan>,
    /// The number of local's subscribers.
    pub(super) local: AtomicUsize,
    /// `true` if requests to local are lost.
    pub(super) is_deaf: AtomicBool,
    /// The output and the revision that were published last.
    published: Mutex<[Option<Payload>; 2]>,
    reported_lines: Mutex<NodeOutput>,
    /// The calls that ended or were dropped, by priority, with the time in milliseconds.
    pub(super) dropped: Drops,
    /// The late results that were published, with the time in milliseconds.
    pub(super) hints: Mutex<Vec<(u128, Payload)>>,
}

type Drops = Arc<Mutex<Vec<(usize, u128)>>>;

/// Records when a call ends or is dropped.
struct Guard(Drops, usize, Instant);

impl Drop for Guard {
    fn drop(&mut self) {
        self.0.lock().unwrap().push((self.1, self.2.elapsed().as_millis()));
    }
}

impl Surroundings for Peers {
    fn publish(self: &Arc<Self>, topic: PublishedTopic, published: Payload) -> bool {
        match topic {
            PublishedTopic::Requests(_) if self.is_deaf.load(Ordering::Relaxed) => {}
            PublishedTopic::Requests(source) => {
                let (t, peers) = (key(&published), Arc::clone(self));
                let computing = compute(self.plans[source](t), "local".into(), t, self.start);
                tokio::spawn(async move {
                    let value = payload(t, &computing.await.unwrap());
                    peers.senders.send(ReceivedTopic::Results(source), Some(value)).await
                });
            }
            PublishedTopic::Hints(_) => {
                self.hints.lock().unwrap().push((self.start.elapsed().as_millis(), published));
            }
            PublishedTopic::Output | PublishedTopic::Revisions => {
                let index = usize::from(topic == PublishedTopic::Revisions);
                let earlier = self.published.lock().unwrap()[index].replace(published);
                assert_eq!(earlier, None, "an output without a status");
            }
        }
        true
    }

    fn subscribers(&self, topic: PublishedTopic) -> usize {
        match topic {
            PublishedTopic::Requests(_) => self.local.load(Ordering::Relaxed),
            PublishedTopic::Hints(_) | PublishedTopic::Output | PublishedTopic::Revisions => 1,
        }
    }

    fn call(
        self: &Arc<Self>,
        cloud: usize,
        request: Payload,
        call: Call,
    ) -> impl Future<Output = Result<Payload, Error>> + Send + 'static {
        let guard = Guard(Arc::clone(&self.dropped), cloud, self.start);
        let t = key(&request);
        assert_eq!(call.timestamp, t);
        let computing = compute(self.plans[cloud](t), format!("cloud{cloud}"), t, self.start);
        async move {
            let _guard = guard;
            Ok(payload(t, &computing.await?))
        }
    }

    fn status(&self, status: DiagnosticStatus) {
        let of = |key: &str| {
            let found = status.values.iter().find(|value| value.key == key);
            found.map(|value| value.value.clone()).unwrap_or_default()
        };
        let published = self.published.lock().unwrap().each_mut().map(Option::take);
        let text = |payload: &Payload| {
            assert_eq!(key(payload).to_string(), of("key"), "another message's output");
            let text = text(&payload.body);
            assert!(text.starts_with(&format!("{}'s", of("source"))), "{text} of {status:?}");
            text
        };
        let text = match published {
            [None, None] => status.message.clone(),
            [Some(output), None] => format!("{} by {}", text(&output), of("rule")),
            [None, Some(revision)] => {
                format!("{} as revision {}", text(&revision), of("revision"))
            }
            [Some(_), Some(_)] => panic!("two at once of {status:?}"),
        };
        let t = of("timestamp").parse().unwrap();
        let line = line(self.start.elapsed().as_millis(), t, &text);
        self.reported_lines.lock().unwrap().lines.push(line);
    }

    fn diagnostics(&self, status: Vec<DiagnosticStatus>) {
        self.reported_lines.lock().unwrap().diagnostics.push(status);
    }
}

impl Node {
    pub(super) fn start(local: Plan, clouds: &[(u64, Plan)]) -> Self {
        Self::start_with(local, clouds, &[])
    }

    /// Starts the node with more parameters.
    pub(super) fn start_with(local: Plan, clouds: &[(u64, Plan)], more: &[&str]) -> Self {
        let start = Instant::now();
        let mut parameters: Vec<_> = more.iter().map(|it| (*it).to_owned()).collect();
        for (cloud, (ms, _)) in (1..).zip(clouds) {
            let deadline = Duration::from_millis(*ms).as_secs_f64();
            parameters.push(format!("cloud{cloud}.deadline:={deadline:?}"));
            parameters.push(format!("cloud{cloud}.grpc.url:=http://localhost:1"));
        }
        let settings = settings(clouds.len(), parameters);
        let peers = |senders| Peers {
            start,
            senders,
            plans: [local].into_iter().chain(clouds.iter().map(|cloud| cloud.1)).collect(),
            local: AtomicUsize::new(1),
            is_deaf: AtomicBool::default(),
            published: Mutex::default(),
            reported_lines: Mutex::default(),
            dropped: Drops::default(),
            hints: Mutex::default(),
        };
        let (peers, running, counting) = in_process::start(settings, peers).unwrap();
        Self { start, peers, counting, running }
    }

    /// Sends messages at these milliseconds, with rising keys from `first` on.
    pub(super) async fn feed(&self, first: u64, messages: impl IntoIterator<Item = u64>) {
        for (t, ms) in (first..).zip(messages) {
            sleep_until(self.start + Duration::from_millis(ms)).await;
            assert!(self.peers.senders.send(ReceivedTopic::Input, Some(payload(t, "frame"))).await);
        }
    }

    pub(super) async fn until(&self, ms: u64) {
        sleep_until(self.start + Duration::from_millis(ms)).await;
    }

    pub(super) fn reported_lines(&self) -> MutexGuard<'_, NodeOutput> {
        self.peers.reported_lines.lock().unwrap()
    }

    pub(super) fn lines(&self) -> Vec<String> {
        self.reported_lines().lines.clone()
    }

    pub(super) fn tally(&self) -> Tally {
        self.counting.tally()
    }
}
