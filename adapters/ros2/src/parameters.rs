//! Reads parameters from ROS's YAML files and from the command line.

pub(crate) mod ros;
mod sections;
pub(crate) mod services;
mod value;
mod yaml;

use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::names::{NameError, NodeName, check_token};
pub use crate::parameters::value::Value;
pub use crate::parameters::yaml::YamlError;

/// The greatest size of a file, in bytes.
const BYTES: u64 = 1 << 20;

/// A parameter that was given.
#[derive(Clone, PartialEq, Debug)]
pub struct ParameterOverride {
    /// The name, with dots.
    pub name: String,
    /// Its value.
    pub value: Value,
    /// The place where it was given.
    pub origin: ValueOrigin,
    /// `true` if it also applies to other nodes, because the file gives it under a name with a
    /// wildcard.
    pub is_shared: bool,
}

/// The origin of a value.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum ValueOrigin {
    /// It was not given.
    Default,
    /// A variable of the environment.
    Environment(&'static str),
    /// A file, with line and column from 1.
    File(PathBuf, usize, usize),
    /// The command line.
    Argument(String),
}

/// A parameter on the command line, `[node:]name:=value`.
#[derive(Clone, PartialEq, Debug)]
pub struct Assignment {
    /// The node that it is for, a name without namespace; `None` means any node.
    pub node: Option<String>,
    /// The parameter and its value.
    pub given: ParameterOverride,
}

/// The reason why a file or an assignment is refused.
#[derive(Debug, Error)]
pub enum ParameterError {
    /// The file cannot be read, or is not UTF-8.
    #[error("{path}: {source}; give a parameter file that can be read")]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The file is too large.
    #[error("{path}: the file has more than 1 MiB; give a parameter file")]
    Large {
        /// The file.
        path: PathBuf,
    },
    /// Something in the file or assignment is wrong.
    #[error("{origin}: {flaw}")]
    ParameterFlaw {
        /// The place.
        origin: ValueOrigin,
        /// The flaw.
        flaw: ParameterFlaw,
    },
}

/// A flaw of a file or an assignment.
#[derive(Clone, PartialEq, Eq, Debug, Error)]
pub enum ParameterFlaw {
    /// It is not the YAML of parameters.
    #[error(transparent)]
    Yaml(#[from] YamlError),
    /// Something other than a node's name.
    #[error("expected a node's name with ros__parameters below it")]
    Node,
    /// A node's name that can match no node.
    #[error("{name:?} is not a node's name: {source}")]
    Pattern {
        /// The name.
        name: String,
        /// The reason.
        source: NameError,
    },
    /// Something other than parameters.
    #[error("expected parameters, each as name: value")]
    Parameters,
    /// A parameter has no value.
    #[error("{0} has no value; give one, '' for an empty string")]
    Empty(String),
    /// A list of lists, of mappings, or of values of several types.
    #[error("{0} must be a list of only booleans, only integers, only numbers or only strings")]
    List(String),
    /// A mapping stands where a value belongs.
    #[error("{0} is a mapping; give each of its values as a parameter of its own")]
    Mapping(String),
    /// An assignment without name or `:=`.
    #[error("give NAME:=VALUE")]
    Shape,
}

/// Returns the parameters that files and then assignments give to a node, by name; later ones win.
/// Also returns, in a sentence each, the files and assignments that give this node nothing.
///
/// In a file, parameters under `/**` come first, then those under other names with wildcards, then
/// those under the node's own name. `*` matches one part of a name, `**` any number, as in rcl.
/// A node's name in an assignment matches in every namespace.
///
/// # Errors
/// If a file cannot be read or does not consist of nodes with parameters. Parameters of other nodes
/// are not checked.
pub fn given(
    files: &[PathBuf],
    assignments: &[Assignment],
    node: &NodeName,
) -> Result<(BTreeMap<String, ParameterOverride>, Vec<String>), ParameterError> {
    let (mut all, mut idle, full) = (BTreeMap::new(), Vec::new(), node.full());
    for path in files {
        let overrides = sections::overrides(path, &read(path)?, node)?;
        if overrides.is_empty() {
            idle.push(format!(
                "{}: no node in this file is {full}; name it, or /**",
                path.display()
            ));
        }
        all.extend(overrides.into_iter().map(|parameter| (parameter.name.clone(), parameter)));
    }
    for Assignment { node: whose, given } in assignments {
        if whose.as_ref().is_none_or(|whose| *whose == node.name) {
            all.insert(given.name.clone(), given.clone());
        } else {
            idle.push(format!("{}: is for another node; this one is {full}", given.origin));
        }
    }
    Ok((all, idle))
}

impl Assignment {
    /// Reads `[node:]name:=value` with a value in YAML; `argument` is its name in errors.
    ///
    /// # Errors
    /// If it is something else.
    pub fn parse(text: &str, argument: &str) -> Result<Self, ParameterError> {
        let origin = ValueOrigin::Argument(argument.to_owned());
        let fault = |flaw| ParameterError::ParameterFlaw { origin: origin.clone(), flaw };
        let (name, value) = text.split_once(":=").ok_or_else(|| fault(ParameterFlaw::Shape))?;
        let (node, name) = match name.split_once(':') {
            Some((node, name)) => (Some(node.to_owned()), name.to_owned()),
            None => (None, name.to_owned()),
        };
        if let Some(name) = &node {
            let flaw = |source| fault(ParameterFlaw::Pattern { name: name.clone(), source });
            check_token(name).map_err(flaw)?;
        }
        if name.is_empty() {
            return Err(fault(ParameterFlaw::Shape));
        }
        let value = match yaml::read(value).map_err(|(_, error)| fault(error.into()))? {
            Some(value) => value::read(&name, &value).map_err(|(_, flaw)| fault(flaw))?,
            None => return Err(fault(ParameterFlaw::Empty(name))),
        };
        Ok(Self { node, given: ParameterOverride { name, value, origin, is_shared: false } })
    }
}

impl fmt::Display for ValueOrigin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Default => f.write_str("default"),
            Self::Environment(variable) => f.write_str(variable),
            Self::File(path, line, column) => write!(f, "{}:{line}:{column}", path.display()),
            Self::Argument(argument) => f.write_str(argument),
        }
    }
}

fn read(path: &Path) -> Result<String, ParameterError> {
    let fault = |source| ParameterError::Read { path: path.to_owned(), source };
    let mut text = Vec::new();
    File::open(path).and_then(|file| file.take(BYTES + 1).read_to_end(&mut text)).map_err(fault)?;
    if text.len() as u64 > BYTES {
        return Err(ParameterError::Large { path: path.to_owned() });
    }
    String::from_utf8(text).map_err(|_| fault(io::Error::other("not UTF-8")))
}
