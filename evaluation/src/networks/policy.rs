//! The policies that are compared, and the deadlines that they give.

use std::fmt;
use std::time::Duration;

use fuseline_deadline::{
    Choice, Guard, Impact, Loss, Observation, Situation, Survival, least_loss,
};
use fuseline_testkit::networks::Drive;
use serde::{Serialize, Serializer};

use crate::approach::{Approach, Vehicle, nanos};
use crate::options::time_above_0;

/// Calls are observed for this long before the first frame.
pub(crate) const OBSERVED: Duration = Duration::from_secs(30);

/// The source that answers, and its deadline.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) enum ResponsePolicy {
    Local,
    Cloud,
    First,
    Constant(Duration),
    Guard,
    Expected,
}

impl ResponsePolicy {
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        Ok(match text {
            "local" => Self::Local,
            "cloud" => Self::Cloud,
            "first" => Self::First,
            "guard" => Self::Guard,
            "expected" => Self::Expected,
            text => {
                Self::Constant(Duration::from_secs_f64(time_above_0(text).map_err(|wanted| {
                    format!("write local, cloud, first, guard, expected or a deadline: {wanted}")
                })?))
            }
        })
    }

    /// Returns the answering source.
    pub(crate) const fn approach(self) -> Approach {
        match self {
            Self::Local => Approach::Local,
            Self::Cloud => Approach::Cloud,
            Self::First => Approach::First,
            Self::Constant(_) | Self::Guard | Self::Expected => Approach::Ours,
        }
    }

    /// Returns `true` if it uses the guard.
    pub(crate) const fn is_guarded(self) -> bool {
        matches!(self, Self::Guard | Self::Expected)
    }
}

impl fmt::Display for ResponsePolicy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Local => f.pad("local"),
            Self::Cloud => f.pad("cloud"),
            Self::First => f.pad("first"),
            Self::Constant(deadline) => f.pad(&deadline.as_secs_f64().to_string()),
            Self::Guard => f.pad("guard"),
            Self::Expected => f.pad("expected"),
        }
    }
}

/// Serializes a policy as the text that names it. A constant is its seconds, such as `0.5`.
impl Serialize for ResponsePolicy {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// Returns the instant of a drive at `age` before `start`. A drive that is over starts again, so
/// its end lies before its beginning.
pub(crate) fn before(drive: &Drive, start: Duration, age: Duration) -> Duration {
    let laps = age.as_nanos().div_ceil(drive.length().as_nanos());
    let laps = u32::try_from(laps).unwrap_or(u32::MAX);
    (start + drive.length() * laps).saturating_sub(age)
}

/// Returns how the calls ended that began in the 30 s before a start. A call that is not answered
/// by then has its age as its response. `response` returns the response of the call of an age.
pub(crate) fn observe(
    vehicle: &Vehicle,
    response: impl Fn(Duration) -> Option<Duration>,
) -> Vec<Observation> {
    let mut observed = Vec::new();
    let calls =
        (1_u32..).map(|call| Duration::from_nanos(nanos(f64::from(call) * vehicle.period())));
    for age in calls.take_while(|age| *age <= OBSERVED) {
        let response = response(age);
        let (response, is_answered) = match response.filter(|response| *response <= age) {
            Some(response) => (response, true),
            None => (age, false),
        };
        observed.push(Observation { response, is_answered, count: 1 });
    }
    observed.sort_by_key(Observation::key);
    observed.dedup_by(|later, first| {
        let is_same = later.key() == first.key();
        first.count += if is_same { later.count } else { 0 };
        is_same
    });
    observed
}

/// Returns the deadline of each request of a run.
pub(crate) fn deadline(
    mode: ResponsePolicy,
    guard: Option<&Guard>,
    situation: &Situation<'_>,
    observed: &[Observation],
) -> Duration {
    let cap = guard.map_or(Duration::MAX, |guard| guard.judge(situation).deadline);
    match (mode, guard) {
        (ResponsePolicy::Constant(deadline), _) => deadline,
        (ResponsePolicy::Expected, Some(guard)) => {
            let impact = Impact::from(guard);
            let steps = Survival::new(observed.iter().copied(), &[]);
            let Choice { deadline, .. } =
                least_loss(steps, guard.local_response(), cap, |source, response| {
                    impact.loss(situation, source, response)
                });
            deadline
        }
        _ => cap,
    }
}
