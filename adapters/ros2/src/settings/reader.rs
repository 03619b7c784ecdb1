//! Reads parameters one by one, each by its line in the table; what is left at the end is no parameter of the node.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

use crate::names::{NodeName, Remap, check_token};
use crate::parameters::{ParameterOverride, Value, ValueOrigin};
use crate::settings::nearest::nearest;
use crate::settings::parameter::{Kind, Parameter, Preset, Spec, is_of_a_cloud, spec};
use crate::settings::qos::{Qos, Role, Topic};
use crate::settings::seconds::{DeadlineBound, GREATEST_DEADLINE, own_seconds, seconds_of};
use crate::settings::{SettingsError, qos};

/// The parameters given and not read yet, and those read.
pub(super) struct ParameterReader<'a> {
    overrides: BTreeMap<String, ParameterOverride>,
    node: NodeName,
    remaps: &'a [Remap],
    deadlines: DeadlineBound,
    /// The parameters that were read.
    pub(super) declared: Vec<Parameter>,
    /// The topics among it.
    pub(super) topics: Vec<Topic>,
    /// Their names before they were remapped.
    pub(super) own_names: Vec<String>,
}

/// A value and where it comes from.
pub(super) struct LocatedValue<T> {
    pub(super) value: T,
    pub(super) origin: ValueOrigin,
}

impl<'a> ParameterReader<'a> {
    pub(super) fn new(
        overrides: BTreeMap<String, ParameterOverride>,
        node: NodeName,
        remaps: &'a [Remap],
    ) -> Self {
        let deadlines = DeadlineBound(Duration::MAX);
        let (declared, topics, own_names) = (Vec::new(), Vec::new(), Vec::new());
        Self { overrides, node, remaps, deadlines, declared, topics, own_names }
    }

    /// Reads a parameter with `convert`; `default` is for one whose line in the table has none.
    pub(super) fn read<T>(
        &mut self,
        name: &str,
        default: Option<Value>,
        convert: impl FnOnce(&Value) -> Option<T>,
    ) -> Result<LocatedValue<T>, SettingsError> {
        self.read_as(name, line(name).kind, default, convert)
    }

    fn read_as<T>(
        &mut self,
        name: &str,
        kind: Kind,
        default: Option<Value>,
        convert: impl FnOnce(&Value) -> Option<T>,
    ) -> Result<LocatedValue<T>, SettingsError> {
        let Spec { preset, at_run_time, about, .. } = *line(name);
        let default = default.or_else(|| preset.value()).unwrap_or(Value::String(String::new()));
        let is_double = matches!(default, Value::Double(_));
        let (value, origin) = match self.overrides.remove(name) {
            Some(parameter) => (parameter.value, parameter.origin),
            None => (default, ValueOrigin::Default),
        };
        let value = match value.number() {
            Some(number) if is_double => Value::Double(number),
            Some(_) | None => value,
        };
        let (name, expected) = (name.to_owned(), kind.expected(self.deadlines));
        let Some(converted) = convert(&value) else {
            return Err(SettingsError::Value { origin, name, value, expected });
        };
        let (range, located) = (kind.range(self.deadlines), origin.clone());
        let origin = located.clone();
        self.declared.push(Parameter { name, value, about, expected, range, at_run_time, origin });
        Ok(LocatedValue { value: converted, origin: located })
    }

    pub(super) fn text(
        &mut self,
        name: &str,
        default: Option<&str>,
    ) -> Result<LocatedValue<String>, SettingsError> {
        let default = default.map(|default| Value::String(default.to_owned()));
        self.read(name, default, |value| match value {
            Value::String(text) => Some(text.clone()),
            _ => None,
        })
    }

    /// Reads a list of texts.
    pub(super) fn names(&mut self, name: &str) -> Result<LocatedValue<Vec<String>>, SettingsError> {
        self.read(name, None, |value| match value {
            Value::Strings(names) => Some(names.clone()),
            _ => None,
        })
    }

    pub(super) fn integer<T: TryFrom<i64>>(
        &mut self,
        name: &str,
        default: Option<i64>,
    ) -> Result<LocatedValue<T>, SettingsError> {
        self.integer_up_to(name, i64::MAX, default)
    }

    /// Reads an integer with a bound that depends on other parameters.
    pub(super) fn integer_up_to<T: TryFrom<i64>>(
        &mut self,
        name: &str,
        bound: i64,
        default: Option<i64>,
    ) -> Result<LocatedValue<T>, SettingsError> {
        let Kind::Integer(least, most) = line(name).kind else {
            unreachable!("{name} is an integer")
        };
        let most = most.min(bound);
        let (kind, default) = (Kind::Integer(least, most), default.map(Value::Integer));
        self.read_as(name, kind, default, |value| match value {
            Value::Integer(it) if (least..=most).contains(it) => T::try_from(*it).ok(),
            _ => None,
        })
    }

    /// Reads one of these words, each with what it means; the table has them in the same order.
    pub(super) fn choice<T: Copy>(
        &mut self,
        name: &str,
        meanings: &[T],
    ) -> Result<LocatedValue<T>, SettingsError> {
        let Kind::Words(words) = line(name).kind else { unreachable!("{name} is a word") };
        self.read(name, None, |value| match value {
            Value::String(word) => {
                words.iter().zip(meanings).find(|(it, _)| *it == word).map(|(_, it)| *it)
            }
            _ => None,
        })
    }

    pub(super) fn flag(&mut self, name: &str) -> Result<bool, SettingsError> {
        let flag = self.read(name, None, |value| match value {
            Value::Bool(flag) => Some(*flag),
            _ => None,
        });
        flag.map(|flag| flag.value)
    }

    /// Reads a time, by the kind of the parameter.
    pub(super) fn seconds(&mut self, name: &str) -> Result<Duration, SettingsError> {
        let (kind, bound) = (line(name).kind, self.deadlines);
        let seconds = self.read(name, None, |value| match kind {
            Kind::Deadline => bound.deadline(value),
            Kind::OwnDeadline => bound.own_deadline(value),
            Kind::SecondsOr(_) => own_seconds(value),
            _ => seconds_of(value),
        });
        seconds.map(|seconds| seconds.value)
    }

    /// Reads the greatest deadline, which bounds those that are read after it.
    pub(super) fn greatest_deadline(&mut self) -> Result<Duration, SettingsError> {
        let greatest = self.seconds(GREATEST_DEADLINE)?;
        self.deadlines = DeadlineBound(greatest);
        Ok(greatest)
    }

    /// Reads a number of at least 0.
    pub(super) fn figure(
        &mut self,
        name: &str,
        default: Option<f64>,
    ) -> Result<f64, SettingsError> {
        let figure = self.read(name, default.map(Value::Double), |value| {
            value.number().filter(|number| number.is_finite() && *number >= 0.0)
        });
        figure.map(|figure| figure.value)
    }

    /// Returns an error about a parameter that was read.
    pub(super) fn out_of_range(&self, name: &str) -> SettingsError {
        let read = self.declared.iter().find(|declared| declared.name == name);
        let (value, origin) = match read {
            Some(Parameter { value, origin, .. }) => (value.clone(), origin.clone()),
            None => (Value::Double(0.0), ValueOrigin::Default),
        };
        let (name, expected) = (name.to_owned(), line(name).kind.expected(self.deadlines));
        SettingsError::Value { origin, name, value, expected }
    }

    /// Reads a file's path; `None` if it is empty, which is the default.
    pub(super) fn path(&mut self, name: &str) -> Result<Option<PathBuf>, SettingsError> {
        let path = self.text(name, None)?.value;
        Ok(Some(path).filter(|path| !path.is_empty()).map(PathBuf::from))
    }

    /// Reads a topic, and returns its full name; `None` if it is empty, and so is its default.
    pub(super) fn topic(
        &mut self,
        parameter: &str,
        default: Option<&str>,
        type_name: &str,
        role: Role,
    ) -> Result<Option<String>, SettingsError> {
        let LocatedValue { value, origin } = self.text(parameter, default)?;
        if value.is_empty() && matches!(line(parameter).preset, Preset::Text("")) {
            return Ok(None);
        }
        self.add_topic(parameter.to_owned(), &value, origin, type_name, role).map(Some)
    }

    /// Reads a topic that must have a name.
    pub(super) fn named_topic(
        &mut self,
        parameter: &str,
        default: Option<&str>,
        type_name: &str,
        role: Role,
    ) -> Result<String, SettingsError> {
        let LocatedValue { value, origin } = self.text(parameter, default)?;
        self.add_topic(parameter.to_owned(), &value, origin, type_name, role)
    }

    /// Adds a published topic that has no parameter, and returns its full name.
    pub(super) fn fixed_topic(
        &mut self,
        name: &str,
        type_name: &str,
    ) -> Result<String, SettingsError> {
        self.add_topic(name.to_owned(), name, ValueOrigin::Default, type_name, Role::Publisher)
    }

    fn add_topic(
        &mut self,
        purpose: String,
        value: &str,
        origin: ValueOrigin,
        type_name: &str,
        role: Role,
    ) -> Result<String, SettingsError> {
        let name = match self.node.topic(value, self.remaps) {
            Ok(name) => name,
            Err(source) => {
                let topic = value.to_owned();
                return Err(SettingsError::Topic { origin, name: purpose, topic, source });
            }
        };
        let is_remapped = self.node.expand(value).is_ok_and(|unmapped| unmapped != name);
        let origin = match origin {
            ValueOrigin::Default if is_remapped => ValueOrigin::Argument("--remap".to_owned()),
            origin => origin,
        };
        // The node would receive its own messages, or would not know whose message it received.
        if let Some(other) = self.topics.iter().find(|other| other.name == name) {
            let origin = if origin == ValueOrigin::Default { other.origin.clone() } else { origin };
            let other = other.purpose.clone();
            return Err(SettingsError::Shared { origin, name: purpose, topic: name, other });
        }
        let (type_name, qos) = (type_name.to_owned(), Qos::of(role));
        self.own_names.push(value.to_owned());
        self.topics.push(Topic { name: name.clone(), type_name, role, qos, purpose, origin });
        Ok(name)
    }

    /// Applies the rest, which must be quality of service of the node's topics.
    ///
    /// Returns what is for other nodes and not for this one, in a sentence each. Only what is given under a wildcard can be, and
    /// that is refused too if it can hardly mean anything but a parameter of this node.
    pub(super) fn apply_rest(&mut self) -> Result<Vec<String>, SettingsError> {
        let mut idle = Vec::new();
        for parameter in std::mem::take(&mut self.overrides).into_values() {
            let applied = match parameter.name.strip_prefix(qos::PREFIX) {
                Some(rest) => qos::apply(&mut self.topics, rest, &parameter),
                None => Err(self.unknown(&parameter)),
            };
            match applied {
                Ok((about, expected)) => self.declared.push(Parameter {
                    name: parameter.name,
                    value: parameter.value,
                    about,
                    expected: expected.to_owned(),
                    range: None,
                    at_run_time: false,
                    origin: parameter.origin,
                }),
                Err(error @ (SettingsError::Unknown { .. } | SettingsError::NoCloud { .. }))
                    if parameter.is_shared && !self.is_meant(&parameter.name, &error) =>
                {
                    idle.push(match error {
                        SettingsError::NoCloud { .. } => {
                            format!("{error}, unless it is another node's")
                        }
                        _ => format!(
                            "{}: {} is no parameter of this node, and counts as another node's",
                            parameter.origin, parameter.name
                        ),
                    });
                }
                Err(error) => return Err(error),
            }
        }
        Ok(idle)
    }

    /// Returns `true` if a name that no parameter has is one of this node's, with typing errors or
    /// below a name that it uses.
    fn is_meant(&self, name: &str, error: &SettingsError) -> bool {
        let errors = if name.len() < 8 { 1 } else { 2 };
        let is_near = |known: &str| strsim::damerau_levenshtein(name, known) <= errors;
        // Other nodes have topics of these names too.
        let is_qos = name.starts_with(qos::PREFIX);
        let first = name.split_once('.').map(|(first, _)| first).filter(|_| !is_qos);
        let is_known = |known: &str| {
            let rest = first.and_then(|first| known.strip_prefix(first));
            is_near(known) || rest.is_some_and(|rest| rest.starts_with('.'))
        };
        matches!(error, SettingsError::Unknown { nearest, .. } if is_near(nearest))
            || self.declared.iter().any(|known| is_known(&known.name))
    }

    pub(super) fn is_given(&self, name: &str) -> bool {
        self.overrides.contains_key(name)
    }

    /// Returns the place where a parameter is given, if it is.
    pub(super) fn origin(&self, name: &str) -> Option<ValueOrigin> {
        self.overrides.get(name).map(|parameter| parameter.origin.clone())
    }

    fn unknown(&self, parameter: &ParameterOverride) -> SettingsError {
        let (origin, name) = (parameter.origin.clone(), parameter.name.clone());
        if let Some((cloud, part)) = name.split_once('.')
            && is_of_a_cloud(part)
            && check_token(cloud).is_ok()
            && !self.declared.iter().any(|known| known.name == format!("{cloud}.deadline"))
        {
            let cloud = cloud.to_owned();
            return SettingsError::NoCloud { origin, name, cloud };
        }
        let names = self.declared.iter().map(|known| known.name.as_str());
        let nearest = nearest(&name, names);
        SettingsError::Unknown { origin, name, nearest }
    }
}

/// Returns the line of a parameter that is read.
fn line(name: &str) -> &'static Spec {
    spec(name).unwrap_or_else(|| unreachable!("{name} is in no line of the table"))
}
