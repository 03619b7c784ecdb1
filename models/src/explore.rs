//! The Explorer: shows a configuration's states in a browser, step by step.

use std::io;
use std::net::{SocketAddr, TcpListener};

use stateright::Model;

use crate::operator::Operator;
use crate::world::World;

/// Serves the Explorer on this address until the process ends.
///
/// With `sightings` the Explorer shows them too. It then searches for a path to each of them
/// whenever it shows a state, which takes seconds once it has found many.
///
/// # Errors
/// Returns an error if it cannot listen on the address.
pub fn explore(config: &'static World, listen: SocketAddr, sightings: bool) -> io::Result<()> {
    // Stateright panics if it cannot listen.
    drop(TcpListener::bind(listen)?);
    let operator = Operator::new(config);
    let operator = if sightings { operator } else { operator.without_sightings() };
    operator.checker().serve(listen);
    Ok(())
}
