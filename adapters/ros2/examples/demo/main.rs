//! A camera, a model on board and a model in a cloud, joined by `fuseline-ros2` on loopback. It
//! shows fusion, fallback while the cloud is dead, and recovery. Each part is a process of its own.
//!
//! ```sh
//! cargo run --release -p fuseline-ros2 --example demo
//! cargo run --release -p fuseline-ros2 --features zenoh --example demo -- --zenoh    # through a router
//! ```

mod messages;
mod ros;

use std::collections::BTreeMap;
use std::env;
use std::fs::{self, File};
use std::io::BufReader;
use std::path::Path;
use std::process::{Child, Command};
use std::sync::Arc;
use std::time::Duration;

use fuseline_ros2::{Arguments, Settings, Stop};
use rustix::process::{Pid, Signal, kill_process};
use serde::Deserialize;
use tokio::time::{Instant, interval, sleep, timeout};

use messages::{Any, CompressedImage, Header, PointStamped, Time};
use ros::{Publisher, Subscription, is_over_zenoh, node_in, publisher, subscription};

const RATE_HZ: u32 = 10;
const IMAGE_BYTES: usize = 33_000;
const LOCAL: Model = Model { name: "local", takes: Duration::from_millis(80) };
const WEST: Model = Model { name: "west", takes: Duration::from_millis(30) };
/// The seconds after which the cloud is killed, starts again, and everything ends.
const DIES: u64 = 4;
const RETURNS: u64 = 8;
const ENDS: u64 = 14;

const USAGE: &str = "\
Usage: demo [--zenoh]

Runs the node, a model on board and one in a cloud for 14 seconds on loopback. --zenoh needs a build
with --features zenoh. The parts node, local, west and router are processes that it starts itself.";

const PARAMETERS: &str = "
/**:
  ros__parameters:
    input: {type: sensor_msgs/msg/CompressedImage}
    output: {type: geometry_msgs/msg/PointStamped}
    deadline: 0.2
    clouds: [west]
";

struct Model {
    name: &'static str,
    takes: Duration,
}

#[derive(Deserialize)]
struct DiagnosticArray {
    _header: Header,
    status: Vec<DiagnosticStatus>,
}

#[derive(Deserialize)]
struct DiagnosticStatus {
    level: u8,
    name: String,
    message: String,
    _hardware_id: String,
    _values: Vec<[String; 2]>,
}

/// A process of this demo, which is killed when this is dropped.
struct ChildProcess(Child);

fn main() -> Result<(), Any> {
    let args: Vec<String> = env::args().skip(1).collect();
    // Zenoh needs more than one thread.
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    match args.first().map(String::as_str) {
        None => runtime.block_on(direct()),
        #[cfg(feature = "zenoh")]
        Some("--zenoh") => runtime.block_on(direct()),
        #[cfg(not(feature = "zenoh"))]
        Some("--zenoh") => Err("this build has no Zenoh; build with --features zenoh".into()),
        #[cfg(feature = "zenoh")]
        Some("router") => runtime.block_on(ros::over_zenoh::route()),
        Some("node") => {
            let words = args.into_iter().skip(1).filter(|word| word != "--zenoh");
            let arguments = Arguments::parse(words.map(Into::into))?;
            let settings = Settings::from(&arguments, |name| env::var(name).ok())?;
            runtime.block_on(async {
                fuseline_ros2::run(&settings, &mut Stop::watch()?, None).await.map_err(Any::from)
            })?;
            Ok(())
        }
        Some("local") => runtime.block_on(model(&LOCAL)),
        Some("west") => runtime.block_on(model(&WEST)),
        Some("--help" | "-h") => {
            println!("{USAGE}");
            Ok(())
        }
        Some(other) => Err(format!("{other}: there is no such part\n{USAGE}").into()),
    }
}

/// Starts all parts, plays the camera, and prints what the node sends.
async fn direct() -> Result<(), Any> {
    let folder = tempfile::tempdir()?;
    let trace = folder.path().join("run.jsonl");
    let _router = is_over_zenoh().then(|| ChildProcess::start(&["router"])).transpose()?;
    let fusion = fusion(folder.path(), &trace)?;
    let _local = ChildProcess::start(&[LOCAL.name])?;
    let mut west = Some(ChildProcess::start(&[WEST.name])?);
    let mut node = node_in(domain(), "camera")?;
    let camera: Publisher<CompressedImage> =
        publisher(&mut node, "input", "sensor_msgs/CompressedImage")?;
    let output: Subscription<PointStamped> =
        subscription(&mut node, "output", "geometry_msgs/PointStamped")?;
    let diagnostics: Subscription<DiagnosticArray> =
        subscription(&mut node, "diagnostics", "diagnostic_msgs/DiagnosticArray")?;
    let [of_local, of_west] = [LOCAL, WEST].map(|model| model.takes.as_millis());
    print!("A camera takes {RATE_HZ} images a second; ");
    println!("local takes {of_local} ms, west {of_west} ms; each message has 200 ms.\n");
    camera.subscribed(&node).await;
    sleep(Duration::from_secs(2)).await;
    println!(" second  inputs  west  local   p50     west in /diagnostics");

    let mut frames = interval(Duration::from_secs(1) / RATE_HZ);
    let (mut book, mut second) = (ImageLog::new(), 0);
    loop {
        tokio::select! {
            _ = frames.tick() => {
                if book.start.elapsed().as_secs() > second {
                    second += 1;
                    book.print(second);
                    if second == ENDS {
                        break;
                    } else if second == DIES {
                        west = None;
                        println!("{:>39}west is killed", "");
                    } else if second == RETURNS {
                        west = Some(ChildProcess::start(&[WEST.name])?);
                        println!("{:>39}west is started again", "");
                    }
                }
                let header = Header { stamp: book.stamp()?, frame_id: "camera".into() };
                let data = vec![0; IMAGE_BYTES];
                let image = CompressedImage { header, format: "jpeg".into(), data };
                camera.publish(image).await?;
            }
            Ok((point, _)) = output.take() => book.output(&point.header),
            Ok((array, _)) = diagnostics.take() => book.state(array),
        }
    }
    // The last outputs are still on their way.
    while book.unanswered() > 0 {
        match timeout(Duration::from_millis(500), output.take()).await {
            Ok(Ok((point, _))) => book.output(&point.header),
            _ => break,
        }
    }
    drop(west);
    fusion.stop()?;
    book.close();
    println!("the node's trace {}", judge(&trace)?);
    Ok(())
}

/// Starts the node with a parameter file such as users write.
fn fusion(folder: &Path, trace: &Path) -> Result<ChildProcess, Any> {
    let parameters = folder.join("fusion.yaml");
    fs::write(&parameters, PARAMETERS)?;
    let file = parameters.to_string_lossy();
    let trace = format!("trace.file:={}", trace.display());
    let domain = format!("domain_id:={}", domain());
    let middleware = if is_over_zenoh() { "middleware:=zenoh" } else { "middleware:=dds" };
    let ours = ["-p", &trace, "-p", &domain, "-p", "localhost_only:=true", "-p", middleware];
    ChildProcess::start(&[&["node", "--ros-args", "--params-file", &*file][..], &ours].concat())
}

/// Records the images that were sent, the outputs that came, and how the node reported west.
struct ImageLog {
    start: Instant,
    /// For each image by its stamp, when it was taken, and the number of its outputs.
    images: BTreeMap<(i32, u32), (Instant, u32)>,
    inputs: u32,
    of_west: u32,
    of_local: u32,
    took: Vec<Duration>,
    state: String,
}

impl ImageLog {
    fn new() -> Self {
        let (start, images, took, state) =
            (Instant::now(), BTreeMap::new(), Vec::new(), String::new());
        Self { start, images, inputs: 0, of_west: 0, of_local: 0, took, state }
    }

    /// Records an image that is taken now, and returns its stamp.
    fn stamp(&mut self) -> Result<Time, Any> {
        let now = self.start.elapsed();
        let stamp = Time { sec: i32::try_from(now.as_secs())?, nanosec: now.subsec_nanos() };
        self.images.insert((stamp.sec, stamp.nanosec), (Instant::now(), 0));
        self.inputs += 1;
        Ok(stamp)
    }

    fn output(&mut self, header: &Header) {
        let stamp = (header.stamp.sec, header.stamp.nanosec);
        if let Some((at, outputs)) = self.images.get_mut(&stamp) {
            *outputs += 1;
            self.took.push(at.elapsed());
            *(if header.frame_id == WEST.name { &mut self.of_west } else { &mut self.of_local }) +=
                1;
        }
    }

    fn state(&mut self, array: DiagnosticArray) {
        let of_west = array.status.into_iter().find(|status| status.name.ends_with("west"));
        if let Some(DiagnosticStatus { level, message, .. }) = of_west {
            let levels = ["OK", "WARN", "ERROR"];
            let level = levels.get(usize::from(level)).copied().unwrap_or("STALE");
            self.state = format!("{level:5} {message}");
        }
    }

    /// Prints the line of a second, and begins the next one.
    fn print(&mut self, second: u64) {
        self.took.sort();
        let p50 = self.took.get(self.took.len() / 2).map_or(0, Duration::as_millis);
        let Self { inputs, of_west, of_local, state, .. } = self;
        println!("{second:7} {inputs:7} {of_west:5} {of_local:6} {p50:4} ms     {state}");
        (self.inputs, self.of_west, self.of_local) = (0, 0, 0);
        self.took.clear();
    }

    fn unanswered(&self) -> usize {
        self.images.values().filter(|(_, outputs)| *outputs == 0).count()
    }

    fn close(&self) {
        let (all, none) = (self.images.len(), self.unanswered());
        let more = self.images.values().filter(|(_, outputs)| *outputs > 1).count();
        println!("\n{all} images, {none} without an output, {more} with more than one");
    }
}

/// Runs a node that computes something for each image, for all images at once.
async fn model(model: &Model) -> Result<(), Any> {
    let mut node = node_in(domain(), model.name)?;
    let (input, output) = (format!("{}/input", model.name), format!("{}/output", model.name));
    let images: Subscription<CompressedImage> =
        subscription(&mut node, &input, "sensor_msgs/CompressedImage")?;
    let points: Publisher<PointStamped> =
        publisher(&mut node, &output, "geometry_msgs/PointStamped")?;
    let points = Arc::new(points);
    loop {
        let (image, _) = images.take().await?;
        let (points, name, takes) = (Arc::clone(&points), model.name, model.takes);
        tokio::spawn(async move {
            sleep(takes).await;
            let header = Header { stamp: image.header.stamp, frame_id: name.into() };
            // The requester may have left.
            drop(points.publish(PointStamped { header, point: [1.0, 2.0, 3.0] }).await);
        });
    }
}

impl ChildProcess {
    fn start(args: &[&str]) -> Result<Self, Any> {
        let mut command = Command::new(env::current_exe()?);
        command.args(args);
        #[cfg(feature = "zenoh")]
        if is_over_zenoh() {
            command.arg("--zenoh").envs([ros::over_zenoh::variable()]);
        }
        Ok(Self(command.spawn()?))
    }

    /// Asks it to end, and waits for that.
    fn stop(mut self) -> Result<(), Any> {
        let id = Pid::from_raw(i32::try_from(self.0.id())?).ok_or("no such process")?;
        kill_process(id, Signal::TERM)?;
        self.0.wait()?;
        Ok(())
    }
}

impl Drop for ChildProcess {
    fn drop(&mut self) {
        // It may have ended by itself.
        drop((self.0.kill(), self.0.wait()));
    }
}

/// Returns the judge's verdict on the trace.
fn judge(trace: &Path) -> Result<String, Any> {
    let lines = BufReader::new(File::open(trace)?);
    let verdict = fuseline_traces::judge("the run", lines)?;
    let word = if verdict.conforms { "conforms" } else { "does not conform" };
    Ok(format!("{word}: {} messages judged in {} lines", verdict.judged, verdict.lines))
}

/// Returns the domain of all parts, in which nobody else is likely to be.
fn domain() -> u16 {
    env::var("ROS_DOMAIN_ID").ok().and_then(|domain| domain.parse().ok()).unwrap_or(87)
}
