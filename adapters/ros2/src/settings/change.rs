//! Changes parameters while the node runs (D16).

use std::time::Duration;

use thiserror::Error;

use crate::names::nearest;
use crate::parameters::Value;
use crate::settings::parameter::{Spec, none_if_zero};
use crate::settings::{Parameter, Settings, SettingsError};

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
    /// The node would not start with this value, for the reason that the last text says.
    #[error("{0} cannot be {1}: {2}")]
    Refused(String, Value, String),
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
        let Spec { name: line, kind, at_run_time, .. } = known.spec;
        if !at_run_time {
            return Err(ChangeError::Fixed(name.to_owned()));
        }
        let greatest = self.greatest_deadline;
        if !kind.accepts(value, greatest) {
            let expected = kind.expected(greatest);
            return Err(ChangeError::Value(name.to_owned(), value.clone(), expected));
        }
        let (flag, time) = (*value == Value::Bool(true), kind.time(value, greatest));
        let (time, of) = (time.unwrap_or_default(), name.split_once('.').map(|(cloud, _)| cloud));
        let at = self.clouds.iter().position(|cloud| Some(&*cloud.name) == of);
        let change = match (line, at) {
            ("<cloud>.deadline", Some(at)) => Change::CloudDeadline(at, none_if_zero(time)),
            ("<cloud>.enabled", Some(at)) => Change::CloudEnabled(at, flag),
            ("deadline", _) => Change::Deadline(time),
            ("local.deadline", _) => Change::LocalDeadline(time),
            ("use_sim_time", _) => Change::SimTime(flag),
            (other, _) => unreachable!("{other} changes while the node runs"),
        };
        let mut changed = self.clone();
        changed.apply(change);
        let refused = |why: SettingsError| {
            ChangeError::Refused(name.to_owned(), value.clone(), why.to_string())
        };
        changed.check().map(|()| change).map_err(refused)
    }

    /// Sets a parameter; returns what that changes, and its value as it is kept: a whole number
    /// where a number with a point is expected is one.
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
