//! The command: runs the seeded faults, and makes or checks the matrix.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use clap::{Args, Parser, Subcommand};
use fuseline_evidence::{
    Campaign, CampaignSummary, EvidenceError, EvidenceKind, KINDS, MEASURES, Matrix, McdcReport,
    Tree, artefacts, core_coverage, load_faults,
};
use indicatif::{ProgressBar, ProgressStyle};

/// Seeded faults, who catches them, and the matrix of evidence.
#[derive(Parser)]
#[command(name = "evidence", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Seed faults in copies of the project, run the witnesses, and record who catches what.
    ///
    /// Results that are current are kept: an interrupted run goes on where it was.
    Faults(Faults),
    /// Measure the tests: mutants that survive, code that never runs.
    Measure(MeasureArguments),
    /// Measure modified condition/decision coverage of the core into evidence/mcdc.md of cargo's target folder, with the two tests
    /// that show each condition.
    ///
    /// It fails if a condition is neither shown nor explained in evidence/mcdc.toml.
    Mcdc {
        /// Leave out tests with this in their name.
        #[arg(long, value_name = "PART")]
        without: Vec<String>,
    },
    /// Measure which lines and branches of the core its tests reach, into evidence/coverage.md of cargo's target folder.
    ///
    /// It fails if one is neither reached nor explained in evidence/coverage.toml.
    Coverage,
    /// Write the matrix of the results into evidence/ of cargo's target folder: matrix.md, evidence.csv and evidence.json.
    ///
    /// It fails if a result is missing or older than its sources without a reason in evidence/older.toml; the files name it.
    Matrix {
        /// Write nothing; only fail as above.
        #[arg(long)]
        check: bool,
    },
}

#[derive(Args)]
struct Faults {
    /// The faults; all unless named.
    names: Vec<String>,
    /// The kinds of witness; all unless named.
    #[arg(long, value_name = "KIND")]
    kind: Vec<String>,
    /// How many copies to work on at once.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=64))]
    jobs: u8,
    /// How many seconds one run of one kind may take, building included.
    #[arg(long, value_name = "SECONDS", default_value_t = 120)]
    limit: u64,
    /// Run again what the results already say.
    #[arg(long)]
    again: bool,
}

#[derive(Args)]
struct MeasureArguments {
    /// The measurements; all unless named.
    #[arg(value_parser = MEASURES.iter().map(|measure| measure.name).collect::<Vec<_>>())]
    names: Vec<String>,
    /// How many mutants to test at once.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=64))]
    jobs: u8,
}

static STOP: AtomicBool = AtomicBool::new(false);

fn main() -> ExitCode {
    let tree = Tree::new(PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/..")));
    let done = match Cli::parse().command {
        Command::Faults(args) => faults(&tree, &args),
        Command::Measure(args) => measure(&tree, &args),
        Command::Mcdc { without } => mcdc(&tree, &without),
        Command::Coverage => coverage(&tree),
        Command::Matrix { check } => matrix(&tree, check),
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

/// Whether each condition is shown or explained.
fn mcdc(tree: &Tree, without: &[String]) -> Result<bool, EvidenceError> {
    let target = target(tree);
    let report = McdcReport::take(tree, &target.join("mcdc"), without)?;
    for file in [report.page(), report.json()] {
        println!("{}", file.save(&target)?.display());
    }
    println!("{}", report.summary());
    let gaps = report.gaps();
    for gap in &gaps {
        eprintln!("{gap}");
    }
    Ok(gaps.is_empty())
}

/// Whether each line and branch of the core is reached or explained.
fn coverage(tree: &Tree) -> Result<bool, EvidenceError> {
    let target = target(tree);
    let report = core_coverage(tree, &target)?;
    println!("{}", report.page().save(&target)?.display());
    println!("{}", report.summary());
    for line in report.wrong() {
        eprintln!("{line}");
    }
    Ok(report.wrong().is_empty())
}

/// Whether every fault is caught.
fn faults(tree: &Tree, args: &Faults) -> Result<bool, EvidenceError> {
    let mut faults = load_faults(tree)?;
    let wanted: BTreeSet<&str> = args.names.iter().map(String::as_str).collect();
    if let Some(name) = wanted.iter().find(|name| !faults.iter().any(|f| f.name == **name)) {
        return Err(EvidenceError::Seed {
            name: (*name).to_owned(),
            why: "there is none".to_owned(),
        });
    }
    faults.retain(|fault| wanted.is_empty() || wanted.contains(&*fault.name));
    let kinds: Vec<&'static EvidenceKind> = KINDS
        .iter()
        .filter(|kind| args.kind.is_empty() || args.kind.iter().any(|name| name == kind.name))
        .collect();
    // Where the system refuses a handler, Ctrl-C ends the command as it does otherwise.
    let _ = ctrlc::set_handler(|| STOP.store(true, Ordering::Release));

    let bar = ProgressBar::new(0);
    let style = ProgressStyle::with_template("{bar:30} {pos}/{len} {elapsed} {wide_msg}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    let campaign = Campaign {
        tree,
        kinds: &kinds,
        faults: &faults,
        jobs: usize::from(args.jobs),
        limit: Duration::from_secs(args.limit),
        again: args.again,
        stop: &STOP,
    };
    let summary = campaign.run(|name, done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
        bar.set_message(name.to_owned());
    });
    bar.finish_and_clear();
    Ok(report(&summary?))
}

/// Prints who caught what; whether someone caught each.
fn report(summary: &CampaignSummary) -> bool {
    let mut all = true;
    // A fault that no chosen kind could see says nothing about them.
    for (fault, kinds) in summary.iter().filter(|(_, kinds)| !kinds.is_empty()) {
        let counts: Vec<String> =
            kinds.iter().map(|(kind, by)| format!("{kind} {}", by.len())).collect();
        let caught = kinds.values().any(|by| !by.is_empty());
        all &= caught;
        println!("{} {fault}: {}", if caught { "caught" } else { "MISSED" }, counts.join(", "));
    }
    all
}

/// Takes measurements; what they leave open is for the matrix to say.
fn measure(tree: &Tree, args: &MeasureArguments) -> Result<bool, EvidenceError> {
    let is_wanted = |name: &str| args.names.is_empty() || args.names.iter().any(|n| n == name);
    for measure in MEASURES.iter().filter(|measure| is_wanted(measure.name)) {
        let measured = measure.take(tree, args.jobs)?;
        println!("{}, by {}", measure.title, measured.by);
        for (kind, count) in &measured.counts {
            println!("  {kind}: {count}");
        }
        for gap in &measured.gaps {
            println!("  {gap}");
        }
    }
    Ok(true)
}

/// Whether the matrix stands; its files are written even if it does not, for they name what is missing.
fn matrix(tree: &Tree, check: bool) -> Result<bool, EvidenceError> {
    let matrix = Matrix::build(tree)?;
    if !check {
        let target = target(tree);
        for artefact in artefacts(&matrix)? {
            println!("{}", artefact.save(&target)?.display());
        }
    }
    for line in &matrix.wrong {
        eprintln!("{line}");
    }
    Ok(matrix.wrong.is_empty())
}

/// Where cargo builds; a relative path begins at the root, whatever the working directory is.
fn target(tree: &Tree) -> PathBuf {
    tree.path(std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into()))
}
