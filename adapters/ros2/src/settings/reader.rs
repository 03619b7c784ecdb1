//! Reads parameters one by one, each by its line in the table; what is left at the end is no
//! parameter of the node.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

use crate::names::{NodeName, Remap, check_token, nearest};
use crate::parameters::{ParameterOverride, Value, ValueOrigin};
use crate::settings::parameter::{Kind, Parameter, Preset, Spec, is_of_a_cloud, spec};
use crate::settings::qos::{self, Qos, Role, Topic};
use crate::settings::{SettingsError, SettingsFlaw};

/// The parameters given and not read yet, and those read.
pub(super) struct ParameterReader<'a> {
    overrides: BTreeMap<String, ParameterOverride>,
    node: NodeName,
    remaps: &'a [Remap],
    /// The longest deadline that is accepted.
    greatest: Duration,
    /// The parameters that were read.
    pub(super) declared: Vec<Parameter>,
    /// The topics among it.
    pub(super) topics: Vec<Topic>,
    /// Their names before they were remapped.
    pub(super) own_names: Vec<String>,
}

impl<'a> ParameterReader<'a> {
    pub(super) fn new(
        overrides: BTreeMap<String, ParameterOverride>,
        node: NodeName,
        remaps: &'a [Remap],
    ) -> Self {
        let (declared, topics, own_names) = (Vec::new(), Vec::new(), Vec::new());
        Self { overrides, node, remaps, greatest: Duration::MAX, declared, topics, own_names }
    }

    /// Reads a parameter; `default` is for one whose line in the table has none.
    fn read(&mut self, name: &str, default: Option<Value>) -> Result<Value, SettingsError> {
        self.read_as(name, *line(name), default)
    }

    fn read_as(
        &mut self,
        name: &str,
        spec: Spec,
        default: Option<Value>,
    ) -> Result<Value, SettingsError> {
        let default =
            default.or_else(|| spec.preset.value()).unwrap_or(Value::String(String::new()));
        let is_double = matches!(default, Value::Double(_));
        let (value, origin) = match self.overrides.remove(name) {
            Some(parameter) => (parameter.value, parameter.origin),
            None => (default, ValueOrigin::Default),
        };
        let value = match value.number() {
            Some(number) if is_double => Value::Double(number),
            Some(_) | None => value,
        };
        self.declare(Parameter { name: name.to_owned(), value: value.clone(), spec, origin })?;
        Ok(value)
    }

    fn declare(&mut self, parameter: Parameter) -> Result<(), SettingsError> {
        let is_accepted = parameter.spec.kind.accepts(&parameter.value, self.greatest);
        let name = parameter.name.clone();
        self.declared.push(parameter);
        if is_accepted { Ok(()) } else { Err(self.refused(&name)) }
    }

    pub(super) fn text(
        &mut self,
        name: &str,
        default: Option<&str>,
    ) -> Result<String, SettingsError> {
        match self.read(name, default.map(|default| Value::String(default.to_owned())))? {
            Value::String(text) => Ok(text),
            other => unreachable!("{name} is {other}"),
        }
    }

    /// Reads a list of texts.
    pub(super) fn names(&mut self, name: &str) -> Result<Vec<String>, SettingsError> {
        match self.read(name, None)? {
            Value::Strings(names) => Ok(names),
            other => unreachable!("{name} is {other}"),
        }
    }

    pub(super) fn integer<T: TryFrom<i64>>(
        &mut self,
        name: &str,
        default: Option<i64>,
    ) -> Result<T, SettingsError> {
        self.integer_up_to(name, i64::MAX, default)
    }

    /// Reads an integer with a bound that depends on other parameters.
    pub(super) fn integer_up_to<T: TryFrom<i64>>(
        &mut self,
        name: &str,
        bound: i64,
        default: Option<i64>,
    ) -> Result<T, SettingsError> {
        let mut spec = *line(name);
        if let Kind::Integer(_, most) = &mut spec.kind {
            *most = bound.min(*most);
        }
        match self.read_as(name, spec, default.map(Value::Integer))? {
            Value::Integer(integer) => Ok(T::try_from(integer)
                .unwrap_or_else(|_| unreachable!("{name} has narrower bounds in the table"))),
            other => unreachable!("{name} is {other}"),
        }
    }

    /// Reads one of these words, each with what it means; the table has them in the same order.
    pub(super) fn choice<T: Copy>(
        &mut self,
        name: &str,
        meanings: &[T],
    ) -> Result<T, SettingsError> {
        let Kind::Words(words) = line(name).kind else { unreachable!("{name} is a word") };
        let chosen = self.text(name, None)?;
        let at = words.iter().position(|word| *word == chosen);
        Ok(meanings[at.unwrap_or_else(|| unreachable!("{name} is {chosen}"))])
    }

    pub(super) fn flag(&mut self, name: &str) -> Result<bool, SettingsError> {
        Ok(self.read(name, None)? == Value::Bool(true))
    }

    /// Reads a time, by the kind of the parameter.
    pub(super) fn seconds(&mut self, name: &str) -> Result<Duration, SettingsError> {
        let seconds = self.read(name, None)?;
        let time = line(name).kind.time(&seconds, self.greatest);
        Ok(time.unwrap_or_else(|| unreachable!("{name} is {seconds}")))
    }

    /// Reads the greatest deadline, which bounds those that are read after it.
    pub(super) fn greatest_deadline(&mut self) -> Result<Duration, SettingsError> {
        self.greatest = self.seconds("greatest_deadline")?;
        Ok(self.greatest)
    }

    /// Reads a number of at least 0.
    pub(super) fn figure(
        &mut self,
        name: &str,
        default: Option<f64>,
    ) -> Result<f64, SettingsError> {
        let figure = self.read(name, default.map(Value::Double))?;
        Ok(figure.number().unwrap_or_else(|| unreachable!("{name} is {figure}")))
    }

    /// Reads a file's path; `None` if it is empty, which is the default.
    pub(super) fn path(&mut self, name: &str) -> Result<Option<PathBuf>, SettingsError> {
        Ok(Some(self.text(name, None)?).filter(|path| !path.is_empty()).map(PathBuf::from))
    }

    /// Returns the error about a flaw of a parameter, whether it was read or not.
    pub(super) fn flaw(&self, name: &str, flaw: SettingsFlaw) -> SettingsError {
        SettingsError::Flaw { origin: self.origin(name), name: name.to_owned(), flaw }
    }

    /// Returns the error about the value of a parameter that was read.
    pub(super) fn refused(&self, name: &str) -> SettingsError {
        let mut read = self.declared.iter().filter(|declared| declared.name == name);
        let Some(Parameter { value, spec, .. }) = read.next() else {
            unreachable!("{name} was read")
        };
        let expected = spec.kind.expected(self.greatest);
        self.flaw(name, SettingsFlaw::Value(value.clone(), expected))
    }

    /// Reads a topic, and returns its full name; `None` if it is empty, and so is its default.
    pub(super) fn topic(
        &mut self,
        parameter: &str,
        default: Option<&str>,
        type_name: &str,
        role: Role,
    ) -> Result<Option<String>, SettingsError> {
        let value = self.text(parameter, default)?;
        if value.is_empty() && matches!(line(parameter).preset, Preset::Text("")) {
            return Ok(None);
        }
        self.add_topic(parameter, &value, type_name, role).map(Some)
    }

    /// Reads a topic that must have a name.
    pub(super) fn named_topic(
        &mut self,
        parameter: &str,
        default: Option<&str>,
        type_name: &str,
        role: Role,
    ) -> Result<String, SettingsError> {
        let value = self.text(parameter, default)?;
        self.add_topic(parameter, &value, type_name, role)
    }

    /// Adds a published topic that has no parameter, and returns its full name.
    pub(super) fn fixed_topic(
        &mut self,
        name: &str,
        type_name: &str,
    ) -> Result<String, SettingsError> {
        self.add_topic(name, name, type_name, Role::Publisher)
    }

    fn add_topic(
        &mut self,
        purpose: &str,
        value: &str,
        type_name: &str,
        role: Role,
    ) -> Result<String, SettingsError> {
        let named = self.node.topic(value, self.remaps);
        let name =
            named.map_err(|why| self.flaw(purpose, SettingsFlaw::Topic(value.to_owned(), why)))?;
        let is_remapped = self.node.expand(value).is_ok_and(|unmapped| unmapped != name);
        let origin = match self.origin(purpose) {
            ValueOrigin::Default if is_remapped => ValueOrigin::Argument("--remap".to_owned()),
            origin => origin,
        };
        // The node would receive its own messages, or would not know whose message it received.
        if let Some(other) = self.topics.iter().find(|other| other.name == name) {
            let origin = if origin == ValueOrigin::Default { other.origin.clone() } else { origin };
            let flaw = SettingsFlaw::Shared(name, other.purpose.clone());
            return Err(SettingsError::Flaw { origin, name: purpose.to_owned(), flaw });
        }
        let (type_name, qos, purpose) = (type_name.to_owned(), Qos::of(role), purpose.to_owned());
        self.own_names.push(value.to_owned());
        self.topics.push(Topic { name: name.clone(), type_name, role, qos, purpose, origin });
        Ok(name)
    }

    /// Applies the rest, which must be quality of service of the node's topics.
    ///
    /// Returns what is for other nodes and not for this one, in a sentence each. Only what is given
    /// under a wildcard can be, and that is refused too if it can hardly mean anything but a
    /// parameter of this node.
    pub(super) fn apply_rest(&mut self) -> Result<Vec<String>, SettingsError> {
        let mut idle = Vec::new();
        for parameter in std::mem::take(&mut self.overrides).into_values() {
            let ParameterOverride { name, value, origin, is_shared } = parameter;
            if let Some((topic, spec)) = qos::find(&self.topics, &name) {
                self.declare(Parameter { name, value: value.clone(), spec, origin })?;
                self.topics[topic].qos.set(spec.name, &value);
                continue;
            }
            let unknown = self.unknown(&name, origin);
            if !is_shared || self.is_meant(&name, &unknown) {
                return Err(unknown);
            }
            idle.push(match unknown {
                SettingsError::Unknown { origin, .. } => format!(
                    "{origin}: {name} is not a parameter of this node, and counts as another node's"
                ),
                of_a_cloud => format!("{of_a_cloud}, unless it is a parameter of another node"),
            });
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

    /// Returns the origin of a parameter's value, whether it was read or not.
    pub(super) fn origin(&self, name: &str) -> ValueOrigin {
        let given = self.overrides.get(name).map(|parameter| &parameter.origin);
        let mut declared = self.declared.iter().filter(|declared| declared.name == name);
        let origin = given.or_else(|| declared.next().map(|declared| &declared.origin));
        origin.cloned().unwrap_or(ValueOrigin::Default)
    }

    /// Returns the error about a name that no parameter has.
    fn unknown(&self, name: &str, origin: ValueOrigin) -> SettingsError {
        let name = name.to_owned();
        if name.starts_with(qos::PREFIX) {
            let names = qos::names(&self.topics);
            let nearest = nearest(&name, names.iter().map(String::as_str));
            return SettingsError::Unknown { origin, name, nearest };
        }
        if let Some((cloud, part)) = name.split_once('.')
            && is_of_a_cloud(part)
            && check_token(cloud).is_ok()
            && !self.declared.iter().any(|known| known.name == format!("{cloud}.deadline"))
        {
            let flaw = SettingsFlaw::NoCloud(cloud.to_owned());
            return SettingsError::Flaw { origin, name, flaw };
        }
        let nearest = nearest(&name, self.declared.iter().map(|known| known.name.as_str()));
        SettingsError::Unknown { origin, name, nearest }
    }
}

/// Returns the line of a parameter that is read.
fn line(name: &str) -> &'static Spec {
    spec(name).unwrap_or_else(|| unreachable!("{name} is in no line of the table"))
}
