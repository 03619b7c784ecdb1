//! Animations: what moved in some runs, and what left their operators, for the page's script to show.

use std::io::BufReader;

use fuseline_traces::{Decision, Event, Events};
use serde::Serialize;

/// Draws animations; a file of its own.
pub(crate) const SCRIPT: &str = include_str!("animation.js");

/// How many places a second has.
pub(crate) const RATE: u32 = 20;

/// Runs side by side, at the same time.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Animation {
    pub(crate) caption: String,
    /// From left to right and from below to above, in m.
    pub(crate) shown: [[f64; 2]; 2],
    /// What does not move: roads and walls, with their corners.
    pub(crate) still: Vec<(&'static str, Vec<[f64; 2]>)>,
    pub(crate) runs: Vec<AnimatedRun>,
}

/// One run.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct AnimatedRun {
    pub(crate) name: String,
    /// How it ends, in words.
    pub(crate) outcome: String,
    pub(crate) collides: bool,
    /// When it was decided to brake or swerve, in s.
    pub(crate) decided: Option<f64>,
    pub(crate) bodies: Vec<AnimatedBody>,
    /// The operator's outputs: when, in s, and whose.
    pub(crate) outputs: Vec<(f64, u64)>,
}

/// What moves.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct AnimatedBody {
    /// Ego, other or person.
    pub(crate) role: &'static str,
    /// Length and width; a person has a diameter.
    pub(crate) size: [f64; 2],
    /// The middle of its front and its heading in rad, [`RATE`] times a second.
    pub(crate) poses: Vec<[f64; 3]>,
}

impl AnimatedBody {
    /// A body by its pose at each instant, until `end`; what has touched stays where it is from `contact` on.
    pub(crate) fn new(
        role: &'static str,
        size: [f64; 2],
        (end, contact): (f64, Option<f64>),
        pose: impl Fn(f64) -> ([f64; 2], [f64; 2]),
    ) -> Self {
        let steps = (0_u32..).map(|step| f64::from(step) / f64::from(RATE));
        let poses = steps.take_while(|now| *now <= end).map(|now| {
            let ([x, y], heading) = pose(now.min(contact.unwrap_or(f64::INFINITY)));
            [x, y, heading[1].atan2(heading[0])].map(|figure| (figure * 1e3).round() / 1e3)
        });
        Self { role, size, poses: poses.collect() }
    }
}

/// The outputs in a trace that was just recorded: when, in s from `from` on, and whose.
pub(crate) fn outputs(trace: &[u8], from: f64) -> Vec<(f64, u64)> {
    let mut outputs = Vec::new();
    let Ok(mut events) = Events::new("a run", BufReader::new(trace)) else { return outputs };
    while let Ok(Some(event)) = events.next_event() {
        if let Event::Decision(Decision::Emit { at, p, .. }) = event {
            let at = std::time::Duration::from_nanos(at).as_secs_f64() - from;
            outputs.push(((at * 1e4).round() / 1e4, p));
        }
    }
    outputs
}

/// Animations as the page's script reads them: no tag ends within.
pub(crate) fn data(animations: &[Animation]) -> String {
    serde_json::to_string(animations).unwrap_or_default().replace('<', "\\u003c")
}
