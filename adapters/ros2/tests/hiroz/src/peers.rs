//! Who is around the node: each a process with a session of its own, configured as `rmw_zenoh` is without a file.

use std::num::NonZeroUsize;
use std::thread;
use std::time::Duration;

use hiroz::Builder;
use hiroz::config::router_config;
use hiroz::context::{ZContext, ZContextBuilder};
use hiroz::msg::ZMessage;
use hiroz::qos::{QosHistory, QosProfile};
use hiroz_msgs::sensor_msgs::CompressedImage;
use zenoh::Wait;

use crate::image::{self, CAMERA};
use crate::{Any, graph_scene};

/// Local is the first with its result, so that it is available when the better one comes.
const LOCAL_TAKES: Duration = Duration::from_millis(5);
const WEST_TAKES: Duration = Duration::from_millis(20);

/// Is the router until the process is killed.
pub(crate) fn route() -> Result<(), Any> {
    let _session = zenoh::open(router_config()?).wait()?;
    loop {
        thread::park();
    }
}

/// A context of ROS 2, in the domain of the environment.
pub(crate) fn context() -> Result<ZContext, Any> {
    // The router begins at the same time.
    let context = ZContextBuilder::default().with_json("connect/timeout_ms", 10_000);
    context.with_json("connect/exit_on_failure", true).build()
}

/// Reliable, with room for all that may come before it is read.
pub(crate) fn quality() -> QosProfile {
    let depth = NonZeroUsize::new(1000).unwrap_or(NonZeroUsize::MIN);
    QosProfile { history: QosHistory::KeepLast(depth), ..QosProfile::default() }
}

/// Answers each image, until the process is killed.
pub(crate) fn answer(source: &str) -> Result<(), Any> {
    let takes = if source == graph_scene::WEST { WEST_TAKES } else { LOCAL_TAKES };
    let context = context()?;
    let node = context.create_node(source).build()?;
    let results = node.create_pub::<CompressedImage>(&format!("/{source}/output"));
    let results = results.with_qos(quality()).build()?;
    let images = node.create_sub::<CompressedImage>(&format!("/{source}/input"));
    let images = images.with_qos(quality()).build()?;
    loop {
        let sample = images.recv_serialized()?;
        let payload = sample.payload().to_bytes();
        let number = image::number(&payload)?;
        if *payload != *image::of(CAMERA, number).serialize() {
            return Err(format!("image {number} is not what the camera made").into());
        }
        thread::sleep(takes);
        results.publish(&image::of(source, number))?;
    }
}
