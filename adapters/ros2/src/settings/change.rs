//! Changes parameters while the node runs (D16).

use std::time::Duration;

use fuseline_engine::CapacityErrors;
use thiserror::Error;

use crate::parameters::Value;
use crate::settings::nearest::nearest;
use crate::settings::seconds::{DeadlineBound, none_if_zero};
use crate::settings::{Parameter, Settings};

/// A parameter's new value.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Change {
    /// `deadline`.
    Deadline(Duration),
    /// `local.deadline`.
    LocalDeadline(Duration),
    /// A cloud's `deadline`, by its index in [`Settings::clouds`]; `None` means the node's
    /// `deadline`.
    CloudDeadline(usize, Option<Duration>),
    /// A cloud's `enabled`, by its index in [`Settings::clouds`].
    CloudEnabled(usize, bool),
    /// `use_sim_time`.
    SimTime(bool),
}

/// The reason why a parameter was not changed.
#[derive(Clone, PartialEq, Debug, Error)]
pub enum ChangeError {
    /// There is no such parameter.
    #[error("there is no parameter {0}; the nearest is {1}")]
    Unknown(String, String),
    /// The parameter is read only when the node starts.
    #[error("{0} is fixed while the node runs; restart it with another value")]
    Fixed(String),
    /// The value is not valid.
    #[error("{0} cannot be {1}; give {2}")]
    Value(String, Value, String),
    /// The node could not keep up with this value.
    #[error("{0} cannot be {1}: {2}")]
    Workload(String, Value, CapacityErrors),
}

impl Settings {
    /// Returns the change that a new value of a parameter makes. The settings themselves do not
    /// change.
    ///
    /// # Errors
    /// Returns an error if there is no such parameter, it is fixed, or the value is not valid.
    pub fn check_change(&self, name: &str, value: &Value) -> Result<Change, ChangeError> {
        let Some(known) = self.parameter(name) else {
            let names = self.declared.iter().map(|known| known.name.as_str());
            return Err(ChangeError::Unknown(name.to_owned(), nearest(name, names)));
        };
        if !known.at_run_time {
            return Err(ChangeError::Fixed(name.to_owned()));
        }
        let bound = DeadlineBound(self.greatest_deadline);
        let of_cloud = name.split_once('.').and_then(|(cloud, part)| {
            Some((self.clouds.iter().position(|other| other.name == cloud)?, part))
        });
        let change = match (name, of_cloud) {
            (_, Some((at, "deadline"))) => {
                let own = bound.own_deadline(value);
                own.map(|time| Change::CloudDeadline(at, none_if_zero(time)))
            }
            (_, Some((at, "enabled"))) => flag_of(value).map(|flag| Change::CloudEnabled(at, flag)),
            ("deadline", None) => bound.deadline(value).map(Change::Deadline),
            ("local.deadline", None) => bound.deadline(value).map(Change::LocalDeadline),
            ("use_sim_time", None) => flag_of(value).map(Change::SimTime),
            _ => None,
        };
        let Some(change) = change else {
            let expected = known.expected.clone();
            return Err(ChangeError::Value(name.to_owned(), value.clone(), expected));
        };
        match self.keeps_pace_with(change) {
            Ok(()) => Ok(change),
            Err(why) => Err(ChangeError::Workload(name.to_owned(), value.clone(), why)),
        }
    }

    /// Checks that the node can keep up after this change.
    fn keeps_pace_with(&self, change: Change) -> Result<(), CapacityErrors> {
        let mut changed = self.clone();
        changed.apply(change);
        changed.keep_pace()
    }

    /// Sets a parameter; returns what that changes, and its value as it is kept: a whole number where a number with a
    /// point is expected is one.
    pub(crate) fn change(
        &mut self,
        name: &str,
        value: Value,
    ) -> Result<(Change, Value), ChangeError> {
        let change = self.check_change(name, &value)?;
        let declared = self.declared.iter_mut().find(|parameter| parameter.name == name);
        let value = match (&declared, value.number()) {
            (Some(Parameter { value: Value::Double(_), .. }), Some(number)) => {
                Value::Double(number)
            }
            _ => value,
        };
        if let Some(declared) = declared {
            declared.value = value.clone();
        }
        self.apply(change);
        Ok((change, value))
    }

    /// Takes a change over.
    fn apply(&mut self, change: Change) {
        match change {
            Change::Deadline(deadline) => self.deadline = deadline,
            Change::LocalDeadline(deadline) => self.local.deadline = deadline,
            Change::CloudDeadline(at, deadline) => self.clouds[at].deadline = deadline,
            Change::CloudEnabled(at, enabled) => self.clouds[at].enabled = enabled,
            Change::SimTime(follows) => self.use_sim_time = follows,
        }
    }
}

fn flag_of(value: &Value) -> Option<bool> {
    match value {
        Value::Bool(flag) => Some(*flag),
        _ => None,
    }
}
