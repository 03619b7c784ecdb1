//! The `fuseline` command; all of it is in the library beside this file, so that its tests have
//! every feature.

use std::process::ExitCode;

fn main() -> ExitCode {
    fuseline::main()
}
