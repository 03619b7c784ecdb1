//! What a build without the feature `full` lacks, and the remedy.

use thiserror::Error;

/// The commands that it lacks.
pub(crate) const COMMANDS: [&str; 6] =
    ["completions", "convert", "export", "man", "probe", "scenario"];

/// The end of its help.
pub(crate) const LACKS: &str = "\
This build lacks completions, convert, export, man, probe, scenario, TLS, zstd and MCAP.
`cargo install --locked --path cli --features full` builds everything.";

/// Something is not in this build.
#[derive(Debug, Error)]
#[error("{0} is not in this build; {REMEDY}")]
struct AbsentError(&'static str);

const REMEDY: &str = "build it with --features full";

/// What to print of a command that this build lacks; none of other words.
pub(crate) fn missing(command: &str) -> Option<String> {
    let command = COMMANDS.into_iter().find(|name| *name == command)?;
    Some(AbsentError(command).to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_absent_says_how_to_get_it() {
        let message = missing("probe").expect("it is of a full build");
        assert_eq!(message, "probe is not in this build; build it with --features full");
        assert!(missing("check").is_none() && COMMANDS.iter().all(|name| LACKS.contains(name)));
    }
}
