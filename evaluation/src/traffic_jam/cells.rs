//! The cells of the table. Each cell comes from its drives, and the shipped machine decides each
//! drive.

use std::time::Duration;

use fuseline_deadline::{Choice, Guard, Impact, Loss, Observation, Source, Survival, least_loss};
use rayon::prelude::*;
use serde::Serialize;

use crate::ScenarioError;
use crate::approach::{Approach, ApproachRun, Vehicle, nanos};
use crate::braking::DriveOutcome;
use crate::operator::ScenarioOperator;
use crate::paper::PAPER;
use crate::plot::Folder;

/// States how the deadline of *ours* is chosen.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) enum DeadlineChoice {
    /// The longest that is safe.
    Guard,
    /// The deadline of least mean loss, up to the guard's. It is chosen as if all calls took the
    /// cell's response.
    Expected,
    /// Always the same.
    Constant(Duration),
}

/// A vehicle, and its deadlines.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Jam {
    pub(crate) vehicle: Vehicle,
    pub(crate) deadline: DeadlineChoice,
    /// `None` if no deadline needs a guard.
    guard: Option<Guard>,
}

/// The outcome of a speed, an approach and a response over all phases.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub(crate) struct Cell {
    pub(crate) speed: f64,
    pub(crate) approach: Approach,
    pub(crate) response: f64,
    /// The deadline of each request, in s.
    pub(crate) deadline: Option<f64>,
    pub(crate) outcome: Colour,
    /// The least and the greatest speed at impact.
    pub(crate) impact: Option<[f64; 2]>,
    /// The least and the greatest gap that is left.
    pub(crate) gap: Option<[f64; 2]>,
    /// The outcome in the paper, or `None` if the paper has no such cell.
    pub(crate) paper: Option<Colour>,
}

/// States how a cell is marked.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Colour {
    /// No phase collides.
    Avoids,
    /// Every phase does.
    Collides,
    /// Some do.
    Mixed,
}

/// The settings of a cell.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct CellParameters {
    pub(crate) speed: f64,
    pub(crate) approach: Approach,
    pub(crate) response: f64,
}

impl Cell {
    /// Returns `true` if the cell is as in the paper, or the paper has no such cell.
    pub(crate) fn is_as_in_paper(&self) -> bool {
        self.paper.is_none_or(|paper| self.outcome == paper)
    }
}

impl From<bool> for Colour {
    fn from(collides: bool) -> Self {
        if collides { Self::Collides } else { Self::Avoids }
    }
}

impl Jam {
    /// Creates a jam from a vehicle and the way in which its deadlines are chosen.
    ///
    /// # Errors
    /// Returns an error if the deadlines need a guard and its figures make no sense.
    pub(crate) fn new(vehicle: Vehicle, deadline: DeadlineChoice) -> Result<Self, ScenarioError> {
        let guard = match deadline {
            DeadlineChoice::Constant(_) => None,
            DeadlineChoice::Guard | DeadlineChoice::Expected => Some(vehicle.guard()?),
        };
        Ok(Self { vehicle, deadline, guard })
    }

    /// Returns where the obstacle comes into range, in frames after a capture. The places are
    /// spread evenly over the frames for which local is busy.
    pub(crate) fn phases(&self) -> Vec<f64> {
        let busy = self.vehicle.frames_of_local();
        let (width, count) =
            if self.vehicle.local_serial { (8.0, busy * 4.0) } else { (16.0, 8.0) };
        let places = (0_u32..).map(f64::from).take_while(|index| *index < count);
        places.map(|index| (2.0 * index + 1.0) / width).collect()
    }

    /// Returns the deadline of each request of *ours*.
    pub(crate) fn deadline(&self, speed: f64, response: f64) -> Duration {
        let situation = self.vehicle.situation(speed);
        let cap = self.guard.map_or(Duration::MAX, |guard| guard.judge(&situation).deadline);
        match (self.deadline, self.guard) {
            (DeadlineChoice::Constant(deadline), _) => deadline,
            (DeadlineChoice::Expected, Some(guard)) => {
                let response = Duration::from_nanos(nanos(response));
                let calls = [Observation { response, is_answered: true, count: 1 }];
                let impact = Impact::from(&guard);
                let steps = Survival::new(calls.into_iter(), &[]);
                let loss = |source: Source, at| impact.loss(&situation, source, at);
                let Choice { deadline, .. } = least_loss(steps, guard.local_response(), cap, loss);
                deadline
            }
            (DeadlineChoice::Guard | DeadlineChoice::Expected, _) => cap,
        }
    }

    fn drive(&self, question: &CellParameters, phase: f64) -> ApproachRun<'_> {
        let CellParameters { speed, approach, response } = *question;
        let deadline = match approach {
            Approach::Ours => self.deadline(speed, response),
            Approach::Local | Approach::Cloud | Approach::First => Duration::ZERO,
        };
        ApproachRun { vehicle: &self.vehicle, speed, phase, approach, deadline }
    }

    /// Returns how the drive of this phase ends; its trace is written to the folder.
    fn run(
        &self,
        question: &CellParameters,
        (index, phase): (usize, f64),
        traces: Option<&Folder>,
    ) -> Result<DriveOutcome, ScenarioError> {
        let CellParameters { speed, approach, response } = *question;
        let drive = self.drive(question, phase);
        let word = format!("{approach:?}").to_lowercase();
        let name = format!("{word}, {speed} m/s, response {response} s, phase {phase}");
        let mut operator = ScenarioOperator::new(&name, drive.frames(), traces.is_some());
        let takes = nanos(response);
        let (end, _) = drive.run(&mut operator, |_| Some(takes));
        if operator.is_full() {
            return Err(ScenarioError::Full { speed });
        }
        if let (Some(folder), Some(trace)) = (traces, operator.into_trace()) {
            folder.put(&format!("{word}-v{speed}-r{response}-{index:02}.jsonl"), &trace)?;
        }
        Ok(end)
    }

    /// Returns how all drives of a cell end, in the order of their phases.
    pub(crate) fn ends(
        &self,
        question: &CellParameters,
        traces: Option<&Folder>,
    ) -> Result<Vec<DriveOutcome>, ScenarioError> {
        let phases = self.phases().into_iter().enumerate();
        phases.map(|phase| self.run(question, phase, traces)).collect()
    }

    pub(crate) fn cell(
        &self,
        question: &CellParameters,
        traces: Option<&Folder>,
    ) -> Result<Cell, ScenarioError> {
        let CellParameters { speed, approach, response } = *question;
        let ends = self.ends(question, traces)?;
        let deadline = match approach {
            Approach::Ours => Some(self.deadline(speed, response).as_secs_f64()),
            Approach::First => Some(self.vehicle.local_response),
            Approach::Local | Approach::Cloud => None,
        };
        let impact = range(ends.iter().filter_map(|end| match end {
            DriveOutcome::Hits { impact } => Some(*impact),
            DriveOutcome::Stops { .. } => None,
        }));
        let gap = range(ends.iter().filter_map(|end| match end {
            DriveOutcome::Stops { gap } => Some(*gap),
            DriveOutcome::Hits { .. } => None,
        }));
        let paper = PAPER.traffic_jam.collides(speed, approach, response).map(Colour::from);
        Ok(Cell { speed, approach, response, deadline, outcome: colour(&ends), impact, gap, paper })
    }

    pub(crate) fn cells(
        &self,
        questions: &[CellParameters],
        traces: Option<&Folder>,
    ) -> Result<Vec<Cell>, ScenarioError> {
        questions.par_iter().map(|question| self.cell(question, traces)).collect()
    }

    /// Returns `true` if a cell has this outcome. It drives no more phases than the answer needs.
    pub(crate) fn is(
        &self,
        question: &CellParameters,
        collides: bool,
    ) -> Result<bool, ScenarioError> {
        for phase in self.phases() {
            if self.run(question, (0, phase), None)?.hits() != collides {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

fn colour(ends: &[DriveOutcome]) -> Colour {
    match ends.iter().filter(|end| end.hits()).count() {
        0 => Colour::Avoids,
        hits if hits == ends.len() => Colour::Collides,
        _ => Colour::Mixed,
    }
}

fn range(figures: impl Iterator<Item = f64> + Clone) -> Option<[f64; 2]> {
    let least = figures.clone().min_by(f64::total_cmp)?;
    Some([least, figures.max_by(f64::total_cmp)?])
}
