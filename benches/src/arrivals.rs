//! Makes the inputs of a vehicle with three clouds on recorded drives.

use std::collections::BTreeMap;

use fuseline_core::{Cloud, Commit, ConfigError, Fusion, Instant, Priority};
use fuseline_traces::Input;

use crate::machine::{DecisionTally, Machine};

/// The round trips of three drives, one for each cloud: good coverage, coverage that is lost, and
/// outages of seconds.
const DRIVES: [&str; 3] = [
    include_str!("../../testkit/data/cicv5g/urban_n78_v40.csv"),
    include_str!("../../testkit/data/cicv5g/strong_to_weak_n8_v30.csv"),
    include_str!("../../testkit/data/cicv5g/rural_n8_v10.csv"),
];

/// The time that the models take (DETR-ResNet-101, DETR-ResNet-101-DC and DINO-SWIN-Tiny on an
/// A100), in ns.
const RUNTIMES: [u64; 3] = [118_200_000, 146_600_000, 90_100_000];
/// The time that local's DETR-ResNet-50 takes on an Orin, in ns.
const LOCAL_RUNTIME: u64 = 301_700_000;
/// The time between messages in ns: 20 Hz, the rate of the recordings.
const PERIOD: u64 = 50_000_000;
/// The deadline of each request in ns.
const DEADLINE: u64 = 500_000_000;

/// The window of the measured machines.
pub const WINDOW: usize = 16;

/// Priority, limit and resume of each cloud.
pub const CLOUDS: [(u64, u64, u64); 3] = [(1, 31, 0), (2, 31, 0), (3, 31, 0)];

/// The core's machine for these arrivals.
///
/// # Errors
/// Never: the configuration is valid.
pub fn fusion(commit: Commit) -> Result<Fusion<3, WINDOW>, ConfigError> {
    let clouds = CLOUDS.map(|(p, limit, resume)| Cloud {
        priority: Priority::new(u16::try_from(p).unwrap_or_default()),
        limit,
        resume,
    });
    Fusion::new(WINDOW, commit, &clouds)
}

/// Every input of `messages` messages, in order: each is opened and offered to all clouds; local's
/// and every cloud's result arrives, late ones too; a tick comes at each due instant.
///
/// # Panics
/// If a drive's file is not what it was.
#[must_use]
pub fn inputs(messages: usize, commit: Commit) -> Vec<Input> {
    let round_trips = DRIVES.map(|drive| {
        drive.lines().skip(1).map(|row| rtt_ns(row).expect("a row of a drive")).collect::<Vec<_>>()
    });
    let mut arrivals = BTreeMap::new();
    for message in 0..messages {
        let t = message as u64;
        let at = t * PERIOD;
        arrivals.insert((at, t, 0), Input::Open { at, t, deadline: None });
        arrivals
            .insert((at + LOCAL_RUNTIME, t, 4), Input::Result { at: at + LOCAL_RUNTIME, t, p: 0 });
        for ((cloud, rtts), runtime) in (1..).zip(&round_trips).zip(RUNTIMES) {
            let offer = Input::Offer { at, t, p: cloud, deadline: DEADLINE, backlog: 0 };
            arrivals.insert((at, t, cloud), offer);
            let at = at + rtts[message % rtts.len()] + runtime;
            arrivals.insert((at, t, 4 + cloud), Input::Result { at, t, p: cloud });
        }
    }
    with_ticks(arrivals.into_values(), commit)
}

fn with_ticks(inputs: impl Iterator<Item = Input>, commit: Commit) -> Vec<Input> {
    let mut fusion = fusion(commit).expect("a valid configuration");
    let mut all = Vec::new();
    for input in inputs {
        while let Some(due) =
            fusion.next_due().map(Instant::as_nanos).filter(|due| *due < input.at())
        {
            let tick = Input::Tick { at: due };
            fusion.apply(&tick, &mut DecisionTally::default());
            all.push(tick);
        }
        fusion.apply(&input, &mut DecisionTally::default());
        all.push(input);
    }
    all
}

fn rtt_ns(row: &str) -> Option<u64> {
    let ms: u64 = row.split(',').nth(1)?.parse().ok()?;
    Some(ms * 1_000_000)
}
