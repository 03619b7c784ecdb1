//! Runs the node's loop on topics within this process, for its tests and for the simulator.

use std::sync::Arc;

use fuseline_engine::{Counting, Tally};
use fuseline_tokio::{Call, Error, StampedValue};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;

use crate::arguments::Arguments;
use crate::error::NodeError;
use crate::lifecycle::{LifecycleRequest, LifecycleRequests, LifecycleTask, TransitionResult};
use crate::middleware::{DecodeError, Endpoint, Publish, ReceivedPayload};
use crate::node::{self, ExternalInputs, OpenNode, OpenTopics};
use crate::raw::Payload;
pub use crate::report::{DiagnosticStatus, KeyValue};
use crate::settings::{Change, CloudConnection, Settings};
use crate::source::{NodeSource, Route, UnmatchedResults};
use crate::status_publisher::PublishStatus;
use crate::stop::Stop;

/// A topic on which the node publishes. Local has the number 0, and the clouds follow.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum PublishedTopic {
    /// The requests to a source.
    Requests(usize),
    /// The late results of a source.
    Hints(usize),
    /// The outputs.
    Output,
    /// The preliminary results.
    Revisions,
}

/// A topic on which the node receives.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum ReceivedTopic {
    /// The messages.
    Input,
    /// The results of a source.
    Results(usize),
    /// The deadline that the environment decides.
    Deadline,
    /// The vehicle's speed.
    Speed,
}

/// Everything around a node: the subscribers of its topics, and its servers.
pub trait Surroundings: Send + Sync + 'static {
    /// Receives a payload that the node publishes. Returns `false` if a subscriber is too far behind.
    fn publish(self: &Arc<Self>, topic: PublishedTopic, payload: Payload) -> bool;

    /// Returns the number of subscribers of a topic.
    fn subscribers(&self, topic: PublishedTopic) -> usize;

    /// Answers a request to a cloud behind gRPC. `cloud` counts from 1.
    fn call(
        self: &Arc<Self>,
        cloud: usize,
        request: Payload,
        call: Call,
    ) -> impl Future<Output = Result<Payload, Error>> + Send + 'static;

    /// Receives the status of a message.
    fn status(&self, status: DiagnosticStatus);

    /// Receives the node's diagnostics.
    fn diagnostics(&self, statuses: Vec<DiagnosticStatus>);
}

/// Sends to a node, on its topics and from its user.
pub struct NodeSenders {
    inputs: mpsc::Sender<ReceivedPayload>,
    pub(crate) results: mpsc::Sender<(usize, ReceivedPayload)>,
    deadlines: mpsc::Sender<ReceivedPayload>,
    speeds: mpsc::Sender<ReceivedPayload>,
    changes: mpsc::UnboundedSender<Change>,
    orders: mpsc::Sender<LifecycleRequest>,
}

/// A running node: its surroundings, its task, and its counts so far.
pub type RunningNode<S> = (Arc<S>, JoinHandle<Result<Tally, NodeError>>, Counting);

/// A topic's publisher.
struct Publisher<S> {
    surroundings: Arc<S>,
    topic: PublishedTopic,
    end: Arc<Endpoint>,
}

struct StatusPublisher<S>(Arc<S>);

/// The type of all messages.
const TYPE: &str = "tests/msg/Text";

/// Returns the settings of a node with these parameters and this many clouds, `cloud1` and so on.
/// Its messages and results begin with their keys.
///
/// # Panics
/// Panics if a node would refuse the parameters.
#[must_use]
pub fn settings(clouds: usize, parameters: Vec<String>) -> Settings {
    let names: Vec<_> = (1..=clouds).map(|cloud| format!("cloud{cloud}")).collect();
    let common = [
        "timers:=tokio".to_owned(),
        format!("input.type:={TYPE}"),
        format!("output.type:={TYPE}"),
        "input.key:=uint64".to_owned(),
        "output.key:=uint64".to_owned(),
        format!("clouds:=[{}]", names.join(",")),
    ];
    let mut args = ["--ros-args", "-r", "__node:=node"].map(str::to_owned).to_vec();
    for parameter in common.into_iter().chain(parameters) {
        args.extend(["-p".to_owned(), parameter]);
    }
    let arguments = Arguments::parse(args.into_iter().map(Into::into)).expect("arguments");
    Settings::from(&arguments, |_| None).expect("a node's parameters")
}

/// Starts a node within a tokio runtime. Calls `surroundings` with the senders to the node.
///
/// # Errors
/// Returns an error if its trace cannot be created.
pub fn start<S: Surroundings>(
    settings: Settings,
    surroundings: impl FnOnce(NodeSenders) -> S,
) -> Result<RunningNode<S>, NodeError> {
    let (engine, created) = node::recorded(&settings)?;
    created.keep();
    let counting = engine.counts();
    let (input_sender, inputs) = mpsc::channel(1024);
    let (result_sender, results) = mpsc::channel(64);
    let (deadline_sender, deadlines) = mpsc::channel(1);
    let (speed_sender, speeds) = mpsc::channel(1);
    let (change_sender, mut changes) = mpsc::unbounded_channel();
    let (order_sender, orders) = mpsc::channel(1);
    let surroundings = Arc::new(surroundings(NodeSenders {
        inputs: input_sender,
        results: result_sender,
        deadlines: deadline_sender,
        speeds: speed_sender,
        changes: change_sender,
        orders: order_sender,
    }));
    let revisions = settings.revisions.as_deref();
    let topics = OpenTopics {
        sources: sources(&settings, &surroundings),
        output: publisher(&surroundings, PublishedTopic::Output, &settings.output.topic),
        revisions: revisions.map(|name| publisher(&surroundings, PublishedTopic::Revisions, name)),
        ends: Vec::new(),
        inputs,
        results,
        deadlines,
        speeds,
    };
    let status_publisher = Box::new(StatusPublisher(Arc::clone(&surroundings)));
    let running = tokio::spawn(async move {
        let mut stop = Stop::never();
        let mut orders = LifecycleRequests { reported: orders, is_active: false, last: None };
        let outside = ExternalInputs {
            changes: &mut changes,
            orders: settings.lifecycle.then_some(&mut orders),
            stop: &mut stop,
        };
        let open = OpenNode::new(&settings, engine, topics, status_publisher, outside)?;
        let ended = open.run().await;
        if let Some(order) = orders.last.take() {
            let is_ok = ended.is_ok();
            order.done(if is_ok { TransitionResult::Success } else { TransitionResult::Error });
        }
        ended
    });
    Ok((surroundings, running, counting))
}

impl NodeSenders {
    /// Sends a sample on a topic. `None` stands for a sample that is not CDR. Returns `false` if the
    /// node has ended.
    pub async fn send(&self, topic: ReceivedTopic, sample: Option<Payload>) -> bool {
        let sample = sample.ok_or_else(|| DecodeError("not CDR".into()));
        match topic {
            ReceivedTopic::Input => self.inputs.send(sample).await.is_ok(),
            ReceivedTopic::Results(source) => self.results.send((source, sample)).await.is_ok(),
            ReceivedTopic::Deadline => self.deadlines.send(sample).await.is_ok(),
            ReceivedTopic::Speed => self.speeds.send(sample).await.is_ok(),
        }
    }

    /// Sets a parameter. Returns `false` if the node has ended.
    #[must_use]
    pub fn set(&self, change: Change) -> bool {
        self.changes.send(change).is_ok()
    }

    /// Activates or deactivates a managed node. Returns `true` if the node did so.
    pub async fn activate(&self, is_active: bool) -> bool {
        self.order(if is_active { LifecycleTask::Activate } else { LifecycleTask::Deactivate })
            .await
    }

    /// Ends a managed node. Returns `true` if it ended well.
    pub async fn clean_up(&self) -> bool {
        self.order(LifecycleTask::CleanUp).await
    }

    async fn order(&self, task: LifecycleTask) -> bool {
        let (order, done) = LifecycleRequest::new(task);
        // If the node has ended, `done` gets an error.
        let _ = self.orders.send(order).await;
        done.await == Ok(TransitionResult::Success)
    }
}

/// Returns local and the clouds, with their topics or their servers.
fn sources<S: Surroundings>(settings: &Settings, surroundings: &Arc<S>) -> Vec<NodeSource> {
    let local = &settings.local;
    let topics = |number, requests: &str, results: &str| {
        let results = Endpoint::new(results, TYPE);
        results.change([7; 16], 1, None);
        let requests = publisher(surroundings, PublishedTopic::Requests(number), requests);
        Route::Topics { requests, results: Arc::new(results) }
    };
    let mut sources = vec![NodeSource {
        priority: 0,
        name: "local".into(),
        route: topics(0, &local.input, &local.output),
        enabled: true,
        deadline: Some(local.deadline),
        hints: None,
        unmatched: UnmatchedResults::default(),
    }];
    for (number, cloud) in (1..).zip(&settings.clouds) {
        let hints = cloud.hints.as_deref();
        sources.push(NodeSource {
            priority: cloud.priority,
            name: cloud.name.clone(),
            route: match &cloud.way {
                CloudConnection::Topics { input, output, .. } => topics(number, input, output),
                CloudConnection::Grpc(_) => server(surroundings, number),
            },
            enabled: cloud.enabled,
            deadline: cloud.deadline,
            hints: hints.map(|name| publisher(surroundings, PublishedTopic::Hints(number), name)),
            unmatched: UnmatchedResults::default(),
        });
    }
    sources
}

fn server<S: Surroundings>(surroundings: &Arc<S>, cloud: usize) -> Route {
    let surroundings = Arc::clone(surroundings);
    Route::Grpc(Arc::new(move |request, call| {
        let answer = surroundings.call(cloud, request, call);
        Box::pin(async { Ok(StampedValue::from(answer.await?)) })
    }))
}

fn publisher<S: Surroundings>(
    surroundings: &Arc<S>,
    topic: PublishedTopic,
    name: &str,
) -> Box<dyn Publish> {
    let end = Arc::new(Endpoint::new(name, TYPE));
    Box::new(Publisher { surroundings: Arc::clone(surroundings), topic, end })
}

impl<S: Surroundings> Publish for Publisher<S> {
    fn publish(&self, payload: Payload) -> bool {
        self.surroundings.publish(self.topic, payload)
    }

    fn matched(&self) -> usize {
        self.surroundings.subscribers(self.topic)
    }

    fn end(&self) -> &Arc<Endpoint> {
        &self.end
    }
}

impl<S: Surroundings> PublishStatus for StatusPublisher<S> {
    fn status(&self, status: DiagnosticStatus) {
        self.0.status(status);
    }

    fn diagnostics(&self, statuses: Vec<DiagnosticStatus>) {
        self.0.diagnostics(statuses);
    }
}
