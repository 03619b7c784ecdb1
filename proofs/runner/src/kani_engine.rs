//! Runs Kani itself, where it is installed, and reads the output of its driver; see
//! `docs/book/src/verified/proofs.md`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::{Command, Stdio};

use crate::error::Error;
use crate::record::Record;
use crate::source::HarnessSources;

/// The harnesses that Kani must prove.
pub(crate) struct KaniSelection {
    /// The number of covers that each must reach, by its path.
    covers: BTreeMap<String, usize>,
    /// `true` if these are all harnesses.
    whole: bool,
}

impl KaniSelection {
    /// Selects all harnesses, or only the named ones. The record states how many covers each must
    /// reach.
    ///
    /// # Errors
    /// Returns an error if no harness has a name.
    pub(crate) fn new(
        sources: &HarnessSources,
        record: &Record,
        names: &[String],
    ) -> Result<Self, Error> {
        let harnesses = &sources.harnesses;
        for name in names {
            if !harnesses.iter().any(|harness| harness.name == *name) {
                return Err(Error::Name { kind: "harness", name: name.clone() });
            }
        }
        let chosen = harnesses.iter().filter(|of| names.is_empty() || names.contains(&of.name));
        let covers = |name: &str| record.harnesses.get(name).copied().unwrap_or(1);
        let covers = chosen.map(|harness| (harness.path(), covers(&harness.name))).collect();
        Ok(Self { covers, whole: names.is_empty() })
    }

    /// Lets Kani prove the harnesses. It does not try seeded faults, because the other engine does
    /// that.
    ///
    /// # Errors
    /// Returns an error if Kani cannot be started.
    pub(crate) fn prove(&self, tree: &Path, jobs: u8, seconds: u64) -> Result<bool, Error> {
        let mut command = Command::new("cargo");
        command.current_dir(tree).args(self.arguments(jobs, seconds));
        command.stdin(Stdio::null()).stderr(Stdio::inherit());
        let output = command.output().map_err(Error::file(Path::new("cargo")))?;
        let printed = String::from_utf8_lossy(&output.stdout);
        print!("{printed}");
        let wrong = self.judge(&printed);
        for line in &wrong {
            eprintln!("{line}");
        }
        println!("engine: kani; the seeded faults were not tried");
        Ok(output.status.success() && wrong.is_empty())
    }

    /// Returns Kani's arguments. If harnesses are named, they include `--exact`, because
    /// `--harness` alone selects by a part of the path, and `p2_never_late` is part of another
    /// harness's path.
    fn arguments(&self, jobs: u8, seconds: u64) -> Vec<String> {
        let mut arguments: Vec<String> =
            ["kani", "-p", "fuseline-proofs"].map(str::to_owned).into();
        arguments.extend(["--output-format=terse".to_owned(), format!("--jobs={jobs}")]);
        arguments
            .extend(["-Zunstable-options".to_owned(), format!("--harness-timeout={seconds}s")]);
        if !self.whole {
            arguments.push("--exact".to_owned());
            arguments.extend(self.covers.keys().map(|path| format!("--harness={path}")));
        }
        arguments
    }

    /// Returns the faults of a run. Kani's exit code does not show which harnesses it left out, or
    /// which covers it did not reach.
    fn judge(&self, printed: &str) -> Vec<String> {
        let mut wrong = Vec::new();
        let summed = printed.lines().rev().find_map(|line| line.strip_prefix("Complete - "));
        let proved = summed.and_then(|line| line.split(' ').next()?.parse::<usize>().ok());
        let expected = self.covers.len();
        if proved != Some(expected) {
            wrong.push(format!("kani proved {} harnesses of {expected}", proved.unwrap_or(0)));
        }
        let KaniOutput { proved, covers } = read(printed);
        for (path, least) in &self.covers {
            if !proved.contains(path.as_str()) {
                wrong.push(format!("kani did not prove {path}"));
            }
            let (reached, all) = covers.get(path.as_str()).copied().unwrap_or((0, 0));
            if reached != all || reached < *least {
                wrong.push(format!("{path} reached {reached} of {all} covers, and has {least}"));
            }
        }
        wrong
    }
}

/// Kani's output about each harness, by its path.
#[derive(Default)]
struct KaniOutput<'a> {
    proved: BTreeSet<&'a str>,
    /// The numbers of covers that it reached and that it has.
    covers: BTreeMap<&'a str, (usize, usize)>,
}

/// Reads the output. Several threads print in turn: each block of lines begins with `Thread 2: ` and concerns
/// the harness that this thread checks.
fn read(printed: &str) -> KaniOutput<'_> {
    let mut output = KaniOutput::default();
    let (mut thread, mut checked) = ("", BTreeMap::new());
    for line in printed.lines() {
        let of_thread = line.strip_prefix("Thread ").and_then(|line| line.split_once(": "));
        let line = match of_thread {
            Some((number, rest)) => {
                thread = number;
                rest
            }
            None => line,
        };
        let begun = line.strip_prefix("Checking harness ").and_then(|it| it.strip_suffix("..."));
        if let Some(path) = begun {
            checked.insert(thread, path);
        }
        let Some(path) = checked.get(thread).copied() else { continue };
        if line.trim_start().starts_with("VERIFICATION:- SUCCESSFUL") {
            output.proved.insert(path);
        } else if line.contains(" cover properties satisfied") {
            let mut numbers = line.split(' ').filter_map(|word| word.parse().ok());
            output.covers.extend(numbers.next().zip(numbers.next()).map(|of| (path, of)));
        }
    }
    output
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(covers: &[(&str, usize)], whole: bool) -> KaniSelection {
        let covers = covers.iter().map(|(path, covers)| ((*path).to_owned(), *covers)).collect();
        KaniSelection { covers, whole }
    }

    const SLOT: (&str, usize) = ("harness::slot::p2_never_late", 2);
    const CLOCK: (&str, usize) = ("harness::fusion::p2_never_late_by_the_clock", 1);

    /// The output of two threads.
    const PRINTED: &str = "Thread 0: Checking harness harness::slot::p2_never_late...\n\
        Thread 1: Checking harness harness::fusion::p2_never_late_by_the_clock...\n\
        Thread 0: \nVERIFICATION RESULT:\n ** 0 of 90 failed (1 unreachable)\n\n \
        ** 2 of 2 cover properties satisfied\n\n\nVERIFICATION:- SUCCESSFUL\n\
        Thread 1: \nVERIFICATION RESULT:\n ** 0 of 70 failed\n\n \
        ** 1 of 1 cover properties satisfied\n\n\nVERIFICATION:- SUCCESSFUL\n\
        Manual Harness Summary:\n\
        Complete - 2 successfully verified harnesses, 0 failures, 2 total.\n";

    #[test]
    fn fewer_harnesses_or_covers_are_wrong() {
        let both = chosen(&[SLOT, CLOCK], true);
        assert_eq!(both.judge(PRINTED), Vec::<String>::new());
        let wrong = |from, to| both.judge(&PRINTED.replace(from, to));
        assert_eq!(wrong("2 of 2 cover", "1 of 2 cover").len(), 1);
        assert_eq!(wrong("2 of 2 cover", "1 of 1 cover").len(), 1);
        assert_eq!(wrong("Thread 1: \n", "Thread 0: \n").len(), 3);
        assert_eq!(wrong("Complete - 2", "Complete - 1").len(), 1);
        assert_eq!(both.judge("No proof harnesses were found to verify.").len(), 5);
        assert_eq!(chosen(&[SLOT, (CLOCK.0, 2)], true).judge(PRINTED).len(), 1);
    }

    #[test]
    fn one_thread_prints_no_number() {
        let printed = PRINTED.replace("Thread 0: ", "").replace("Thread 1: ", "");
        let (first, second) = printed.split_once("Checking harness harness::f").unwrap();
        let (name, blocks) = second.split_once('\n').unwrap();
        let (slot, clock) = blocks.split_once("SUCCESSFUL\n").unwrap();
        let printed =
            format!("{first}{slot}SUCCESSFUL\nChecking harness harness::f{name}\n{clock}");
        assert_eq!(chosen(&[SLOT, CLOCK], true).judge(&printed), Vec::<String>::new());
    }

    #[test]
    fn named_harness_is_selected_by_its_whole_path() {
        let arguments = chosen(&[SLOT], false).arguments(2, 600);
        assert!(arguments.ends_with(&["--exact".to_owned(), format!("--harness={}", SLOT.0)]));
        let timeout = arguments.iter().position(|it| it == "--harness-timeout=600s").unwrap();
        assert_eq!(arguments[timeout - 1], "-Zunstable-options");
        assert!(!chosen(&[SLOT], true).arguments(2, 600).contains(&"--exact".to_owned()));
    }
}
