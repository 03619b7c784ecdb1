//! Runs a harness natively on the values of a counterexample: `replay NAME VALUE…`.

use std::env;
use std::process::ExitCode;

use kani::native::{self, RunError};

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let Some((name, values)) = arguments.split_first() else {
        eprintln!("error: name a harness and its values");
        return ExitCode::from(2);
    };
    let all = fuseline_proofs::harness::ALL;
    let Some((_, harness)) = all.iter().find(|(known, _)| known == name) else {
        eprintln!("error: there is no harness {name}; see --list");
        return ExitCode::from(2);
    };
    let values: Result<Vec<u64>, _> = values.iter().map(|value| value.parse()).collect();
    let Ok(values) = values else {
        eprintln!("error: the values of a counterexample are whole numbers from 0 to {}", u64::MAX);
        return ExitCode::from(2);
    };
    let ended = native::replay(*harness, &values);
    for line in fuseline_proofs::take_recording() {
        println!("{line}");
    }
    match ended {
        Ok(report) => {
            println!("it holds for these values: {} assertions", report.assertions.len());
            return ExitCode::SUCCESS;
        }
        Err(RunError::Rejected) => {
            println!("these values are left out by an assumption: they show nothing");
        }
        Err(RunError::Failed(failure)) => {
            let place = failure.location.unwrap_or_else(|| "a panic".to_owned());
            println!("it does not hold: {} ({place})", failure.message);
        }
    }
    ExitCode::FAILURE
}
