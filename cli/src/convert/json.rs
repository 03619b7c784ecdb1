//! Rows of JSON: an object a line, or an array of objects.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{BufRead, Read};
use std::sync::Arc;

use serde::Deserialize;
use serde_json::value::RawValue;

use crate::convert::row::{Cells, Place, Problem, ProblemKind, ReadRow, Row, Spot};

/// Objects within objects are read to this depth.
const DEPTH: usize = 16;

type Fields<'j> = BTreeMap<Cow<'j, str>, &'j RawValue>;

/// JSON lines that are being read. Blank lines are passed over.
pub(super) struct LineRows<R> {
    file: Arc<str>,
    inner: R,
    line: Vec<u8>,
    number: u64,
    has_ended: bool,
}

impl<R: BufRead> LineRows<R> {
    pub(super) fn new(file: &Arc<str>, inner: R) -> Self {
        let (line, number) = (Vec::new(), 0);
        Self { file: Arc::clone(file), inner, line, number, has_ended: false }
    }
}

impl<R: BufRead> Iterator for LineRows<R> {
    type Item = ReadRow;

    fn next(&mut self) -> Option<ReadRow> {
        while !self.has_ended {
            self.line.clear();
            self.number += 1;
            let place = Place::new(&self.file, Spot::Line(self.number));
            if let Err(error) = self.inner.read_until(b'\n', &mut self.line) {
                self.has_ended = true;
                return Some(Err(Problem::of_read(&place, &error)));
            }
            self.has_ended = !self.line.ends_with(b"\n");
            let text = self.line.trim_ascii();
            if text.is_empty() {
                continue;
            }
            // A line without its end may be half of one.
            let kind = if self.has_ended { ProblemKind::Cut } else { ProblemKind::Row };
            return Some(match cells_of(text) {
                Ok(cells) => Ok(Row::new(place, cells)),
                Err(message) => Err(Problem::of_kind(kind, &place, message)),
            });
        }
        None
    }
}

/// Returns the rows of one array of objects.
pub(super) fn array(
    file: &Arc<str>,
    inner: &mut dyn Read,
) -> Result<impl Iterator<Item = ReadRow> + use<>, Problem> {
    let mut text = String::new();
    let read = inner.read_to_string(&mut text);
    read.map_err(|error| Problem::of_read(&Place::new(file, Spot::File), &error))?;
    let objects: Vec<Box<RawValue>> = serde_json::from_str(&text)
        .map_err(|error| Problem::of_file(file, format!("not a JSON array of objects: {error}")))?;
    let file = Arc::clone(file);
    Ok((1..).zip(objects).map(move |(number, object)| {
        let place = Place::new(&file, Spot::Element(number));
        let cells = cells_of(object.get().as_bytes());
        let cells = cells.map_err(|message| Problem::at(&place, message))?;
        Ok(Row::new(place, cells))
    }))
}

/// Returns the values of an object by their paths, such as `header.stamp`. Arrays have none; a time
/// of ROS has one of its own too.
pub(super) fn cells_of(json: &[u8]) -> Result<Cells, String> {
    let text = str::from_utf8(json).map_err(|_| "not UTF-8".to_owned())?;
    let mut cells = Vec::new();
    let quoted;
    let fields = match serde_json::from_str::<Fields<'_>>(text) {
        Ok(fields) => fields,
        Err(error) => {
            // Python writes NaN and Infinity, which JSON has not.
            quoted = quote_nan(text);
            let fields = quoted.as_deref().and_then(|text| serde_json::from_str(text).ok());
            fields.ok_or_else(|| no_object(text, &error))?
        }
    };
    flatten("", &fields, 0, &mut cells);
    Ok(cells)
}

fn flatten(outer: &str, fields: &Fields<'_>, depth: usize, cells: &mut Cells) {
    #[derive(Deserialize)]
    struct SecondsObject {
        sec: i64,
        #[serde(alias = "nsec")]
        nanosec: u32,
    }
    for (key, value) in fields {
        let (name, text) = (joined(outer, key), value.get());
        let text = match text.as_bytes().first() {
            Some(b'{') => {
                if let Ok(fields) = serde_json::from_str::<Fields<'_>>(text)
                    && depth < DEPTH
                {
                    flatten(&name, &fields, depth + 1, cells);
                }
                let time = serde_json::from_str(text).ok();
                time.map(|SecondsObject { sec, nanosec }| seconds(sec, nanosec))
            }
            Some(b'[') => None,
            Some(b'n') => Some(String::new()),
            Some(b'"') => serde_json::from_str(text).ok(),
            _ => Some(text.to_owned()),
        };
        cells.extend(text.map(|text| (name, text)));
    }
}

/// Returns the path of a value within another one.
pub(super) fn joined(outer: &str, name: &str) -> Arc<str> {
    if outer.is_empty() { name.into() } else { format!("{outer}.{name}").into() }
}

/// Returns a time or duration in seconds, with their unit, so that `--unit` does not change it.
/// Half a second before zero is -1 s and 500,000,000 ns, as ROS writes it.
pub(super) fn seconds(seconds: i64, nanoseconds: u32) -> String {
    let nanos = i128::from(seconds) * 1_000_000_000 + i128::from(nanoseconds);
    let sign = if nanos < 0 { "-" } else { "" };
    let nanos = nanos.unsigned_abs();
    format!("{sign}{}.{:09}s", nanos / 1_000_000_000, nanos % 1_000_000_000)
}

/// Returns the text with NaN and Infinity as texts; none if it has none.
fn quote_nan(text: &str) -> Option<String> {
    let (mut quoted, mut is_text) = (String::with_capacity(text.len() + 16), false);
    // Text ends at a quote, unless an odd number of backslashes is before it.
    for part in text.split_inclusive('"') {
        if is_text {
            quoted.push_str(part);
            let before = part.strip_suffix('"').unwrap_or(part);
            let backslashes = before.len() - before.trim_end_matches('\\').len();
            is_text = backslashes % 2 == 1;
        } else {
            let part = part.replace("NaN", "\"NaN\"").replace("Infinity", "\"Infinity\"");
            quoted.push_str(&part.replace("-\"Infinity", "\"-Infinity"));
            is_text = true;
        }
    }
    (quoted != text).then_some(quoted)
}

fn no_object(text: &str, error: &serde_json::Error) -> String {
    let start: String = text.chars().take(40).collect();
    let found = match text.as_bytes().first() {
        Some(b'{') if text.starts_with("{'") => {
            "it has Python's single quotes; write lines with json.dumps".to_owned()
        }
        Some(b'{') if error.is_eof() => {
            "it ends within an object; write each object on one line, as `jq -c .` does".to_owned()
        }
        Some(b'{') => error.to_string(),
        _ => format!("it begins with {start:?}"),
    };
    format!("not a JSON object: {found}; --skip-bad skips such lines")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_have_their_paths() {
        let text = r#"{"a":{"b":1.50,"c":null},"d":"x","e":[1],"f":{"sec":2,"nanosec":5},"g":NaN}"#;
        let cells = cells_of(text.as_bytes()).unwrap();
        let read: Vec<(&str, &str)> = cells.iter().map(|(name, text)| (&**name, &**text)).collect();
        let expected = [
            ("a.b", "1.50"),
            ("a.c", ""),
            ("d", "x"),
            ("f.nanosec", "5"),
            ("f.sec", "2"),
            ("f", "2.000000005s"),
            ("g", "NaN"),
        ];
        assert_eq!(read, expected);
    }

    #[test]
    fn only_bare_words_are_quoted() {
        let text = r#"{"NaN \" NaN":"NaN","b":-Infinity}"#;
        let quoted = r#"{"NaN \" NaN":"NaN","b":"-Infinity"}"#;
        assert_eq!(quote_nan(text).as_deref(), Some(quoted));
        assert_eq!(quote_nan("{\"a\":1}"), None);
    }
}
