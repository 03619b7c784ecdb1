//! What the tools that measure tests have in common.

use std::process::Command;

use crate::error::EvidenceError;

/// Which tests run.
pub(crate) struct Tests {
    pub(crate) packages: &'static [&'static str],
    /// The arguments for `cargo test` that choose among those of the packages.
    pub(crate) targets: &'static [&'static str],
}

/// A tool's name and version, from its first line.
pub(crate) fn version(command: &mut Command, remedy: &str) -> Result<String, EvidenceError> {
    let tool = format!("{command:?}");
    let missing = || EvidenceError::Tool { tool: tool.clone(), remedy: remedy.to_owned() };
    let printed = command.output().map_err(|_| missing())?;
    if !printed.status.success() {
        return Err(missing());
    }
    let text = String::from_utf8_lossy(&printed.stdout);
    Ok(text.lines().next().unwrap_or_default().trim().to_owned())
}
