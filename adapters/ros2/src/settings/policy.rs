//! The policy that chooses deadlines.

use std::fmt;
use std::time::Duration;

use fuseline_deadline::{
    Accuracy, Expected, Guard, Hazard, Impact, Invalid, Metres, MetresPerSecondSquared, Parameters,
    Span,
};
use fuseline_engine::Policy;

use crate::settings::reader::ParameterReader;
use crate::settings::{Role, SettingsError, SettingsFlaw};

/// The policy that chooses each request's deadline, up to the one without a policy.
#[derive(Clone, PartialEq, Debug)]
pub struct DeadlineSettings {
    /// The policy.
    pub kind: PolicyKind,
    /// The vehicle and its sources, for guard and impact.
    pub parameters: Parameters,
    /// The loss of an output.
    pub accuracy: Accuracy,
    /// One message in this many measures how long a cloud takes.
    pub probe_every: u32,
    /// The topic of the speed, if there is one.
    pub speed: Option<SpeedTopic>,
    /// Messages a second, if known.
    pub rate: Option<f64>,
}

/// The policy.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum PolicyKind {
    /// None: deadlines stay as set.
    Set,
    /// The longest deadline that is safe.
    Guard,
    /// The deadline that costs least, by accuracy and time.
    Expected,
    /// The safe deadline that costs least, by impacts.
    Guarded,
}

/// The topic of the speed.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SpeedTopic {
    /// The topic.
    pub topic: String,
    /// `nav_msgs/msg/Odometry` or `std_msgs/msg/Float64`.
    pub type_name: String,
    /// The time for which a speed is valid.
    pub age: Duration,
}

impl PolicyKind {
    const ALL: [Self; 4] = [Self::Set, Self::Guard, Self::Expected, Self::Guarded];
    /// Their names among the parameters, in the same order.
    pub(super) const NAMES: [&str; 4] = ["set", "guard", "expected", "guarded"];

    /// Returns its name among the parameters.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        Self::NAMES[self as usize]
    }

    /// Returns `true` if without a speed it never waits longer than local takes.
    const fn goes_by_speed(self) -> bool {
        match self {
            Self::Set | Self::Expected => false,
            Self::Guard | Self::Guarded => true,
        }
    }
}

impl DeadlineSettings {
    /// Returns a policy for one cloud; none if deadlines stay as set.
    ///
    /// # Errors
    /// If there is no policy with these figures.
    pub fn policy(&self) -> Result<Option<Box<dyn Policy + Send>>, Invalid> {
        let local = self.parameters.local_response;
        let every = Some(self.probe_every);
        Ok(match self.kind {
            PolicyKind::Set => None,
            PolicyKind::Guard => Some(Box::new(Guard::new(self.parameters)?)),
            PolicyKind::Expected => {
                Some(Box::new(Expected::<_>::new(self.accuracy, local, every)?))
            }
            PolicyKind::Guarded => {
                let guard = Guard::new(self.parameters)?;
                Some(Box::new(guard.cap(Expected::<_>::new(Impact::from(&guard), local, every)?)))
            }
        })
    }
}

impl fmt::Display for DeadlineSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.kind == PolicyKind::Set {
            return f.write_str("as they are set");
        }
        f.write_str(self.kind.as_str())?;
        if let Some(speed) = &self.speed {
            write!(f, " by the speed on {}", speed.topic)?;
        }
        match self.rate {
            Some(rate) => write!(f, "; the node keeps up with {rate} messages a second"),
            None => f.write_str("; without policy.rate nothing checks that the node keeps up"),
        }
    }
}

/// Reads the parameters of policies.
pub(super) fn read(r: &mut ParameterReader) -> Result<DeadlineSettings, SettingsError> {
    let kind = r.choice("policy", &PolicyKind::ALL)?;
    let rate = Some(r.figure("policy.rate", None)?).filter(|rate| *rate > 0.0);
    let period = rate.map_or(Parameters::DEFAULT.period_local, Span::of_rate);
    let least = r.figure("policy.local_response", None)?;
    let most = r.figure("policy.local_response_most", Some(least))?;
    let mut figure = |name: &str| r.figure(&format!("policy.{name}"), None);
    let parameters = Parameters {
        period_local: period,
        period_cloud: period,
        local_response: Span::new(least, most).map(time),
        deceleration: MetresPerSecondSquared(figure("deceleration")?).into(),
        brake_delay: time(figure("brake_delay")?).into(),
        margin: Metres(figure("margin")?),
        lateness: time(figure("lateness")?),
        classes: Hazard {
            range_local: Metres(figure("range_local")?).into(),
            range_cloud: Metres(figure("range_cloud")?).into(),
            ..Hazard::DEFAULT
        }
        .into(),
        ..Parameters::DEFAULT
    };
    let accuracy = Accuracy {
        local: figure("accuracy_local")?,
        cloud: figure("accuracy_cloud")?,
        price_per_ms: figure("price_per_ms")?,
    };
    let probe_every = r.integer("policy.probe_every", None)?;
    let speed = speed(r)?;
    if kind.goes_by_speed() && speed.is_none() {
        return Err(r.flaw("policy", SettingsFlaw::Speed(kind.as_str())));
    }
    Ok(DeadlineSettings { kind, parameters, accuracy, probe_every, speed, rate })
}

/// A time that is not implausible is not so long.
fn time(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX)
}

fn speed(r: &mut ParameterReader) -> Result<Option<SpeedTopic>, SettingsError> {
    let type_name = r.text("policy.speed_type", None)?;
    let topic = r.topic("policy.speed_topic", None, &type_name, Role::Subscription)?;
    let age = r.seconds("policy.speed_age")?;
    Ok(topic.map(|topic| SpeedTopic { topic, type_name, age }))
}
