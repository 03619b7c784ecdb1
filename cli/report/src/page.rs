//! The page: its text, the built script and style, and the data, in one file.

use std::io::{self, Write};

use serde::Serialize;

use crate::columns::PageTrace;
use crate::reasons::{ReasonColumn, drops, refusals};
use crate::statistics::COLUMNS;

/// The text. Each mark in it is replaced by the part that it names.
const PAGE: &str = include_str!("../page/page.html");
/// `npm run build` makes the script, with the licences of its parts.
const SCRIPT: &str = include_str!("../page/dist/report.js");
const STYLE: &str = include_str!("../page/dist/report.css");
const LICENSES: &str = include_str!("../page/dist/LICENSES.txt");

/// All data of the page. The page itself has no names for the counts and reasons.
#[derive(Serialize)]
pub(crate) struct Data<'a> {
    /// The counts of a source's requests: the word for each count and its meaning.
    columns: [(&'static str, &'static str); COLUMNS.len()],
    refusals: Vec<ReasonColumn>,
    drops: [ReasonColumn; 5],
    traces: &'a [PageTrace],
}

impl<'a> Data<'a> {
    pub(crate) fn new(traces: &'a [PageTrace]) -> Self {
        Self { columns: COLUMNS, refusals: refusals(), drops: drops(), traces }
    }
}

/// Writes the page.
pub(crate) fn write(out: &mut impl Write, data: &Data<'_>) -> io::Result<()> {
    for (i, part) in PAGE.split("@@").enumerate() {
        match (i % 2, part) {
            (1, "licenses") => out.write_all(LICENSES.as_bytes())?,
            (1, "style") => out.write_all(STYLE.as_bytes())?,
            (1, "script") => out.write_all(SCRIPT.as_bytes())?,
            (1, "data") => serde_json::to_writer(Inline(&mut *out), data)?,
            (_, text) => out.write_all(text.as_bytes())?,
        }
    }
    Ok(())
}

/// Writes JSON that is safe inside a page. It escapes `<` as scripts do, so no name can end the
/// element or begin another. `<` occurs only in JSON's texts, so the JSON means the same.
struct Inline<W>(W);

impl<W: Write> Write for Inline<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        for (i, part) in bytes.split(|byte| *byte == b'<').enumerate() {
            if i > 0 {
                self.0.write_all(b"\\u003c")?;
            }
            self.0.write_all(part)?;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}
