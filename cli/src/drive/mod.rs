//! `fuseline drive`: another implementation, driven through cases and judged.
//!
//! `case` has the runs, `peer` the process, `trial` compares its decisions with the reference machine's, `shrink` makes a
//! failing run small, and `report` shows the results.

mod case;
mod extent;
mod junit;
mod matrix;
mod peer;
mod report;
mod results;
mod shrink;
#[cfg(test)]
mod tests;
mod trial;
mod words;
mod written;

use std::ffi::OsString;
use std::fs;
use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::ValueEnum;
use fuseline_testkit::Coverage;
use fuseline_traces::Commit;
use indicatif::{HumanCount, ProgressBar, ProgressStyle};
use thiserror::Error;

use self::case::{DriveCase, Generate, Suite};
use self::extent::DrivenExtent;
use self::report::{CaseOutcome, DriveReport, ReportedFinding};
use self::shrink::{DriveFinding, FindingKind, shrink};
use self::trial::{Bench, DriveStop};
use self::written::WrittenReport;
use crate::complain::complain;
use crate::exit::Exit;
use crate::fault::{Fault, plain};
use crate::interrupt::Interrupt;
use crate::output::{self, Output};
use crate::results::Files;
use crate::schema::SchemaOption;
use crate::seconds::seconds;
use crate::sink::OutputSink;

/// How often progress is printed when there is no terminal.
const TELL: Duration = Duration::from_secs(10);
/// How long generated runs are driven, unless options say so.
const BUDGET: Duration = Duration::from_secs(30);

#[derive(clap::Args)]
#[command(after_help = "\
The command is started once. On its standard input it gets a trace's header, then one input a line;
after each line, the header too, it answers with its decisions, one a line, and then {\"ev\":\"done\"}.
A further header begins the next run. It ends, with code 0, when its input ends. The corpus comes first, then
generated runs up to the first difference, which is shown as a smallest run: for 30 seconds, unless --for or
--cases says otherwise. Every other one is wide: up to 15 clouds, priorities up to 65535, some of them over a
thousand inputs. The verdict says how far they went; nothing beyond was driven. What each line means is
in SPEC.md; traces/examples has templates in Python and C++. An answer is waited for until it is there:
flush the output after each.

Exit code 0 if nothing differs, 1 on a difference or if the command misbehaves, 2 if it cannot be
started or Ctrl-C came before a difference.

Examples:
  fuseline drive -- fuseline impl
  fuseline drive --for 5m -- ./my-arbiter
  fuseline drive --cases 10000 --save found -- python3 traces/examples/arbiter.py
  fuseline drive --run found/g-1-17.jsonl -- ./my-arbiter
  fuseline drive --junit drive.xml --matrix drive.html -- ./my-arbiter")]
pub(crate) struct Args {
    /// How many generated runs follow the corpus; else they end with --for.
    #[arg(long, value_name = "N", conflicts_with = "budget")]
    cases: Option<u64>,
    /// How long generated runs may begin, such as 30s or 5m; 30s if neither this nor --cases is given.
    #[arg(long = "for", id = "budget", value_name = "TIME", value_parser = budget)]
    budget: Option<Duration>,
    /// Decides which runs are generated.
    #[arg(long, value_name = "N", default_value = "1")]
    seed: u64,
    /// The commit rules of generated runs.
    #[arg(long, value_name = "RULE", default_value = "all")]
    commit: CommitRules,
    /// The most clouds of a generated run, up to 15; 15 in wide runs and 4 in the others if not given.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(..=15))]
    clouds: Option<u8>,
    /// Drive these instead: trace files, cases of the corpus, generated cases such as g-1-17 or w-1-17.
    #[arg(long, value_name = "CASE", num_args = 1.., conflicts_with_all = ["cases", "budget", "seed"])]
    run: Vec<String>,
    /// How long an answer may take, in seconds.
    #[arg(long, value_name = "S", default_value = "5", value_parser = wait, allow_negative_numbers = true)]
    wait: Duration,
    /// What to call the implementation; the command if not given.
    #[arg(long)]
    name: Option<String>,
    /// Save the smallest run of a difference as a trace in this folder, which is made then.
    #[arg(long, value_name = "DIR")]
    save: Option<PathBuf>,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    schema: SchemaOption,
    /// Write the results for continuous integration, as `JUnit` XML.
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    #[command(flatten)]
    results: Files,
    /// Write a table of all cases, as .md or .html; may be given for both.
    #[arg(long, value_name = "FILE", value_parser = matrix::TableWriter::new)]
    matrix: Vec<matrix::TableWriter>,
    /// The command and its arguments.
    #[arg(last = true, required = true)]
    command: Vec<OsString>,
}

/// The commit rules to drive.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
enum CommitRules {
    Eager,
    Patient,
    Progressive,
    All,
}

fn wait(text: &str) -> Result<Duration, &'static str> {
    seconds(text, 0.001..=3600.0).ok_or("it must be seconds, from 0.001 to 3600")
}

fn budget(text: &str) -> Result<Duration, &'static str> {
    let budget = humantime::parse_duration(text).ok().filter(|budget| !budget.is_zero());
    budget.ok_or("it must be above 0 with a unit, such as 30s or 5m")
}

/// Why a command cannot be driven.
#[derive(Debug, Error)]
enum CommandError {
    #[error("--save {}: a file; name a folder", .path.display())]
    NoFolder { path: PathBuf },
    #[error("{command:?}: {}; give a program that can be started", plain(.source))]
    Start { command: OsString, source: io::Error },
}

impl From<CommandError> for Fault {
    fn from(error: CommandError) -> Self {
        Self::own(error)
    }
}

/// Drives the command through all cases and reports the results.
pub(crate) fn drive(args: &Args) -> Result<Exit, Fault> {
    if let Some(exit) = args.schema.print::<WrittenReport>()? {
        return Ok(exit);
    }
    let commit = match args.commit {
        CommitRules::Eager => Some(Commit::Eager),
        CommitRules::Patient => Some(Commit::Patient),
        CommitRules::Progressive => Some(Commit::Progressive),
        CommitRules::All => None,
    };
    let generator = Generate { seed: args.seed, commit, clouds: args.clouds };
    let suite = if args.run.is_empty() {
        Suite::whole(generator, args.cases.unwrap_or(u64::MAX))?
    } else {
        Suite::of(&args.run, generator)?
    };
    if let Some(folder) = args.save.as_deref().filter(|path| path.exists() && !path.is_dir()) {
        return Err(CommandError::NoFolder { path: folder.to_owned() }.into());
    }
    let outputs = DriveOutputs::new(args, &suite)?;
    let mut driver = CaseRunner::new(args, suite);
    match driver.all() {
        Ok(()) => {}
        Err(DriveStop::Interrupted) => driver.report.was_interrupted = true,
        Err(DriveStop::Start(source)) => {
            let command = args.command.first().cloned().unwrap_or_default();
            return Err(CommandError::Start { command, source }.into());
        }
    }
    let report = driver.finish();
    for entry in &report.findings {
        if let Some(path) = &entry.saved {
            let folder = args.save.as_deref().unwrap_or(Path::new("."));
            fs::create_dir_all(folder).map_err(|source| create(folder, source))?;
            output::file(path, &[], args.results.overwrite)?;
            fs::write(path, entry.finding.reported.trace())
                .map_err(|source| create(path, source))?;
        }
    }
    if let Some(output) = &outputs.junit {
        let text = junit::xml(&report).map_err(|error| Fault::Output(io::Error::other(error)))?;
        output.write(|out| out.write_all(text.as_bytes()).map_err(Fault::Output))?;
    }
    outputs.results.write(&[results::judged(&report)])?;
    for (matrix, output) in args.matrix.iter().zip(&outputs.matrix) {
        let text = matrix.text(&report);
        output.write(|out| out.write_all(text.as_bytes()).map_err(Fault::Output))?;
    }
    let mut out = OutputSink::new(anstream::stdout());
    if args.json {
        let written = serde_json::to_writer(&mut out, &report.json()).map_err(io::Error::from);
        written.and_then(|()| writeln!(out)).map_err(Fault::Output)?;
    } else {
        report.print_report(&mut out).map_err(Fault::Output)?;
    }
    Ok(report.exit())
}

/// Where results go. None of these files is read.
struct DriveOutputs {
    junit: Option<Output>,
    results: crate::results::Outputs,
    matrix: Vec<Output>,
}

impl DriveOutputs {
    fn new(args: &Args, suite: &Suite) -> Result<Self, Fault> {
        let read: Vec<&Path> = args.run.iter().map(Path::new).collect();
        let overwrite = args.results.overwrite;
        if let Some(directory) = &args.save {
            for case in &suite.fixed {
                output::file(&smallest(directory, &case.id), &read, overwrite)?;
            }
        }
        let output = |path: &Path| Output::new(path, &read, overwrite);
        Ok(Self {
            junit: args.junit.as_deref().map(output).transpose()?,
            results: args.results.outputs(&read)?,
            matrix: args
                .matrix
                .iter()
                .map(|matrix| output(matrix.path()))
                .collect::<Result<_, _>>()?,
        })
    }
}

/// Where the smallest run of a case is saved.
fn smallest(directory: &Path, case: &str) -> PathBuf {
    directory.join(format!("{case}.jsonl"))
}

fn create(path: &Path, source: io::Error) -> Fault {
    Fault::Create { name: path.display().to_string(), source }
}

/// How telling a difference is, the most telling first: whether its case is of another rule, and how long
/// the trace is.
type DifferenceRank = (bool, usize);

/// Whether driving more cases makes sense.
enum DriveProgress {
    All,
    Enough,
}

struct CaseRunner<'a> {
    args: &'a Args,
    bench: Bench,
    bar: ProgressBar,
    since: Instant,
    /// When progress was last printed, if there is no bar.
    reported: Instant,
    report: DriveReport,
    /// How long generated runs may begin, if their number is not given.
    budget: Option<Duration>,
}

impl<'a> CaseRunner<'a> {
    fn new(args: &'a Args, suite: Suite) -> Self {
        let bench = Bench::new(args.command.clone(), args.wait, Interrupt::watch());
        let is_timed = args.run.is_empty() && args.cases.is_none();
        let budget = is_timed.then(|| args.budget.unwrap_or(BUDGET));
        let bar = if io::stderr().is_terminal() {
            let (bar, words) = if budget.is_some() {
                (ProgressBar::no_length(), "{spinner} {human_pos} runs, {elapsed}")
            } else {
                let words = "{wide_bar} {human_pos} of {human_len} runs, {eta}";
                (ProgressBar::new(suite.len()), words)
            };
            let style = ProgressStyle::with_template(words);
            bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        } else {
            ProgressBar::hidden()
        };
        let command = quoted(&args.command);
        let report = DriveReport {
            name: args.name.clone().unwrap_or_else(|| command.clone()),
            command,
            fixed: suite.fixed.iter().map(|case| (case.id.clone(), CaseOutcome::NotRun)).collect(),
            suite,
            passed: 0,
            failed: None,
            findings: Vec::new(),
            at_end: None,
            was_interrupted: false,
            inputs: 0,
            took: Duration::ZERO,
            reach: Coverage::default(),
            extent: DrivenExtent::default(),
            budget,
        };
        let now = Instant::now();
        Self { args, bench, bar, since: now, reported: now, report, budget }
    }

    /// All fixed cases, and the generated ones up to the first difference.
    fn all(&mut self) -> Result<(), DriveStop> {
        let mut first = None;
        let driven = self.fixed(&mut first);
        if let Some((_, case, finding)) = first {
            self.find(case, finding);
        }
        if let DriveProgress::Enough = driven? {
            return Ok(());
        }
        self.generated()?;
        self.report.at_end = self.bench.end()?;
        Ok(())
    }

    /// The generated cases up to the first difference, or until their time is over.
    fn generated(&mut self) -> Result<(), DriveStop> {
        for number in 0..self.report.suite.generated {
            if self.budget.is_some_and(|budget| self.since.elapsed() >= budget) {
                break;
            }
            let case = self.report.suite.case(number);
            if let Some(finding) = self.run(&case)? {
                self.report.failed = Some((case.id.clone(), CaseOutcome::of(&finding)));
                self.find(case, finding);
                break;
            }
            self.report.passed += 1;
        }
        Ok(())
    }

    /// The fixed cases; `first` becomes the difference that shows most.
    ///
    /// A command that does not answer at all is not waited for case after case.
    fn fixed(
        &mut self,
        first: &mut Option<(DifferenceRank, DriveCase, DriveFinding)>,
    ) -> Result<DriveProgress, DriveStop> {
        for (index, case) in self.report.suite.fixed.clone().into_iter().enumerate() {
            let Some(finding) = self.run(&case)? else {
                self.report.fixed[index].1 = CaseOutcome::Passes;
                continue;
            };
            self.report.fixed[index].1 = CaseOutcome::of(&finding);
            let is_slow = matches!(&finding.kind, FindingKind::Misbehaves(misbehaviour) if misbehaviour.is_slow());
            let key = (!is_telling(&case, &finding), finding.reported.events.len());
            if first.as_ref().is_none_or(|(least, _, _)| key < *least) {
                *first = Some((key, case, finding));
            }
            if is_slow {
                return Ok(DriveProgress::Enough);
            }
        }
        Ok(DriveProgress::All)
    }

    fn run(&mut self, case: &DriveCase) -> Result<Option<DriveFinding>, DriveStop> {
        let finding = DriveFinding::of(self.bench.try_run(&case.run)?);
        if finding.is_none() {
            self.report.reach.watch(&case.run);
            self.report.extent.add(&case.run);
        }
        self.bar.inc(1);
        if self.bar.is_hidden() && self.reported.elapsed() >= TELL {
            self.reported = Instant::now();
            let [so_far, all] = [self.report.runs(), self.report.suite.len()].map(HumanCount);
            match self.budget {
                Some(_) => complain(format_args!("{so_far} runs")),
                None => complain(format_args!("{so_far} of {all} runs")),
            }
        }
        self.report.inputs = self.bench.inputs;
        self.report.took = self.since.elapsed();
        Ok(finding)
    }

    /// Notes what is wrong, in a smallest run.
    fn find(&mut self, case: DriveCase, finding: DriveFinding) {
        let finding = shrink(&mut self.bench, finding);
        let saved = self.args.save.as_ref().map(|dir| smallest(dir, &case.id));
        let replay = self.replay(&case.name, saved.as_deref());
        let of = case.run.inputs.len();
        self.report.findings.push(ReportedFinding { case: case.id, of, finding, saved, replay });
    }

    /// The command line that shows it again.
    fn replay(&self, name: &str, saved: Option<&Path>) -> String {
        let mut words: Vec<OsString> = ["fuseline", "drive"].map(Into::into).into();
        if let Some(rule) = self.args.commit.to_possible_value()
            && saved.is_none()
            && self.args.commit != CommitRules::All
        {
            words.extend(["--commit".into(), rule.get_name().into()]);
        }
        if let Some(clouds) = self.args.clouds.filter(|_| saved.is_none()) {
            words.extend(["--clouds".into(), clouds.to_string().into()]);
        }
        let case = saved.map_or_else(|| name.into(), Into::into);
        words.extend(["--run".into(), case, "--".into()]);
        words.extend(self.args.command.iter().cloned());
        quoted(&words)
    }

    fn finish(mut self) -> DriveReport {
        self.bar.finish_and_clear();
        if self.budget.is_some() {
            let failed = u64::from(self.report.failed.is_some());
            self.report.suite.generated = self.report.passed + failed;
        }
        self.report
    }
}

/// Whether a case is one of the rule that it shows broken.
fn is_telling(case: &DriveCase, finding: &DriveFinding) -> bool {
    match finding.kind {
        FindingKind::Breaks(rule) => {
            case.id.split('-').next().is_some_and(|id| id.eq_ignore_ascii_case(rule.id()))
        }
        FindingKind::Misbehaves(_) => false,
    }
}

/// The words, quoted for a shell.
fn quoted(words: &[OsString]) -> String {
    let words: Vec<_> = words.iter().map(|word| word.to_string_lossy()).collect();
    let quote = |word: &str| shlex::try_quote(word).map_or_else(|_| word.into(), Into::into);
    words.iter().map(|word| quote(word)).collect::<Vec<String>>().join(" ")
}
