//! What the node in the path costs: `cargo bench -p fuseline-ros2`.
//!
//! A camera and a cloud that answers at once, on loopback: first joined directly, then by the node,
//! in one run. The node's own part is from the moment when the cloud's result comes in, as seen by
//! another subscriber, to the publication of the output, as its source timestamp says.

#[path = "../examples/demo/ros.rs"]
mod ros;

use std::collections::BTreeMap;
use std::fs;
use std::process::{Child, Command};
use std::time::Duration;

use futures_util::StreamExt;
use ros2_client::{Publisher, Subscription, SystemTime};
use tokio::time::{Instant, interval, sleep, timeout};

use ros::{Any, CompressedImage, Header, PointStamped, Time, node_in, publisher, subscription};

const DOMAIN: u16 = 88;
const MESSAGES: usize = 1000;
const WARM_UP: usize = 50;
const RATE_HZ: u32 = 50;
const SIZES: [usize; 3] = [100, 33_000, 300_000];

/// The node under measurement, killed with this.
struct Fusion(Child);

fn main() -> Result<(), Any> {
    // `cargo test` runs benches once, to see that they build.
    if std::env::args().any(|arg| arg == "--test") {
        return Ok(());
    }
    let runtime =
        tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    println!(
        "  input     without the node      with the node       the node's part     its processor time"
    );
    println!(
        "            p50       p99         p50       p99       p50       p99       for a message"
    );
    for bytes in SIZES {
        runtime.block_on(measure(bytes))?;
    }
    Ok(())
}

async fn measure(bytes: usize) -> Result<(), Any> {
    let fusion = Fusion::start()?;
    let mut node = node_in(DOMAIN, "bench")?;
    let image = "sensor_msgs/CompressedImage";
    let point = "geometry_msgs/PointStamped";
    let through: Publisher<CompressedImage> = publisher(&mut node, "input", image)?;
    let direct: Publisher<CompressedImage> = publisher(&mut node, "direct/input", image)?;
    let cloud: Subscription<PointStamped> = subscription(&mut node, "west/output", point)?;
    let output: Subscription<PointStamped> = subscription(&mut node, "output", point)?;
    let answers: Subscription<PointStamped> = subscription(&mut node, "direct/output", point)?;
    for topic in ["west", "direct"] {
        echo(topic)?;
    }
    through.wait_for_subscription(&node).await;
    direct.wait_for_subscription(&node).await;
    cloud.wait_for_publisher(&node).await;
    sleep(Duration::from_secs(2)).await;

    let (sent, came) = run(&direct, &[&answers], bytes).await?;
    let without = spans(&came[0], &sent, |out| out.received);
    let cpu = fusion.cpu()?;
    let (sent, came) = run(&through, &[&cloud, &output], bytes).await?;
    let cpu = fusion.cpu()?.saturating_sub(cpu) / u32::try_from(MESSAGES + WARM_UP)?;
    let with = spans(&came[1], &sent, |out| out.received);
    let part = spans(&came[1], &came[0], |out| out.published);
    let [a, b, c] = [without, with, part].map(|[p50, p99]| format!("{p50:6.2} ms {p99:6.2} ms"));
    println!("{bytes:7} B {a}   {b} {c}      {:.2} ms", cpu.as_secs_f64() * 1e3);
    Ok(())
}

/// When messages were published and received, in nanoseconds since 1970, by their stamps.
type Seen = BTreeMap<(i32, u32), Instants>;

#[derive(Clone, Copy)]
struct Instants {
    published: i64,
    received: i64,
}

/// Sends that many messages, and says when each was sent and came on each topic.
async fn run(
    camera: &Publisher<CompressedImage>,
    topics: &[&Subscription<PointStamped>],
    bytes: usize,
) -> Result<(Seen, Vec<Seen>), Any> {
    let (mut sent, mut came) = (Seen::new(), vec![Seen::new(); topics.len()]);
    let streams = topics.iter().enumerate();
    let streams =
        streams.map(|(i, topic)| Box::pin(topic.async_stream().map(move |point| (i, point))));
    let mut points = futures_util::stream::select_all(streams);
    let (start, mut frames) = (Instant::now(), interval(Duration::from_secs(1) / RATE_HZ));
    while came.iter().any(|came| came.len() < MESSAGES + WARM_UP) {
        tokio::select! {
            point = timeout(Duration::from_secs(2), points.next()) => {
                // What is lost on the way is left out of the figures.
                let Ok(Some((i, Ok((PointStamped { header, .. }, info))))) = point else { break };
                let (published, received) = (info.source_timestamp(), info.received_timestamp());
                let (published, received) = (published.ok_or("when?")?, received.ok_or("when?")?);
                let seen = Instants { published: published.to_nanos(), received: received.to_nanos() };
                came[i].insert((header.stamp.sec, header.stamp.nanosec), seen);
            }
            _ = frames.tick(), if sent.len() < MESSAGES + WARM_UP => {
                let now = start.elapsed();
                let stamp = Time { sec: i32::try_from(now.as_secs())?, nanosec: now.subsec_nanos() };
                let header = Header { stamp, frame_id: String::new() };
                let data = vec![0; bytes];
                let now = SystemTime::now().to_nanos();
                let sending = Instants { published: now, received: now };
                sent.insert((stamp.sec, stamp.nanosec), sending);
                let image = CompressedImage { header, format: String::new(), data };
                camera.async_publish(image).await.map_err(|error| error.to_string())?;
            }
        }
    }
    Ok((sent, came))
}

/// The cloud: answers each image at once, in a thread of its own.
fn echo(name: &'static str) -> Result<(), Any> {
    let mut node = node_in(DOMAIN, &format!("{name}_model"))?;
    let images: Subscription<CompressedImage> =
        subscription(&mut node, &format!("{name}/input"), "sensor_msgs/CompressedImage")?;
    let points: Publisher<PointStamped> =
        publisher(&mut node, &format!("{name}/output"), "geometry_msgs/PointStamped")?;
    tokio::spawn(async move {
        let _node = node;
        while let Ok((image, _)) = images.async_take().await {
            let point = PointStamped { header: image.header, point: [0.0; 3] };
            drop(points.async_publish(point).await);
        }
    });
    Ok(())
}

/// The median and the 99th percentile of how much later than it was received before, in
/// milliseconds.
fn spans(later: &Seen, earlier: &Seen, at: fn(&Instants) -> i64) -> [f64; 2] {
    let span = |(key, out): (_, &Instants)| Some(at(out) - earlier.get(key)?.received);
    let mut spans: Vec<i64> = later.iter().skip(WARM_UP).filter_map(span).collect();
    spans.sort_unstable();
    let nth = |percent: usize| spans.get(spans.len() * percent / 100).copied();
    [50, 99].map(|percent| nth(percent).map_or(f64::NAN, milliseconds))
}

#[expect(clippy::cast_precision_loss, reason = "nanoseconds of less than a second")]
fn milliseconds(nanos: i64) -> f64 {
    nanos as f64 / 1e6
}

impl Fusion {
    fn start() -> Result<Self, Any> {
        let set = [
            "input.type:=sensor_msgs/msg/CompressedImage".to_owned(),
            "output.type:=geometry_msgs/msg/PointStamped".to_owned(),
            "clouds:=[west]".to_owned(),
            format!("domain_id:={DOMAIN}"),
            "localhost_only:=true".to_owned(),
            "qos_overrides./input.subscription.reliability:=reliable".to_owned(),
        ];
        let mut command = Command::new(env!("CARGO_BIN_EXE_fuseline-ros2"));
        command.args(["--ros-args", "--log-level", "error"]);
        for set in set {
            command.args(["-p", &set]);
        }
        Ok(Self(command.spawn()?))
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

impl Drop for Fusion {
    fn drop(&mut self) {
        // It may have ended by itself.
        drop((self.0.kill(), self.0.wait()));
    }
}
