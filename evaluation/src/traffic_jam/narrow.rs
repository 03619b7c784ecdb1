//! Finds how far each parameter may change before the table breaks, how constant deadlines do, and
//! what the paper does not say.

use std::time::Duration;

use rayon::prelude::*;
use serde::Serialize;

use crate::ScenarioError;
use crate::approach::{Approach, Vehicle};
use crate::paper::PAPER;
use crate::traffic_jam::cells::{CellParameters, Colour, DeadlineChoice, Jam};

/// The runtime of the cloud's model on board, in s.
pub(crate) const ON_BOARD: f64 = 0.4077;
/// The cloud's response with the paper's median round trip, in s.
pub(crate) const MEDIAN: f64 = 0.1182 + 0.068;
/// The constants that are shown.
const CONSTANTS: [f64; 7] = [0.25, 0.3017, 0.5, 0.76, 1.0, 1.5, 3.1];
/// The constants that are tried, in hundredths of a second.
const SWEEP: std::ops::RangeInclusive<u32> = 1..=449;

/// The interval in which one parameter may change alone while each cell of the paper's table stays
/// the same.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Interval {
    pub(crate) parameter: &'static str,
    pub(crate) value: f64,
    pub(crate) least: f64,
    pub(crate) greatest: f64,
}

/// Counts the paper's 30 cells of *ours* that a constant deadline misses.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct ConstantMisses {
    pub(crate) deadline: f64,
    pub(crate) misses: usize,
}

/// The outcomes of constant deadlines.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Constants {
    pub(crate) some: Vec<ConstantMisses>,
    /// The best of all constants from 0.01 to 4.49 s. If several are equally good, it is the
    /// shortest.
    pub(crate) best: ConstantMisses,
}

/// The cloud's model on board, against the cloud.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct OnBoardCells {
    pub(crate) speed: f64,
    pub(crate) pipelined: Colour,
    /// One frame at a time.
    pub(crate) serial: Colour,
    /// The cloud at 0.5 s.
    pub(crate) cloud: Colour,
}

/// The speeds at which the cloud at the median response avoids a collision that its model on board,
/// pipelined, does not avoid.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct CloudOnlySpeeds {
    pub(crate) above: f64,
    pub(crate) up_to: f64,
}

/// Returns the cells of the paper's table. Local has one cell for all responses of the cloud.
fn table() -> Vec<(CellParameters, bool)> {
    let paper = &PAPER.traffic_jam;
    let mut cells = Vec::new();
    for speed in paper.speeds() {
        for approach in [Approach::Local, Approach::Cloud, Approach::Ours] {
            for response in &paper.cloud_response_s {
                let question = CellParameters { speed, approach, response: *response };
                let collides = paper.collides(speed, approach, *response);
                cells.extend(collides.map(|collides| (question, collides)));
                if approach == Approach::Local {
                    break;
                }
            }
        }
    }
    cells
}

/// Returns `true` if all cells are as in the paper's table.
pub(crate) fn holds(vehicle: Vehicle, deadline: DeadlineChoice) -> bool {
    // No cell holds if the guard's figures make no sense.
    let Ok(jam) = Jam::new(vehicle, deadline) else { return false };
    table().par_iter().all(|(question, collides)| jam.is(question, *collides).unwrap_or(false))
}

/// Returns the interval of each parameter while the others stay the same, or `None` if the table is
/// not reproduced to begin with.
pub(crate) fn intervals(jam: &Jam) -> Option<Vec<Interval>> {
    type ParameterChange = fn(&mut Vehicle) -> &mut f64;
    let parameters: [(&str, ParameterChange); 6] = [
        ("deceleration", |vehicle| &mut vehicle.deceleration),
        ("brake_delay", |vehicle| &mut vehicle.brake_delay),
        ("rate", |vehicle| &mut vehicle.rate),
        ("range_local", |vehicle| &mut vehicle.range_local),
        ("range_cloud", |vehicle| &mut vehicle.range_cloud),
        ("local_response", |vehicle| &mut vehicle.local_response),
    ];
    holds(jam.vehicle, jam.deadline).then(|| {
        let interval = |(parameter, change): (&'static str, ParameterChange)| {
            let holds = |value: f64| {
                let mut vehicle = jam.vehicle;
                *change(&mut vehicle) = value;
                holds(vehicle, jam.deadline)
            };
            let value = *change(&mut jam.vehicle.clone());
            let (least, greatest) = (edge(value, -0.02, holds), edge(value, 0.02, holds));
            Interval { parameter, value, least, greatest }
        };
        parameters.into_iter().map(interval).collect()
    })
}

/// Returns how far a parameter may change. It moves by this share of its value in each step until
/// the table breaks, and then finds the edge to a ten-thousandth.
fn edge(value: f64, step: f64, holds: impl Fn(f64) -> bool) -> f64 {
    const STEPS: u32 = 200;
    let at = |steps: u32| (value * (1.0 + step * f64::from(steps))).max(0.0);
    let Some(steps) = (1..=STEPS).find(|steps| !holds(at(*steps)) || at(*steps) == 0.0) else {
        return at(STEPS);
    };
    let (mut good, mut bad) = (at(steps - 1), at(steps));
    while (bad - good).abs() > value * 1e-4 {
        let middle = f64::midpoint(good, bad);
        if holds(middle) { good = middle } else { bad = middle }
    }
    good
}

/// Returns how many cells of *ours* differ under a constant deadline.
pub(crate) fn misses(vehicle: Vehicle, deadline: f64) -> usize {
    let deadline = DeadlineChoice::Constant(Duration::from_secs_f64(deadline));
    let Ok(jam) = Jam::new(vehicle, deadline) else { return 0 };
    let differs = |(question, collides): &(CellParameters, bool)| {
        question.approach == Approach::Ours && !jam.is(question, *collides).unwrap_or(false)
    };
    table().iter().filter(|cell| differs(cell)).count()
}

/// Returns the outcomes of constant deadlines.
pub(crate) fn constants(vehicle: Vehicle) -> Constants {
    let constant = |deadline| ConstantMisses { deadline, misses: misses(vehicle, deadline) };
    let some = CONSTANTS.map(constant).to_vec();
    let all: Vec<ConstantMisses> =
        SWEEP.into_par_iter().map(|index| constant(f64::from(index) / 100.0)).collect();
    let best = all.into_iter().min_by_key(|constant| constant.misses);
    Constants { some, best: best.expect("some were looked through") }
}

/// Returns how all drives end for a vehicle that needs no deadlines.
fn colour(
    vehicle: Vehicle,
    approach: Approach,
    speed: f64,
    response: f64,
) -> Result<Colour, ScenarioError> {
    let jam = Jam::new(vehicle, DeadlineChoice::Constant(Duration::ZERO))?;
    Ok(jam.cell(&CellParameters { speed, approach, response }, None)?.outcome)
}

/// Returns the cloud's model on board, at the paper's speeds.
pub(crate) fn on_board(vehicle: Vehicle) -> Result<Vec<OnBoardCells>, ScenarioError> {
    let board = vehicle.with_model_on_board(ON_BOARD);
    let alone = |local_serial, speed| {
        colour(Vehicle { local_serial, ..board }, Approach::Local, speed, 0.0)
    };
    let of = |speed| {
        let (pipelined, serial) = (alone(false, speed)?, alone(true, speed)?);
        let cloud = colour(vehicle, Approach::Cloud, speed, 0.5)?;
        Ok(OnBoardCells { speed, pipelined, serial, cloud })
    };
    PAPER.traffic_jam.speeds().into_iter().map(of).collect()
}

/// Returns the speeds at which the paper's picture holds: the cloud at the median response avoids
/// the collision, and its model on board does not.
pub(crate) fn only_cloud(vehicle: Vehicle) -> Result<Option<CloudOnlySpeeds>, ScenarioError> {
    let board = Vehicle { local_serial: false, ..vehicle.with_model_on_board(ON_BOARD) };
    let above = first(|speed| Ok(colour(board, Approach::Local, speed, 0.0)? == Colour::Collides))?;
    let up_to =
        first(|speed| Ok(colour(vehicle, Approach::Cloud, speed, MEDIAN)? != Colour::Avoids))?;
    let both = above.zip(up_to).filter(|(above, up_to)| above < up_to);
    Ok(both.map(|(above, up_to)| CloudOnlySpeeds { above, up_to }))
}

/// Returns the least speed from 5 m/s on at which a condition holds, to a hundredth.
fn first(is: impl Fn(f64) -> Result<bool, ScenarioError>) -> Result<Option<f64>, ScenarioError> {
    for step in 5..60 {
        if is(f64::from(step))? {
            let (mut low, mut high) = (f64::from(step - 1), f64::from(step));
            while high - low > 0.005 {
                let middle = f64::midpoint(low, high);
                if is(middle)? { high = middle } else { low = middle }
            }
            return Ok(Some(high));
        }
    }
    Ok(None)
}
