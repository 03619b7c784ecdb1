//! Reads parameters one by one; what is left at the end is no parameter of the node.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::time::Duration;

use crate::names::{NodeName, Remap, check_token};
use crate::parameters::{ParameterOverride, Value, ValueOrigin};
use crate::settings::nearest::nearest;
use crate::settings::parameter::{Parameter, Range, is_of_a_cloud};
use crate::settings::qos::{Qos, Role, Topic};
use crate::settings::seconds::{
    DeadlineBound, GREATEST_DEADLINE, MOST_SECONDS, SECONDS, own_seconds, seconds_of,
};
use crate::settings::{SettingsError, qos};

/// The parameters given and not read yet, and those read.
pub(super) struct ParameterReader<'a> {
    overrides: BTreeMap<String, ParameterOverride>,
    node: NodeName,
    remaps: &'a [Remap],
    deadlines: DeadlineBound,
    /// What was read.
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

    /// Reads a parameter with `convert`; the error says what is `expected`.
    pub(super) fn read<T>(
        &mut self,
        name: &str,
        default: Value,
        about: &'static str,
        expected: &str,
        convert: impl FnOnce(&Value) -> Option<T>,
    ) -> Result<LocatedValue<T>, SettingsError> {
        let is_double = matches!(default, Value::Double(_));
        let (value, origin) = match self.overrides.remove(name) {
            Some(parameter) => (parameter.value, parameter.origin),
            None => (default, ValueOrigin::Default),
        };
        let value = match value.number() {
            Some(number) if is_double => Value::Double(number),
            Some(_) | None => value,
        };
        let name = name.to_owned();
        let Some(converted) = convert(&value) else {
            let expected = expected.to_owned();
            return Err(SettingsError::Value { origin, name, value, expected });
        };
        self.declared.push(Parameter {
            name,
            value,
            about,
            expected: expected.to_owned(),
            range: None,
            at_run_time: false,
            origin: origin.clone(),
        });
        Ok(LocatedValue { value: converted, origin })
    }

    pub(super) fn text(
        &mut self,
        name: &str,
        default: &str,
        about: &'static str,
    ) -> Result<LocatedValue<String>, SettingsError> {
        let default = Value::String(default.to_owned());
        self.read(
            name,
            default,
            about,
            "a string, in quotes if it looks like something else",
            |value| match value {
                Value::String(text) => Some(text.clone()),
                _ => None,
            },
        )
    }

    /// A list of texts, empty by default.
    pub(super) fn names(
        &mut self,
        name: &str,
        about: &'static str,
    ) -> Result<LocatedValue<Vec<String>>, SettingsError> {
        let default = Value::Strings(Vec::new());
        self.read(name, default, about, "a list of names such as [west, east]", |value| match value
        {
            Value::Strings(names) => Some(names.clone()),
            _ => None,
        })
    }

    pub(super) fn integer<T: TryFrom<i64>>(
        &mut self,
        name: &str,
        range: RangeInclusive<i64>,
        default: i64,
        about: &'static str,
    ) -> Result<LocatedValue<T>, SettingsError> {
        let expected = match (*range.start(), *range.end()) {
            (least, i64::MAX) => format!("an integer of at least {least}"),
            (least, most) => format!("an integer from {least} to {most}"),
        };
        let read =
            self.read(name, Value::Integer(default), about, &expected, |value| match value {
                Value::Integer(integer) if range.contains(integer) => T::try_from(*integer).ok(),
                _ => None,
            });
        self.bound(name, Range::Integer(*range.start(), *range.end()));
        read
    }

    /// The parameter that was read last has these bounds.
    fn bound(&mut self, name: &str, range: Range) {
        if let Some(declared) = self.declared.last_mut().filter(|last| last.name == name) {
            declared.range = Some(range);
        }
    }

    /// One of these words, each with what it means.
    pub(super) fn choice<T: Copy>(
        &mut self,
        name: &str,
        default: &str,
        about: &'static str,
        choices: &[(&str, T)],
    ) -> Result<T, SettingsError> {
        let words: Vec<&str> = choices.iter().map(|(word, _)| *word).collect();
        let default = Value::String(default.to_owned());
        let chosen = self.read(name, default, about, &words.join(" or "), |value| match value {
            Value::String(word) => choices.iter().find(|(it, _)| it == word).map(|(_, it)| *it),
            _ => None,
        });
        chosen.map(|chosen| chosen.value)
    }

    pub(super) fn flag(
        &mut self,
        name: &str,
        default: bool,
        about: &'static str,
    ) -> Result<bool, SettingsError> {
        let flag =
            self.read(name, Value::Bool(default), about, "true or false", |value| match value {
                Value::Bool(flag) => Some(*flag),
                _ => None,
            });
        flag.map(|flag| flag.value)
    }

    pub(super) fn seconds(
        &mut self,
        name: &str,
        default: f64,
        about: &'static str,
    ) -> Result<Duration, SettingsError> {
        let seconds = self.read(name, Value::Double(default), about, SECONDS, seconds_of);
        self.bound(name, MOST_SECONDS);
        seconds.map(|seconds| seconds.value)
    }

    /// The greatest deadline, which bounds those that are read after it.
    pub(super) fn greatest_deadline(&mut self) -> Result<Duration, SettingsError> {
        let about = "The greatest that a deadline may be, in seconds";
        let greatest = self.seconds(GREATEST_DEADLINE, 60.0, about)?;
        self.deadlines = DeadlineBound(greatest);
        Ok(greatest)
    }

    pub(super) fn deadline(
        &mut self,
        name: &str,
        default: f64,
        about: &'static str,
    ) -> Result<Duration, SettingsError> {
        let (bound, default) = (self.deadlines, Value::Double(default));
        let read =
            self.read(name, default, about, &bound.expected(), |value| bound.deadline(value))?;
        self.bound(name, bound.range());
        Ok(read.value)
    }

    /// A cloud's own deadline, 0 by default.
    pub(super) fn own_deadline(
        &mut self,
        name: &str,
        about: &'static str,
    ) -> Result<Duration, SettingsError> {
        let (bound, expected) = (self.deadlines, self.deadlines.own_expected());
        let default = Value::Double(0.0);
        let read = self.read(name, default, about, &expected, |value| bound.own_deadline(value))?;
        self.bound(name, bound.range());
        Ok(read.value)
    }

    /// Seconds that are 0 by default, which means what `expected` says.
    pub(super) fn own_seconds(
        &mut self,
        name: &str,
        about: &'static str,
        expected: &str,
    ) -> Result<Duration, SettingsError> {
        let seconds = self.read(name, Value::Double(0.0), about, expected, own_seconds);
        self.bound(name, MOST_SECONDS);
        seconds.map(|seconds| seconds.value)
    }

    /// What is wrong with a parameter that was read, by another one.
    pub(super) fn out_of_range(&self, name: &str, expected: &str) -> SettingsError {
        let read = self.declared.iter().find(|declared| declared.name == name);
        let (value, origin) = match read {
            Some(Parameter { value, origin, .. }) => (value.clone(), origin.clone()),
            None => (Value::Double(0.0), ValueOrigin::Default),
        };
        let (name, expected) = (name.to_owned(), expected.to_owned());
        SettingsError::Value { origin, name, value, expected }
    }

    /// A file's path; an empty one is none, and the default.
    pub(super) fn path(
        &mut self,
        name: &str,
        about: &'static str,
    ) -> Result<Option<PathBuf>, SettingsError> {
        let path = self.text(name, "", about)?.value;
        Ok(Some(path).filter(|path| !path.is_empty()).map(PathBuf::from))
    }

    /// A topic's full name; an empty one stays so if it is the default.
    pub(super) fn topic(
        &mut self,
        parameter: &str,
        default: &str,
        about: &'static str,
        type_name: &str,
        role: Role,
    ) -> Result<String, SettingsError> {
        let LocatedValue { value, origin } = self.text(parameter, default, about)?;
        if value.is_empty() && default.is_empty() {
            return Ok(value);
        }
        self.add_topic(parameter.to_owned(), &value, origin, type_name, role)
    }

    /// A published topic that has no parameter.
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

    /// Whether a name that no parameter has is one of this node's, with typing errors or below a name that it uses.
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

    /// Where a parameter is given, if it is.
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

impl<T> LocatedValue<T> {
    pub(super) fn map<U>(self, change: impl FnOnce(T) -> U) -> LocatedValue<U> {
        LocatedValue { value: change(self.value), origin: self.origin }
    }
}
