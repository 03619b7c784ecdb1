//! Images and results. All of one follows from its number and from who made it, so that whoever gets one knows each byte of it.

use hiroz::msg::ZMessage;
use hiroz_msgs::builtin_interfaces::Time;
use hiroz_msgs::sensor_msgs::CompressedImage;
use hiroz_msgs::std_msgs::Header;

use crate::Any;

/// Who makes the inputs.
pub(crate) const CAMERA: &str = "camera";

/// The first stamp: with odd digits in all places, so that none can be left out unseen.
const FIRST_S: i32 = 1_700_000_001;
const FIRST_NS: u32 = 123_456_789;

/// What `source` makes of a number: the camera an image, each of the others its result.
pub(crate) fn of(source: &str, number: u32) -> CompressedImage {
    let stamp = Time { sec: FIRST_S + number.cast_signed(), nanosec: FIRST_NS + number };
    let header = Header { stamp, frame_id: format!("{source} {number}") };
    // Up to 40 kB, of any alignment.
    let length = number as usize * 7919 % 40_000;
    let data: Vec<u8> = format!("{source} {number},").into_bytes();
    let data: Vec<u8> = data.iter().copied().cycle().take(length).collect();
    CompressedImage { header, format: source.into(), data: data.into() }
}

/// The number of an image or of a result.
///
/// # Errors
/// It cannot be read.
pub(crate) fn number(serialized: &[u8]) -> Result<u32, Any> {
    let image = <CompressedImage as ZMessage>::deserialize(serialized)?;
    Ok(image.header.stamp.sec.wrapping_sub(FIRST_S).cast_unsigned())
}

/// The key by which the node knows it: its stamp in nanoseconds.
pub(crate) fn key(number: u32) -> String {
    let Time { sec, nanosec } = of(CAMERA, number).header.stamp;
    format!("{sec}{nanosec:09}")
}
