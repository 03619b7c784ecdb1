//! Runs shipped operators with real clouds over real sockets, while the network and the clouds are
//! being disrupted.
//!
//! The chapter `docs/book/src/verified/chaos.md` describes what it does and what it checks. This
//! crate is not published.

mod certificates;
mod checks;
mod cloud;
mod disruption;
mod field;
mod fleet;
mod gauges;
mod soak;
mod span;
mod summary;
mod vehicle;

use std::process::ExitCode;

use clap::Parser;
use fuseline_tokio::Error;

#[derive(Parser)]
#[command(
    about = "Operators and clouds under chaos; run it by .ci/chaos, which makes the namespaces"
)]
enum Args {
    /// Send messages through many operators, with a disruption every few seconds.
    Soak(soak::Args),
    /// Run one cloud for the soak; it ends with its standard input.
    #[command(hide = true)]
    Cloud(cloud::Args),
}

fn main() -> ExitCode {
    let runtime = tokio::runtime::Runtime::new().expect("a runtime starts");
    let ended: Result<bool, Error> = match Args::parse() {
        Args::Soak(args) => runtime.block_on(soak::soak(args)),
        Args::Cloud(args) => runtime.block_on(cloud::cloud(args)).map(|()| true),
    };
    runtime.shutdown_background();
    match ended {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}
