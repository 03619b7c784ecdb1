//! The node's command.

use std::io::{IsTerminal, Write};
use std::process::ExitCode;

use fuseline_ros2::arguments::{Action, Arguments, HELP, Level};
use fuseline_ros2::settings::PolicyKind;
use fuseline_ros2::{NodeError, PendingLogs, Rosout, Settings, Stop};
use tokio::runtime::{Builder, Runtime};
use tracing::{error, warn};
use tracing_subscriber::filter::{EnvFilter, LevelFilter, Targets};
use tracing_subscriber::prelude::*;

/// Bad arguments or settings.
const BAD_INPUT: u8 = 2;

fn main() -> ExitCode {
    let reported = |error: &dyn std::fmt::Display| {
        eprintln!("fuseline-ros2: {error}");
        ExitCode::from(BAD_INPUT)
    };
    let arguments = match Arguments::parse(std::env::args_os().skip(1)) {
        Ok(arguments) => arguments,
        Err(error) => return reported(&error),
    };
    match arguments.action {
        Action::Help => return print(HELP),
        Action::Version => return print(&format!("fuseline-ros2 {}\n", env!("CARGO_PKG_VERSION"))),
        Action::Check | Action::Run => {}
    }
    let settings = match Settings::from(&arguments, |name| {
        // A value that is not UTF-8 is an error where it is read, not missing.
        std::env::var_os(name).map(|value| value.to_string_lossy().into_owned())
    }) {
        Ok(settings) => settings,
        Err(error) => return reported(&error),
    };
    if arguments.action == Action::Check {
        return match check(&settings) {
            Ok(()) => {
                let warning = |text: String, caution: &String| text + "warning: " + caution + "\n";
                let cautions = settings.cautions().iter().fold(String::new(), warning);
                print(&format!("{settings}\n{cautions}"))
            }
            Err(error) => reported(&error),
        };
    }
    let lines = log(settings.log_level);
    if settings.deadlines.kind != PolicyKind::Set && settings.deadlines.rate.is_none() {
        warn!(
            "policy.rate is not given, so nothing checks that the node can keep up with its inputs"
        );
    }
    for caution in settings.cautions() {
        warn!("{caution}");
    }
    match serve(&settings, lines) {
        Ok(code) => code,
        Err(
            error @ (NodeError::Settings(_)
            | NodeError::Recording { .. }
            | NodeError::ZenohConfig(_)
            | NodeError::Grpc { .. }),
        ) => reported(&error),
        Err(error) => {
            error!(%error, "the node has failed");
            ExitCode::FAILURE
        }
    }
}

/// Checks whether the node would start. The error is the reason why it would not.
fn check(settings: &Settings) -> Result<(), NodeError> {
    runtime()?.block_on(async { fuseline_ros2::check(settings) })
}

/// Runs the node until it is to end.
fn serve(settings: &Settings, lines: PendingLogs) -> Result<ExitCode, NodeError> {
    let runtime = runtime()?;
    let mut stop = runtime.block_on(async { Stop::watch() }).map_err(NodeError::System)?;
    runtime.block_on(fuseline_ros2::run(settings, &mut stop, Some(lines)))?;
    Ok(if stop.is_urgent() { ExitCode::from(130) } else { ExitCode::SUCCESS })
}

fn runtime() -> Result<Runtime, NodeError> {
    Builder::new_current_thread().enable_all().build().map_err(NodeError::System)
}

/// Logs to standard error and to what it returns; `RUST_LOG` says more than a level can.
fn log(level: Option<Level>) -> PendingLogs {
    let level = match level {
        Some(Level::Debug) => "debug",
        Some(Level::Info) | None => "info",
        Some(Level::Warn) => "warn",
        Some(Level::Error | Level::Fatal) => "error",
    };
    // The libraries' logs are for those who ask for them. Some log what is no error to us: that
    // there is no multicast, as on loopback alone; that the wall clock stepped back or a
    // participant has ended, which the node reports itself; that a sample is for nobody; each
    // message while clocks differ; and that `/clock` has another type for `ros2-client`.
    let ours = format!(
        "error,fuseline_ros2={level},fuseline_engine={level},rustdds::network=off,rustdds::rtps::writer=off,\
         rustdds::structure::dds_cache=off,rustdds::dds::pubsub=off,rustdds::discovery::discovery_db=off,\
         zenoh::net::routing::dispatcher::pubsub=off"
    );
    let asked = std::env::var(EnvFilter::DEFAULT_ENV).ok().filter(|text| !text.is_empty());
    let asked = asked.map(EnvFilter::try_new);
    let wrong = asked.as_ref().and_then(|asked| asked.as_ref().err().map(ToString::to_string));
    let asked = asked.and_then(Result::ok);
    let is_asked = asked.is_some();
    let filter = asked.unwrap_or_else(|| EnvFilter::new(ours));
    let to_stderr = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal());
    let (rosout, lines) = Rosout::new();
    let ours = Targets::new().with_target("fuseline", LevelFilter::DEBUG);
    let published = rosout.with_filter(ours);
    tracing_subscriber::registry().with(filter).with(to_stderr).with(published).init();
    if !is_asked {
        // `rustdds` logs through the crate `log`, several times for each message. This drops
        // everything below an error before a record reaches the filters.
        log::set_max_level(log::LevelFilter::Error);
    }
    if let Some(why) = wrong {
        warn!("RUST_LOG is ignored: {why}");
    }
    lines
}

fn print(text: &str) -> ExitCode {
    // A reader that closes early is no error.
    drop(std::io::stdout().write_all(text.as_bytes()));
    ExitCode::SUCCESS
}
