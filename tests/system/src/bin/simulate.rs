//! `fuseline-simulate`: plays the seeds that ever failed, then fresh seeds for a while, or plays
//! one seed again.
//!
//! It prints what does not hold, with the seed. The library's `simulate` plays the runs and checks
//! them.

use std::io::{self, IsTerminal, Write as _};
use std::panic;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Parser;
use fuseline_system_tests::simulate::{
    Drawn, Graph, SavedSeed, Scenario, Server, Simulated, Simulator, nodes, saved_seeds,
};
use fuseline_testkit::Rng;
use indicatif::{ProgressBar, ProgressStyle};
use mimalloc::MiMalloc;
use serde::Serialize;

const EXITS: &str = "\
Exit codes:
  0  every run kept every promise
  1  one did not: its seed is printed, with a smaller run that fails too if there is one
  2  bad input, reported in one line
  130  interrupted";

/// Runs the shipped operator in virtual time, among hostile sources, readers and disks, and checks
/// the outcome. It also runs graphs of operators, gRPC servers, and the ROS 2 node on topics that
/// lose messages.
///
/// The seeds that ever failed come first, then fresh ones.
#[derive(Parser)]
#[command(name = "fuseline-simulate", version, after_help = EXITS, max_term_width = 100)]
struct Cli {
    /// The least number of seconds to run; a run that has begun is finished.
    #[arg(long, value_name = "N", default_value_t = 10)]
    seconds: u64,
    /// Play only this seed, and print its scenario.
    #[arg(long, value_name = "N", group = "one")]
    seed: Option<u64>,
    /// Play only the graph of operators of this seed.
    #[arg(long, value_name = "N", group = "one")]
    graph: Option<u64>,
    /// Play only the gRPC server of this seed.
    #[arg(long, value_name = "N", group = "one")]
    server: Option<u64>,
    /// Play only the ROS 2 node of this seed, and print its scenario.
    #[arg(long, value_name = "N", group = "one")]
    node: Option<u64>,
    /// The first of the fresh seeds; random if not given.
    #[arg(long, value_name = "N", conflicts_with = "one")]
    from: Option<u64>,
    /// Play this many fresh seeds, instead of for some time.
    #[arg(long, value_name = "N", conflicts_with_all = ["one", "seconds"])]
    runs: Option<u64>,
    /// Write the trace of an operator or a node to this file.
    #[arg(long, value_name = "FILE", requires = "one", conflicts_with_all = ["graph", "server"])]
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
    /// The ROS 2 nodes among the runs.
    nodes: u64,
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
    /// The option of the command that plays this seed.
    option: &'static str,
    seed: u64,
    check: &'static str,
    what: String,
    #[serde(skip)]
    hangs: bool,
    /// The smallest run that was found, or the scenario of a run that hangs.
    smallest: String,
}

/// A node is played after this many runs of one operator.
const RUNS_BEFORE_NODE: u64 = 2;
/// A graph of several operators is played after this many runs of one operator.
const RUNS_BEFORE_GRAPH: u64 = 64;
/// A server takes as long as several hundred runs, so it is played after this many runs.
const RUNS_BEFORE_SERVER: u64 = 1024;

#[global_allocator]
static MEMORY: MiMalloc = MiMalloc;

static STOP: AtomicBool = AtomicBool::new(false);

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
    let done = match (cli.seed, cli.graph, cli.server, cli.node) {
        (Some(seed), ..) => replay::<Scenario>(&cli, seed),
        (_, Some(seed), ..) => replay::<Graph>(&cli, seed),
        (_, _, Some(seed), _) => replay::<Server>(&cli, seed),
        (.., Some(seed)) => replay::<nodes::Scenario>(&cli, seed),
        (None, None, None, None) => search(&cli),
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
fn replay<D: Drawn>(cli: &Cli, seed: u64) -> io::Result<Sum> {
    if !cli.json {
        write!(anstream::stdout(), "{}", D::draw(seed).text())?;
    }
    let mut player = Player::new(ProgressBar::hidden())?;
    let trace = player.play::<D>(seed)?;
    if let Some(path) = &cli.trace {
        std::fs::write(path, trace).map_err(|error| {
            io::Error::new(error.kind(), format!("{}: {error}", path.display()))
        })?;
    }
    Ok(player.sum)
}

/// Plays the saved seeds, then fresh ones, until the time is up or one fails.
fn search(cli: &Cli) -> io::Result<Sum> {
    let from = cli.from.unwrap_or_else(by_chance);
    let (mut player, mut count) = (Player::new(bar(cli))?, 0_u64);
    player.sum.seeds = Some((from, from));
    let saved_seeds = saved_seeds().into_iter().map(|SavedSeed { seed, .. }| (seed, false));
    let fresh = (0..).map(|next: u64| (from.wrapping_add(next), true));
    for (seed, is_fresh) in saved_seeds.chain(fresh) {
        let elapsed = player.start.elapsed();
        let is_over = match cli.runs {
            Some(runs) => seed.wrapping_sub(from) >= runs,
            None => elapsed >= Duration::from_secs(cli.seconds),
        };
        player.sum.interrupted = STOP.load(Ordering::Acquire);
        if player.sum.interrupted || (is_fresh && is_over) {
            break;
        }
        if is_fresh {
            player.sum.seeds = Some((from, seed.wrapping_add(1)));
        }
        count += 1;
        for (every, play) in [
            (1, Player::play::<Scenario> as fn(&mut Player, u64) -> _),
            (RUNS_BEFORE_NODE, Player::play::<nodes::Scenario>),
            (RUNS_BEFORE_GRAPH, Player::play::<Graph>),
            (RUNS_BEFORE_SERVER, Player::play::<Server>),
        ] {
            if player.sum.failed.is_none() && (!is_fresh || count.is_multiple_of(every)) {
                play(&mut player, seed)?;
            }
        }
        if player.sum.failed.is_some() {
            break;
        }
        player.bar.set_position(elapsed.as_secs());
        if count.is_multiple_of(64) {
            let Sum { runs, messages, .. } = player.sum;
            player.bar.set_message(format!("{runs} runs, {messages} messages"));
        }
    }
    player.bar.finish_and_clear();
    Ok(player.sum)
}

/// Plays seeds and sums up.
struct Player {
    simulator: Simulator,
    bar: ProgressBar,
    start: Instant,
    sum: Sum,
}

impl Player {
    fn new(bar: ProgressBar) -> io::Result<Self> {
        let (simulator, start) = (Simulator::new()?, Instant::now());
        Ok(Self { simulator, bar, start, sum: Sum::default() })
    }

    /// Plays the run of a seed, and returns its trace. Makes it smaller if it fails.
    fn play<D: Drawn>(&mut self, seed: u64) -> io::Result<Vec<u8>> {
        let drawn = D::draw(seed);
        let simulated = self.simulator.simulate(&drawn)?;
        self.add::<D>(&simulated);
        let Some(finding) = simulated.findings.first() else { return Ok(simulated.trace) };
        self.bar.set_message("making the run smaller");
        let (check, mut what, mut smallest) = (finding.check, &finding.reason, drawn.text());
        let again;
        if !simulated.hangs {
            // A smaller run may panic too, and there are thousands of them.
            let hook = panic::take_hook();
            panic::set_hook(Box::new(|_| {}));
            let smaller = self.simulator.smallest(&drawn, check);
            panic::set_hook(hook);
            let smaller = smaller?;
            again = self.simulator.simulate(&smaller)?;
            smallest = smaller.text() + &String::from_utf8_lossy(&again.trace);
            what = again.breaks(check).map_or(what, |again| &again.reason);
        }
        let (option, what, hangs) = (D::OPTION, what.clone(), simulated.hangs);
        self.sum.failed = Some(Failed { option, seed, check, what, hangs, smallest });
        Ok(simulated.trace)
    }

    #[expect(clippy::cast_precision_loss, reason = "for people")]
    fn add<D: Drawn>(&mut self, run: &Simulated) {
        let sum = &mut self.sum;
        sum.runs += 1;
        match D::OPTION {
            Graph::OPTION => sum.graphs += 1,
            Server::OPTION => sum.servers += 1,
            nodes::Scenario::OPTION => sum.nodes += 1,
            _ => {}
        }
        sum.messages += run.messages;
        sum.lived += run.life.as_secs_f64();
        sum.took = self.start.elapsed().as_secs_f64();
        sum.rate = sum.messages as f64 / sum.took;
    }
}

fn report(cli: &Cli, sum: &Sum) -> io::Result<ExitCode> {
    let mut out = anstream::stdout();
    if cli.json {
        serde_json::to_writer(&mut out, sum)?;
        writeln!(out)?;
    } else {
        if let Some(Failed { option, seed, check, what, hangs, smallest }) = &sum.failed {
            writeln!(out, "{option} {seed} breaks {check}: {what}")?;
            // The scenario of a seed that was asked for is printed before its run.
            let is_printed = *hangs && sum.seeds.is_none();
            if !smallest.is_empty() && !is_printed {
                let title = if *hangs { "its scenario" } else { "a smallest run that breaks it" };
                writeln!(out, "\n{title}:\n{smallest}")?;
            }
            writeln!(out, "again: fuseline-simulate --{option} {seed}")?;
        }
        if let Some((first, end)) = sum.seeds.filter(|(first, end)| first != end) {
            writeln!(out, "fresh seeds {first} to {}", end.wrapping_sub(1))?;
        }
        let Sum { runs, graphs, servers, nodes, messages, lived, took, rate, .. } = sum;
        writeln!(
            out,
            "{runs} runs, {graphs} of graphs, {servers} of servers, {nodes} of nodes, {messages} messages, {lived:.0} s of life in {took:.1} s: {rate:.0} messages a second"
        )?;
    }
    Ok(match (&sum.failed, sum.interrupted) {
        (Some(_), _) => ExitCode::FAILURE,
        (None, true) => ExitCode::from(130),
        (None, false) => ExitCode::SUCCESS,
    })
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
