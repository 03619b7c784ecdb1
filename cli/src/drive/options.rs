//! The options of `fuseline drive`.

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Duration;

use clap::ValueEnum;
use fuseline_traces::Commit;

use super::case::{Generate, GeneratorVersion};
use super::matrix;
use super::reach::DriveLimits;
use crate::results::Files;
use fuseline_evaluation::duration::{SHORTEST, duration};

/// How many inputs generated runs have, unless options say otherwise.
const INPUTS: u64 = 400_000;

#[derive(clap::Args)]
#[command(after_help = "\
The command is started once. Its standard input gets a trace's header, then one input a line. After each line, the
header's too, it writes its decisions, one a line, and then {\"ev\":\"done\"}. It writes nothing else to standard
output, and flushes after each answer. A further header begins the next run in the same process. When its input
ends it exits with code 0. SPEC.md defines each line; traces/examples has templates in Python and C++.

The corpus comes first. Generated runs follow until they have 400,000 inputs in all, or differ. Options change
how many there are: --inputs, --cases, --for. With --for a slow command is driven less, and the verdict says so.
A difference is shown as a smallest run. The verdict says how far the runs went, and names the option that reaches
what they did not.

The same version, seed and number always make the same run. Their names have all three: g2-1-17 is run 17 of
seed 1 of generator 2; g-1-17 and w-1-17 are runs of generator 1.

--commit and --clouds are for implementations of a part: the cases of the corpus that need more are left out, and
the verdict says how many.

Exit code 0 if nothing differs; 1 on a difference, or if the command breaks the protocol; 2 if it cannot be
started, ends before it answers the first header, or Ctrl-C came before a difference.

Examples:
  fuseline drive -- fuseline impl
  fuseline drive --inputs 4000000 -- ./my-arbiter
  fuseline drive --commit eager --save found -- python3 traces/examples/arbiter.py
  fuseline drive --run found/g2-1-17.jsonl -- ./my-arbiter
  fuseline drive --junit drive.xml --matrix drive.html -- ./my-arbiter")]
pub(crate) struct Args {
    /// How many inputs generated runs have in all; 400,000 unless this, --cases or --for says otherwise.
    #[arg(long, value_name = "N", conflicts_with = "cases")]
    inputs: Option<u64>,
    /// How many generated runs follow the corpus.
    #[arg(long, value_name = "N")]
    pub(super) cases: Option<u64>,
    /// How long generated runs may begin, such as 30s or 5m.
    #[arg(long = "for", id = "budget", value_name = "TIME", value_parser = budget)]
    budget: Option<Duration>,
    /// Decides which runs are generated.
    #[arg(long, value_name = "N", default_value = "1")]
    seed: u64,
    /// Which generator makes the runs. Seeds of 1 keep their runs; 2 finds more.
    #[arg(long, value_name = "VERSION", default_value = "2")]
    generator: GeneratorVersion,
    /// The commit rule to drive.
    #[arg(long, value_name = "RULE", default_value = "all")]
    pub(super) commit: CommitRules,
    /// The most clouds of a run, up to 15.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(..=15))]
    pub(super) clouds: Option<u8>,
    /// Results say whose value they bring and for which message it is meant, by the keys of and for, and an emit must say what the
    /// result that it sends said.
    #[arg(long)]
    pub(super) values: bool,
    /// Drive these instead, in this order and one process: trace files, cases of the corpus, generated runs such as
    /// g2-1-17.
    #[arg(long, value_name = "CASE", num_args = 1..,
          conflicts_with_all = ["inputs", "cases", "budget", "seed", "generator"])]
    pub(super) run: Vec<String>,
    /// How long an answer may take.
    #[arg(long, value_name = "TIME", default_value = "5s", value_parser = wait, allow_hyphen_values = true)]
    pub(super) wait: Duration,
    /// What to call the implementation; the command if not given.
    #[arg(long)]
    pub(super) name: Option<String>,
    /// Save the smallest run of a difference as a trace in this folder, with the runs before it that it needs. Files
    /// that are there stay: a new one gets a number.
    #[arg(long, value_name = "DIR")]
    pub(super) save: Option<PathBuf>,
    /// Print one JSON object instead of text.
    #[arg(long)]
    pub(super) json: bool,
    /// Write the results for continuous integration, as `JUnit` XML.
    #[arg(long, value_name = "FILE")]
    pub(super) junit: Option<PathBuf>,
    #[command(flatten)]
    pub(super) results: Files,
    /// Write a table of all cases, as .md or .html; may be given for both.
    #[arg(long, value_name = "FILE", value_parser = matrix::TableWriter::new)]
    pub(super) matrix: Vec<matrix::TableWriter>,
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
    /// What generated runs have in common.
    pub(super) const fn generate(&self) -> Generate {
        let commit = match self.commit {
            CommitRules::Eager => Some(Commit::Eager),
            CommitRules::Patient => Some(Commit::Patient),
            CommitRules::Progressive => Some(Commit::Progressive),
            CommitRules::All => None,
        };
        Generate { version: self.generator, seed: self.seed, commit, clouds: self.clouds }
    }

    /// What limits generated runs.
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
