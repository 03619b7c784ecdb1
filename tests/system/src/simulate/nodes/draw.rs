//! Draws scenarios from seeds.

use std::time::Duration;

use fuseline_ros2::Commit;
use fuseline_ros2::settings::Change;
use fuseline_testkit::Rng;

use crate::simulate::nodes::scenario::{
    Delivery, Disturbance, Form, Input, Peer, Reply, ReplyKind, Scenario,
};

/// The deadlines in ms. None is longer than the time for which a calm waits.
const DEADLINES: [u64; 6] = [10, 30, 60, 100, 500, 1000];

impl Scenario {
    /// Draws the run of this seed.
    pub(crate) fn of_seed(seed: u64) -> Self {
        let mut rng = Rng::with_seed(seed);
        let rng = &mut rng;
        let clouds = rng.one_of(&[0, 1, 1, 2, 2, 3]);
        let peers: Vec<_> = (0..=clouds).map(|index| peer(rng, index)).collect();
        let count = rng.one_of(&[3, 10, 30, 60, 120]);
        let gap = rng.one_of(&[1, 5, 10, 33, 100]);
        let inputs = inputs(rng, count, gap, peers.len());
        let span = inputs.last().map_or(Duration::ZERO, |last| last.at);
        let drawn = Self {
            window: rng.one_of(&[1, 2, 4, 16, 16, 64]),
            commit: rng.one_of(&[Commit::Eager, Commit::Patient]),
            waiting: rng.one_of(&[1, 4, 16, 64]),
            turns: turns(rng, span, peers.len()),
            peers,
            inputs,
        };
        // This is drawn last, so that the rest of each scenario stays the same.
        let is_progressive = rng.u8(0..3) == 0;
        Self { commit: if is_progressive { Commit::Progressive } else { drawn.commit }, ..drawn }
    }
}

fn peer(rng: &mut Rng, index: usize) -> Peer {
    let is_called = index > 0 && rng.u8(0..3) == 0;
    Peer {
        // Most peers have the defaults.
        in_flight: if index == 0 {
            rng.one_of(&[1, 2, 4, 4, 4])
        } else {
            rng.one_of(&[1, 2, 8, 8])
        },
        limit: rng.one_of(&[1, 3, 31]),
        is_called,
        hints: index > 0 && !is_called && rng.bool(),
    }
}

fn inputs(rng: &mut Rng, count: u64, gap: u64, peers: usize) -> Vec<Input> {
    // By now the manager has activated the node.
    let mut at = Duration::from_millis(1);
    let mut inputs: Vec<Input> = Vec::new();
    // The share of messages to or from this peer that gets lost, in percent.
    let losses: Vec<u8> = (0..peers).map(|_| rng.one_of(&[0, 0, 5, 20, 60, 100])).collect();
    for number in 0..count {
        at += Duration::from_micros(match rng.u8(0..8) {
            0 => 0,
            1 => gap * 1000 + rng.u64(0..1000),
            _ => gap * 1000,
        });
        let key = match (rng.u8(0..20), inputs.last()) {
            // A message with this stamp may still be open.
            (0, Some(last)) => last.key,
            (1, Some(_)) => inputs[rng.usize(0..inputs.len())].key,
            _ => 10 * number + 100,
        };
        let form = match rng.u8(0..40) {
            0 => Form::Short,
            1 => Form::NotCdr,
            _ => Form::Whole,
        };
        let fates = losses.iter().map(|loss| delivery(rng, *loss)).collect();
        inputs.push(Input { at, key, form, is_unsent: rng.u8(0..50) == 0, fates });
    }
    inputs
}

fn delivery(rng: &mut Rng, loss: u8) -> Delivery {
    let is_lost = |rng: &mut Rng| rng.u8(0..100) < loss;
    let transit = (!is_lost(rng)).then(|| delay(rng));
    let took = Duration::from_micros(match rng.u8(0..8) {
        0 => 0,
        1 => 1000 * rng.one_of(&DEADLINES),
        _ => rng.u64(1000..80_000),
    });
    let replies = if is_lost(rng) { 0 } else { rng.one_of(&[1, 1, 1, 1, 1, 1, 1, 2, 3]) };
    let reply = |rng: &mut Rng| {
        let kind = match rng.u8(0..40) {
            0 => ReplyKind::Stray,
            1 => ReplyKind::Short,
            2 => ReplyKind::NotCdr,
            _ => ReplyKind::Result,
        };
        Reply { delay: delay(rng), kind }
    };
    Delivery { delay: transit, took, replies: (0..replies).map(|_| reply(rng)).collect() }
}

/// Draws the time that a message travels. Most times are short and some are long, so that a later
/// message may come first.
fn delay(rng: &mut Rng) -> Duration {
    Duration::from_micros(match rng.u8(0..10) {
        0 => rng.u64(0..1_500_000),
        1..4 => rng.u64(0..40_000),
        _ => rng.u64(0..3_000),
    })
}

fn turns(rng: &mut Rng, span: Duration, peers: usize) -> Vec<(Duration, Disturbance)> {
    let mut turns = Vec::new();
    let mut is_active = true;
    // Only one of the two ways to set the deadline is used. If both were used at one instant,
    // either could be the last.
    let by_topic = rng.bool();
    for _ in 0..rng.one_of(&[0, 1, 4, 12]) {
        let at = span.mul_f64(rng.f64());
        let peer = rng.usize(0..peers);
        let some = Duration::from_millis(rng.one_of(&DEADLINES));
        let cloud = rng.usize(0..peers.max(2) - 1);
        match rng.u8(0..10) {
            0 if !by_topic => turns.push((at, Disturbance::Set(Change::Deadline(some)))),
            1 => turns.push((at, Disturbance::Set(Change::LocalDeadline(some)))),
            2 | 3 if peers > 1 => {
                let own = rng.bool().then_some(some);
                turns.push((at, Disturbance::Set(Change::CloudDeadline(cloud, own))));
            }
            4 if peers > 1 => {
                turns.push((at, Disturbance::Set(Change::CloudEnabled(cloud, rng.bool()))));
            }
            5 if by_topic => {
                let seconds =
                    rng.one_of(&[0.05, 0.2, 1.0, 0.0, -1.0, 61.0, f64::NAN, f64::INFINITY]);
                turns.push((at, Disturbance::Deadline(seconds)));
            }
            6 => {
                is_active = !is_active;
                turns.push((at, Disturbance::Activate(is_active)));
            }
            7 => turns.push((at, Disturbance::Stalls(Duration::from_millis(rng.u64(1..300))))),
            _ => {
                turns.push((at, Disturbance::Dies { peer, is_seen: rng.bool() }));
                turns.push((at + span.mul_f64(rng.f64() / 4.0), Disturbance::Lives(peer)));
            }
        }
    }
    turns.sort_by_key(|turn| turn.0);
    turns
}
