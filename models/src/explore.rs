//! The Explorer: a configuration's states in a browser, step by step.

use std::io;
use std::net::{SocketAddr, TcpListener};

use stateright::Model;

use crate::config::Config;
use crate::operator::Operator;

/// Serves the Explorer on this address until the process ends.
///
/// # Errors
/// If nothing can listen there.
pub fn explore(config: &'static Config, listen: SocketAddr) -> io::Result<()> {
    // Stateright panics where it cannot listen.
    drop(TcpListener::bind(listen)?);
    Operator::new(config).checker().serve(listen);
    Ok(())
}
