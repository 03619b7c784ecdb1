//! ROS nodes of this machine alone, and messages as `.msg` files have them.

use std::error::Error;
use std::net::Ipv4Addr;

use ros2_client::qos::{History, WhenFull};
use ros2_client::{
    Context, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, QosProfile,
    Subscription,
};
use rustdds::{DomainParticipantBuilder, Topic};
use serde::{Deserialize, Serialize};

pub(crate) type Any = Box<dyn Error + Send + Sync>;

/// `builtin_interfaces/msg/Time`.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub(crate) struct Time {
    pub(crate) sec: i32,
    pub(crate) nanosec: u32,
}

/// `std_msgs/msg/Header`.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct Header {
    pub(crate) stamp: Time,
    pub(crate) frame_id: String,
}

/// `sensor_msgs/msg/CompressedImage`.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct CompressedImage {
    pub(crate) header: Header,
    pub(crate) format: String,
    pub(crate) data: Vec<u8>,
}

/// `geometry_msgs/msg/PointStamped`.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct PointStamped {
    pub(crate) header: Header,
    pub(crate) point: [f64; 3],
}

/// A ROS node of this machine alone.
pub(crate) fn node_in(domain: u16, name: &str) -> Result<Node, Any> {
    let participant =
        DomainParticipantBuilder::new(domain).with_only_networks([Ipv4Addr::LOCALHOST]).build()?;
    let context = Context::from_domain_participant(participant)?;
    let options = NodeOptions::new().enable_rosout(false);
    let mut node = context
        .new_node(NodeName::new("/", name)?, options)
        .map_err(|error| format!("{error:?}"))?;
    tokio::spawn(node.spinner()?.spin());
    Ok(node)
}

pub(crate) fn publisher<M: Serialize>(
    node: &mut Node,
    topic: &str,
    ty: &str,
) -> Result<Publisher<M>, Any> {
    let topic = topic_of(node, topic, ty)?;
    Ok(node.create_publisher(&topic, Some(quality()))?)
}

pub(crate) fn subscription<M: 'static>(
    node: &mut Node,
    topic: &str,
    ty: &str,
) -> Result<Subscription<M>, Any> {
    let topic = topic_of(node, topic, ty)?;
    Ok(node.create_subscription(&topic, Some(quality()))?)
}

fn topic_of(node: &Node, topic: &str, ty: &str) -> Result<Topic, Any> {
    let (package, ty) = ty.split_once('/').ok_or("a type has a package")?;
    let name = Name::parse(&format!("/{topic}"))?;
    Ok(node.create_topic(&name, MessageTypeName::new(package, ty), &quality())?)
}

fn quality() -> QosProfile {
    QosProfile::publisher_default()
        .reliability_reliable(WhenFull::Fail)
        .history(History::KeepLast { depth: 10 })
}
