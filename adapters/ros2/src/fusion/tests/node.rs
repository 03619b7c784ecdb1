//! A node on topics within this process, which a test drives.

use std::sync::atomic::{AtomicBool, AtomicUsize};
use std::sync::{Mutex, MutexGuard};

use fuseline_engine::{Engine, Tally};
use fuseline_tokio::drive::{Driver, Timers, finish};
use tokio::sync::{mpsc, oneshot};

use super::*;
use crate::arguments::Arguments;
use crate::key::IntegerKind;
use crate::lifecycle::{LifecycleRequest, LifecycleTask, TransitionResult};
use crate::middleware::ReceivedPayload;
use crate::node;
use crate::report::DiagnosticStatus;
use crate::settings::Settings;
use crate::source::{Handle, UnmatchedResults};

/// A topic within this process. Published payloads go to the model of its subscriber.
struct Topic {
    subscriber: mpsc::UnboundedSender<Payload>,
    matched: Arc<AtomicUsize>,
    end: Arc<Endpoint>,
}

impl Publish for Topic {
    fn publish(&self, payload: Payload) -> bool {
        self.subscriber.send(payload).is_ok()
    }

    fn matched(&self) -> usize {
        self.matched.load(Ordering::Relaxed)
    }

    fn end(&self) -> &Arc<Endpoint> {
        &self.end
    }
}

fn topic(name: &str) -> (Topic, mpsc::UnboundedReceiver<Payload>) {
    let (subscriber, published) = mpsc::unbounded_channel();
    let end = Arc::new(Endpoint::new(name, "tests/msg/Text"));
    (Topic { subscriber, matched: Arc::new(AtomicUsize::new(1)), end }, published)
}

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

/// Receives what the node publishes, for a test.
struct Publication {
    reported_lines: Arc<Mutex<NodeOutput>>,
    /// The outputs, and the revisions.
    published: Mutex<[mpsc::UnboundedReceiver<Payload>; 2]>,
    start: Instant,
}

impl PublishStatus for Publication {
    fn status(&self, status: DiagnosticStatus) {
        let of = |key: &str| {
            let found = status.values.iter().find(|value| value.key == key);
            found.map(|value| value.value.clone()).unwrap_or_default()
        };
        let published = self.published.lock().unwrap().each_mut().map(|it| it.try_recv().ok());
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

/// A node on topics. Its local is a model behind topics, and its clouds are called.
pub(super) struct Node {
    pub(super) start: Instant,
    pub(super) mouths: Publications,
    /// The number of local's subscribers.
    pub(super) local: Arc<AtomicUsize>,
    /// `true` if requests to local are lost.
    pub(super) is_deaf: Arc<AtomicBool>,
    pub(super) reported_lines: Arc<Mutex<NodeOutput>>,
    pub(super) counting: Counting,
    /// The calls that ended or were dropped, by priority, with the time in milliseconds.
    pub(super) dropped: Drops,
    pub(super) hints: Hints,
    pub(super) running: tokio::task::JoinHandle<()>,
}

/// The calls that ended or were dropped, by priority, with the time in milliseconds.
type Drops = Arc<Mutex<Vec<(u16, u128)>>>;

/// The late results that were published, with the time in milliseconds.
type Hints = Arc<Mutex<Vec<(u128, Payload)>>>;

/// Records when a call ends or is dropped.
struct Guard(Drops, u16, Instant);

impl Drop for Guard {
    fn drop(&mut self) {
        self.0.lock().unwrap().push((self.1, self.2.elapsed().as_millis()));
    }
}

/// The publishers that send to a node.
pub(super) struct Publications {
    pub(super) inputs: mpsc::Sender<ReceivedPayload>,
    pub(super) results: mpsc::Sender<(usize, ReceivedPayload)>,
    pub(super) deadlines: mpsc::Sender<ReceivedPayload>,
    pub(super) speeds: mpsc::Sender<ReceivedPayload>,
    pub(super) changes: mpsc::UnboundedSender<Change>,
    pub(super) orders: mpsc::Sender<LifecycleRequest>,
}

/// The channels on which a node receives.
pub(super) struct Subscription {
    inputs: mpsc::Receiver<ReceivedPayload>,
    results: mpsc::Receiver<(usize, ReceivedPayload)>,
    deadlines: mpsc::Receiver<ReceivedPayload>,
    speeds: mpsc::Receiver<ReceivedPayload>,
    changes: mpsc::UnboundedReceiver<Change>,
    orders: mpsc::Receiver<LifecycleRequest>,
}

impl Publications {
    /// Orders a managed node to change its state. The receiver gets the result.
    pub(super) async fn order(&self, task: LifecycleTask) -> oneshot::Receiver<TransitionResult> {
        let (order, done) = LifecycleRequest::new(task);
        assert!(self.orders.send(order).await.is_ok(), "the node ended");
        done
    }
}

pub(super) fn mouths() -> (Publications, Subscription) {
    let (inputs, received_inputs) = mpsc::channel(1024);
    let (results, received_results) = mpsc::channel(64);
    let (deadlines, received_deadlines) = mpsc::channel(1);
    let (speeds, received_speeds) = mpsc::channel(1);
    let (changes, received_changes) = mpsc::unbounded_channel();
    let (orders, received_orders) = mpsc::channel(1);
    let subscription = Subscription {
        inputs: received_inputs,
        results: received_results,
        deadlines: received_deadlines,
        speeds: received_speeds,
        changes: received_changes,
        orders: received_orders,
    };
    (Publications { inputs, results, deadlines, speeds, changes, orders }, subscription)
}

/// Runs the shipped loop over these topics. Their messages begin with their keys.
pub(super) fn run(
    settings: &Settings,
    engine: Engine<Payload, Payload>,
    sources: Vec<NodeSource>,
    [output, revisions]: [Box<dyn Publish>; 2],
    status_publisher: Box<dyn PublishStatus>,
    mut subscription: Subscription,
) -> tokio::task::JoinHandle<()> {
    let (deadline, node) = (settings.deadline, settings.node.full());
    let end_to_end = settings.end_to_end.clone();
    let greatest_deadline = settings.greatest_deadline;
    let speed = settings.deadlines.speed.as_ref().map(Speed::new);
    let is_managed = settings.lifecycle;
    let revisions = settings.revisions.is_some().then_some(revisions);
    tokio::spawn(async move {
        let mut stop = Stop::never();
        let mut reported =
            LifecycleRequests { reported: subscription.orders, is_active: false, last: None };
        let counting = engine.counts();
        let fusion = NodeFusion {
            sources,
            output,
            revisions,
            ends: Vec::new(),
            input_key: MessageKey::Integer { offset: 0, kind: IntegerKind::U64 },
            origin: end_to_end.origin.as_str().into(),
            within: end_to_end.within,
            reserve: end_to_end.reserve,
            output_key: MessageKey::Integer { offset: 0, kind: IntegerKind::U64 },
            greatest_deadline,
            deadline,
            node,
            status_publisher,
            memory: LoopState::new(Reporter::new("/node", counting.tally())),
            counting,
            received: InputChannels {
                inputs: subscription.inputs,
                results: subscription.results,
                deadlines: subscription.deadlines,
                speeds: subscription.speeds,
                changes: &mut subscription.changes,
                reports: report_ticks(1000 * MS),
            },
            speed,
            orders: is_managed.then_some(&mut reported),
            stop: &mut stop,
        };
        let driver = Driver::new(engine, fusion, Timers::Tokio).unwrap();
        let (mut fusion, engine) = driver.run().await;
        fusion.report();
        drop(fusion);
        finish(engine).await.unwrap();
        if let Some(order) = reported.last.take() {
            order.done(TransitionResult::Success);
        }
    })
}

/// Returns the settings of a node with this many clouds.
pub(super) fn settings(clouds: usize, more: &[&str]) -> Settings {
    let names: Vec<_> = (1..=clouds).map(|cloud| format!("cloud{cloud}")).collect();
    let types = "--ros-args -p input.type:=tests/msg/Text -p output.type:=tests/msg/Text";
    let keys = "-p input.key:=uint64 -p output.key:=uint64";
    let mut args: Vec<_> = types.split(' ').chain(keys.split(' ')).collect();
    let clouds = format!("clouds:=[{}]", names.join(","));
    args.extend(["-p", &clouds]);
    args.extend(more);
    let arguments = Arguments::parse(args.into_iter().map(Into::into)).unwrap();
    Settings::from(&arguments, |_| None).unwrap()
}

/// Returns the clouds of a node, which are called.
fn called(
    settings: &Settings,
    clouds: &[(u64, Plan)],
    (dropped, hints): (&Drops, &Hints),
    start: Instant,
) -> Vec<NodeSource> {
    let mut sources = Vec::new();
    for (priority, (deadline, act)) in (1..).zip(clouds.iter().copied()) {
        let handle = cloud(priority, act, Arc::clone(dropped), start);
        let late = settings.clouds[usize::from(priority) - 1].hints.as_ref().map(|name| {
            let (late, published) = topic(name);
            tokio::spawn(note(published, Arc::clone(hints), start));
            Box::new(late) as Box<dyn Publish>
        });
        sources.push(NodeSource {
            priority,
            name: name(priority),
            route: Route::Grpc(handle),
            enabled: true,
            deadline: Some(Duration::from_millis(deadline)).filter(|it| !it.is_zero()),
            hints: late,
            unmatched: UnmatchedResults::default(),
        });
    }
    sources
}

impl Node {
    pub(super) fn start(local: Plan, clouds: &[(u64, Plan)]) -> Self {
        Self::start_with(local, clouds, &[])
    }

    /// Starts the node with more arguments.
    pub(super) fn start_with(local: Plan, clouds: &[(u64, Plan)], more: &[&str]) -> Self {
        let start = Instant::now();
        let settings = settings(clouds.len(), more);
        let engine: Engine<Payload, Payload> =
            Engine::new(node::engine_config(&settings).unwrap()).unwrap();
        let counting = engine.counts();
        let (mouths, subscription) = mouths();
        let (requests, requested) = topic("/local/input");
        let matched = Arc::clone(&requests.matched);
        let is_deaf = Arc::<AtomicBool>::default();
        tokio::spawn(model(local, requested, mouths.results.clone(), Arc::clone(&is_deaf), start));
        let dropped = Arc::new(Mutex::new(Vec::new()));
        let hints = Hints::default();
        let answers = Endpoint::new("/local/output", "tests/msg/Text");
        answers.change([7; 16], 1, None);
        let mut sources = vec![NodeSource {
            priority: 0,
            name: "local".into(),
            route: Route::Topics { requests: Box::new(requests), results: Arc::new(answers) },
            enabled: true,
            deadline: Some(settings.local.deadline),
            hints: None,
            unmatched: UnmatchedResults::default(),
        }];
        sources.extend(called(&settings, clouds, (&dropped, &hints), start));
        let (output, outputs) = topic("/output");
        let (revisions, revised) = topic("/output/revisions");
        let reported_lines = Arc::<Mutex<NodeOutput>>::default();
        let publication = Publication {
            reported_lines: Arc::clone(&reported_lines),
            published: Mutex::new([outputs, revised]),
            start,
        };
        let outputs: [Box<dyn Publish>; 2] = [Box::new(output), Box::new(revisions)];
        let running = run(&settings, engine, sources, outputs, Box::new(publication), subscription);
        Self {
            start,
            mouths,
            local: matched,
            is_deaf,
            reported_lines,
            counting,
            dropped,
            hints,
            running,
        }
    }

    /// Sends messages at these milliseconds, with rising keys from `first` on.
    pub(super) async fn feed(&self, first: u64, messages: impl IntoIterator<Item = u64>) {
        for (t, ms) in (first..).zip(messages) {
            sleep_until(self.start + Duration::from_millis(ms)).await;
            self.mouths.inputs.send(Ok(payload(t, "frame"))).await.unwrap();
        }
    }

    pub(super) async fn until(&self, ms: u64) {
        sleep_until(self.start + Duration::from_millis(ms)).await;
    }

    pub(super) fn reported_lines(&self) -> MutexGuard<'_, NodeOutput> {
        self.reported_lines.lock().unwrap()
    }

    pub(super) fn lines(&self) -> Vec<String> {
        self.reported_lines().lines.clone()
    }

    pub(super) fn tally(&self) -> Tally {
        self.counting.tally()
    }
}

/// Records what is published.
async fn note(mut published: mpsc::UnboundedReceiver<Payload>, hints: Hints, start: Instant) {
    while let Some(hint) = published.recv().await {
        hints.lock().unwrap().push((start.elapsed().as_millis(), hint));
    }
}

/// Emulates the model behind local's topics.
async fn model(
    plan: Plan,
    mut requested: mpsc::UnboundedReceiver<Payload>,
    results: mpsc::Sender<(usize, ReceivedPayload)>,
    is_deaf: Arc<AtomicBool>,
    start: Instant,
) {
    while let Some(request) = requested.recv().await {
        if is_deaf.load(Ordering::Relaxed) {
            continue;
        }
        let (t, results) = (key(&request), results.clone());
        tokio::spawn(async move {
            let computed = compute(plan(t), "local".into(), t, start).await.unwrap();
            drop(results.send((LOCAL, Ok(payload(t, &computed)))).await);
        });
    }
}

/// Returns the handle of a cloud that is called.
fn cloud(priority: u16, plan: Plan, dropped: Drops, start: Instant) -> Handle {
    Arc::new(move |request: Payload, call: Call| {
        let guard = Guard(Arc::clone(&dropped), priority, start);
        let t = key(&request);
        assert_eq!(call.timestamp, t);
        let computing = compute(plan(t), name(priority), t, start);
        Box::pin(async move {
            let _guard = guard;
            Ok(payload(t, &computing.await?).into())
        })
    })
}
