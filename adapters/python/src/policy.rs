//! The policies of `fuseline-deadline`.

use std::sync::{Arc, Mutex, MutexGuard, TryLockError};
use std::time::Duration;

use fuseline_deadline as deadline;
use fuseline_deadline::{
    Accuracy, Assessment, BoxDetector, Chosen, Classes, End, Hazard, Impact, Invalid, Loss, Metres,
    MetresPerSecond, MetresPerSecondSquared, Parameters, Policy, Reason, Situation, Source, Span,
    StreamLoss, Survival,
};
use fuseline_engine::lock;
use fuseline_traces::nanos;
use pyo3::exceptions::{PyRuntimeError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::answer_classes::AnswerClasses;
use crate::raised::DeadlineError;
use crate::time::{Nanos, Plain};

/// The number of calls that are remembered.
const WINDOW: usize = 64;

/// A deadline in nanoseconds, the word for its reason, the guard's case, and the mean loss.
type DeadlineFields = (u64, &'static str, Option<u8>, Option<f64>);

/// A response in nanoseconds, whether the call was answered then, and how many calls there were.
type ObservedCall = (u64, bool, u64);

/// A figure: one number or time, or the least and the greatest.
pub(crate) struct FigureArgument<T>(Span<T>);

/// The facts that a policy knows, read from an object with these attributes.
pub(crate) struct SituationFields {
    speed: FigureArgument<Plain>,
    reveal: Option<Plain>,
    under_way: Vec<Nanos>,
}

/// The cost of an output, read from an object with the attributes of one of these, or a function.
pub(crate) enum LossFields {
    Impact { vehicle: VehicleArgument },
    Accuracy { local: Plain, cloud: Plain, price_per_ms: Plain },
    Stream { local: DetectorFields, cloud: DetectorFields, period: Nanos },
    Function(Py<PyAny>),
}

/// A detector's quality, read from an object with these attributes.
pub(crate) struct DetectorFields {
    accuracy: Plain,
    overlap: Plain,
}

/// A class of hazards, read from an object with these attributes.
pub(crate) struct Class {
    range_local: FigureArgument<Plain>,
    range_cloud: FigureArgument<Plain>,
    weight: Plain,
}

/// A vehicle, its sources and the hazards, read from an object with these attributes.
pub(crate) struct VehicleArgument {
    deceleration: FigureArgument<Plain>,
    brake_delay: FigureArgument<Nanos>,
    frames: u32,
    period_local: FigureArgument<Nanos>,
    period_cloud: FigureArgument<Nanos>,
    local_response: FigureArgument<Nanos>,
    lateness: Nanos,
    margin: Plain,
    hazards: Vec<Class>,
}

/// Chooses the longest deadline that is safe.
#[pyclass(name = "Guard", module = "fuseline._fuseline", frozen)]
pub(crate) struct PyGuard(pub(crate) deadline::Guard);

/// Chooses the deadline of least mean loss.
#[pyclass(name = "Expected", module = "fuseline._fuseline", frozen)]
pub(crate) struct PyExpected(pub(crate) SharedExpected);

/// A policy that is shared with an engine.
#[derive(Clone)]
pub(crate) struct SharedExpected {
    policy: Arc<Mutex<deadline::Expected<AnyLoss, WINDOW>>>,
    /// The loss, if it is a function of Python's.
    function: Option<Arc<LossFunction>>,
}

/// Remembers the ends of the last calls of one cloud.
#[pyclass(name = "Observations", module = "fuseline._fuseline")]
pub(crate) struct PyObservations(deadline::Observations<WINDOW>);

enum AnyLoss {
    Impact(Box<Impact>),
    Accuracy(Accuracy),
    Stream(Box<StreamLoss<WINDOW>>),
    Function(Arc<LossFunction>),
}

/// Calls a Python function for the loss.
struct LossFunction {
    called: Py<PyAny>,
    /// The situation that the policy is asked about.
    situation: Mutex<Option<Py<PyAny>>>,
    /// The first exception that it raised.
    raised: Mutex<Option<PyErr>>,
}

#[pymethods]
impl PyGuard {
    #[new]
    fn new(vehicle: VehicleArgument) -> PyResult<Self> {
        Ok(Self(guard(vehicle)?))
    }

    /// Returns the budgets of local and of the cloud in seconds, the case, and the longest
    /// deadline.
    fn judge(&self, known: SituationFields) -> (f64, f64, u8, u64) {
        let (situation, under_way) = known.split();
        let situation = Situation { under_way: &under_way, ..situation };
        let Assessment { budget_local, budget_cloud, case, deadline } = self.0.judge(&situation);
        (budget_local, budget_cloud, case.number(), nanos(deadline))
    }

    fn decide(&self, known: SituationFields, cap: Nanos) -> DeadlineFields {
        let (situation, under_way) = known.split();
        let situation = Situation { under_way: &under_way, ..situation };
        fields_of(self.0.clone().decide(&situation, Duration::from_nanos(cap.0)))
    }
}

#[pymethods]
impl PyExpected {
    #[new]
    #[pyo3(signature = (loss, local_response, probe_every))]
    fn new(
        loss: LossFields,
        local_response: FigureArgument<Nanos>,
        probe_every: Option<u32>,
    ) -> PyResult<Self> {
        let loss = AnyLoss::try_from(loss)?;
        let function = match &loss {
            AnyLoss::Function(function) => Some(Arc::clone(function)),
            AnyLoss::Impact(_) | AnyLoss::Accuracy(_) | AnyLoss::Stream(_) => None,
        };
        let local_response = local_response.times();
        let policy = deadline::Expected::new(loss, local_response, probe_every).map_err(invalid)?;
        Ok(Self(SharedExpected { policy: Arc::new(Mutex::new(policy)), function }))
    }

    fn decide(&self, known: &Bound<'_, PyAny>, cap: Nanos) -> PyResult<DeadlineFields> {
        let fields: SituationFields = known.extract()?;
        self.0.set_situation(known.clone().unbind());
        let (situation, under_way) = fields.split();
        let situation = Situation { under_way: &under_way, ..situation };
        self.0.decide(&situation, Duration::from_nanos(cap.0)).map(fields_of)
    }

    fn ended(&self, end: &str, age: Nanos) -> PyResult<()> {
        self.0.ended(end_of(end, age)?)
    }

    /// Learns how fast boxes moved. Only a loss in a stream uses it.
    fn moved(&self, speeds: Vec<Plain>) -> PyResult<()> {
        if let AnyLoss::Stream(loss) = self.0.locked()?.loss_mut() {
            for Plain(speed) in speeds {
                loss.moved(speed);
            }
        }
        Ok(())
    }

    /// Returns what is known of the cloud.
    fn observations(&self) -> PyResult<Vec<ObservedCall>> {
        Ok(self.0.locked()?.observations().sorted().map(seen).collect())
    }
}

/// Returns the cost of an output of local or of the cloud, `response` after its capture.
#[pyfunction]
#[pyo3(signature = (loss, known, source, response))]
pub(crate) fn loss(
    loss: LossFields,
    known: SituationFields,
    source: &str,
    response: Nanos,
) -> PyResult<f64> {
    let source = match source {
        "local" => Source::Local,
        "cloud" => Source::Cloud,
        _ => {
            let message = format!("a source {source:?}; it must be local or cloud");
            return Err(DeadlineError::new_err(message));
        }
    };
    let (situation, _) = known.split();
    Ok(AnyLoss::try_from(loss)?.loss(&situation, source, Duration::from_nanos(response.0)))
}

#[pymethods]
impl PyObservations {
    #[new]
    const fn new() -> Self {
        Self(deadline::Observations::new())
    }

    fn add(&mut self, end: &str, age: Nanos) -> PyResult<()> {
        self.0.add(end_of(end, age)?);
        Ok(())
    }

    /// Returns the remembered calls by response, answered calls before those that were given up.
    fn sorted(&self) -> Vec<ObservedCall> {
        self.0.sorted().map(seen).collect()
    }

    /// Returns the Kaplan–Meier estimate.
    ///
    /// Each entry has a response, the share of calls answered then, and the share not answered by
    /// then.
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
            Self::Stream(loss) => loss.loss(situation, source, response),
            Self::Function(function) => function.loss(source, response),
        }
    }

    fn check(&self) -> Result<(), Invalid> {
        match self {
            Self::Impact(loss) => loss.check(),
            Self::Accuracy(loss) => loss.check(),
            Self::Stream(loss) => loss.check(),
            Self::Function(_) => Ok(()),
        }
    }
}

impl TryFrom<LossFields> for AnyLoss {
    type Error = PyErr;

    fn try_from(loss: LossFields) -> PyResult<Self> {
        Ok(match loss {
            LossFields::Impact { vehicle } => {
                Self::Impact(Box::new(Impact::from(&guard(vehicle)?)))
            }
            LossFields::Accuracy { local, cloud, price_per_ms } => {
                let [local, cloud, price_per_ms] = [local.0, cloud.0, price_per_ms.0];
                Self::Accuracy(Accuracy { local, cloud, price_per_ms })
            }
            LossFields::Stream { local, cloud, period: Nanos(period) } => {
                let period = Duration::from_nanos(period);
                Self::Stream(Box::new(StreamLoss::new(local.into(), cloud.into(), period)))
            }
            LossFields::Function(function) => {
                let (situation, raised) = (Mutex::new(None), Mutex::new(None));
                Self::Function(Arc::new(LossFunction { called: function, situation, raised }))
            }
        })
    }
}

impl LossFunction {
    /// Returns NaN if the callback raises; `decide` then raises its error.
    fn loss(&self, source: Source, response: Duration) -> f64 {
        let word = match source {
            Source::Local => "local",
            Source::Cloud => "cloud",
        };
        let loss = Python::attach(|py| {
            let situation = lock(&self.situation).as_ref().map(|it| it.clone_ref(py));
            let response = AnswerClasses::get(py)?.ns(py, nanos(response))?;
            self.called.call1(py, (situation, word, response))?.extract(py)
        });
        loss.unwrap_or_else(|error| {
            lock(&self.raised).get_or_insert(error);
            f64::NAN
        })
    }
}

impl SharedExpected {
    pub(crate) fn decide(&self, situation: &Situation<'_>, cap: Duration) -> PyResult<Chosen> {
        let chosen = self.locked()?.decide(situation, cap);
        match self.function.as_ref().and_then(|function| lock(&function.raised).take()) {
            Some(raised) => Err(raised),
            None => Ok(chosen),
        }
    }

    pub(crate) fn ended(&self, end: End) -> PyResult<()> {
        self.locked()?.ended(end);
        Ok(())
    }

    /// Returns `true` if the policy learns of longer deadlines only from calls that linger.
    pub(crate) fn needs_linger(&self) -> PyResult<bool> {
        Ok(self.locked()?.needs_linger())
    }

    /// Returns `true` if the loss is a Python function.
    pub(crate) const fn calls_python(&self) -> bool {
        self.function.is_some()
    }

    /// Sets the situation that is passed to a Python loss.
    pub(crate) fn set_situation(&self, situation: Py<PyAny>) {
        if let Some(function) = &self.function {
            *lock(&function.situation) = Some(situation);
        }
    }

    /// Locks the policy without waiting, because a loss in Python runs while it is locked.
    fn locked(&self) -> PyResult<MutexGuard<'_, deadline::Expected<AnyLoss, WINDOW>>> {
        match self.policy.try_lock() {
            Ok(policy) => Ok(policy),
            Err(TryLockError::Poisoned(poisoned)) => Ok(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => Err(PyRuntimeError::new_err(
                "the policy is computing a loss; use the policy after the loss has returned",
            )),
        }
    }
}

impl SituationFields {
    pub(crate) fn split(self) -> (Situation<'static>, Vec<Duration>) {
        let reveal = self.reveal.map(|Plain(reveal)| Metres(reveal));
        let situation = Situation { reveal, ..Situation::at(self.speed.numbers(MetresPerSecond)) };
        (situation, ages(self.under_way))
    }
}

impl<'a, 'py, T> FromPyObject<'a, 'py> for FigureArgument<T>
where
    T: Copy + for<'b> FromPyObject<'b, 'py, Error = PyErr>,
{
    type Error = PyErr;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let Ok(ends) = object.cast::<PyTuple>() else {
            return Ok(Self(Span::exactly(object.extract()?)));
        };
        if ends.len() != 2 {
            let message =
                format!("a figure of {} values; give one number, or (least, greatest)", ends.len());
            return Err(PyTypeError::new_err(message));
        }
        Ok(Self(Span::new(ends.get_item(0)?.extract()?, ends.get_item(1)?.extract()?)))
    }
}

impl<'py> FromPyObject<'_, 'py> for SituationFields {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        Ok(Self {
            speed: field(object, "speed")?,
            reveal: field(object, "reveal")?,
            under_way: field(object, "under_way")?,
        })
    }
}

impl<'py> FromPyObject<'_, 'py> for LossFields {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if object.hasattr("vehicle")? {
            return Ok(Self::Impact { vehicle: field(object, "vehicle")? });
        }
        if object.hasattr("price_per_ms")? {
            return Ok(Self::Accuracy {
                local: field(object, "local")?,
                cloud: field(object, "cloud")?,
                price_per_ms: field(object, "price_per_ms")?,
            });
        }
        if object.hasattr("period")? {
            return Ok(Self::Stream {
                local: field(object, "local")?,
                cloud: field(object, "cloud")?,
                period: field(object, "period")?,
            });
        }
        if !object.is_callable() {
            let message = format!("{}: a loss is Impact, Accuracy or a function", object.repr()?);
            return Err(PyTypeError::new_err(message));
        }
        Ok(Self::Function(object.to_owned().unbind()))
    }
}

impl<'py> FromPyObject<'_, 'py> for DetectorFields {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        Ok(Self { accuracy: field(object, "accuracy")?, overlap: field(object, "overlap")? })
    }
}

impl<'py> FromPyObject<'_, 'py> for Class {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        Ok(Self {
            range_local: field(object, "range_local")?,
            range_cloud: field(object, "range_cloud")?,
            weight: field(object, "weight")?,
        })
    }
}

impl<'py> FromPyObject<'_, 'py> for VehicleArgument {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        Ok(Self {
            deceleration: field(object, "deceleration")?,
            brake_delay: field(object, "brake_delay")?,
            frames: field(object, "frames")?,
            period_local: field(object, "period_local")?,
            period_cloud: field(object, "period_cloud")?,
            local_response: field(object, "local_response")?,
            lateness: field(object, "lateness")?,
            margin: field(object, "margin")?,
            hazards: field(object, "hazards")?,
        })
    }
}

/// Returns an attribute. An error about its value names the attribute.
fn field<'py, T>(object: Borrowed<'_, 'py, PyAny>, name: &str) -> PyResult<T>
where
    T: for<'b> FromPyObject<'b, 'py, Error: Into<PyErr>>,
{
    let attribute = object.getattr(name)?;
    T::extract(attribute.as_borrowed()).map_err(Into::into).map_err(|error: PyErr| {
        let py = object.py();
        PyErr::from_type(error.get_type(py), format!("{name}: {}", error.value(py)))
    })
}

impl FigureArgument<Nanos> {
    fn times(self) -> Span<Duration> {
        self.0.map(|Nanos(nanos)| Duration::from_nanos(nanos))
    }
}

impl FigureArgument<Plain> {
    fn numbers<T>(self, unit: impl FnMut(f64) -> T) -> Span<T> {
        self.0.map(|Plain(number)| number).map(unit)
    }
}

impl From<DetectorFields> for BoxDetector {
    fn from(fields: DetectorFields) -> Self {
        let DetectorFields { accuracy: Plain(accuracy), overlap: Plain(overlap) } = fields;
        Self { accuracy, overlap }
    }
}

impl From<Class> for Hazard {
    fn from(class: Class) -> Self {
        let Class { range_local, range_cloud, weight: Plain(weight) } = class;
        let (range_local, range_cloud) = (range_local.numbers(Metres), range_cloud.numbers(Metres));
        Self { weight, range_local, range_cloud }
    }
}

fn guard(vehicle: VehicleArgument) -> PyResult<deadline::Guard> {
    let hazards: Vec<Hazard> = vehicle.hazards.into_iter().map(Hazard::from).collect();
    let parameters = Parameters {
        deceleration: vehicle.deceleration.numbers(MetresPerSecondSquared),
        brake_delay: vehicle.brake_delay.times(),
        frames: vehicle.frames,
        period_local: vehicle.period_local.times(),
        period_cloud: vehicle.period_cloud.times(),
        local_response: vehicle.local_response.times(),
        lateness: Duration::from_nanos(vehicle.lateness.0),
        margin: Metres(vehicle.margin.0),
        classes: Classes::new(&hazards).map_err(invalid)?,
    };
    deadline::Guard::new(parameters).map_err(invalid)
}

fn fields_of(Chosen { deadline, reason }: Chosen) -> DeadlineFields {
    let (word, case, loss) = match reason {
        Reason::Constant => ("constant", None, None),
        Reason::Guard(case) => ("guard", Some(case.number()), None),
        Reason::Expected { loss } => ("expected", None, Some(loss)),
        Reason::Probe => ("probe", None, None),
        Reason::Cap => ("cap", None, None),
    };
    (nanos(deadline), word, case, loss)
}

fn end_of(end: &str, age: Nanos) -> PyResult<End> {
    let age = Duration::from_nanos(age.0);
    match end {
        "answered" => Ok(End::Answered(age)),
        "failed" => Ok(End::Failed(age)),
        "censored" => Ok(End::Censored(age)),
        _ => {
            let message = format!("an end {end:?}; it must be answered, failed or censored");
            Err(DeadlineError::new_err(message))
        }
    }
}

fn seen(observation: deadline::Observation) -> ObservedCall {
    (nanos(observation.response), observation.is_answered, observation.count)
}

fn ages(under_way: Vec<Nanos>) -> Vec<Duration> {
    under_way.into_iter().map(|age| Duration::from_nanos(age.0)).collect()
}

fn invalid(error: Invalid) -> PyErr {
    DeadlineError::new_err(error.to_string())
}
