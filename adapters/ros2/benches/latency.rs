//! Measures the cost of a node in the path. Run `cargo bench -p fuseline-ros2`. With
//! `--features zenoh` it also measures over Zenoh, in the same run, through a router.
//!
//! A camera and a cloud that answers at once, on loopback, are joined directly, by a relay, and by
//! the node, in turns in one run. The relay only publishes images and results again as they come,
//! so the node's own cost is what it adds beyond the relay. Camera, cloud, subscriber, relay and
//! node are separate processes.

#[path = "../examples/demo/messages.rs"]
mod messages;
#[expect(
    dead_code,
    unreachable_pub,
    unused_imports,
    reason = "the node's own: the relay uses a part"
)]
#[path = "../src/raw.rs"]
mod raw;
mod relay;
#[path = "../examples/demo/ros.rs"]
mod ros;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::io::{Read, Write, stdin, stdout};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use ros2_client::{MessageInfo, SystemTime};
use tokio::time::{interval, sleep};

use messages::{Any, CompressedImage, Header, PointStamped, Time};
use ros::{Publisher, Subscription, is_over_zenoh, node_in, publisher, subscription};

const DOMAIN: u16 = 88;
/// A turn sends `MESSAGES` messages by each way. The first `WARM_UP` of them do not count.
const TURNS: usize = 6;
const MESSAGES: usize = 150;
const WARM_UP: usize = 30;
const RATE_HZ: u32 = 30;
const SIZES: [usize; 2] = [100, 300_000];
/// No message is under way for longer than this.
const REST: Duration = Duration::from_secs(2);
const PAUSE: Duration = Duration::from_millis(300);

const IMAGE: &str = "sensor_msgs/CompressedImage";
const POINT: &str = "geometry_msgs/PointStamped";
/// The input topics: the cloud's own, the relay's, and the node's.
const INPUTS: [&str; 3] = ["direct/input", "relay/input", "input"];
/// The topics to which the subscriber listens, in the same order.
const OUTPUTS: [&str; 3] = ["direct/output", "relay/output", "output"];
/// The two hops of the relay: to the cloud and back.
const HOPS: [relay::Hop; 2] = [
    ["relay/input", "relayed/input", "sensor_msgs::msg::dds_::CompressedImage_"],
    ["relayed/output", "relay/output", "geometry_msgs::msg::dds_::PointStamped_"],
];

/// A process of this bench, which is killed when this is dropped.
struct ChildProcess(Child);

/// The instants at which results came, by the instants at which their images were sent, in
/// nanoseconds since 1970.
type ReceivedAt = BTreeMap<i64, i64>;

fn main() -> Result<(), Any> {
    let role = std::env::args().nth(1).unwrap_or_default();
    // Zenoh needs more than one thread.
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    match role.as_str() {
        // `cargo test` runs benches once, to see that they build.
        "--test" => Ok(()),
        "cloud" => runtime
            .block_on(async { tokio::try_join!(echo("west"), echo("relayed"), echo("direct")) })
            .map(drop),
        #[cfg(feature = "zenoh")]
        "relay" if is_over_zenoh() => runtime.block_on(relay::over_zenoh(DOMAIN, HOPS)),
        "relay" => runtime.block_on(relay::over_dds(DOMAIN, HOPS)),
        "subscriber" => runtime.block_on(listen()),
        #[cfg(feature = "zenoh")]
        "router" => runtime.block_on(ros::over_zenoh::route()),
        _ => runtime.block_on(async {
            println!("over {}", if is_over_zenoh() { "Zenoh" } else { "DDS" });
            println!("  input     directly              by a relay            by the node           the node adds         its processor");
            println!("            p50        p99        p50        p99        p50        p99        p50        p99        time a message");
            for bytes in SIZES {
                measure(bytes).await?;
            }
            if cfg!(feature = "zenoh") && !is_over_zenoh() {
                Command::new(std::env::current_exe()?).arg("--zenoh").status()?;
            }
            Ok(())
        }),
    }
}

async fn measure(bytes: usize) -> Result<(), Any> {
    let _router = is_over_zenoh().then(|| ChildProcess::of_this(&["router"])).transpose()?;
    let fusion = ChildProcess::fusion()?;
    let _cloud = ChildProcess::of_this(&["cloud"])?;
    let _relay = ChildProcess::of_this(&["relay"])?;
    let subscriber = ChildProcess::of_this(&["subscriber"])?;
    let mut node = node_in(DOMAIN, "camera")?;
    let mut cameras = Vec::new();
    for input in INPUTS {
        let camera: Publisher<CompressedImage> = publisher(&mut node, input, IMAGE)?;
        // Over Zenoh the relay cannot be seen.
        if !is_over_zenoh() || input != INPUTS[1] {
            camera.subscribed(&node).await;
        }
        cameras.push(camera);
    }
    sleep(REST).await;
    let cpu = fusion.cpu()?;
    let mut counted = Vec::new();
    for _ in 0..TURNS {
        for camera in &cameras {
            counted.extend(send(camera, bytes).await?.into_iter().skip(WARM_UP));
            sleep(PAUSE).await;
        }
    }
    sleep(REST).await;
    let cpu = fusion.cpu()?.as_secs_f64() - cpu.as_secs_f64();
    let mut ways = [[0.0; 2]; 3];
    let received = subscriber.received_by_stamp()?;
    for ((way, received), output) in ways.iter_mut().zip(received).zip(OUTPUTS) {
        let took = counted.iter().filter_map(|sent| Some(received.get(sent)? - sent)).collect();
        *way = percentiles(took).map_err(|error| format!("{output}: {error}"))?;
    }
    let [directly, relayed, fused] = ways;
    let added = [fused[0] - relayed[0], fused[1] - relayed[1]];
    let columns = [directly, relayed, fused, added];
    let columns = columns.map(|[p50, p99]| format!("{p50:6.2} ms  {p99:6.2} ms  ")).join(" ");
    let messages = u32::try_from(TURNS * MESSAGES)?;
    println!("{bytes:7} B {columns}      {:.2} ms", cpu * 1e3 / f64::from(messages));
    Ok(())
}

/// Plays the camera and returns the stamps that it sent, which are the time of day.
async fn send(camera: &Publisher<CompressedImage>, bytes: usize) -> Result<Vec<i64>, Any> {
    let mut frames = interval(Duration::from_secs(1) / RATE_HZ);
    let mut sent = Vec::with_capacity(MESSAGES);
    for _ in 0..MESSAGES {
        frames.tick().await;
        let now = SystemTime::now().to_nanos();
        let stamp = Time {
            sec: i32::try_from(now / 1_000_000_000)?,
            nanosec: u32::try_from(now % 1_000_000_000)?,
        };
        let header = Header { stamp, frame_id: String::new() };
        let image = CompressedImage { header, format: String::new(), data: vec![0; bytes] };
        camera.publish(image).await?;
        sent.push(now);
    }
    Ok(sent)
}

/// Plays the cloud, which answers each image at once.
async fn echo(name: &str) -> Result<(), Any> {
    let mut node = node_in(DOMAIN, &format!("{name}_model"))?;
    let images: Subscription<CompressedImage> =
        subscription(&mut node, &format!("{name}/input"), IMAGE)?;
    let points: Publisher<PointStamped> = publisher(&mut node, &format!("{name}/output"), POINT)?;
    loop {
        let (image, _) = images.take().await?;
        points.publish(PointStamped { header: image.header, point: [0.0; 3] }).await?;
    }
}

/// Plays the subscriber. When its input ends, it writes what it received.
async fn listen() -> Result<(), Any> {
    let mut node = node_in(DOMAIN, "subscriber")?;
    let topics: Vec<Subscription<PointStamped>> = OUTPUTS
        .iter()
        .map(|topic| subscription(&mut node, topic, POINT))
        .collect::<Result<_, _>>()?;
    let mut lines = String::new();
    let mut end = tokio::task::spawn_blocking(|| stdin().read_to_end(&mut Vec::new()));
    loop {
        tokio::select! {
            _ = &mut end => break,
            (index, point) = any_of(&topics) => {
                let (PointStamped { header: Header { stamp, .. }, .. }, info) = point?;
                // Zenoh does not report when a message came.
                let now = SystemTime::now().to_nanos();
                let sent = i64::from(stamp.sec) * 1_000_000_000 + i64::from(stamp.nanosec);
                let received = info.received_timestamp().map_or(now, |time| time.to_nanos());
                writeln!(lines, "{index} {sent} {received}")?;
            }
        }
    }
    Ok(stdout().write_all(lines.as_bytes())?)
}

/// Returns the next message on one of these topics, and the index of its topic.
async fn any_of(
    topics: &[Subscription<PointStamped>],
) -> (usize, Result<(PointStamped, MessageInfo), Any>) {
    let next = topics.iter().map(|topic| Box::pin(topic.take()));
    let (next, index, _) = futures_util::future::select_all(next).await;
    (index, next)
}

/// Returns the median and the 99th percentile of the times, in milliseconds.
///
/// # Errors
/// Returns an error if one result in ten, or more, did not come.
fn percentiles(mut nanos: Vec<i64>) -> Result<[f64; 2], Any> {
    let sent = TURNS * (MESSAGES - WARM_UP);
    let lost = sent.saturating_sub(nanos.len());
    if lost >= sent / 10 {
        return Err(format!("{lost} of {sent} results did not come").into());
    }
    if lost > 0 {
        eprintln!("{lost} of {sent} results did not come");
    }
    nanos.sort_unstable();
    Ok([50, 99].map(|percent| milliseconds(nanos[nanos.len() * percent / 100])))
}

#[expect(clippy::cast_precision_loss, reason = "nanoseconds of less than a second")]
fn milliseconds(nanos: i64) -> f64 {
    nanos as f64 / 1e6
}

impl ChildProcess {
    fn of_this(args: &[&str]) -> Result<Self, Any> {
        let mut command = Command::new(std::env::current_exe()?);
        if is_over_zenoh() {
            command.args(args).arg("--zenoh");
        } else {
            command.args(args);
        }
        Ok(Self(command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?))
    }

    /// Starts the node under measurement.
    fn fusion() -> Result<Self, Any> {
        let domain = format!("domain_id:={DOMAIN}");
        let set = [
            "input.type:=sensor_msgs/msg/CompressedImage",
            "output.type:=geometry_msgs/msg/PointStamped",
            "clouds:=[west]",
            if is_over_zenoh() { "middleware:=zenoh" } else { "middleware:=dds" },
            "localhost_only:=true",
            "qos_overrides./input.subscription.reliability:=reliable",
            &domain,
        ];
        let mut command = Command::new(env!("CARGO_BIN_EXE_fuseline-ros2"));
        command.args(["--ros-args", "--log-level", "error"]);
        command.args(set.iter().flat_map(|set| ["-p", set]));
        #[cfg(feature = "zenoh")]
        if is_over_zenoh() {
            command.envs([ros::over_zenoh::variable()]);
        }
        Ok(Self(command.spawn()?))
    }

    /// Returns what the subscriber received, in the order of [`OUTPUTS`].
    fn received_by_stamp(mut self) -> Result<[ReceivedAt; 3], Any> {
        drop(self.0.stdin.take());
        let mut lines = String::new();
        self.0.stdout.take().ok_or("no output")?.read_to_string(&mut lines)?;
        let mut received_by_stamp = [ReceivedAt::new(), ReceivedAt::new(), ReceivedAt::new()];
        for line in lines.lines() {
            let numbers: Vec<i64> = line.split(' ').map(str::parse).collect::<Result<_, _>>()?;
            let [index, sent, received] = numbers[..] else { return Err(line.into()) };
            received_by_stamp[usize::try_from(index)?].insert(sent, received);
        }
        Ok(received_by_stamp)
    }

    /// Returns its processor time so far, the user's and the system's.
    fn cpu(&self) -> Result<Duration, Any> {
        let stat = fs::read_to_string(format!("/proc/{}/stat", self.0.id()))?;
        let after_name = stat.rsplit_once(')').ok_or("no such process")?.1;
        let ticks = after_name.split_whitespace().skip(11).take(2).map(str::parse::<u64>);
        let ticks: u64 = ticks.sum::<Result<_, _>>()?;
        // Linux counts hundredths of a second here, on every architecture.
        Ok(Duration::from_millis(ticks * 10))
    }
}

impl Drop for ChildProcess {
    fn drop(&mut self) {
        // It may have ended by itself.
        drop((self.0.kill(), self.0.wait()));
    }
}
