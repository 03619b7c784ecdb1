//! `trace LINES` prints the trace of the benches, with at least this many lines.

use std::io::{self, Write, stdout};

use fuseline_benches::trace::trace;

fn main() -> io::Result<()> {
    let lines = std::env::args().nth(1).and_then(|lines| lines.parse().ok());
    let lines = lines.ok_or_else(|| io::Error::other("usage: trace LINES"))?;
    stdout().write_all(&trace(lines).0)
}
