//! The Explorer: a configuration's states in a browser, step by step.

use std::io;
use std::net::{SocketAddr, TcpListener};

use stateright::Model;

use crate::operator::Operator;
use crate::world::World;

/// Serves the Explorer on this address until the process ends.
///
/// With `sightings` it shows them too: it finds the way to each anew whenever it shows a state, which
/// takes seconds once many are met.
///
/// # Errors
/// If nothing can listen there.
pub fn explore(config: &'static World, listen: SocketAddr, sightings: bool) -> io::Result<()> {
    // Stateright panics where it cannot listen.
    drop(TcpListener::bind(listen)?);
    let operator = Operator::new(config);
    let operator = if sightings { operator } else { operator.without_sightings() };
    operator.checker().serve(listen);
    Ok(())
}
