//! Signals, as a terminal sends them.

use std::process::{Child, Command};

/// Presses Ctrl-C.
pub(crate) fn interrupt(child: &Child) {
    send(child, "INT");
}

/// Sends a signal.
pub(crate) fn send(child: &Child, signal: &str) {
    let id = child.id().to_string();
    let sent = Command::new("kill").args(["-s", signal, &id]).status().unwrap();
    assert!(sent.success());
}
