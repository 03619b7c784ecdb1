//! `fuseline-simulate`: plays the seeds that ever failed, then fresh seeds for a while, or plays
//! one seed again.
//!
//! It prints what does not hold, with the seed. The library's `simulate` plays the runs and checks
//! them.

use std::io::{self, IsTerminal, Write as _};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use clap::Parser;
use fuseline_system_tests::judge::Finding;
use fuseline_system_tests::simulate::{
    KeptSeed, Scenario, Simulated, Simulator, graph_findings, saved_seeds, server_findings,
};
use fuseline_testkit::Rng;
use indicatif::{ProgressBar, ProgressStyle};
use mimalloc::MiMalloc;
use serde::Serialize;

const EXITS: &str = "\
Exit codes:
  0  every run kept every promise
  1  one did not: its seed and a smallest run of its kind are printed
  2  bad input, reported in one line
  130  interrupted";

/// Runs the shipped operator in virtual time, among hostile sources, readers and disks, and checks
/// the outcome.
///
/// The seeds that ever failed come first, then fresh ones.
#[derive(Parser)]
#[command(name = "fuseline-simulate", version, after_help = EXITS, max_term_width = 100)]
struct Cli {
    /// The least number of seconds to run; a run that has begun is finished.
    #[arg(long, value_name = "N", default_value_t = 10)]
    seconds: u64,
    /// Play only this seed, and print its scenario.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Play only the graph of operators of this seed.
    #[arg(long, value_name = "N", conflicts_with = "seed")]
    graph: Option<u64>,
    /// Play only the gRPC server of this seed.
    #[arg(long, value_name = "N", conflicts_with_all = ["seed", "graph"])]
    server: Option<u64>,
    /// The first of the fresh seeds; random if not given.
    #[arg(long, value_name = "N", conflicts_with_all = ["seed", "graph", "server"])]
    from: Option<u64>,
    /// Play this many fresh seeds, instead of for some time.
    #[arg(long, value_name = "N", conflicts_with_all = ["seed", "graph", "server", "seconds"])]
    runs: Option<u64>,
    /// Write the trace of the seed to this file.
    #[arg(long, value_name = "FILE", requires = "seed")]
    trace: Option<PathBuf>,
    /// Print one JSON object at the end.
    #[arg(long)]
    json: bool,
}

/// The work done so far.
#[derive(Default, Serialize)]
struct Sum {
    runs: u64,
    /// The graphs of operators among the runs.
    graphs: u64,
    /// The gRPC servers among the runs.
    servers: u64,
    messages: u64,
    /// The seconds of virtual time.
    lived: f64,
    /// The seconds of real time.
    took: f64,
    /// The messages per second of real time.
    rate: f64,
    /// The first fresh seed, and the seed after the last one.
    seeds: Option<(u64, u64)>,
    failed: Option<Failed>,
    #[serde(skip)]
    interrupted: bool,
}

#[derive(Serialize)]
struct Failed {
    seed: u64,
    check: &'static str,
    what: String,
    smallest: String,
}

/// A graph of several operators is played after this many runs of one operator.
const RUNS_BEFORE_GRAPH: u64 = 64;
/// A server takes as long as several hundred runs, so it is played after this many runs.
const RUNS_BEFORE_SERVER: u64 = 1024;
/// A run that takes longer than this hangs: none takes more than a second.
const HANGS: Duration = Duration::from_secs(120);

#[global_allocator]
static MEMORY: MiMalloc = MiMalloc;

static STOP: AtomicBool = AtomicBool::new(false);
/// The seed that is played, and the number of runs.
static NOW: [AtomicU64; 2] = [AtomicU64::new(0), AtomicU64::new(0)];

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(help) if !help.use_stderr() => {
            // If this fails, nobody reads the help.
            let _ = help.print();
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            let reported = error.to_string();
            eprintln!("{}", reported.lines().next().unwrap_or("error: bad arguments"));
            return ExitCode::from(2);
        }
    };
    // If the system refuses a handler, Ctrl-C ends the command in the usual way.
    let _ = ctrlc::set_handler(|| STOP.store(true, Ordering::Release));
    thread::spawn(watch);
    let done = match (cli.seed, cli.graph, cli.server) {
        (Some(seed), ..) => replay(&cli, seed),
        (None, Some(seed), _) => replay_drawn(Drawn::Graph, seed),
        (None, None, Some(seed)) => replay_drawn(Drawn::Server, seed),
        (None, None, None) => search(&cli),
    };
    match done.and_then(|sum| report(&cli, &sum)) {
        Ok(code) => code,
        // The reader has read enough.
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

/// Plays one seed and prints its scenario.
fn replay(cli: &Cli, seed: u64) -> io::Result<Sum> {
    let simulator = Simulator::new()?;
    let scenario = Scenario::draw(seed);
    if !cli.json {
        write!(anstream::stdout(), "{scenario}")?;
    }
    let mut sum = Sum::default();
    let start = Instant::now();
    let run = play(&simulator, &scenario, &mut sum)?;
    if let Some(path) = &cli.trace {
        std::fs::write(path, &run.trace).map_err(|error| {
            io::Error::new(error.kind(), format!("{}: {error}", path.display()))
        })?;
    }
    sum.end(start);
    sum.failed = failed(&simulator, &scenario, run.findings)?;
    Ok(sum)
}

fn replay_drawn(drawn: Drawn, seed: u64) -> io::Result<Sum> {
    let (mut sum, start) = (Sum::default(), Instant::now());
    play_drawn(drawn, seed, &mut sum)?;
    sum.end(start);
    Ok(sum)
}

/// Plays the saved seeds, then fresh ones, until the time is up or one fails.
fn search(cli: &Cli) -> io::Result<Sum> {
    let simulator = Simulator::new()?;
    let from = cli.from.unwrap_or_else(by_chance);
    let (start, bar) = (Instant::now(), bar(cli));
    let (mut sum, mut played) = (Sum { seeds: Some((from, from)), ..Sum::default() }, 0_u64);
    let saved_seeds = saved_seeds().into_iter().map(|KeptSeed { seed, .. }| (seed, false));
    let fresh = (0..).map(|next: u64| (from.wrapping_add(next), true));
    for (seed, is_fresh) in saved_seeds.chain(fresh) {
        let is_over = match cli.runs {
            Some(runs) => seed.wrapping_sub(from) >= runs,
            None => start.elapsed() >= Duration::from_secs(cli.seconds),
        };
        sum.interrupted = STOP.load(Ordering::Acquire);
        if sum.interrupted || (is_fresh && is_over) {
            break;
        }
        let scenario = Scenario::draw(seed);
        let run = play(&simulator, &scenario, &mut sum)?;
        if is_fresh {
            sum.seeds = Some((from, seed.wrapping_add(1)));
        }
        if run.findings.is_empty() {
            played += 1;
            for (drawn, every) in
                [(Drawn::Graph, RUNS_BEFORE_GRAPH), (Drawn::Server, RUNS_BEFORE_SERVER)]
            {
                if sum.failed.is_none() && played % every == 0 {
                    play_drawn(drawn, seed, &mut sum)?;
                }
            }
            if sum.failed.is_some() {
                sum.end(start);
                break;
            }
        }
        bar.set_position(start.elapsed().as_secs());
        if sum.runs.is_multiple_of(64) {
            bar.set_message(format!("{} runs, {} messages", sum.runs, sum.messages));
        }
        if !run.findings.is_empty() {
            bar.set_message("making the run smaller");
            sum.end(start);
            sum.failed = failed(&simulator, &scenario, run.findings)?;
            break;
        }
    }
    bar.finish_and_clear();
    if sum.failed.is_none() {
        sum.end(start);
    }
    Ok(sum)
}

fn play(simulator: &Simulator, scenario: &Scenario, sum: &mut Sum) -> io::Result<Simulated> {
    NOW[0].store(scenario.seed, Ordering::Release);
    NOW[1].fetch_add(1, Ordering::AcqRel);
    let run = simulator.simulate(scenario)?;
    sum.runs += 1;
    sum.messages += run.messages;
    sum.lived += run.life.as_secs_f64();
    Ok(run)
}

/// A kind of run that is drawn in addition to the runs of one operator.
#[derive(Clone, Copy)]
enum Drawn {
    Graph,
    Server,
}

/// Plays the graph or the server of a seed.
fn play_drawn(drawn: Drawn, seed: u64, sum: &mut Sum) -> io::Result<()> {
    NOW[0].store(seed, Ordering::Release);
    NOW[1].fetch_add(1, Ordering::AcqRel);
    let (check, findings) = match drawn {
        Drawn::Graph => ("graph", graph_findings(seed)?),
        Drawn::Server => ("server", server_findings(seed)?),
    };
    sum.runs += 1;
    match drawn {
        Drawn::Graph => sum.graphs += 1,
        Drawn::Server => sum.servers += 1,
    }
    if !findings.is_empty() {
        let smallest = String::new();
        sum.failed = Some(Failed { seed, check, what: findings.join("; "), smallest });
    }
    Ok(())
}

fn failed(
    simulator: &Simulator,
    scenario: &Scenario,
    findings: Vec<Finding>,
) -> io::Result<Option<Failed>> {
    let Some(finding) = findings.into_iter().next() else { return Ok(None) };
    NOW[1].store(u64::MAX, Ordering::Release);
    let smallest = simulator.smallest(scenario, finding.check)?;
    let again = simulator.simulate(&smallest)?;
    let reason = again.findings.into_iter().find(|again| again.check == finding.check);
    let reason = reason.map_or(finding.reason, |again| again.reason);
    let trace = String::from_utf8_lossy(&again.trace);
    let smallest = format!("{smallest}{trace}");
    Ok(Some(Failed { seed: scenario.seed, check: finding.check, what: reason, smallest }))
}

fn report(cli: &Cli, sum: &Sum) -> io::Result<ExitCode> {
    let mut out = anstream::stdout();
    if cli.json {
        serde_json::to_writer(&mut out, sum)?;
        writeln!(out)?;
    } else {
        if let Some(Failed { seed, check, what, smallest }) = &sum.failed {
            writeln!(out, "seed {seed} breaks {check}: {what}")?;
            if !smallest.is_empty() {
                writeln!(out, "\na smallest run that breaks it:\n{smallest}")?;
            }
            let option = if ["graph", "server"].contains(check) { check } else { "seed" };
            writeln!(out, "again: fuseline-simulate --{option} {seed}")?;
        }
        if let Some((first, end)) = sum.seeds.filter(|(first, end)| first != end) {
            writeln!(out, "fresh seeds {first} to {}", end.wrapping_sub(1))?;
        }
        let Sum { runs, graphs, servers, messages, lived, took, rate, .. } = sum;
        writeln!(
            out,
            "{runs} runs, {graphs} of graphs, {servers} of servers, {messages} messages, {lived:.0} s of life in {took:.1} s: {rate:.0} messages a second"
        )?;
    }
    Ok(match (&sum.failed, sum.interrupted) {
        (Some(_), _) => ExitCode::FAILURE,
        (None, true) => ExitCode::from(130),
        (None, false) => ExitCode::SUCCESS,
    })
}

impl Sum {
    #[expect(clippy::cast_precision_loss, reason = "for people")]
    fn end(&mut self, start: Instant) {
        self.took = start.elapsed().as_secs_f64();
        self.rate = self.messages as f64 / self.took;
    }
}

/// Ends the command with the seed of a run that hangs.
fn watch() {
    let mut last = (0, Instant::now());
    loop {
        thread::sleep(Duration::from_millis(500));
        let count = NOW[1].load(Ordering::Acquire);
        if count != last.0 {
            last = (count, Instant::now());
        } else if last.1.elapsed() > HANGS && count != u64::MAX {
            println!("seed {} hangs", NOW[0].load(Ordering::Acquire));
            std::process::exit(1);
        }
    }
}

fn bar(cli: &Cli) -> ProgressBar {
    if cli.json || !io::stderr().is_terminal() || cli.runs.is_some() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(cli.seconds);
    let style = ProgressStyle::with_template("{bar:30} {pos}/{len} s {wide_msg}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}

/// Returns a random seed that is short enough to be read aloud.
fn by_chance() -> u64 {
    Rng::by_chance().u64(0..1_000_000_000_000)
}
