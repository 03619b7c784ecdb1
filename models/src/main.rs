//! The command: checks the models, and serves them for exploring.

mod error;
mod report;

use std::io::{self, IsTerminal};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::thread;

use clap::{Parser, Subcommand};
use fuseline_models::{
    CheckOptions, Exploration, Size, WORLDS, World, check, explore, silence_panic_output,
};
use indicatif::{ProgressBar, ProgressStyle};

use crate::error::ModelsError;

const EXITS: &str = "\
Exit codes:
  0  every claim is kept, every sighting met, and there are as many states as there should be
  1  not so
  2  bad input, reported in one line";

/// Searches every state that the shipped machine can reach for a broken rule or promise.
#[derive(Parser)]
#[command(name = "fuseline-models", version, after_help = EXITS, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Check configurations state by state.
    Check(CheckArguments),
    /// Explore a configuration in a browser, with every step in the words of the trace.
    Explore(Explore),
    /// List the configurations.
    List,
}

#[derive(clap::Args)]
#[command(after_help = "\
A broken claim is printed with a short run that breaks it, as a trace: `fuseline replay` shows what the
machine that it is built with does, `fuseline check` what it should do.

Examples:
  fuseline-models check                    what CI checks
  fuseline-models check 2x3w2 gate         2x3w2-eager, 2x3w2-patient and gate
  fuseline-models check --quick --keep-going --save violations/")]
#[expect(clippy::struct_excessive_bools, reason = "one for each switch")]
struct CheckArguments {
    /// The configurations, or the beginnings of their names; by default all but the large ones.
    #[arg(value_name = "CONFIG")]
    configs: Vec<String>,
    /// Check only the quick configurations.
    #[arg(long, conflicts_with_all = ["configs", "large"])]
    quick: bool,
    /// Check the large configurations too.
    #[arg(long, conflicts_with = "configs")]
    large: bool,
    /// Continue after a violation, to see all claims that are broken.
    #[arg(long)]
    keep_going: bool,
    /// The number of threads; by default as many as there are processors.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: Option<u16>,
    /// Write each counterexample into this directory, as CONFIG.CLAIM.jsonl.
    #[arg(long, value_name = "DIR")]
    save: Option<PathBuf>,
    /// Print one JSON object for each configuration.
    #[arg(long)]
    json: bool,
}

#[derive(clap::Args)]
struct Explore {
    /// The configuration.
    config: String,
    /// The address to listen on.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:3000")]
    listen: SocketAddr,
    /// Show the sightings beside the claims; each click then takes seconds.
    #[arg(long)]
    sightings: bool,
}

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(help) if !help.use_stderr() => {
            // If this fails, nobody reads the help.
            let _ = help.print();
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            eprintln!("error: {}", error::usage(&error));
            return ExitCode::from(2);
        }
    };
    let done = match &cli.command {
        Command::Check(args) => check_all(args),
        Command::Explore(args) => explore_one(args).map(|()| true),
        Command::List => report::list(&mut anstream::stdout()).map(|()| true),
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

/// Checks the requested configurations. Returns `true` if all of them hold.
fn check_all(args: &CheckArguments) -> Result<bool, ModelsError> {
    silence_panic_output();
    let configs = chosen(args)?;
    let threads = args
        .threads
        .map_or_else(|| thread::available_parallelism().map_or(1, usize::from), usize::from);
    let effort = CheckOptions { threads, all: args.keep_going };
    let mut out = anstream::stdout();
    let mut verdicts: Vec<Exploration> = Vec::new();
    for config in configs {
        let verdict = check_one(config, effort)?;
        if let Some(folder) = &args.save {
            report::save(folder, &verdict)?;
        }
        if args.json {
            report::json(&mut out, &verdict)?;
        }
        let stop = !verdict.violations.is_empty() && !args.keep_going;
        verdicts.push(verdict);
        if stop {
            break;
        }
    }
    if !args.json {
        report::write_table(&mut out, &verdicts)?;
    }
    Ok(verdicts.iter().all(Exploration::holds))
}

/// Returns the requested configurations in the order of the table.
fn chosen(args: &CheckArguments) -> Result<Vec<&'static World>, ModelsError> {
    let is_named = |config: &World, name: &str| {
        let rest = config.name.strip_prefix(name);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('-'))
    };
    for name in &args.configs {
        if !WORLDS.iter().any(|config| is_named(config, name)) {
            return Err(ModelsError::World { name: name.clone() });
        }
    }
    let most = match (args.quick, args.large) {
        (true, _) => Size::Quick,
        (false, false) => Size::Standard,
        (false, true) => Size::Large,
    };
    let is_chosen = |config: &&World| {
        if args.configs.is_empty() {
            config.size <= most
        } else {
            args.configs.iter().any(|name| is_named(config, name))
        }
    };
    Ok(WORLDS.iter().filter(is_chosen).collect())
}

fn check_one(config: &'static World, effort: CheckOptions) -> Result<Exploration, ModelsError> {
    let visible = io::stderr().is_terminal();
    let bar = if visible {
        let style =
            ProgressStyle::with_template("{prefix} {bar:30} {pos} of {len} states {elapsed}");
        let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
        ProgressBar::new(config.states as u64).with_style(style).with_prefix(config.name)
    } else {
        ProgressBar::hidden()
    };
    let verdict = check(config, effort, |states| bar.set_position(states as u64));
    bar.finish_and_clear();
    let verdict = verdict.map_err(|source| ModelsError::Check { config: config.name, source })?;
    if !visible {
        eprintln!("{}", report::line(&verdict));
    }
    Ok(verdict)
}

fn explore_one(args: &Explore) -> Result<(), ModelsError> {
    let name = &args.config;
    let config = World::named(name).ok_or_else(|| ModelsError::World { name: name.clone() })?;
    eprintln!("{name}: open http://{}/ in a browser; Ctrl-C ends it", args.listen);
    silence_panic_output();
    explore(config, args.listen, args.sightings)
        .map_err(|source| ModelsError::Listen { address: args.listen, source })
}
