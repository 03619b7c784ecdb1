//! The scene: the cloud answers, is killed, and returns.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::time::{Duration, Instant};

use hiroz::Builder;
use hiroz::msg::ZMessage;
use hiroz::node::ZNode;
use hiroz::parameter::{Parameter, ParameterClient, ParameterTarget, ParameterValue};
use hiroz::pubsub::{ZPub, ZSub};
use hiroz_msgs::diagnostic_msgs::DiagnosticStatus;
use hiroz_msgs::sensor_msgs::CompressedImage;
use zenoh::sample::Sample;

use crate::Any;
use crate::book::{ImageLog, Expected};
use crate::image::{self, CAMERA};
use crate::part::ChildProcess;
use crate::peers::{context, quality};

pub(crate) const LOCAL: &str = "local";
pub(crate) const WEST: &str = "west";

/// Twenty images a second.
const PERIOD: Duration = Duration::from_millis(50);
const IMAGES: usize = 100;
/// How long anything may take.
const LONG: Duration = Duration::from_secs(30);
/// How many errors are reported.
const SHOWN: usize = 10;

const MEETING: &str = "all meet";
const LIVES: &str = "west lives";
const KILLED: &str = "west is killed";
const RETURNS: &str = "west is started again";
const AGAIN: &str = "west answers again";

const PARAMETERS: &str = "
/**:
  ros__parameters:
    middleware: zenoh
    input: {type: sensor_msgs/msg/CompressedImage}
    output: {type: sensor_msgs/msg/CompressedImage}
    deadline: 1.0
    window: 64
    clouds: [west]
";

/// The camera and the subscriber.
struct Scene {
    camera: Publisher<CompressedImage>,
    outputs: Subscriber<CompressedImage>,
    statuses: Subscriber<DiagnosticStatus>,
    book: ImageLog,
    next: Instant,
}

type Publisher<M> = ZPub<M, <M as ZMessage>::Serdes>;
type Subscriber<M> = ZSub<M, Sample, <M as ZMessage>::Serdes>;

/// Plays all of it, and says what held.
pub(crate) fn play(node: &str, fuseline: &str, folder: &Path) -> Result<(), Any> {
    let (parameters, trace) = (folder.join("parameters.yaml"), folder.join("trace.jsonl"));
    fs::write(&parameters, PARAMETERS)?;
    let _router = ChildProcess::role("router")?;
    let (file, record) = (parameters.to_string_lossy(), format!("trace.file:={}", trace.display()));
    let words = ["--ros-args", "--params-file", &*file, "-p", &record];
    let node = ChildProcess::program(node, &words, &folder.join("log"))?;
    let _local = ChildProcess::role(LOCAL)?;
    let west = ChildProcess::role(WEST)?;

    let context = context()?;
    let ours = Arc::new(context.create_node("camera").build()?);
    let mut graph_scene = Scene::of(&ours)?;
    graph_scene.until_west(MEETING, Expected::Perhaps)?;
    graph_scene.images(LIVES, WEST)?;
    sets_a_parameter(&ours)?;
    graph_scene.next = Instant::now();
    drop(west);
    graph_scene.book.unsure();
    graph_scene.images(KILLED, LOCAL)?;
    let _west = ChildProcess::role(WEST)?;
    graph_scene.until_west(RETURNS, Expected::Either)?;
    graph_scene.images(AGAIN, WEST)?;
    graph_scene.rest()?;
    let names = context.graph().get_node_names();
    graph_scene.book.print(&[MEETING, LIVES, KILLED, RETURNS, AGAIN]);

    let mut wrong = graph_scene.book.wrong();
    if !names.contains(&("fuseline".into(), "/".into())) {
        wrong.push(format!("the graph has no node /fuseline but {names:?}"));
    }
    let ended = node.interrupt()?;
    if !ended.success() {
        wrong.push(format!("the node ended with {ended}"));
    }
    let verdict = Command::new(fuseline).arg("check").arg(&trace).output()?;
    print!("{}", String::from_utf8_lossy(&verdict.stdout));
    if !verdict.status.success() {
        wrong.push("the node's trace does not conform".into());
    }
    if wrong.is_empty() {
        println!("each image has its one answer, byte for byte, and a status that says whose");
        return Ok(());
    }
    if wrong.len() > SHOWN {
        let left_out = wrong.split_off(SHOWN).len();
        wrong.push(format!("and {left_out} more"));
    }
    Err(wrong.join("\n       ").into())
}

/// By the node's services.
fn sets_a_parameter(ours: &Arc<ZNode>) -> Result<(), Any> {
    let target = ParameterTarget::from_fqn("/fuseline").ok_or("no name of a node")?;
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let reported = async {
        let client = ParameterClient::new(Arc::clone(ours), target)?;
        let before = client.get(&["deadline"]).await?;
        let shorter = ParameterValue::Double(0.9);
        let set = client.set(&[Parameter::new("deadline", shorter.clone())]).await?;
        let is_set = set.iter().all(|result| result.successful);
        let after = client.get(&["deadline"]).await?;
        if before == [ParameterValue::Double(1.0)] && is_set && after == [shorter] {
            return Ok(());
        }
        Err(format!("the deadline is {before:?}, and {after:?} when set: {set:?}").into())
    };
    runtime.block_on(async { tokio::time::timeout(LONG, reported).await? })
}

impl Scene {
    fn of(node: &ZNode) -> Result<Self, Any> {
        Ok(Self {
            camera: node.create_pub("/input").with_qos(quality()).build()?,
            outputs: node.create_sub("/output").with_qos(quality()).build()?,
            statuses: node.create_sub("/fuseline/status").with_qos(quality()).build()?,
            book: ImageLog::default(),
            next: Instant::now(),
        })
    }

    /// Goes on until west answers in this part.
    fn until_west(&mut self, part: &'static str, expected: Expected) -> Result<(), Any> {
        let end = Instant::now() + LONG;
        while self.book.answered_by(WEST, part) == 0 {
            if end < Instant::now() {
                return Err(format!("{part}: west answers nothing").into());
            }
            self.image(part, expected)?;
        }
        Ok(())
    }

    /// Some images, which one source answers.
    fn images(&mut self, part: &'static str, source: &'static str) -> Result<(), Any> {
        (0..IMAGES).try_for_each(|_| self.image(part, Expected::Only(source)))
    }

    /// Publishes an image, and takes what comes until it is time for the next.
    fn image(&mut self, part: &'static str, expected: Expected) -> Result<(), Any> {
        let number = self.book.begins(part, expected);
        self.camera.publish(&image::of(CAMERA, number))?;
        self.next += PERIOD;
        self.take_until(self.next)
    }

    /// Takes the last outputs.
    fn rest(&mut self) -> Result<(), Any> {
        let end = Instant::now() + Duration::from_secs(5);
        while !self.book.is_complete() && Instant::now() < end {
            self.take_until(Instant::now() + PERIOD)?;
        }
        // One too many would come now.
        self.take_until(Instant::now() + 10 * PERIOD)
    }

    fn take_until(&mut self, end: Instant) -> Result<(), Any> {
        loop {
            while self.statuses.is_ready() {
                self.book.status(self.statuses.recv()?);
            }
            let remaining = end.saturating_duration_since(Instant::now());
            if remaining.is_zero() {
                return Ok(());
            }
            if let Ok(sample) = self.outputs.recv_serialized_timeout(remaining) {
                self.book.output(&sample);
            }
        }
    }
}
