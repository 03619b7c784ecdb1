//! A configuration and what happens to its operator.

use std::fmt;
use std::io::BufRead;

use fuseline_traces::{Event, Events, Header, Input, ReadError, Reference};

/// A configuration and what happens to its operator.
///
/// Its debug form is the conforming trace, so that a failure can go into the corpus as it is printed.
#[derive(Clone, PartialEq, Eq)]
pub struct Run {
    /// The configuration.
    pub header: Header,
    /// The inputs, in order.
    pub inputs: Vec<Input>,
}

impl Run {
    /// Reads a header and inputs; decisions are left out. Errors call the text `name`.
    ///
    /// # Errors
    /// The text is not a trace, or cannot be read.
    pub fn read(name: &str, text: impl BufRead) -> Result<Self, ReadError> {
        let mut reader = Events::new(name, text)?;
        let (header, mut inputs) = (reader.header().clone(), Vec::new());
        while let Some(event) = reader.next_event()? {
            if let Event::Input(input) = event {
                inputs.push(input);
            }
        }
        Ok(Self { header, inputs })
    }

    /// Appends the header and the inputs, a line each.
    pub fn write(&self, out: &mut Vec<u8>) {
        self.header.write(out);
        out.push(b'\n');
        for input in &self.inputs {
            input.write(out);
            out.push(b'\n');
        }
    }

    /// The run without any input that can be left out while `fault` still finds something, and what
    /// it finds then; nothing if it finds nothing in the whole run.
    pub fn shortened<T>(&self, fault: impl Fn(&Self) -> Option<T>) -> Option<(Self, T)> {
        let (mut run, mut found) = (self.clone(), fault(self)?);
        let mut place = 0;
        while place < run.inputs.len() {
            let mut shorter = run.clone();
            shorter.inputs.remove(place);
            match fault(&shorter) {
                // What was needed before may no longer be.
                Some(still) => (run, found, place) = (shorter, still, 0),
                None => place += 1,
            }
        }
        Some((run, found))
    }
}

impl fmt::Debug for Run {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut lines = Vec::new();
        self.header.write(&mut lines);
        let mut reference = Reference::new(&self.header);
        let mut demands = Vec::new();
        for input in &self.inputs {
            lines.push(b'\n');
            input.write(&mut lines);
            demands.clear();
            reference.apply(input, &mut demands);
            for (decision, _) in &demands {
                lines.push(b'\n');
                decision.write(&mut lines);
            }
        }
        writeln!(f, "\n{}", String::from_utf8_lossy(&lines))
    }
}
