//! A plain node: what it opens, and its end. A managed one opens the same, in
//! [`managed`](crate::managed).

use std::sync::Arc;
use std::time::Duration;

use fuseline_engine::{Counting, Engine, Tally};
use fuseline_tokio::drive::{Driver, finish};
use tokio::sync::mpsc;
use tracing::info;

use crate::error::NodeError;
use crate::fusion::{InputChannels, LoopState, NodeFusion, report_ticks};
use crate::lifecycle::LifecycleRequests;
use crate::middleware::{Endpoint, Graph, Publish, ReceivedPayload};
use crate::raw::Payload;
use crate::realtime;
use crate::recordings::{self, CreatedFiles};
use crate::report::Reporter;
use crate::rosout::PendingLogs;
use crate::settings::{self, Change, Settings, SpeedTopic, Topic};
use crate::source::{Handle, NodeSource, Route, UnmatchedResults, call};
use crate::speed::Speed;
use crate::status_publisher::{NodeInterface, PublishStatus, StatusPublisher};
use crate::stop::Stop;

/// The number of results that may wait for the node. Further ones stay in the readers, which drop
/// the oldest.
const RESULTS: usize = 64;

/// Runs a plain node until it is stopped; returns its counts.
///
/// # Errors
/// As for [`run`](crate::run).
pub(crate) async fn run(
    settings: &Settings,
    stop: &mut Stop,
    lines: Option<PendingLogs>,
) -> Result<Tally, NodeError> {
    // Mistakes are refused before anybody notices the node.
    check(settings)?;
    realtime::prepare(settings.realtime)?;
    let (engine, created) = recorded(settings)?;
    let mut graph = Graph::join(settings, |it| settings.needs(it)).await?;
    let NodeInterface { status_publisher, mut changes, mut tasks, .. } =
        StatusPublisher::join(settings, &mut graph, lines)?;
    let outside = ExternalInputs { changes: &mut changes, orders: None, stop };
    let open = open(settings, engine, &mut graph, status_publisher, outside)?;
    created.keep();
    let ended = open.run().await;
    tasks.shutdown().await;
    graph.leave().await;
    ended
}

/// The events that reach a node from outside its topics.
pub(crate) struct ExternalInputs<'a> {
    pub(crate) changes: &'a mut mpsc::UnboundedReceiver<Change>,
    pub(crate) orders: Option<&'a mut LifecycleRequests>,
    pub(crate) stop: &'a mut Stop,
}

/// The topics of a node, which are open.
pub(crate) struct OpenTopics {
    pub(crate) sources: Vec<NodeSource>,
    pub(crate) output: Box<dyn Publish>,
    pub(crate) revisions: Option<Box<dyn Publish>>,
    pub(crate) ends: Vec<Arc<Endpoint>>,
    pub(crate) inputs: mpsc::Receiver<ReceivedPayload>,
    pub(crate) results: mpsc::Receiver<(usize, ReceivedPayload)>,
    pub(crate) deadlines: mpsc::Receiver<ReceivedPayload>,
    pub(crate) speeds: mpsc::Receiver<ReceivedPayload>,
}

/// A node whose topics are open.
pub(crate) struct OpenNode<'a> {
    driver: Driver<NodeFusion<'a>>,
    counting: Counting,
}

/// Opens the node's topics.
pub(crate) fn open<'a>(
    settings: &Settings,
    engine: Engine<Payload, Payload>,
    graph: &mut Graph,
    status_publisher: Arc<StatusPublisher>,
    outside: ExternalInputs<'a>,
) -> Result<OpenNode<'a>, NodeError> {
    let (arrived, results) = mpsc::channel(RESULTS);
    let sources = sources(settings, graph, &arrived)?;
    let output = publisher(graph, settings, &settings.output.topic)?;
    let revisions = settings.revisions.as_ref();
    let revisions = revisions.map(|topic| publisher(graph, settings, topic)).transpose()?;
    let (sender, inputs) = mpsc::channel(1);
    let input_end = subscribe(graph, settings, &settings.input.topic, sender, |it| it)?;
    input_end.expect(settings.silence);
    let mut ends = vec![input_end, Arc::clone(output.end())];
    ends.extend(revisions.as_ref().map(|revisions| Arc::clone(revisions.end())));
    let (decided, deadlines) = mpsc::channel(1);
    if let Some(topic) = &settings.deadline_topic {
        ends.push(latest(graph, settings, topic, decided)?);
    }
    let (reported, speeds) = mpsc::channel(1);
    if let Some(SpeedTopic { topic, .. }) = &settings.deadlines.speed {
        ends.push(latest(graph, settings, topic, reported)?);
    }
    let topics =
        OpenTopics { sources, output, revisions, ends, inputs, results, deadlines, speeds };
    let open = OpenNode::new(settings, engine, topics, Box::new(status_publisher), outside)?;
    // The threads of DDS and of the recorder are there already: they stay as they are.
    realtime::schedule(settings.realtime)?;
    info!(
        node = settings.node.full(),
        domain = settings.domain,
        input = settings.input.topic,
        output = settings.output.topic,
        clouds = settings.clouds.len(),
        "the node runs"
    );
    Ok(open)
}

impl<'a> OpenNode<'a> {
    pub(crate) fn new(
        settings: &Settings,
        engine: Engine<Payload, Payload>,
        topics: OpenTopics,
        status_publisher: Box<dyn PublishStatus>,
        outside: ExternalInputs<'a>,
    ) -> Result<Self, NodeError> {
        let ExternalInputs { changes, orders, stop } = outside;
        let counting = engine.counts();
        let node = settings.node.full();
        let received = InputChannels {
            inputs: topics.inputs,
            results: topics.results,
            deadlines: topics.deadlines,
            speeds: topics.speeds,
            changes,
            reports: report_ticks(settings.diagnostics_period),
        };
        let fusion = NodeFusion {
            sources: topics.sources,
            ends: topics.ends,
            output: topics.output,
            revisions: topics.revisions,
            input_key: settings.input.key,
            origin: settings.end_to_end.origin.as_str().into(),
            within: settings.end_to_end.within,
            reserve: settings.end_to_end.reserve,
            output_key: settings.output.key,
            greatest_deadline: settings.greatest_deadline,
            deadline: settings.deadline,
            memory: LoopState::new(Reporter::new(&node, counting.tally())),
            node,
            status_publisher,
            counting: counting.clone(),
            received,
            orders,
            speed: settings.deadlines.speed.as_ref().map(Speed::new),
            stop,
        };
        let driver = Driver::new(engine, fusion, settings.timers).map_err(NodeError::Timers)?;
        Ok(Self { driver, counting })
    }

    /// Runs until it is requested to stop or to close.
    pub(crate) async fn run(self) -> Result<Tally, NodeError> {
        let (mut fusion, engine) = self.driver.run().await;
        fusion.report();
        drop(fusion);
        finish(engine).await.map_err(NodeError::Trace)?;
        let tally = self.counting.tally();
        let (forwarded, missed) = (tally.forwarded(), tally.missed);
        info!(messages = tally.messages, forwarded, missed, "the node has ended");
        Ok(tally)
    }
}

/// Checks whether the node could start, as far as that is known without starting it: the files of
/// its secrets can be read, and the folders of its recordings exist. [`Settings::from`] has checked
/// the parameters.
///
/// To be called within a tokio runtime. Nothing is opened, joined or written.
///
/// # Errors
/// With the first thing that is wrong; [`run`](crate::run) refuses the same.
pub fn check(settings: &Settings) -> Result<(), NodeError> {
    recordings::check(settings)?;
    #[cfg(feature = "zenoh")]
    if settings.needs(settings::Middleware::Zenoh) {
        crate::middleware::zenoh::config::from_environment()?;
    }
    for cloud in &settings.clouds {
        if let settings::CloudConnection::Grpc(grpc) = &cloud.way {
            handle(cloud, grpc)?;
        }
    }
    Ok(())
}

/// Returns the way to call a cloud behind gRPC.
fn handle(cloud: &settings::Cloud, grpc: &settings::Grpc) -> Result<Handle, NodeError> {
    call(grpc).map_err(|error| NodeError::Grpc { cloud: cloud.name.clone(), error })
}

/// Returns the operator with its recordings, whose files are made.
pub(crate) fn recorded(
    settings: &Settings,
) -> Result<(Engine<Payload, Payload>, CreatedFiles), NodeError> {
    let config = settings.engine_config()?;
    let (header, _) = config.header();
    let mut engine = Engine::new(config).map_err(|why| settings.refused(why))?;
    let created = recordings::record(&mut engine, settings, &header)?;
    Ok((engine, created))
}

/// Returns local and the clouds, with their topics or their servers.
fn sources(
    settings: &Settings,
    graph: &mut Graph,
    arrived: &mpsc::Sender<(usize, ReceivedPayload)>,
) -> Result<Vec<NodeSource>, NodeError> {
    let local = &settings.local;
    let mut sources = vec![NodeSource {
        priority: 0,
        name: "local".into(),
        route: topics(graph, settings, [&local.input, &local.output], arrived, 0)?,
        enabled: true,
        deadline: Some(local.deadline),
        hints: None,
        unmatched: UnmatchedResults::default(),
    }];
    for (index, cloud) in (1..).zip(&settings.clouds) {
        let route = match &cloud.way {
            settings::CloudConnection::Topics { input, output, .. } => {
                topics(graph, settings, [input, output], arrived, index)?
            }
            settings::CloudConnection::Grpc(grpc) => Route::Grpc(handle(cloud, grpc)?),
        };
        let hints = cloud.hints.as_ref();
        let hints = hints.map(|topic| publisher(graph, settings, topic)).transpose()?;
        sources.push(NodeSource {
            priority: cloud.priority,
            name: cloud.name.clone(),
            route,
            enabled: cloud.enabled,
            deadline: cloud.deadline,
            hints,
            unmatched: UnmatchedResults::default(),
        });
    }
    Ok(sources)
}

fn topics(
    graph: &mut Graph,
    settings: &Settings,
    [requests, results]: [&str; 2],
    arrived: &mpsc::Sender<(usize, ReceivedPayload)>,
    index: usize,
) -> Result<Route, NodeError> {
    let requests = publisher(graph, settings, requests)?;
    let results =
        subscribe(graph, settings, results, arrived.clone(), move |sample| (index, sample))?;
    Ok(Route::Topics { requests, results })
}

/// Subscribes to a topic that says how something is; it may say so seldom.
fn latest(
    graph: &mut Graph,
    settings: &Settings,
    topic: &str,
    received: mpsc::Sender<ReceivedPayload>,
) -> Result<Arc<Endpoint>, NodeError> {
    let end = subscribe(graph, settings, topic, received, |it| it)?;
    end.patience(Some(Duration::MAX));
    Ok(end)
}

fn publisher(
    graph: &mut Graph,
    settings: &Settings,
    name: &str,
) -> Result<Box<dyn Publish>, NodeError> {
    let Topic { type_name, qos, .. } = settings.topic(name);
    graph.publisher(settings.middleware_of(name), name, type_name, *qos)
}

/// Subscribes to a topic; `sender` gets what `received` makes of each sample.
fn subscribe<T: Send + 'static>(
    graph: &mut Graph,
    settings: &Settings,
    name: &str,
    sender: mpsc::Sender<T>,
    received: impl Fn(ReceivedPayload) -> T + Send + Sync + 'static,
) -> Result<Arc<Endpoint>, NodeError> {
    let Topic { type_name, qos, .. } = settings.topic(name);
    graph.subscribe(settings.middleware_of(name), name, type_name, *qos, move |sample| {
        let (sender, received) = (sender.clone(), received(sample));
        async move { drop(sender.send(received).await) }
    })
}
