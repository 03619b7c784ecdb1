//! Reads the paper's figures from `paper.json`, for comparison with ours.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

use crate::approach::Approach;

/// The paper's figures that scenarios show beside their own.
#[derive(Deserialize)]
pub(crate) struct Paper {
    pub(crate) runtime_ms: Vec<ModelRuntime>,
    /// The least and the greatest human reaction time that the paper cites, in s.
    pub(crate) human_reaction_s: [f64; 2],
    pub(crate) drive_5g_san_francisco: MeasuredDrive,
    pub(crate) traffic_jam: TrafficJam,
    pub(crate) jaywalking: Jaywalking,
    pub(crate) red_light: RedLight,
}

/// A row of the table of runtimes, in ms.
#[derive(Deserialize)]
pub(crate) struct ModelRuntime {
    pub(crate) model: String,
    pub(crate) orin: f64,
    pub(crate) a100: f64,
    /// Box AP on COCO val2017, where a figure was found.
    pub(crate) coco_ap: Option<f64>,
}

/// The 5G drive.
#[derive(Deserialize)]
pub(crate) struct MeasuredDrive {
    pub(crate) rtt_ms: TripQuantiles,
}

/// Round trips in ms.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
pub struct TripQuantiles {
    /// The median.
    pub p50: f64,
    /// The 90th percentile.
    pub p90: f64,
    /// The 99th percentile.
    pub p99: f64,
}

/// The table of the traffic jam.
#[derive(Deserialize)]
pub(crate) struct TrafficJam {
    pub(crate) cloud_response_s: Vec<f64>,
    /// Has a 1 for each response that collides, by speed in m/s and approach.
    collides: BTreeMap<String, BTreeMap<String, Vec<u8>>>,
}

#[derive(Deserialize)]
pub(crate) struct Jaywalking {
    pub(crate) collides: PlanCollides,
}

#[derive(Deserialize)]
pub(crate) struct PlanCollides {
    pub(crate) local_planner: bool,
    pub(crate) cached_contingency: bool,
}

#[derive(Deserialize)]
pub(crate) struct RedLight {
    pub(crate) collides: SeenCollides,
}

#[derive(Deserialize)]
pub(crate) struct SeenCollides {
    pub(crate) local_detector: bool,
    pub(crate) cloud_detector: bool,
    pub(crate) shared_locations: bool,
}

pub(crate) static PAPER: LazyLock<Paper> = LazyLock::new(|| {
    serde_json::from_str(include_str!("../paper.json")).expect("the file is as above")
});

/// Returns the round trips of the paper's 5G drive.
#[must_use]
pub fn paper_round_trips() -> TripQuantiles {
    PAPER.drive_5g_san_francisco.rtt_ms
}

impl TrafficJam {
    /// Returns the speeds of the table, ascending, in m/s.
    pub(crate) fn speeds(&self) -> Vec<f64> {
        let mut speeds: Vec<f64> =
            self.collides.keys().filter_map(|speed| speed.parse().ok()).collect();
        speeds.sort_by(f64::total_cmp);
        speeds
    }

    /// Returns whether a cell of the table collides, or `None` if the table has no such cell.
    pub(crate) fn collides(&self, speed: f64, approach: Approach, response: f64) -> Option<bool> {
        let name = match approach {
            Approach::Local => "local",
            Approach::Cloud => "cloud",
            Approach::Ours => "ours",
            Approach::First => return None,
        };
        let index = self.cloud_response_s.iter().position(|at| (at - response).abs() < 1e-9)?;
        Some(*self.collides.get(&speed.to_string())?.get(name)?.get(index)? == 1)
    }
}
