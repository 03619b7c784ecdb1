//! Rows of JSON: an object a line, or an array of objects.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{BufRead, Read};
use std::sync::Arc;

use serde::Deserialize;
use serde_json::value::RawValue;

use crate::convert::row::{Place, Problem, ProblemKind, Row, Source, Spot};

/// How deep objects within objects are read.
const DEPTH: usize = 16;

type Fields<'j> = BTreeMap<Cow<'j, str>, &'j RawValue>;

/// JSON lines that are being read. Blank lines are passed over.
pub(super) struct LineSource<R> {
    file: Arc<str>,
    inner: R,
    line: Vec<u8>,
    number: u64,
    has_ended: bool,
}

/// The objects of one array.
pub(super) struct ArraySource {
    file: Arc<str>,
    objects: std::vec::IntoIter<Box<RawValue>>,
    number: u64,
}

impl<R: BufRead> LineSource<R> {
    pub(super) fn new(file: &Arc<str>, inner: R) -> Self {
        let (line, number) = (Vec::new(), 0);
        Self { file: Arc::clone(file), inner, line, number, has_ended: false }
    }
}

impl<R: BufRead> Source for LineSource<R> {
    fn next_row(&mut self) -> Result<Option<Row>, Problem> {
        while !self.has_ended {
            self.line.clear();
            self.number += 1;
            let place = Place { file: Arc::clone(&self.file), spot: Spot::Line(self.number) };
            let read = self.inner.read_until(b'\n', &mut self.line);
            if let Err(error) = read {
                self.has_ended = true;
                let is_cut = error.kind() == std::io::ErrorKind::UnexpectedEof;
                let kind = if is_cut { ProblemKind::Cut } else { ProblemKind::File };
                return Err(Problem { place, message: error.to_string(), kind });
            }
            self.has_ended = !self.line.ends_with(b"\n");
            let text = self.line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&self.line);
            if text.trim_ascii().is_empty() {
                continue;
            }
            // A line without its end may be half of one.
            let kind = if self.has_ended { ProblemKind::Cut } else { ProblemKind::Row };
            let cells = cells_of(text.trim_ascii());
            let cells = cells.map_err(|message| Problem { place: place.clone(), message, kind })?;
            return Ok(Some(Row { place, cells, log_time: None, topic: None }));
        }
        Ok(None)
    }
}

impl ArraySource {
    /// Reads the array.
    ///
    /// # Errors
    /// If it is none.
    pub(super) fn new(file: &Arc<str>, mut inner: impl Read) -> Result<Self, Problem> {
        let mut text = String::new();
        let read = inner.read_to_string(&mut text).map_err(|error| error.to_string());
        let objects = read.and_then(|_| {
            let text = text.trim_start_matches('\u{feff}');
            serde_json::from_str(text).map_err(|error| format!("no JSON array of objects: {error}"))
        });
        let objects: Vec<Box<RawValue>> = objects.map_err(|message| {
            let place = Place { file: Arc::clone(file), spot: Spot::File };
            Problem { place, message, kind: ProblemKind::File }
        })?;
        Ok(Self { file: Arc::clone(file), objects: objects.into_iter(), number: 0 })
    }
}

impl Source for ArraySource {
    fn next_row(&mut self) -> Result<Option<Row>, Problem> {
        let Some(object) = self.objects.next() else { return Ok(None) };
        self.number += 1;
        let place = Place { file: Arc::clone(&self.file), spot: Spot::Element(self.number) };
        let cells = cells_of(object.get().as_bytes());
        let fault = |message| Problem { place: place.clone(), message, kind: ProblemKind::Row };
        let cells = cells.map_err(fault)?;
        Ok(Some(Row { place, cells, log_time: None, topic: None }))
    }
}

/// The values of an object by their paths, such as `header.stamp`. Arrays have none; a time of ROS has one of its own too.
///
/// # Errors
/// If it is no object.
pub(super) fn cells_of(json: &[u8]) -> Result<Vec<(Arc<str>, String)>, String> {
    let text = str::from_utf8(json).map_err(|_| match json {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => {
            "not UTF-8 but UTF-16; iconv -f utf-16 -t utf-8 makes it readable".to_owned()
        }
        _ => "not UTF-8".to_owned(),
    })?;
    let mut cells = Vec::new();
    match serde_json::from_str::<Fields<'_>>(text) {
        Ok(fields) => flatten("", &fields, 0, &mut cells),
        Err(error) => {
            // Python writes NaN and Infinity, which JSON has not.
            let quoted = quote_nan(text);
            let fields = quoted.as_deref().and_then(|text| serde_json::from_str(text).ok());
            let fields: Fields<'_> = fields.ok_or_else(|| no_object(text, &error))?;
            flatten("", &fields, 0, &mut cells);
        }
    }
    Ok(cells)
}

fn flatten(outer: &str, fields: &Fields<'_>, depth: usize, cells: &mut Vec<(Arc<str>, String)>) {
    #[derive(Deserialize)]
    struct SecondsObject {
        sec: i64,
        #[serde(alias = "nsec")]
        nanosec: u32,
    }
    for (key, value) in fields {
        let name = if outer.is_empty() { key.to_string() } else { format!("{outer}.{key}") };
        let text = value.get();
        if text.starts_with('{') {
            if let Ok(SecondsObject { sec, nanosec }) = serde_json::from_str(text) {
                cells.push((name.as_str().into(), seconds(sec, nanosec)));
            }
            if let Ok(fields) = serde_json::from_str::<Fields<'_>>(text)
                && depth < DEPTH
            {
                flatten(&name, &fields, depth + 1, cells);
            }
            continue;
        }
        if text.starts_with('[') {
            continue;
        }
        let text = match text {
            "null" => Some(String::new()),
            text if text.starts_with('"') => serde_json::from_str(text).ok(),
            text => Some(text.to_owned()),
        };
        cells.extend(text.map(|text| (name.as_str().into(), text)));
    }
}

/// Returns a time or duration in seconds, with their unit, so that `--unit` does not change it. Half a second before zero is
/// -1 s and 500,000,000 ns, as ROS writes it.
pub(super) fn seconds(seconds: i64, nanoseconds: u32) -> String {
    let nanos = i128::from(seconds) * 1_000_000_000 + i128::from(nanoseconds);
    let sign = if nanos < 0 { "-" } else { "" };
    let nanos = nanos.unsigned_abs();
    format!("{sign}{}.{:09}s", nanos / 1_000_000_000, nanos % 1_000_000_000)
}

/// The text with NaN and Infinity as texts; none if it has none.
fn quote_nan(text: &str) -> Option<String> {
    let mut quoted = String::with_capacity(text.len() + 16);
    let (mut rest, mut is_changed) = (text, false);
    while let Some(first) = rest.chars().next() {
        let word = ["NaN", "-Infinity", "Infinity"].into_iter().find(|word| rest.starts_with(word));
        if let Some(word) = word {
            quoted.extend(["\"", word, "\""]);
            rest = &rest[word.len()..];
            is_changed = true;
            continue;
        }
        let len = if first == '"' { text_len(rest) } else { first.len_utf8() };
        quoted.push_str(&rest[..len]);
        rest = &rest[len..];
    }
    is_changed.then_some(quoted)
}

/// How long the quoted text is that this begins with.
fn text_len(text: &str) -> usize {
    let mut is_escaped = false;
    for (at, c) in text.char_indices().skip(1) {
        match c {
            '"' if !is_escaped => return at + 1,
            _ => is_escaped = c == '\\' && !is_escaped,
        }
    }
    text.len()
}

fn no_object(text: &str, error: &serde_json::Error) -> String {
    let start: String = text.chars().take(40).collect();
    let found = match text.as_bytes().first() {
        Some(b'{') if text.starts_with("{'") => {
            "it has quotes as Python prints them; write lines with json.dumps".to_owned()
        }
        Some(b'{') if error.is_eof() => {
            "it ends within an object; one object a line is read, as `jq -c .` writes it".to_owned()
        }
        Some(b'{') => error.to_string(),
        _ => format!("it begins with {start:?}"),
    };
    format!("not a JSON object: {found}; --skip-bad leaves such lines out")
        .replace(char::is_control, "\u{fffd}")
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
            ("f", "2.000000005s"),
            ("f.nanosec", "5"),
            ("f.sec", "2"),
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
