//! The policies of `fuseline-deadline`.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use fuseline_deadline as deadline;
use fuseline_deadline::{
    Accuracy, Assessment, Chosen, Classes, End, Hazard, Impact, Invalid, Loss, Parameters, Policy,
    Reason, Situation, Source, Span, Survival,
};
use pyo3::prelude::*;

use crate::raised::DeadlineError;
use crate::time::Nanos;
use crate::words::AnswerClasses;

/// How many calls are remembered.
const WINDOW: usize = 64;

/// A deadline in nanoseconds, the reason's word, the guard's case and the mean loss.
type DeadlineFields = (u64, &'static str, Option<u8>, Option<f64>);

/// A response in nanoseconds, whether it was answered then, and how many calls.
type ObservedCall = (u64, bool, u64);

/// A figure: a number, or the least and the greatest.
#[derive(FromPyObject)]
pub(crate) enum Figure {
    Exactly(f64),
    Between(f64, f64),
}

/// What a policy knows: an object with these attributes.
#[derive(FromPyObject)]
pub(crate) struct SituationFields {
    speed: Figure,
    reveal: Option<f64>,
    under_way: Vec<Nanos>,
}

/// What an output costs: an object with the attributes of one of them.
#[derive(FromPyObject)]
pub(crate) enum LossFields {
    Impact {
        vehicle: Vehicle,
    },
    Accuracy {
        local: f64,
        cloud: f64,
        price_per_ms: f64,
    },
    #[pyo3(transparent)]
    Function(Py<PyAny>),
}

/// A class of hazards: an object with these attributes.
#[derive(FromPyObject)]
pub(crate) struct Class {
    range_local: Figure,
    range_cloud: Figure,
    weight: f64,
}

/// A vehicle, its sources and the hazards: an object with these attributes.
#[derive(FromPyObject)]
pub(crate) struct Vehicle {
    deceleration: Figure,
    brake_delay: Figure,
    frames: u32,
    period_local: Figure,
    period_cloud: Figure,
    local_response: Figure,
    lateness: f64,
    margin: f64,
    hazards: Vec<Class>,
}

/// The longest deadline that is safe.
#[pyclass(module = "fuseline._fuseline", frozen)]
pub(crate) struct Guard(deadline::Guard);

/// The deadline of least mean loss.
#[pyclass(module = "fuseline._fuseline")]
pub(crate) struct Expected {
    policy: deadline::Expected<AnyLoss, WINDOW>,
    /// The function that is the loss, if it is one.
    function: Option<Arc<Function>>,
}

/// The ends of the last calls of one cloud.
#[pyclass(module = "fuseline._fuseline")]
pub(crate) struct Observations(deadline::Observations<WINDOW>);

enum AnyLoss {
    Impact(Box<Impact>),
    Accuracy(Accuracy),
    Function(Arc<Function>),
}

/// A loss that is a function of Python's.
struct Function {
    called: Py<PyAny>,
    /// The situation that the policy is asked about.
    situation: Mutex<Option<Py<PyAny>>>,
    /// The first exception that it raised.
    raised: Mutex<Option<PyErr>>,
}

#[pymethods]
impl Guard {
    #[new]
    fn new(vehicle: Vehicle) -> PyResult<Self> {
        Ok(Self(guard(vehicle)?))
    }

    /// The budgets of local and of the cloud in seconds, the case, and the longest deadline.
    fn judge(&self, known: SituationFields) -> (f64, f64, u8, u64) {
        let (situation, under_way) = known.split();
        let situation = Situation { under_way: &under_way, ..situation };
        let Assessment { budget_local, budget_cloud, case, deadline } = self.0.judge(&situation);
        (budget_local, budget_cloud, case.number(), nanos(deadline))
    }

    fn decide(&self, known: SituationFields, cap: Nanos) -> DeadlineFields {
        decide(&mut self.0.clone(), known, cap)
    }
}

#[pymethods]
impl Expected {
    #[new]
    #[pyo3(signature = (loss, local_response, probe_every))]
    fn new(loss: LossFields, local_response: Figure, probe_every: Option<u32>) -> PyResult<Self> {
        let loss = AnyLoss::try_from(loss)?;
        let function = match &loss {
            AnyLoss::Function(function) => Some(Arc::clone(function)),
            AnyLoss::Impact(_) | AnyLoss::Accuracy(_) => None,
        };
        let policy = deadline::Expected::new(loss, local_response, probe_every).map_err(invalid)?;
        Ok(Self { policy, function })
    }

    fn decide(&mut self, known: &Bound<'_, PyAny>, cap: Nanos) -> PyResult<DeadlineFields> {
        if let Some(function) = &self.function {
            *locked(&function.situation) = Some(known.clone().unbind());
        }
        let told = decide(&mut self.policy, known.extract()?, cap);
        match self.function.as_ref().and_then(|function| locked(&function.raised).take()) {
            Some(raised) => Err(raised),
            None => Ok(told),
        }
    }

    fn ended(&mut self, end: &str, age: Nanos) -> PyResult<()> {
        self.policy.ended(end_of(end, age)?);
        Ok(())
    }

    /// What is known of the cloud.
    fn observations(&self) -> Vec<ObservedCall> {
        self.policy.observations().sorted().map(seen).collect()
    }
}

/// What an output of local or of the cloud costs, so long after capture.
#[pyfunction]
#[pyo3(signature = (loss, known, source, response))]
pub(crate) fn loss(loss: LossFields, known: SituationFields, source: &str, response: Nanos) -> PyResult<f64> {
    let source = match source {
        "local" => Source::Local,
        "cloud" => Source::Cloud,
        _ => {
            let told = format!("a source {source:?}; it is local or cloud");
            return Err(DeadlineError::new_err(told));
        }
    };
    let (situation, _) = known.split();
    Ok(AnyLoss::try_from(loss)?.loss(&situation, source, Duration::from_nanos(response.0)))
}

#[pymethods]
impl Observations {
    #[new]
    const fn new() -> Self {
        Self(deadline::Observations::new())
    }

    fn add(&mut self, end: &str, age: Nanos) -> PyResult<()> {
        self.0.add(end_of(end, age)?);
        Ok(())
    }

    /// What is remembered: by response, answered calls before those given up.
    fn sorted(&self) -> Vec<ObservedCall> {
        self.0.sorted().map(seen).collect()
    }

    /// The estimate of Kaplan and Meier: responses with the share answered then, and not by then.
    fn survival(&self, under_way: Vec<Nanos>) -> Vec<(u64, f64, f64)> {
        let under_way = ages(under_way);
        let steps = Survival::new(self.0.sorted(), &under_way);
        steps.map(|step| (nanos(step.response), step.mass, step.survival)).collect()
    }
}

impl Loss for AnyLoss {
    fn loss(&self, situation: &Situation<'_>, source: Source, response: Duration) -> f64 {
        match self {
            Self::Impact(loss) => loss.loss(situation, source, response),
            Self::Accuracy(loss) => loss.loss(situation, source, response),
            Self::Function(function) => function.loss(source, response),
        }
    }
}

impl TryFrom<LossFields> for AnyLoss {
    type Error = PyErr;

    fn try_from(loss: LossFields) -> PyResult<Self> {
        Ok(match loss {
            LossFields::Impact { vehicle } => Self::Impact(Box::new(Impact::from(&guard(vehicle)?))),
            LossFields::Accuracy { local, cloud, price_per_ms } => {
                Self::Accuracy(Accuracy { local, cloud, price_per_ms })
            }
            LossFields::Function(function) => {
                let (situation, raised) = (Mutex::new(None), Mutex::new(None));
                Self::Function(Arc::new(Function { called: function, situation, raised }))
            }
        })
    }
}

impl Function {
    /// Not a number once it has raised: then no deadline is chosen for its sake.
    fn loss(&self, source: Source, response: Duration) -> f64 {
        let word = match source {
            Source::Local => "local",
            Source::Cloud => "cloud",
        };
        let told = Python::attach(|py| {
            let situation = locked(&self.situation).as_ref().map(|it| it.clone_ref(py));
            let response = AnswerClasses::get(py)?.ns(py, nanos(response))?;
            self.called.call1(py, (situation, word, response))?.extract(py)
        });
        told.unwrap_or_else(|error| {
            locked(&self.raised).get_or_insert(error);
            f64::NAN
        })
    }
}

impl SituationFields {
    fn split(self) -> (Situation<'static>, Vec<Duration>) {
        let situation = Situation { reveal: self.reveal, ..Situation::at(self.speed) };
        (situation, ages(self.under_way))
    }
}

impl From<Figure> for Span {
    fn from(figure: Figure) -> Self {
        match figure {
            Figure::Exactly(figure) => Self::exactly(figure),
            Figure::Between(least, greatest) => Self::new(least, greatest),
        }
    }
}

impl From<Class> for Hazard {
    fn from(class: Class) -> Self {
        let Class { range_local, range_cloud, weight } = class;
        Self { weight, range_local: range_local.into(), range_cloud: range_cloud.into() }
    }
}

fn guard(vehicle: Vehicle) -> PyResult<deadline::Guard> {
    let hazards: Vec<Hazard> = vehicle.hazards.into_iter().map(Hazard::from).collect();
    let parameters = Parameters {
        deceleration: vehicle.deceleration.into(),
        brake_delay: vehicle.brake_delay.into(),
        frames: vehicle.frames,
        period_local: vehicle.period_local.into(),
        period_cloud: vehicle.period_cloud.into(),
        local_response: vehicle.local_response.into(),
        lateness: vehicle.lateness,
        margin: vehicle.margin,
        classes: Classes::new(&hazards).map_err(invalid)?,
    };
    deadline::Guard::new(parameters).map_err(invalid)
}

fn decide(policy: &mut impl Policy, known: SituationFields, cap: Nanos) -> DeadlineFields {
    let (situation, under_way) = known.split();
    let situation = Situation { under_way: &under_way, ..situation };
    let Chosen { deadline, reason } = policy.decide(&situation, Duration::from_nanos(cap.0));
    let (word, case, loss) = match reason {
        Reason::Constant => ("constant", None, None),
        Reason::Guard(case) => ("guard", Some(case.number()), None),
        Reason::Expected { loss } => ("expected", None, Some(loss)),
        Reason::Probe => ("probe", None, None),
        Reason::Cap => ("cap", None, None),
    };
    (nanos(deadline), word, case, loss)
}

fn locked<T>(value: &Mutex<T>) -> MutexGuard<'_, T> {
    value.lock().unwrap_or_else(PoisonError::into_inner)
}

fn end_of(end: &str, age: Nanos) -> PyResult<End> {
    let age = Duration::from_nanos(age.0);
    match end {
        "answered" => Ok(End::FiredThenAnswer(age)),
        "failed" => Ok(End::Failed(age)),
        "censored" => Ok(End::Censored(age)),
        _ => {
            let told = format!("an end {end:?}; it is answered, failed or censored");
            Err(DeadlineError::new_err(told))
        }
    }
}

fn seen(observation: deadline::Observation) -> ObservedCall {
    (nanos(observation.response), observation.is_answered, observation.count)
}

fn ages(under_way: Vec<Nanos>) -> Vec<Duration> {
    under_way.into_iter().map(|age| Duration::from_nanos(age.0)).collect()
}

fn nanos(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

fn invalid(error: Invalid) -> PyErr {
    DeadlineError::new_err(error.to_string())
}
