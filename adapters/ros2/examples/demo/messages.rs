//! Messages in the form of `.msg` files.

use std::error::Error;

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
