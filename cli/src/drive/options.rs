//! The options of `fuseline drive`.

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Duration;

use clap::ValueEnum;
use fuseline_testkit::VariedGenerator;
use fuseline_traces::Commit;

use super::case::MOST_CLOUDS;
use super::reach::DriveLimits;
use crate::duration::{SHORTEST, duration};
use crate::output::Overwrite;

/// The number of inputs of generated runs, unless options say otherwise.
const INPUTS: u64 = 400_000;

#[derive(clap::Args)]
#[command(after_help = "\
The command is started once. Its standard input gets a trace's header, then one input a line. After each line, even
the header, it writes its decisions, one a line, and then {\"ev\":\"done\"}. It writes nothing else to standard
output, and flushes after each answer. A further header begins the next run in the same process. When its input
ends it exits with code 0. SPEC.md defines each line; traces/examples has templates in Python and C++.

The corpus comes first. Generated runs follow until they have 400,000 inputs in all, or until the command differs.
--inputs, --cases and --for change how many there are. With --for a slow command gets fewer runs, and the verdict
says so. A difference is shown as the smallest run that has it. The verdict says how far the runs went. It names what
they did not reach, with the option that reaches it.

The same seed and number always make the same run. Its name has both: g2-1-17 is run 17 of seed 1.

--commit and --clouds are for partial implementations: drive skips the cases of the corpus that need more, and the
verdict says how many.

Exit code 0 if nothing differs; 1 on a difference, or if the command breaks the protocol; 2 if it cannot be
started, ends before it answers the first header, or Ctrl-C came before a difference.

Examples:
  fuseline drive -- fuseline impl
  fuseline drive --inputs 4000000 -- ./my-arbiter
  fuseline drive --commit eager --save found -- python3 traces/examples/arbiter.py
  fuseline drive --run found/g2-1-17.jsonl -- ./my-arbiter
  fuseline drive --junit drive.xml -- ./my-arbiter")]
pub(crate) struct Args {
    /// The number of inputs of all generated runs; 400,000 without this option, --cases and --for.
    #[arg(long, value_name = "N", conflicts_with = "cases")]
    inputs: Option<u64>,
    /// The number of generated runs after the corpus.
    #[arg(long, value_name = "N")]
    pub(super) cases: Option<u64>,
    /// The time for which generated runs are begun, such as 30s or 5m.
    #[arg(long = "for", id = "budget", value_name = "TIME", value_parser = budget)]
    budget: Option<Duration>,
    /// The seed of the generated runs.
    #[arg(long, value_name = "N", default_value = "1")]
    seed: u64,
    /// The commit rule to drive.
    #[arg(long, value_name = "RULE", default_value = "all")]
    pub(super) commit: CommitRules,
    /// The greatest number of clouds in a run, up to 15.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(..=15))]
    pub(super) clouds: Option<u8>,
    /// Give results the keys of and for, which name the message of a value and the one it is meant
    /// for. An emit must repeat the keys of the result that it sends.
    #[arg(long)]
    pub(super) values: bool,
    /// Drive these instead, in this order and one process: trace files, cases of the corpus,
    /// generated runs such as g2-1-17.
    #[arg(long, value_name = "CASE", num_args = 1..,
          conflicts_with_all = ["inputs", "cases", "budget", "seed"])]
    pub(super) run: Vec<String>,
    /// The longest time that an answer may take.
    #[arg(long, value_name = "TIME", default_value = "5s", value_parser = wait, allow_hyphen_values = true)]
    pub(super) wait: Duration,
    /// The implementation's name; the command by default.
    #[arg(long)]
    pub(super) name: Option<String>,
    /// Save the smallest run of a difference as a trace in this folder, with the earlier runs that
    /// it needs. Existing files stay: a new file gets a number.
    #[arg(long, value_name = "DIR")]
    pub(super) save: Option<PathBuf>,
    /// Print one JSON object instead of text.
    #[arg(long)]
    pub(super) json: bool,
    /// Write the results for continuous integration, as `JUnit` XML.
    #[arg(long, value_name = "FILE")]
    pub(super) junit: Option<PathBuf>,
    #[command(flatten)]
    pub(super) overwrite: Overwrite,
    /// The command and its arguments.
    #[arg(last = true, required = true)]
    pub(super) command: Vec<OsString>,
}

/// The commit rules to drive.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub(super) enum CommitRules {
    Eager,
    Patient,
    Progressive,
    All,
}

impl Args {
    /// Returns the settings that generated runs share.
    pub(super) fn generator(&self) -> VariedGenerator {
        let commit = match self.commit {
            CommitRules::Eager => Some(Commit::Eager),
            CommitRules::Patient => Some(Commit::Patient),
            CommitRules::Progressive => Some(Commit::Progressive),
            CommitRules::All => None,
        };
        let clouds = self.clouds.unwrap_or(MOST_CLOUDS);
        VariedGenerator { seed: self.seed, commit, clouds }
    }

    /// Returns the limits of generated runs.
    pub(super) fn limits(&self) -> DriveLimits {
        let is_limited = self.cases.is_some() || self.budget.is_some();
        let inputs = self.inputs.unwrap_or(if is_limited { u64::MAX } else { INPUTS });
        let (is_named, has_values) = (!self.run.is_empty(), self.values);
        DriveLimits { inputs, time: self.budget, is_named, has_values }
    }
}

fn wait(text: &str) -> Result<Duration, String> {
    duration(text, "5s", &(Duration::from_millis(1)..=Duration::from_secs(3600)))
}

fn budget(text: &str) -> Result<Duration, String> {
    duration(text, "30s", &(SHORTEST..=Duration::MAX))
}
