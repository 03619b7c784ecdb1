//! What the node in the path costs: `cargo bench -p fuseline-ros2 --profile release`; with `--features zenoh` over Zenoh too,
//! in the same run, through a router.
//!
//! A camera and a cloud that answers at once, on loopback: first joined directly, then by the node,
//! in one run. The node's own part is from the moment when the cloud's result comes in, as seen by
//! another subscriber, to the publication of the output, as its source timestamp says. Camera,
//! cloud, subscriber and node are processes of their own.

#[path = "../examples/demo/messages.rs"]
mod messages;
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
const MESSAGES: u32 = 1000;
const WARM_UP: u32 = 50;
const RATE_HZ: u32 = 50;
const SIZES: [usize; 3] = [100, 33_000, 300_000];
/// Longer than anything takes on the way.
const REST: Duration = Duration::from_secs(2);

const IMAGE: &str = "sensor_msgs/CompressedImage";
const POINT: &str = "geometry_msgs/PointStamped";
/// What the subscriber listens to: the cloud's results for the node, the node's outputs, and the
/// cloud's results for the camera itself.
const HEARD: [&str; 3] = ["west/output", "output", "direct/output"];

/// A process of this bench, killed with this.
struct ChildProcess(Child);

/// When a message was published and received, in nanoseconds since 1970.
#[derive(Clone, Copy)]
struct Instants {
    published: i64,
    received: i64,
}

/// By the stamp of the image that it answers, which is when that was sent.
type ReceivedAt = BTreeMap<i64, Instants>;

fn main() -> Result<(), Any> {
    let role = std::env::args().nth(1).unwrap_or_default();
    // Zenoh needs more than one thread.
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    match role.as_str() {
        // `cargo test` runs benches once, to see that they build.
        "--test" => Ok(()),
        "cloud" => runtime.block_on(async { tokio::try_join!(echo("west"), echo("direct")) }).map(drop),
        "subscriber" => runtime.block_on(listen()),
        #[cfg(feature = "zenoh")]
        "router" => runtime.block_on(ros::over_zenoh::route()),
        _ => runtime.block_on(async {
            println!("over {}", if is_over_zenoh() { "Zenoh" } else { "DDS" });
            println!("  input     without the node      with the node         the node's part       its processor");
            println!("            p50        p99        p50        p99        p50        p99        time a message");
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
    let subscriber = ChildProcess::of_this(&["subscriber"])?;
    let mut node = node_in(DOMAIN, "camera")?;
    let direct: Publisher<CompressedImage> = publisher(&mut node, "direct/input", IMAGE)?;
    let through: Publisher<CompressedImage> = publisher(&mut node, "input", IMAGE)?;
    for camera in [&direct, &through] {
        camera.subscribed(&node).await;
    }
    sleep(REST).await;
    send(&direct, bytes).await?;
    let cpu = fusion.cpu()?;
    send(&through, bytes).await?;
    let cpu = fusion.cpu()?.saturating_sub(cpu) / (MESSAGES + WARM_UP);
    let [west, output, direct] = subscriber.received_by_stamp()?;

    let without = percentiles(direct.iter().map(|(sent, result)| result.received - sent));
    let with = percentiles(output.iter().map(|(sent, result)| result.received - sent));
    let part =
        output.iter().filter_map(|(sent, out)| Some(out.published - west.get(sent)?.received));
    let columns = [without, with, percentiles(part)];
    let [a, b, c] = columns.map(|[p50, p99]| format!("{p50:6.2} ms  {p99:6.2} ms  "));
    println!("{bytes:7} B {a} {b} {c}      {:.2} ms", cpu.as_secs_f64() * 1e3);
    Ok(())
}

/// The camera: stamps are the time of day.
async fn send(camera: &Publisher<CompressedImage>, bytes: usize) -> Result<(), Any> {
    let mut frames = interval(Duration::from_secs(1) / RATE_HZ);
    for _ in 0..MESSAGES + WARM_UP {
        frames.tick().await;
        let now = SystemTime::now().to_nanos();
        let stamp = Time {
            sec: i32::try_from(now / 1_000_000_000)?,
            nanosec: u32::try_from(now % 1_000_000_000)?,
        };
        let header = Header { stamp, frame_id: String::new() };
        let image = CompressedImage { header, format: String::new(), data: vec![0; bytes] };
        camera.publish(image).await?;
    }
    sleep(REST).await;
    Ok(())
}

/// The cloud: answers each image at once.
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

/// The subscriber: when its input ends, it writes what it received.
async fn listen() -> Result<(), Any> {
    let mut node = node_in(DOMAIN, "subscriber")?;
    let topics: Vec<Subscription<PointStamped>> = HEARD
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
                // Zenoh does not say when it came.
                let now = SystemTime::now().to_nanos();
                let sent = i64::from(stamp.sec) * 1_000_000_000 + i64::from(stamp.nanosec);
                let published = info.source_timestamp().map_or(0, |time| time.to_nanos());
                let received = info.received_timestamp().map_or(now, |time| time.to_nanos());
                writeln!(lines, "{index} {sent} {published} {received}")?;
            }
        }
    }
    Ok(stdout().write_all(lines.as_bytes())?)
}

/// The next message of one of these, and of which.
async fn any_of(
    topics: &[Subscription<PointStamped>],
) -> (usize, Result<(PointStamped, MessageInfo), Any>) {
    let next = topics.iter().map(|topic| Box::pin(topic.take()));
    let (next, index, _) = futures_util::future::select_all(next).await;
    (index, next)
}

/// The median and the 99th percentile, in milliseconds, without the first.
fn percentiles(nanos: impl Iterator<Item = i64>) -> [f64; 2] {
    let mut nanos: Vec<i64> = nanos.skip(WARM_UP as usize).collect();
    nanos.sort_unstable();
    [50, 99].map(|percent| {
        nanos.get(nanos.len() * percent / 100).copied().map_or(f64::NAN, milliseconds)
    })
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

    /// The node under measurement.
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

    /// What the subscriber received, in the order of [`HEARD`].
    fn received_by_stamp(mut self) -> Result<[ReceivedAt; 3], Any> {
        drop(self.0.stdin.take());
        let mut lines = String::new();
        self.0.stdout.take().ok_or("no output")?.read_to_string(&mut lines)?;
        let mut received_by_stamp = [ReceivedAt::new(), ReceivedAt::new(), ReceivedAt::new()];
        for line in lines.lines() {
            let numbers: Vec<i64> = line.split(' ').map(str::parse).collect::<Result<_, _>>()?;
            let [index, sent, published, received] = numbers[..] else { return Err(line.into()) };
            received_by_stamp[usize::try_from(index)?]
                .insert(sent, Instants { published, received });
        }
        Ok(received_by_stamp)
    }

    /// Its processor time so far, user's and system's.
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
