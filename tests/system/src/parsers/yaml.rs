//! ROS parameter files, up to the node's settings.

use std::path::Path;

use fuseline_ros2::arguments::{Action, Arguments};
use fuseline_ros2::names::NodeName;
use fuseline_ros2::parameters::{
    Assignment, ParameterError, ParameterOverride, Value, ValueOrigin, given,
};
use fuseline_ros2::settings::SettingsError;
use fuseline_ros2::{Settings, settings};

use crate::parsers::held::as_file;
use crate::parsers::{Ends, ParserResult, fit};

pub(super) const ENDS: &[&str] = &["no parameters", "parameters", "no settings", "settings"];

/// Checks any bytes as a parameter file.
pub(super) fn check(bytes: &[u8], ends: &mut Ends) -> ParserResult {
    as_file(bytes, |path| file(path, bytes.len(), ends)).map_err(|error| error.to_string())?
}

fn file(path: &Path, len: usize, ends: &mut Ends) -> ParserResult {
    let files = vec![path.to_owned()];
    let node = NodeName { namespace: "/".to_owned(), name: "fuseline".to_owned() };
    match given(&files, &[], &node) {
        Ok((all, _)) => {
            ends.insert("parameters");
            all.values().try_for_each(|given| parameter(given, len))?;
        }
        Err(error) => {
            ends.insert("no parameters");
            return refused(&error, len);
        }
    }
    let arguments = Arguments {
        action: Action::Check,
        remaps: Vec::new(),
        files,
        assignments: Vec::new(),
        log_levels: Vec::new(),
        rosout: true,
    };
    match Settings::from(&arguments, |_| None) {
        Ok(settings) => {
            ends.insert("settings");
            settings.declared.iter().try_for_each(|it: &settings::Parameter| shown(&it.value))
        }
        Err(SettingsError::Parameter(error)) => Err(format!("read once, and not twice: {error}")),
        Err(error) => {
            ends.insert("no settings");
            fit(&error.to_string())
        }
    }
}

fn parameter(given: &ParameterOverride, len: usize) -> ParserResult {
    placed(&given.origin, len)?;
    shown(&given.value)
}

/// Checks that a value is shown as YAML that gives the same value.
fn shown(value: &Value) -> ParserResult {
    let text = format!("a:={value}");
    fit(&text)?;
    let again = Assignment::parse(&text, "-p").map(|assignment| assignment.given.value);
    match again {
        Ok(again) if is_same(&again, value) => Ok(()),
        again => Err(format!("{value:?} is shown as {value} and read as {again:?}")),
    }
}

/// Compares numbers by their bits, except that all NaNs are the same.
fn is_same(a: &Value, b: &Value) -> bool {
    let same = |a: f64, b: f64| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan();
    match (a, b) {
        (Value::Double(a), Value::Double(b)) => same(*a, *b),
        (Value::Doubles(a), Value::Doubles(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(*a, *b))
        }
        (Value::Strings(strings), empty) | (empty, Value::Strings(strings))
            if strings.is_empty() =>
        {
            // An empty list has no type.
            empty.to_string() == "[]"
        }
        (a, b) => a == b,
    }
}

fn refused(error: &ParameterError, len: usize) -> ParserResult {
    if let ParameterError::ParameterFlaw { origin, .. } = error {
        placed(origin, len)?;
    }
    fit(&error.to_string())
}

/// Checks that an origin is in the file or directly behind its end.
fn placed(origin: &ValueOrigin, len: usize) -> ParserResult {
    match origin {
        ValueOrigin::File(_, line, column)
            if (1..=len + 1).contains(line) && (1..=len + 1).contains(column) =>
        {
            Ok(())
        }
        origin => Err(format!("{origin} is not in a file of {len} bytes")),
    }
}
