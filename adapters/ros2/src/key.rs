//! Keys: the part of a message that matches a result to its input (D14).

use std::fmt;
use std::time::{Duration, SystemTime};

use thiserror::Error;

/// The greatest age that a stamp may have.
const GREATEST_AGE: Duration = Duration::from_secs(3600);

/// Types that begin with a `std_msgs/Header`, or are one. Sorted.
const WITH_HEADER: &[&str] = &[
    "ackermann_msgs/msg/AckermannDriveStamped",
    "actionlib_msgs/msg/GoalStatusArray",
    "apriltag_msgs/msg/AprilTagDetectionArray",
    "diagnostic_msgs/msg/DiagnosticArray",
    "geographic_msgs/msg/GeoPointStamped",
    "geographic_msgs/msg/GeoPoseStamped",
    "geometry_msgs/msg/AccelStamped",
    "geometry_msgs/msg/AccelWithCovarianceStamped",
    "geometry_msgs/msg/InertiaStamped",
    "geometry_msgs/msg/PointStamped",
    "geometry_msgs/msg/PolygonInstanceStamped",
    "geometry_msgs/msg/PolygonStamped",
    "geometry_msgs/msg/PoseArray",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/QuaternionStamped",
    "geometry_msgs/msg/TransformStamped",
    "geometry_msgs/msg/TwistStamped",
    "geometry_msgs/msg/TwistWithCovarianceStamped",
    "geometry_msgs/msg/Vector3Stamped",
    "geometry_msgs/msg/VelocityStamped",
    "geometry_msgs/msg/WrenchStamped",
    "gps_msgs/msg/GPSFix",
    "map_msgs/msg/OccupancyGridUpdate",
    "map_msgs/msg/PointCloud2Update",
    "nav2_msgs/msg/Costmap",
    "nav_msgs/msg/Goals",
    "nav_msgs/msg/GridCells",
    "nav_msgs/msg/OccupancyGrid",
    "nav_msgs/msg/Odometry",
    "nav_msgs/msg/Path",
    "nav_msgs/msg/Trajectory",
    "radar_msgs/msg/RadarScan",
    "radar_msgs/msg/RadarTracks",
    "sensor_msgs/msg/BatteryState",
    "sensor_msgs/msg/CameraInfo",
    "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/FluidPressure",
    "sensor_msgs/msg/Illuminance",
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/Imu",
    "sensor_msgs/msg/JointState",
    "sensor_msgs/msg/Joy",
    "sensor_msgs/msg/LaserScan",
    "sensor_msgs/msg/MagneticField",
    "sensor_msgs/msg/MultiDOFJointState",
    "sensor_msgs/msg/MultiEchoLaserScan",
    "sensor_msgs/msg/NavSatFix",
    "sensor_msgs/msg/PointCloud",
    "sensor_msgs/msg/PointCloud2",
    "sensor_msgs/msg/Range",
    "sensor_msgs/msg/RelativeHumidity",
    "sensor_msgs/msg/Temperature",
    "sensor_msgs/msg/TimeReference",
    "std_msgs/msg/Header",
    "stereo_msgs/msg/DisparityImage",
    "trajectory_msgs/msg/JointTrajectory",
    "trajectory_msgs/msg/MultiDOFJointTrajectory",
    "vision_msgs/msg/BoundingBox2DArray",
    "vision_msgs/msg/BoundingBox3DArray",
    "vision_msgs/msg/Classification",
    "vision_msgs/msg/Detection2D",
    "vision_msgs/msg/Detection2DArray",
    "vision_msgs/msg/Detection3D",
    "vision_msgs/msg/Detection3DArray",
    "vision_msgs/msg/LabelInfo",
    "vision_msgs/msg/VisionInfo",
    "visualization_msgs/msg/ImageMarker",
    "visualization_msgs/msg/InteractiveMarker",
    "visualization_msgs/msg/InteractiveMarkerFeedback",
    "visualization_msgs/msg/InteractiveMarkerPose",
    "visualization_msgs/msg/Marker",
];

/// The place and the kind of a message's key.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum MessageKey {
    /// The stamp of a `std_msgs/Header` at the very beginning. It also fits types that begin with a
    /// `builtin_interfaces/Time`.
    Header,
    /// An integer at a fixed offset.
    Integer {
        /// The offset in bytes after the encapsulation header.
        offset: u32,
        /// The integer's size and sign.
        kind: IntegerKind,
    },
}

/// An integer's size and sign.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum IntegerKind {
    /// `uint32`.
    U32,
    /// `int32`.
    I32,
    /// `uint64`.
    U64,
    /// `int64`.
    I64,
}

/// A key that was read: a header's stamp in nanoseconds, or the integer.
///
/// Equal numbers are equal keys, whatever they were read from.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct Stamp(i128);

/// The reason why a message has no key.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Error)]
pub enum KeyError {
    /// The message ends before its key does.
    #[error("the message ends before its key does")]
    Short,
    /// The header's stamp has 10⁹ nanoseconds or more.
    #[error("the nanoseconds of the stamp are a second or more")]
    Nanosec,
}

/// Returns `true` if the type `package/msg/Type` is known to begin with a `std_msgs/Header`.
///
/// The table has the common interfaces of Humble to Kilted and some other packages. A type that is
/// not in it may still begin with one.
#[must_use]
pub fn has_header(type_name: &str) -> bool {
    WITH_HEADER.binary_search(&type_name).is_ok()
}

impl MessageKey {
    /// Reads the key of a message's body, the bytes after the encapsulation header.
    ///
    /// # Errors
    /// Returns an error if the body is too short, or if a header's stamp is not valid.
    pub fn read(self, body: &[u8], big_endian: bool) -> Result<Stamp, KeyError> {
        let stamp = match self {
            Self::Header => {
                let sec = i32::from_ne_bytes(bytes(body, 0, big_endian)?);
                let nanosec = u32::from_ne_bytes(bytes(body, 4, big_endian)?);
                if nanosec >= 1_000_000_000 {
                    return Err(KeyError::Nanosec);
                }
                i128::from(i64::from(sec) * 1_000_000_000 + i64::from(nanosec))
            }
            Self::Integer { offset, kind } => match kind {
                IntegerKind::U32 => u32::from_ne_bytes(bytes(body, offset, big_endian)?).into(),
                IntegerKind::I32 => i32::from_ne_bytes(bytes(body, offset, big_endian)?).into(),
                IntegerKind::U64 => u64::from_ne_bytes(bytes(body, offset, big_endian)?).into(),
                IntegerKind::I64 => i64::from_ne_bytes(bytes(body, offset, big_endian)?).into(),
            },
        };
        Ok(Stamp(stamp))
    }

    /// Returns `true` if the key is a header's stamp that nobody set, which ROS leaves 0.
    pub(crate) fn is_unset(self, stamp: Stamp) -> bool {
        matches!(self, Self::Header) && stamp.0 == 0
    }
}

impl Stamp {
    /// Returns the time since the stamp, or `None` if the stamp lies in the future or more than an
    /// hour ago. Such a stamp belongs to another clock, as of a simulation or of a recording.
    pub(crate) fn age(self, now: SystemTime) -> Option<Duration> {
        let now =
            i128::try_from(now.duration_since(SystemTime::UNIX_EPOCH).ok()?.as_nanos()).ok()?;
        let age = Duration::from_nanos(u64::try_from(now.checked_sub(self.0)?).ok()?);
        (age <= GREATEST_AGE).then_some(age)
    }

    /// Returns the number, if it has 64 bits.
    pub(crate) fn nanos(self) -> Option<i64> {
        i64::try_from(self.0).ok()
    }

    /// Returns the key as a timestamp of a sensor's stream, or `None` if it is negative.
    pub(crate) fn seq(self) -> Option<u64> {
        u64::try_from(self.0).ok()
    }
}

impl IntegerKind {
    /// Returns the integer's name in ROS.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::U32 => "uint32",
            Self::I32 => "int32",
            Self::U64 => "uint64",
            Self::I64 => "int64",
        }
    }
}

impl fmt::Display for MessageKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Header => f.write_str("header"),
            Self::Integer { offset, kind } => write!(f, "{} at byte {offset}", kind.name()),
        }
    }
}

impl fmt::Display for Stamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Returns the integer's bytes, in this machine's order.
fn bytes<const N: usize>(body: &[u8], offset: u32, big_endian: bool) -> Result<[u8; N], KeyError> {
    let offset = usize::try_from(offset).map_err(|_| KeyError::Short)?;
    let found = body.get(offset..).and_then(<[u8]>::first_chunk::<N>);
    let mut bytes = *found.ok_or(KeyError::Short)?;
    if big_endian != cfg!(target_endian = "big") {
        bytes.reverse();
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn integer(offset: u32, kind: IntegerKind) -> MessageKey {
        MessageKey::Integer { offset, kind }
    }

    fn header(sec: i32, nanosec: u32) -> Vec<u8> {
        [sec.to_le_bytes(), nanosec.to_le_bytes()].concat()
    }

    #[test]
    fn the_table_is_sorted_and_its_types_are_types() {
        assert!(WITH_HEADER.is_sorted_by(|a, b| a < b));
        for name in WITH_HEADER {
            assert_eq!(crate::names::check_type(name), Ok(()), "{name}");
        }
    }

    #[test]
    fn types_with_a_header_differ_from_those_without() {
        for name in ["sensor_msgs/msg/Image", "std_msgs/msg/Header", "vision_msgs/msg/Detection2D"]
        {
            assert!(has_header(name), "{name}");
        }
        let without = [
            "geometry_msgs/msg/Pose",
            "nav_msgs/msg/MapMetaData",
            "sensor_msgs/msg/JoyFeedbackArray",
            "sensor_msgs/msg/NavSatStatus",
            "sensor_msgs/msg/PointField",
            "sensor_msgs/msg/RegionOfInterest",
            "std_msgs/msg/String",
            "tf2_msgs/msg/TFMessage",
            "trajectory_msgs/msg/JointTrajectoryPoint",
            "vision_msgs/msg/BoundingBox2D",
            "visualization_msgs/msg/MarkerArray",
        ];
        for name in without {
            assert!(!has_header(name), "{name}");
        }
    }

    /// D14.
    #[test]
    fn a_header_is_read_in_either_order() {
        let body = [0, 0, 0, 2, 0, 0, 0, 7, 99];
        assert_eq!(MessageKey::Header.read(&body, true).unwrap().to_string(), "2000000007");
        let stamp = MessageKey::Header.read(&header(-1, 999_999_999), false).unwrap();
        assert_eq!(stamp.to_string(), "-1");
        let least = MessageKey::Header.read(&header(i32::MIN, 0), false).unwrap();
        assert_eq!(least.to_string(), "-2147483648000000000");
    }

    /// D14.
    #[test]
    fn a_second_of_nanoseconds_is_no_stamp() {
        let read = |nanosec| MessageKey::Header.read(&header(1, nanosec), false);
        assert_eq!(read(999_999_999).unwrap().to_string(), "1999999999");
        assert_eq!(read(1_000_000_000), Err(KeyError::Nanosec));
        assert_eq!(MessageKey::Header.read(&header(1, u32::MAX)[..7], false), Err(KeyError::Short));
    }

    #[test]
    fn a_stamp_of_the_future_or_of_another_clock_has_no_age() {
        let now = SystemTime::UNIX_EPOCH + Duration::from_secs(1_700_000_000);
        let age = |sec: i32, nanosec| {
            MessageKey::Header.read(&header(sec, nanosec), false).unwrap().age(now)
        };
        assert_eq!(age(1_699_999_999, 970_000_000), Some(Duration::from_millis(30)));
        assert_eq!(age(1_700_000_000, 0), Some(Duration::ZERO));
        assert_eq!(age(1_699_996_400, 0), Some(GREATEST_AGE));
        assert_eq!((age(1_700_000_000, 1), age(1_699_996_399, 999_999_999)), (None, None));
        assert_eq!((age(12, 0), age(-1, 0)), (None, None));
        let seq = |sec| MessageKey::Header.read(&header(sec, 0), false).unwrap().seq();
        assert_eq!((seq(2), seq(-1)), (Some(2_000_000_000), None));
    }

    /// D2.
    #[test]
    fn only_a_header_has_an_unset_stamp() {
        let is_unset =
            |key: MessageKey, body: [u8; 8]| key.is_unset(key.read(&body, false).unwrap());
        let counter = integer(0, IntegerKind::U64);
        assert!(is_unset(MessageKey::Header, [0; 8]));
        assert!(!is_unset(MessageKey::Header, [0, 0, 0, 0, 1, 0, 0, 0]));
        assert!(!is_unset(counter, [0; 8]));
    }

    /// D14.
    #[test]
    fn integers_are_read_at_their_place() {
        let body = [9, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xfe];
        let read = |offset, kind, big| integer(offset, kind).read(&body, big).unwrap().to_string();
        assert_eq!(read(1, IntegerKind::U32, false), "4294967295");
        assert_eq!(read(1, IntegerKind::I32, false), "-1");
        assert_eq!(read(1, IntegerKind::I64, true), "-2");
        assert_eq!(read(1, IntegerKind::U64, true), "18446744073709551614");
        assert_eq!(read(5, IntegerKind::I32, true), "-2");
        assert_eq!(integer(2, IntegerKind::U64).read(&body, true), Err(KeyError::Short));
        assert_eq!(integer(u32::MAX, IntegerKind::I32).read(&body, true), Err(KeyError::Short));
    }

    proptest! {
        #[test]
        fn any_bytes_have_a_key_or_none(body: Vec<u8>, offset in 0..40_u32, big: bool) {
            let is_long = |bytes| body.len() >= offset as usize + bytes;
            prop_assert_eq!(integer(offset, IntegerKind::U64).read(&body, big).is_ok(), is_long(8));
            prop_assert_eq!(integer(offset, IntegerKind::I64).read(&body, big).is_ok(), is_long(8));
            prop_assert_eq!(integer(offset, IntegerKind::U32).read(&body, big).is_ok(), is_long(4));
            prop_assert_eq!(integer(offset, IntegerKind::I32).read(&body, big).is_ok(), is_long(4));
            let stamp = MessageKey::Header.read(&body, big);
            prop_assert_eq!(stamp == Err(KeyError::Short), body.len() < 8);
        }

        /// D14.
        #[test]
        fn a_stamp_is_its_number(number: u64, big: bool) {
            let body = if big { number.to_be_bytes() } else { number.to_le_bytes() };
            let stamp = integer(0, IntegerKind::U64).read(&body, big).unwrap();
            prop_assert_eq!(stamp.to_string(), number.to_string());
        }
    }
}
