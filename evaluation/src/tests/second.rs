//! The second simulation. It adds up positions in small steps of time, and has the rules of fusion
//! for one frame in a few lines.

use std::time::Duration;

use fuseline_testkit::Rng;

use crate::approach::{Approach, ApproachRun, Vehicle, nanos};
use crate::braking::DriveOutcome;
use crate::tests::{any_vehicle, end};

/// A step, in s.
const STEP: f64 = 2e-4;

struct Frame {
    captured: f64,
    gap: f64,
    local: Option<f64>,
    cloud: Option<f64>,
    deadline: f64,
    output: FrameOutput,
}

/// The output for a frame.
#[derive(Clone, Copy, PartialEq)]
enum FrameOutput {
    /// Nothing yet, but something may come.
    Waits,
    /// Nothing, and nothing will come.
    Nothing,
    /// A result, which reports the obstacle or not.
    Tells(bool),
}

/// Lets a vehicle drive into an obstacle or stop before it. `clouds` has the cloud's responses by
/// frame.
fn stepped(drive: &ApproachRun<'_>, clouds: &[Option<f64>]) -> DriveOutcome {
    let ApproachRun { vehicle, speed: full, approach, .. } = *drive;
    let mut frames: Vec<Frame> = Vec::new();
    let (mut now, mut gap, mut speed) = (0.0, drive.start(), full);
    let (mut busy, mut bite) = (f64::NEG_INFINITY, f64::INFINITY);
    loop {
        #[expect(clippy::cast_precision_loss, reason = "some hundreds of frames")]
        let due = frames.len() as f64 / vehicle.rate;
        if due <= now && bite.is_infinite() {
            let gap = gap - full * (due - now);
            let takes = !vehicle.local_serial || due >= busy;
            if takes {
                busy = due + vehicle.local_response;
            }
            let local = (takes && approach != Approach::Cloud).then_some(vehicle.local_response);
            let cloud = if approach == Approach::Local { None } else { clouds[frames.len()] };
            let deadline = match approach {
                Approach::Ours => drive.deadline.as_secs_f64(),
                Approach::First => local.unwrap_or(f64::INFINITY),
                Approach::Local => 0.0,
                Approach::Cloud => f64::INFINITY,
            };
            frames.push(Frame {
                captured: due,
                gap,
                local,
                cloud,
                deadline,
                output: FrameOutput::Waits,
            });
        }
        for frame in frames.iter_mut().filter(|frame| frame.output == FrameOutput::Waits) {
            frame.output = output(vehicle, frame, now - frame.captured);
        }
        if bite.is_infinite() && decides(&frames, vehicle.frames) {
            bite = now + vehicle.brake_delay;
        }
        now += STEP;
        let slower = if now > bite { vehicle.deceleration * STEP } else { 0.0 };
        gap -= (speed - slower / 2.0) * STEP;
        speed -= slower;
        if speed <= 0.0 {
            return DriveOutcome::Stops { gap };
        }
        if gap <= 0.0 {
            return DriveOutcome::Hits { impact: speed };
        }
    }
}

/// Returns the output for a frame of this age.
fn output(vehicle: &Vehicle, frame: &Frame, age: f64) -> FrameOutput {
    let sees = |range: f64| FrameOutput::Tells(frame.gap > 0.0 && frame.gap <= range);
    let by = |response: Option<f64>| response.is_some_and(|response| response <= age);
    let in_time = frame.cloud.filter(|cloud| *cloud < frame.deadline);
    if by(in_time) {
        return sees(vehicle.range_cloud);
    }
    if age < frame.deadline {
        return FrameOutput::Waits;
    }
    match frame.local {
        Some(_) if by(frame.local) => sees(vehicle.range_local),
        Some(_) => FrameOutput::Waits,
        None => FrameOutput::Nothing,
    }
}

/// Returns `true` if `wanted` frames in a row report. Frames without an output are ignored.
fn decides(frames: &[Frame], wanted: u32) -> bool {
    let mut row = 0;
    frames.iter().any(|frame| {
        row = match frame.output {
            FrameOutput::Tells(true) => row + 1,
            FrameOutput::Nothing => row,
            FrameOutput::Tells(false) | FrameOutput::Waits => 0,
        };
        row >= wanted
    })
}

#[test]
fn a_second_simulation_by_small_steps_of_time_agrees_on_250_random_runs() {
    let (mut compared, mut hits) = (0, 0);
    for seed in 0..250 {
        let random = &mut Rng::with_seed(seed);
        let (mut vehicle, speed) = any_vehicle(random);
        vehicle.local_serial = random.f64() < 0.3;
        let approaches = [Approach::Local, Approach::Cloud, Approach::First, Approach::Ours];
        let approach = random.one_of(&approaches);
        let drive = ApproachRun {
            vehicle: &vehicle,
            speed,
            phase: random.f64_between(0.05, 0.95),
            approach,
            deadline: Duration::from_secs_f64(random.f64_between(0.05, 1.5)),
        };
        let responses = [0.1, 0.3, 0.6, 1.2, 3.0];
        let clouds: Vec<Option<f64>> = (0..400)
            .map(|_| {
                let response = random.one_of(&responses) * random.f64_between(0.7, 1.3);
                (random.f64() < 0.9).then_some(response)
            })
            .collect();
        let first = end(&drive, |at| {
            let frame = clouds.iter().enumerate().find(|(frame, _)| {
                #[expect(clippy::cast_precision_loss, reason = "some hundreds of frames")]
                let captured = *frame as f64 / vehicle.rate;
                nanos(captured) == at
            });
            frame.and_then(|(_, response)| *response).map(nanos)
        });
        let second = stepped(&drive, &clouds);
        let apart = match (first, second) {
            (DriveOutcome::Stops { gap }, DriveOutcome::Stops { gap: other }) => {
                (gap - other).abs()
            }
            (DriveOutcome::Hits { impact }, DriveOutcome::Hits { impact: other }) => {
                hits += 1;
                // The distance beyond the obstacle at which the vehicle would have stopped.
                let beyond = |impact: f64| impact * impact / (2.0 * vehicle.deceleration);
                (beyond(impact) - beyond(other)).abs()
            }
            (DriveOutcome::Stops { gap }, DriveOutcome::Hits { .. })
            | (DriveOutcome::Hits { .. }, DriveOutcome::Stops { gap }) => {
                assert!(gap < 0.05, "{seed}: {first:?}, {second:?}");
                continue;
            }
        };
        assert!(apart < 0.1, "{seed}: {first:?}, {second:?}, {drive:?}");
        compared += 1;
    }
    assert!(compared >= 248 && hits >= 50 && compared - hits >= 50, "{compared}, {hits}");
}
