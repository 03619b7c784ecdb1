//! The boxes that three networks found in the frames of a video, the time that each network took,
//! and the true places of people. They were recorded once, see
//! `evaluation/python/perception/README.md`.

use std::fmt;
use std::io::{BufRead, BufReader};
use std::time::Duration;

use flate2::read::GzDecoder;
use fuseline_tokio::Error;
use serde::Deserialize;

/// The left camera looks at the left half of the picture, and the right camera at the right half.
const MIDDLE: f64 = 384.0;

/// A detector. A smaller network answers sooner and finds less.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) enum Detector {
    /// On board.
    Local,
    /// The smaller cloud.
    West,
    /// The larger cloud.
    East,
}

/// Identifies the boxes of a message, which carries this in place of the boxes themselves.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Seen {
    pub(crate) frame: usize,
    pub(crate) by: Detector,
    /// The cameras whose frames had come.
    pub(crate) left: bool,
    pub(crate) right: bool,
}

/// Left, top, right and bottom, in pixels.
pub(crate) type Corners = [f64; 4];

/// All frames, from the first one on.
#[derive(Debug)]
pub(crate) struct Recording {
    frames: Vec<RecordedFrame>,
}

#[derive(Deserialize, Debug)]
struct RecordedFrame {
    seconds: ByDetector<f64>,
    /// Boxes with their scores.
    #[serde(flatten)]
    found: ByDetector<Vec<[f64; 5]>>,
    reference: Vec<Corners>,
}

#[derive(Deserialize, Debug)]
struct ByDetector<T> {
    local: T,
    west: T,
    east: T,
}

impl Recording {
    /// Reads the file.
    pub(crate) fn load() -> Result<Self, Error> {
        let packed: &[u8] = include_bytes!("../../python/perception/detections.jsonl.gz");
        // The first line is about all frames.
        let lines = BufReader::new(GzDecoder::new(packed)).lines().skip(1);
        let frames = lines.map(|line| Ok(serde_json::from_str(&line?)?));
        Ok(Self { frames: frames.collect::<Result<_, Error>>()? })
    }

    pub(crate) const fn len(&self) -> usize {
        self.frames.len()
    }

    /// Returns the time from the first capture to this frame's. The video has 7 frames a second.
    pub(crate) fn captured(frame: usize) -> Duration {
        let frame = u64::try_from(frame).unwrap_or(u64::MAX);
        Duration::from_millis(frame * 500 / 7 * 2)
    }

    /// Returns the newest frame that was captured by then.
    pub(crate) fn newest(&self, since: Duration) -> usize {
        let is_captured = |frame: &usize| Self::captured(*frame) <= since;
        (0..self.len()).take_while(is_captured).last().unwrap_or(0)
    }

    /// Returns how long a detector computes for a frame.
    pub(crate) fn runtime(&self, by: Detector, frame: usize) -> Duration {
        in_steps(*self.frames[frame].seconds.of(by) * 1000.0)
    }

    /// Returns the boxes that lie in the cameras' halves of the picture, with their scores.
    pub(crate) fn boxes(&self, seen: Seen) -> impl Iterator<Item = &[f64; 5]> {
        let is_seen = move |found: &&[f64; 5]| {
            let is_left = f64::midpoint(found[0], found[2]) < MIDDLE;
            if is_left { seen.left } else { seen.right }
        };
        self.frames[seen.frame].found.of(seen.by).iter().filter(is_seen)
    }

    /// Returns where people are.
    pub(crate) fn reference(&self, frame: usize) -> &[Corners] {
        &self.frames[frame].reference
    }
}

/// Rounds milliseconds up to whole steps of 2 ms. Control's ticks lie between two steps, so no plan
/// arrives exactly at a tick: the runtime promises no order for events at one instant.
pub(crate) fn in_steps(ms: f64) -> Duration {
    Duration::from_secs_f64((ms / 2.0).ceil() * 2.0 / 1000.0)
}

impl Detector {
    /// Returns the name of the source. The larger detector has the greater priority.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Local => "local",
            Self::West => "west",
            Self::East => "east",
        }
    }
}

impl fmt::Display for Detector {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl<T> ByDetector<T> {
    const fn of(&self, by: Detector) -> &T {
        match by {
            Detector::Local => &self.local,
            Detector::West => &self.west,
            Detector::East => &self.east,
        }
    }
}
