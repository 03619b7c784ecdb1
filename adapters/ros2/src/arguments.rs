//! Reads the node's command line, with ROS 2's arguments in it.

use std::ffi::OsString;
use std::path::PathBuf;
use std::str::FromStr;

use thiserror::Error;

use crate::names::{Remap, RemapError};
use crate::parameters::{Assignment, ParameterError};

/// The text of `--help`.
pub const HELP: &str = "\
Adds cloud assistance to a ROS 2 graph: forwards one result for each message, the best that has
come by its deadline.

Usage: fuseline-ros2 [OPTION]... [--ros-args [ROS ARGUMENT]... [--]]...

Options:
      --check    Print the resolved settings, or what the start would refuse, and exit
  -h, --help     Print this and exit
  -V, --version  Print the version and exit

ROS arguments:
  -r, --remap [NODE:]FROM:=TO       Rename a topic, the node (__node) or its namespace (__ns)
  -p, --param [NODE:]NAME:=VALUE    Set a parameter; the value is YAML
      --params-file FILE            Set the parameters in a file; -p and later files win
      --log-level [LOGGER:=]LEVEL   debug, info, warn, error or fatal
      --enable-rosout-logs, --disable-rosout-logs
                                    Publish logs too, or do not; the default is to publish

Exit codes:
    0  done, or ended by a signal
    1  the network or the system refuses; the log says what
    2  bad arguments or settings; one line says what, and nothing was started
  130  ended by a second signal
";

/// The node's command line.
#[derive(Clone, PartialEq, Debug)]
pub struct Arguments {
    /// The action to take.
    pub action: Action,
    /// The remapping rules, in order.
    pub remaps: Vec<Remap>,
    /// The parameter files, in order.
    pub files: Vec<PathBuf>,
    /// The parameters, in order.
    pub assignments: Vec<Assignment>,
    /// The levels and the loggers that they are for, in order; `None` means all loggers.
    pub log_levels: Vec<(Option<String>, Level)>,
    /// `true` if logs are also published.
    pub rosout: bool,
}

/// The action that the command line asks for.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Action {
    /// Run the node.
    Run,
    /// Print the settings.
    Check,
    /// Print [`HELP`].
    Help,
    /// Print the version.
    Version,
}

/// The least severe level that is logged.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Level {
    /// Debug and above: everything.
    Debug,
    /// Info and above.
    Info,
    /// Warnings and above.
    Warn,
    /// Errors and above.
    Error,
    /// Only what ends the node.
    Fatal,
}

/// The reason why the command line is refused.
#[derive(Debug, Error)]
pub enum ArgumentError {
    /// There is no such option.
    #[error(
        "{0}: there is no such option; use --check, --help or --version, and put ROS arguments \
        after --ros-args"
    )]
    Option(String),
    /// There is no such ROS argument.
    #[error("{0}: there is no such ROS argument; use -r, -p, --params-file or --log-level")]
    RosArgument(String),
    /// An argument's value is missing.
    #[error("{0}: its value is missing; give {1}")]
    Value(String, &'static str),
    /// An argument is not UTF-8.
    #[error("{0:?}: not UTF-8; use a name that is")]
    Text(OsString),
    /// A remapping rule cannot be read.
    #[error("{argument}: {source}")]
    Remap {
        /// The argument.
        argument: String,
        /// The reason.
        source: RemapError,
    },
    /// A parameter cannot be read.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// There is no such level.
    #[error("{0}: there is no such level; use debug, info, warn, error or fatal")]
    Level(String),
}

impl Arguments {
    /// Reads the arguments, without the program's name.
    ///
    /// # Errors
    /// Returns the first bad argument, unless `--help` or `--version` comes before it.
    pub fn parse(args: impl IntoIterator<Item = OsString>) -> Result<Self, ArgumentError> {
        let mut args = args.into_iter().map(|arg| arg.into_string().map_err(ArgumentError::Text));
        let mut all = Self {
            action: Action::Run,
            remaps: Vec::new(),
            files: Vec::new(),
            assignments: Vec::new(),
            log_levels: Vec::new(),
            rosout: true,
        };
        let mut is_ros = false;
        while let Some(arg) = args.next().transpose()? {
            match arg.as_str() {
                "--ros-args" => is_ros = true,
                "--" if is_ros => is_ros = false,
                _ if is_ros => all.ros_argument(arg, || args.next().transpose())?,
                "--check" => all.action = Action::Check,
                "--help" | "-h" => return Ok(Self { action: Action::Help, ..all }),
                "--version" | "-V" => return Ok(Self { action: Action::Version, ..all }),
                _ => return Err(ArgumentError::Option(arg)),
            }
        }
        Ok(all)
    }

    /// Takes one ROS argument, and its value from `next`.
    fn ros_argument(
        &mut self,
        arg: String,
        mut next: impl FnMut() -> Result<Option<String>, ArgumentError>,
    ) -> Result<(), ArgumentError> {
        let mut value = |expected| match next()? {
            Some(value) if value != "--" && value != "--ros-args" => {
                Ok((format!("{arg} {value}"), value))
            }
            Some(_) | None => Err(ArgumentError::Value(arg.clone(), expected)),
        };
        match arg.as_str() {
            "-r" | "--remap" => {
                let (argument, rule) = value("FROM:=TO")?;
                let rule = rule.parse();
                self.remaps.push(rule.map_err(|source| ArgumentError::Remap { argument, source })?);
            }
            "-p" | "--param" => {
                let (argument, assignment) = value("NAME:=VALUE")?;
                self.assignments.push(Assignment::parse(&assignment, &argument)?);
            }
            "--params-file" => self.files.push(value("a parameter file")?.1.into()),
            "--log-level" => {
                let (argument, level) = value("a level")?;
                let (logger, level) = match level.split_once(":=") {
                    Some((logger, level)) => (Some(logger.to_owned()), level),
                    None => (None, level.as_str()),
                };
                let level = level.parse().map_err(|()| ArgumentError::Level(argument))?;
                self.log_levels.push((logger, level));
            }
            "--enable-rosout-logs" => self.rosout = true,
            "--disable-rosout-logs" => self.rosout = false,
            // Launch files made for other nodes have these. The log on standard error stays on.
            "--enable-stdout-logs"
            | "--disable-stdout-logs"
            | "--enable-external-lib-logs"
            | "--disable-external-lib-logs" => {}
            _ => return Err(ArgumentError::RosArgument(arg)),
        }
        Ok(())
    }
}

impl FromStr for Level {
    type Err = ();

    /// Reads a level as rcl does, in upper or lower case.
    fn from_str(name: &str) -> Result<Self, ()> {
        let levels = [
            ("debug", Self::Debug),
            ("info", Self::Info),
            ("warn", Self::Warn),
            ("error", Self::Error),
            ("fatal", Self::Fatal),
        ];
        let level = levels.into_iter().find(|(other, _)| other.eq_ignore_ascii_case(name));
        level.map(|(_, level)| level).ok_or(())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::names::RemapRule;
    use crate::parameters::Value;

    fn parse(args: &[&str]) -> Result<Arguments, ArgumentError> {
        Arguments::parse(args.iter().map(OsString::from))
    }

    #[test]
    fn several_groups_of_ros_arguments_are_taken_in_order() {
        let args = [
            "--ros-args",
            "-r",
            "input:=/image",
            "--params-file",
            "a.yaml",
            "--",
            "--check",
            "--ros-args",
            "-p",
            "front:window:=4",
            "--remap",
            "__ns:=/car",
            "--log-level",
            "WARN",
            "--log-level",
            "front:=debug",
            "--disable-rosout-logs",
            "--enable-stdout-logs",
            "--params-file",
            "b.yaml",
            "--param",
            "clouds:=[west, east]",
        ];
        let all = parse(&args).unwrap();
        assert_eq!(all.action, Action::Check);
        let rules: Vec<_> = all.remaps.iter().map(|remap| remap.rule.clone()).collect();
        let topic = RemapRule::Topic("input".to_owned(), "/image".to_owned());
        assert_eq!(rules, [topic, RemapRule::Namespace("/car".to_owned())]);
        assert_eq!(all.files, [PathBuf::from("a.yaml"), PathBuf::from("b.yaml")]);
        assert_eq!(all.assignments[0].node.as_deref(), Some("front"));
        assert_eq!(all.assignments[0].given.value, Value::Integer(4));
        let clouds = Value::Strings(vec!["west".to_owned(), "east".to_owned()]);
        assert_eq!(all.assignments[1].given.value, clouds);
        assert_eq!(all.log_levels, [(None, Level::Warn), (Some("front".to_owned()), Level::Debug)]);
        assert!(!all.rosout);
    }

    #[test]
    fn help_and_version_come_before_what_is_wrong_after_them() {
        assert_eq!(parse(&[]).unwrap().action, Action::Run);
        assert_eq!(parse(&["-h", "--no"]).unwrap().action, Action::Help);
        assert_eq!(parse(&["--version", "--no"]).unwrap().action, Action::Version);
    }

    #[test]
    fn what_is_wrong_is_reported_with_the_argument() {
        let cases: [(&[&str], &str); 13] = [
            (
                &["input:=/image"],
                "input:=/image: there is no such option; use --check, --help or --version, and \
                 put ROS arguments after --ros-args",
            ),
            (
                &["--ros-args", "--enclave", "/a"],
                "--enclave: there is no such ROS argument; use -r, -p, --params-file or \
                 --log-level",
            ),
            (&["--ros-args", "-r"], "-r: its value is missing; give FROM:=TO"),
            (&["--ros-args", "-p", "--"], "-p: its value is missing; give NAME:=VALUE"),
            (
                &["--ros-args", "--params-file", "--ros-args"],
                "--params-file: its value is missing; give a parameter file",
            ),
            (&["--ros-args", "-r", "input"], "-r input: give FROM:=TO"),
            (&["--ros-args", "-p", "window"], "-p window: give NAME:=VALUE"),
            (&["--ros-args", "-p", ":=1"], "-p :=1: give NAME:=VALUE"),
            (
                &["--ros-args", "-p", "/a:window:=1"],
                "-p /a:window:=1: \"/a\" is not a node's name: '/' is not a letter, digit or \
                 underscore",
            ),
            (
                &["--ros-args", "-p", "trace.file:="],
                "-p trace.file:=: trace.file has no value; give one, '' for an empty string",
            ),
            (
                &["--ros-args", "-p", "clouds:=[a, 1]"],
                "-p clouds:=[a, 1]: clouds must be a list of only booleans, only integers, only \
                 numbers or only strings",
            ),
            (
                &["--ros-args", "-p", "clouds:={a: 1}"],
                "-p clouds:={a: 1}: clouds is a mapping; give each of its values as a parameter of \
                 its own",
            ),
            (
                &["--ros-args", "--log-level", "a:=loud"],
                "--log-level a:=loud: there is no such level; use debug, info, warn, error or \
                 fatal",
            ),
        ];
        for (args, error) in cases {
            assert_eq!(parse(args).unwrap_err().to_string(), error);
        }
    }

    #[cfg(unix)]
    #[test]
    fn an_argument_that_is_no_text_is_refused() {
        use std::os::unix::ffi::OsStringExt;
        let error = Arguments::parse([OsString::from_vec(vec![b'a', 0xff])]).unwrap_err();
        assert_eq!(error.to_string(), "\"a\\xFF\": not UTF-8; use a name that is");
    }

    proptest! {
        #[test]
        fn any_arguments_are_read_or_refused(
            args: Vec<String>,
            texts in "[a:=/_\\[\\]{}'1]{0,12}",
        ) {
            drop(parse(&args.iter().map(String::as_str).collect::<Vec<_>>()));
            drop(parse(&["--ros-args", "-p", &texts]));
            drop(parse(&["--ros-args", "-r", &texts]));
        }
    }
}
