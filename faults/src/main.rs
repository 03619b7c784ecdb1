//! The command that seeds the faults and prints the evidence for each promise.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Command as Process, ExitCode};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use clap::{Args, Parser, Subcommand};
use fuseline_faults::{
    Campaign, CampaignFindings, FaultsError, McdcReport, SeededFault, Table, Tier, Tree, can_share,
    expected, kinds, load_faults, load_guards, try_cases, write,
};
use rustix::fs::{FlockOperation, flock};

/// Seeds faults in a copy of the project and says which witnesses catch them.
#[derive(Parser)]
#[command(name = "fuseline-faults", version, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Runs the witnesses under the faults, and writes the table of promises into faults/ of
    /// cargo's target folder.
    ///
    /// It exits with 1 if nothing catches a fault, or a promise has too few faults or witnesses.
    Run(RunArguments),
    /// Lists the faults: their names, what they break, where they are.
    List {
        /// Also writes the table of promises, without witnesses.
        #[arg(long)]
        table: bool,
    },
    /// Calls the programs in each case of docs/safety/misuse-commands, which must end as it says
    /// there.
    Misuse {
        /// The folder of the programs.
        programs: PathBuf,
    },
    /// Measures modified condition/decision coverage of the core and of the C interface, with the
    /// two tests that show each condition.
    ///
    /// It exits with 1 if a condition is neither shown nor explained in faults/mcdc.toml.
    Mcdc {
        /// Leaves out tests with this in their name.
        #[arg(long, value_name = "PART")]
        without: Vec<String>,
    },
}

#[derive(Args)]
struct RunArguments {
    /// The faults; those of the tier unless named.
    names: Vec<String>,
    /// `landing` has the faults of core, judges and threads; `full` has all.
    #[arg(long, value_enum, default_value_t = Tier::Landing)]
    tier: Tier,
    /// The kinds of witness; all unless named. With some alone nobody says what is missing.
    #[arg(long, value_name = "KIND")]
    kind: Vec<String>,
    /// Runs a drawn tenth if nothing that the outcome depends on differs from this commit; the
    /// variable `FUSELINE_BASE` names it too.
    #[arg(long, value_name = "COMMIT")]
    base: Option<String>,
    /// The number of witnesses that run at once.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=64))]
    jobs: u8,
    /// Runs every kind that could see a fault, and not only until two have caught it.
    #[arg(long)]
    thorough: bool,
    /// Prints each run as it ends.
    #[arg(long)]
    verbose: bool,
}

static STOP: AtomicBool = AtomicBool::new(false);

fn main() -> ExitCode {
    let tree = Tree::new(PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/..")));
    // A relative path begins at the root, whatever the working directory is.
    let target = tree.path(std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into()));
    let done = match Cli::parse().command {
        Command::Run(args) => run(&tree, &target, &args),
        Command::List { table } => list(&tree, &target, table),
        Command::Misuse { programs } => misuse(&tree, &programs),
        Command::Mcdc { without } => mcdc(&tree, &target, &without),
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

fn all_faults(tree: &Tree) -> Result<Vec<SeededFault>, FaultsError> {
    let mut faults = load_faults(tree)?;
    faults.extend(load_guards(tree)?);
    Ok(faults)
}

/// Runs the chosen faults, and saves and prints the table. Returns `true` if at least one fault ran
/// and nothing is wrong. A run of chosen kinds counts nothing as wrong.
fn run(tree: &Tree, target: &Path, args: &RunArguments) -> Result<bool, FaultsError> {
    let faults = all_faults(tree)?;
    let chosen = chosen(tree, &faults, args)?;
    let _lock = lock(target, "faults/tree")?;
    let why = |why| FaultsError::Seed { name: args.kind.join(", "), why };
    let mut kinds = kinds(&args.kind).map_err(why)?;
    if args.kind.is_empty() && args.names.is_empty() {
        kinds.retain(|kind| args.tier.runs(kind));
    }
    // If the system refuses a handler, Ctrl-C ends the command in the usual way.
    let _ = ctrlc::set_handler(|| STOP.store(true, Ordering::Release));
    let begin = Instant::now();
    let campaign = Campaign {
        tree,
        target: target.to_owned(),
        kinds: &kinds,
        faults: &faults,
        chosen: &chosen,
        expected: &expected(tree)?,
        thorough: args.thorough,
        jobs: usize::from(args.jobs),
        stop: &STOP,
    };
    let findings = campaign.run(|step| {
        if args.verbose || !step.ends_with(" s") {
            eprintln!("[{:4.0} s] {step}", begin.elapsed().as_secs_f64());
        }
    })?;
    let table = Table::build(tree, &faults, &findings)?;
    save(target, &table)?;
    print!("{}", table.text());
    let apart = findings.faults.values().filter(|caught| caught.own_build.is_some()).count();
    println!(
        "{} of {} faults in {:.0} s, {apart} in builds of their own; {} are caught by one kind alone",
        findings.faults.len(),
        faults.len(),
        begin.elapsed().as_secs_f64(),
        table.single.len()
    );
    // A user who selected some kinds knows that the others are missing.
    let wrong = table.wrong.iter().filter(|_| args.kind.is_empty());
    let count = wrong.inspect(|line| eprintln!("{line}")).count();
    Ok(count == 0 && !findings.faults.is_empty())
}

/// Returns the names of the faults that are to run.
fn chosen(
    tree: &Tree,
    faults: &[SeededFault],
    args: &RunArguments,
) -> Result<BTreeSet<String>, FaultsError> {
    if let Some(name) = args.names.iter().find(|name| !faults.iter().any(|it| it.name == **name)) {
        let why = "there is none; `list` prints all".to_owned();
        return Err(FaultsError::Seed { name: name.clone(), why });
    }
    if !args.names.is_empty() {
        return Ok(args.names.iter().cloned().collect());
    }
    let of_tier = faults.iter().filter(|fault| args.tier.has(fault));
    let mut names: Vec<String> = of_tier.map(|fault| fault.name.clone()).collect();
    let base = args.base.clone().or_else(|| std::env::var("FUSELINE_BASE").ok());
    if let Some(base) = base.filter(|base| !base.is_empty())
        && is_same(tree, &base)?
    {
        fastrand::shuffle(&mut names);
        names.truncate(names.len().div_ceil(10));
        println!("drawn, since sources and witnesses are those of {base}: {}", names.join(", "));
    }
    Ok(names.into_iter().collect())
}

/// Returns `true` if everything that the outcome depends on is the same as in this commit.
fn is_same(tree: &Tree, base: &str) -> Result<bool, FaultsError> {
    const SOURCES: [&str; 12] = [
        "core",
        "traces",
        "adapters/threads",
        "adapters/engine",
        "testkit",
        "models",
        "proofs/src",
        "proofs/tests",
        "proofs/kani",
        "tests",
        "fuzz/seeds",
        "faults",
    ];
    let mut git = Process::new("git");
    git.args(["diff", "--quiet", base, "--"])
        .args(SOURCES)
        .args(["SPEC.md", "Cargo.lock", "Cargo.toml"])
        .current_dir(tree.root());
    let ended = git.status().map_err(|source| FaultsError::File { path: "git".into(), source })?;
    match ended.code() {
        Some(0) => Ok(true),
        Some(1) => Ok(false),
        _ => Err(FaultsError::Content {
            path: base.into(),
            why: "git knows no such commit".to_owned(),
        }),
    }
}

fn list(tree: &Tree, target: &Path, table: bool) -> Result<bool, FaultsError> {
    let faults = all_faults(tree)?;
    for fault in &faults {
        let place = fault.function.as_ref().map_or(&fault.file, |function| &function.path);
        let breaks: Vec<&str> = fault.breaks.iter().map(String::as_str).collect();
        let build = if can_share(fault) { "" } else { ", own build" };
        let what = match &fault.case {
            Some(_) => "removes a guard".to_owned(),
            None => format!("breaks {}", breaks.join(" ")),
        };
        // If this fails, the reader has read enough.
        let _ = writeln!(io::stdout(), "{} {what} in {place}{build}", fault.name);
    }
    if table {
        save(target, &Table::build(tree, &faults, &CampaignFindings::default())?)?;
    }
    Ok(true)
}

fn save(target: &Path, table: &Table) -> Result<(), FaultsError> {
    write(&target.join("faults/table.md"), &table.page())?;
    write(&target.join("faults/table.json"), &table.json())
}

/// Runs all cases of misuse, and returns `true` if each ends as it should.
fn misuse(tree: &Tree, programs: &Path) -> Result<bool, FaultsError> {
    let (held, all) = try_cases(tree, programs)?;
    println!("{held} of {all} cases of misuse are refused or reported");
    Ok(held == all && all > 0)
}

/// Waits for other runs in this target folder. If the last run had another copy of the sources,
/// this run makes its copy from scratch. Cargo compares times, so it would take programs of the
/// other copy for its own.
fn lock(target: &Path, copy: &str) -> Result<File, FaultsError> {
    let (path, copied) = (target.join("faults/lock"), target.join(copy));
    let wrong = |source| FaultsError::File { path: path.clone(), source };
    fs::create_dir_all(target.join("faults")).map_err(wrong)?;
    let file = File::options().create(true).append(true).open(&path).map_err(wrong)?;
    if flock(&file, FlockOperation::NonBlockingLockExclusive).is_err() {
        eprintln!("waiting for another run in {}", target.display());
        flock(&file, FlockOperation::LockExclusive).map_err(|error| wrong(error.into()))?;
    }
    if fs::read_to_string(&path).map_err(wrong)? != copy {
        if copied.exists() {
            fs::remove_dir_all(&copied)
                .map_err(|source| FaultsError::File { path: copied, source })?;
        }
        write(&path, copy)?;
    }
    Ok(file)
}

/// Measures the conditions and saves the report. Returns `true` if it has no gap.
fn mcdc(tree: &Tree, target: &Path, without: &[String]) -> Result<bool, FaultsError> {
    let _lock = lock(target, "mcdc/copy")?;
    let report = McdcReport::take(tree, target, without)?;
    write(&target.join("faults/mcdc.md"), &report.page())?;
    write(&target.join("faults/mcdc.json"), &report.json())?;
    println!("{}", report.summary());
    let gaps = report.gaps();
    for gap in &gaps {
        eprintln!("{gap}");
    }
    Ok(gaps.is_empty())
}
