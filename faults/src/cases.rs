//! Cases of misuse of a program: how it is called, and what it then says.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use crate::error::FaultsError;
use crate::kind::WitnessKind;
use crate::schemata::VARIABLE;
use crate::tree::Tree;
use crate::work::{FaultyCopy, Trial, WitnessRun};

/// One case in each line: the interface, the input, what happens, the exit code, a part of the
/// message, and the arguments after any variables.
const CASES: &str = "docs/safety/misuse-commands";
/// The interfaces that are programs, with their programs, and the arguments with which each call
/// begins.
pub(crate) const INTERFACES: [(&str, &str, &str); 2] = [
    ("command", "fuseline", ""),
    (
        "ros2",
        "fuseline-ros2",
        "--check --ros-args -p input.type:=sensor_msgs/msg/Image -p output.type:=vision_msgs/msg/Detection2DArray",
    ),
];

/// A case of a program.
pub(crate) struct ProgramCase {
    pub(crate) name: String,
    pub(crate) code: i32,
    pub(crate) said: String,
    pub(crate) words: Vec<String>,
    pub(crate) variables: Vec<(String, String)>,
}

impl FaultyCopy<'_> {
    /// Calls a program in the cases of misuse of an interface, or in one of them.
    pub(crate) fn run_cases(
        &self,
        kind: &WitnessKind,
        place: &(PathBuf, PathBuf),
        (trial, begin): (Trial, Instant),
        log: &Path,
        seen: &mut WitnessRun,
    ) -> Result<(), FaultsError> {
        let interface = kind.interface().unwrap_or_default();
        for of_interface in of_interface(&self.copy, interface)? {
            if trial.case.is_none_or(|case| case == of_interface.name) {
                let mut command = of_interface.command(&place.0, self.copy.root());
                command.env(VARIABLE, trial.fault.0.to_string());
                let left = trial.limit.saturating_sub(begin.elapsed());
                let (printed, code) = self.print(&mut command, left, &|_| false, log)?;
                let holds = of_interface.happens(code, &printed);
                seen.outcomes.insert(format!("{interface}::{}", of_interface.name), holds);
            }
        }
        // A case may have overwritten a file that it should not.
        self.restore("traces/corpus")
    }

    /// Restores a folder of the copy from the project.
    fn restore(&self, folder: &str) -> Result<(), FaultsError> {
        for name in self.tree.files(&[folder])? {
            let (from, to) = (self.tree.path(&name), self.copy.path(&name));
            let whole = fs::read(&from).map_err(FaultsError::file(&from))?;
            if fs::read(&to).map_or(true, |there| there != whole) {
                fs::write(&to, whole).map_err(FaultsError::file(&to))?;
            }
        }
        Ok(())
    }
}

/// Returns the cases of an interface.
///
/// # Errors
/// Returns an error if the list of cases cannot be read.
pub(crate) fn of_interface(tree: &Tree, interface: &str) -> Result<Vec<ProgramCase>, FaultsError> {
    let options =
        INTERFACES.iter().find(|(name, _, _)| *name == interface).map_or("", |(_, _, it)| it);
    let text = tree.text(CASES)?;
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let fields = lines.map(|line| line.splitn(6, '|').map(str::trim).collect::<Vec<_>>());
    let mut cases = Vec::new();
    for of_case in fields.filter(|fields| fields.first() == Some(&interface)) {
        let wrong = || FaultsError::content(&tree.path(CASES), format!("no case: {of_case:?}"));
        let [_, name, _, code, said, arguments] = of_case[..] else { return Err(wrong()) };
        let words = shlex::split(arguments).ok_or_else(wrong)?;
        let is_variable =
            |word: &&String| word.split_once('=').is_some_and(|(name, _)| is_name(name));
        let count = words.iter().take_while(is_variable).count();
        let variables = words[..count].iter().filter_map(|word| word.split_once('='));
        cases.push(ProgramCase {
            name: name.to_owned(),
            code: code.parse().map_err(|_| wrong())?,
            said: said.to_owned(),
            variables: variables.map(|(name, value)| (name.into(), value.into())).collect(),
            words: options
                .split_whitespace()
                .map(str::to_owned)
                .chain(words[count..].to_vec())
                .collect(),
        });
    }
    Ok(cases)
}

fn is_name(word: &str) -> bool {
    !word.is_empty() && word.bytes().all(|byte| byte.is_ascii_uppercase() || byte == b'_')
}

impl ProgramCase {
    /// Returns the command that calls the program in this case, with no input.
    pub(crate) fn command(&self, program: &Path, folder: &Path) -> Command {
        let mut command = Command::new(program);
        command.args(&self.words).current_dir(folder).stdin(Stdio::null());
        for (name, _) in std::env::vars_os() {
            if ["ROS_", "RMW_"].iter().any(|it| name.to_string_lossy().starts_with(it)) {
                command.env_remove(name);
            }
        }
        command.envs(self.variables.iter().map(|(name, value)| (name, value)));
        command
    }

    /// Returns `true` if the program ended as this case should.
    pub(crate) fn happens(&self, code: Option<i32>, printed: &str) -> bool {
        code == Some(self.code) && printed.contains(&self.said)
    }
}

/// Calls the programs of a folder in each case. Returns how many ended as they should, and how many
/// there are.
///
/// # Errors
/// Returns an error if the cases cannot be read, or a program cannot be started.
pub fn try_all(tree: &Tree, programs: &Path) -> Result<(usize, usize), FaultsError> {
    let (mut held, mut all) = (0, 0);
    for (interface, program, _) in INTERFACES {
        for case in of_interface(tree, interface)? {
            let program = programs.join(program);
            let ended = case.command(&program, tree.root()).output();
            let ended = ended.map_err(FaultsError::file(&program))?;
            let printed = [ended.stdout, ended.stderr].concat();
            let printed = String::from_utf8_lossy(&printed);
            all += 1;
            if case.happens(ended.status.code(), &printed) {
                held += 1;
            } else {
                eprintln!("{interface}, {}: {} and\n{printed}", case.name, ended.status);
            }
        }
    }
    Ok((held, all))
}
