//! A configuration and the inputs to its operator.

use std::convert::Infallible;
use std::fmt;
use std::io::BufRead;

use fuseline_traces::{Event, Events, Header, Input, ReadError, Reference};

use crate::shrink::shrink;

/// A configuration and the inputs to its operator.
///
/// Its debug form is the conforming trace, so a failure can go into the corpus as it is printed.
#[derive(Clone, PartialEq, Eq)]
pub struct Run {
    /// The configuration.
    pub header: Header,
    /// The inputs, in order.
    pub inputs: Vec<Input>,
}

impl Run {
    /// Reads a header and inputs, and skips decisions. `name` names the text in errors.
    ///
    /// # Errors
    /// Returns a [`ReadError`] if the text is not a trace or cannot be read.
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

    /// Appends the header and the inputs, one on each line.
    pub fn write(&self, out: &mut Vec<u8>) {
        self.header.write(out);
        out.push(b'\n');
        for input in &self.inputs {
            input.write(out);
            out.push(b'\n');
        }
    }

    /// Returns the shortest run that was found in which `fault` still finds something, and what it
    /// finds there. Returns `None` if it finds nothing in the whole run.
    pub fn shortened<T>(&self, fault: impl Fn(&Self) -> Option<T>) -> Option<(Self, T)> {
        let mut found = fault(self)?;
        let Ok(shortest) = shrink(
            self.clone(),
            |_| Vec::new(),
            |run| {
                let again = fault(run);
                Ok::<_, Infallible>(again.map(|again| found = again).is_some())
            },
        );
        Some((shortest, found))
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
