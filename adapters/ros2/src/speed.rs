//! The vehicle's speed, from a topic.

use std::time::Duration;

use fuseline_deadline::MetresPerSecond;
use fuseline_engine::Situation;
use tokio::time::Instant;

use crate::raw::Payload;
use crate::settings::{ODOMETRY, SpeedTopic};

/// The last speed that came.
pub(crate) struct Speed {
    topic: String,
    is_odometry: bool,
    age: Duration,
    last: Option<(Instant, f64)>,
}

impl Speed {
    pub(crate) fn new(topic: &SpeedTopic) -> Self {
        let is_odometry = topic.type_name == ODOMETRY;
        Self { topic: topic.topic.clone(), is_odometry, age: topic.age, last: None }
    }

    /// Takes a message; true if it has a speed. A message without one makes the speed unknown.
    pub(crate) fn take(&mut self, now: Instant, payload: &Payload) -> bool {
        let reported = if self.is_odometry { odometry(payload) } else { number(payload, 0) };
        // Going backwards is as fast.
        let speed = reported.map(f64::abs).filter(|speed| speed.is_finite());
        self.last = speed.map(|speed| (now, speed));
        speed.is_some()
    }

    /// Returns the situation for policies, which is unknown if the last speed is too old.
    pub(crate) fn situation(&self, now: Instant) -> Situation<'static> {
        self.fresh(now).map_or(Situation::UNKNOWN, |speed| Situation::at(MetresPerSecond(speed)))
    }

    /// Returns the reason why the speed is unknown, if it is.
    pub(crate) fn missing(&self, now: Instant) -> Option<String> {
        match self.last {
            _ if self.fresh(now).is_some() => None,
            None => Some(format!("no speed on {}", self.topic)),
            Some((then, _)) => {
                let silence = now.duration_since(then).as_secs_f64();
                Some(format!("no speed on {} for {silence:.1} s", self.topic))
            }
        }
    }

    fn fresh(&self, now: Instant) -> Option<f64> {
        let fresh = self.last.filter(|(then, _)| now.duration_since(*then) <= self.age);
        fresh.map(|(_, speed)| speed)
    }
}

/// Returns the length of the twist's linear part.
fn odometry(payload: &Payload) -> Option<f64> {
    // The header's stamp, then two frames' names, each with its length before it.
    let mut at = 8;
    for _ in 0..2 {
        let start = aligned(at, 4)?;
        let len = u32_at(payload, start)?;
        at = start.checked_add(4)?.checked_add(usize::try_from(len).ok()?)?;
    }
    // A position, an orientation and 36 covariances.
    let twist = aligned(at, 8)?.checked_add(8 * (3 + 4 + 36))?;
    let [x, y, z] = [0, 8, 16].map(|offset| number(payload, twist.checked_add(offset)?));
    Some(x?.hypot(y?).hypot(z?))
}

fn aligned(at: usize, to: usize) -> Option<usize> {
    at.checked_next_multiple_of(to)
}

fn u32_at(payload: &Payload, at: usize) -> Option<u32> {
    let bytes = *payload.body.get(at..)?.first_chunk()?;
    Some(if payload.big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
}

fn number(payload: &Payload, at: usize) -> Option<f64> {
    let bytes = *payload.body.get(at..)?.first_chunk()?;
    Some(if payload.big_endian { f64::from_be_bytes(bytes) } else { f64::from_le_bytes(bytes) })
}

#[cfg(test)]
mod tests {
    use bytes::Bytes;
    use proptest::prelude::*;

    use super::*;

    const AGE: Duration = Duration::from_millis(500);

    fn topic(type_name: &str) -> SpeedTopic {
        SpeedTopic { topic: "/odom".into(), type_name: type_name.into(), age: AGE }
    }

    /// Returns an odometry with these names of frames, as CDR has it.
    fn odometry(frames: [&str; 2], speed: [f64; 3], big_endian: bool) -> Payload {
        let mut body = vec![0; 8];
        let number =
            |number: u32| if big_endian { number.to_be_bytes() } else { number.to_le_bytes() };
        for frame in frames {
            body.resize(body.len().next_multiple_of(4), 0);
            body.extend(number(u32::try_from(frame.len()).unwrap() + 1));
            body.extend(frame.bytes().chain([0]));
        }
        body.resize(body.len().next_multiple_of(8), 0);
        let covariances = [7.0; 36];
        let pose = [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0];
        for number in pose.iter().chain(&covariances).chain(&speed).chain(&[9.0; 3 + 36]) {
            body.extend(if big_endian { number.to_be_bytes() } else { number.to_le_bytes() });
        }
        Payload { big_endian, body: body.into() }
    }

    #[tokio::test(start_paused = true)]
    async fn the_speed_of_an_odometry_is_the_length_of_its_twist_whatever_its_frames_are_called() {
        for frames in [["odom", "base_link"], ["", ""], ["a", "bc"], ["abcdefg", "x"]] {
            for big_endian in [false, true] {
                let mut speed = Speed::new(&topic("nav_msgs/msg/Odometry"));
                assert!(speed.situation(Instant::now()).speed.least.0.is_nan());
                assert!(
                    speed.take(Instant::now(), &odometry(frames, [-3.0, 4.0, 12.0], big_endian))
                );
                assert_eq!(
                    speed.situation(Instant::now()),
                    Situation::at(MetresPerSecond(13.0)),
                    "{frames:?}"
                );
            }
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_speed_is_believed_until_it_is_too_old_and_what_is_none_is_not() {
        let mut speed = Speed::new(&topic("std_msgs/msg/Float64"));
        let reported = |speed: f64| Payload {
            big_endian: false,
            body: Bytes::copy_from_slice(&speed.to_le_bytes()),
        };
        let start = Instant::now();
        assert!(speed.take(start, &reported(-18.0)));
        assert_eq!(speed.situation(start + AGE), Situation::at(MetresPerSecond(18.0)));
        assert_eq!(speed.missing(start + AGE), None);
        let old = start + AGE + Duration::from_nanos(1);
        assert!(speed.situation(old).speed.least.0.is_nan());
        assert_eq!(speed.missing(old).unwrap(), "no speed on /odom for 0.5 s");
        for none in [f64::NAN, f64::INFINITY] {
            assert!(speed.take(start, &reported(1.0)));
            assert!(!speed.take(start, &reported(none)));
            assert_eq!(speed.missing(start).unwrap(), "no speed on /odom");
            assert!(speed.situation(start).speed.least.0.is_nan());
        }
    }

    proptest! {
        #[test]
        fn no_bytes_do_any_harm(
            body in proptest::collection::vec(any::<u8>(), 0..800),
            is_odometry in any::<bool>(),
        ) {
            let name = if is_odometry { "nav_msgs/msg/Odometry" } else { "std_msgs/msg/Float64" };
            let mut speed = Speed::new(&topic(name));
            let payload = Payload { big_endian: false, body: body.into() };
            let now = Instant::now();
            let is_known = speed.take(now, &payload);
            prop_assert_eq!(is_known, speed.situation(now).speed.least.0.is_finite());
        }
    }
}
