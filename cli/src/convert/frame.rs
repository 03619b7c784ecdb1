//! `--frame`: rows that have a frame each, with columns for each source.

use crate::convert::entry::Entry;
use crate::convert::mapping::{Mapping, Refusal};
use crate::convert::row::Row;
use crate::convert::value::{self, Id};

/// Where an event of a frame stands.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct FrameColumn {
    /// Whose event it is; none of the frame itself.
    source: Option<String>,
    /// Which event, or what of it.
    part: FramePart,
    /// The column's name; of a duration it may be the value itself, and of `by` a source.
    column: String,
}

/// What a column of frames has; of one instant, events come in this order.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) enum FramePart {
    /// The timestamp; without such a column rows are counted from 0.
    T,
    /// The instant at which the message came.
    Open,
    /// The message's own deadline.
    Within,
    /// The instant of the source's request.
    Request,
    /// How long the request had, or local has.
    Deadline,
    /// The instant of the source's result.
    Result,
    /// The instant of the source's failure.
    Fail,
    /// The message that the source's value is of.
    Of,
    /// The instant at which its output was sent.
    Emit,
    /// The source of the output: its name or priority.
    By,
    /// The instant at which it was given up.
    Miss,
}

/// The columns of frames.
#[derive(Clone, Debug)]
pub(super) struct Frame<'a>(pub(super) Vec<&'a FrameColumn>);

const OF_FRAME: [(&str, FramePart); 6] = [
    ("t", FramePart::T),
    ("open", FramePart::Open),
    ("within", FramePart::Within),
    ("emit", FramePart::Emit),
    ("by", FramePart::By),
    ("miss", FramePart::Miss),
];
const OF_SOURCE: [(&str, FramePart); 5] = [
    ("request", FramePart::Request),
    ("deadline", FramePart::Deadline),
    ("result", FramePart::Result),
    ("fail", FramePart::Fail),
    ("of", FramePart::Of),
];

/// `open=COLUMN` of the frame, or `SOURCE.result=COLUMN` of a source.
///
/// # Errors
/// What to write instead.
pub(super) fn frame_column(text: &str) -> Result<FrameColumn, String> {
    let (what, column) = text.split_once('=').ok_or("write open=COLUMN or SOURCE.result=COLUMN")?;
    let column = column.to_owned();
    let named = |all: &[(&str, FramePart)], word: &str| {
        let found = all.iter().find(|(known, _)| *known == word).map(|(_, part)| *part);
        let words: Vec<&str> = all.iter().map(|(known, _)| *known).collect();
        found.ok_or_else(|| format!("no {word:?}; it is one of {}", words.join(", ")))
    };
    Ok(match what.rsplit_once('.') {
        None => FrameColumn { source: None, part: named(&OF_FRAME, what)?, column },
        Some((source, word)) => {
            let part = named(&OF_SOURCE, word)?;
            FrameColumn { source: Some(source.to_owned()), part, column }
        }
    })
}

impl FrameColumn {
    /// The key whose unit and form the column's values have.
    const fn key(&self) -> &'static str {
        match self.part {
            FramePart::Deadline => "deadline",
            FramePart::Within => "within",
            FramePart::T => "t",
            FramePart::Of => "of",
            FramePart::By => "p",
            _ => "at",
        }
    }

    /// Whether it is the column of this name.
    pub(super) fn is_called(&self, name: &str) -> bool {
        self.column == name
    }

    /// What the option has before `=`.
    fn what(&self) -> String {
        let all = OF_FRAME.iter().chain(&OF_SOURCE);
        let word = all.clone().find(|(_, part)| *part == self.part).map_or("", |(word, _)| *word);
        match &self.source {
            Some(source) => format!("{source}.{word}"),
            None => word.to_owned(),
        }
    }
}

impl<'a> Frame<'a> {
    /// The columns, those that are events in their order.
    ///
    /// # Errors
    /// If none says when a message came.
    pub(super) fn new(columns: &'a [FrameColumn]) -> Result<Option<Self>, String> {
        if columns.is_empty() {
            return Ok(None);
        }
        if !columns.iter().any(|column| column.part == FramePart::Open) {
            return Err("no column for open; name it with --frame open=COLUMN".to_owned());
        }
        let mut columns: Vec<&FrameColumn> = columns.iter().collect();
        columns.sort_by_key(|column| column.part);
        Ok(Some(Self(columns)))
    }

    /// The names that must occur: those that are no values.
    pub(super) fn named(&self, mapping: &Mapping<'_>) -> Vec<(&'static str, String, &'a str)> {
        let columns = self.0.iter().filter(|column| !mapping.is_value(column));
        columns.map(|column| ("--frame", column.what(), &*column.column)).collect()
    }

    /// Whether rows say which message they are.
    pub(super) fn has_ids(&self) -> bool {
        self.0.iter().any(|column| column.part == FramePart::T)
    }

    pub(super) fn sources(&self) -> impl Iterator<Item = &'a str> {
        self.0.iter().filter_map(|column| column.source.as_deref())
    }

    fn of(&self, source: Option<&str>, part: FramePart) -> Option<&'a FrameColumn> {
        let found = self.0.iter().find(|it| it.source.as_deref() == source && it.part == part);
        found.copied()
    }
}

impl Mapping<'_> {
    /// Whether a column's name is the value itself.
    fn is_value(&self, column: &FrameColumn) -> bool {
        let name = &*column.column;
        let is_value = match column.part {
            FramePart::Deadline | FramePart::Within => {
                value::duration(name, self.unit_of(column.key())).is_ok()
            }
            FramePart::By => self.sources.has(name),
            _ => false,
        };
        is_value && !self.names.has(name)
    }

    /// What stands in a column; none if it is empty.
    fn frame_cell<'r>(&self, row: &'r Row, column: &'r FrameColumn) -> Option<&'r str> {
        match row.cell(&column.column) {
            Some(text) => Some(text).filter(|text| !self.is_missing(text)),
            None => self.is_value(column).then_some(&*column.column),
        }
    }

    /// The events of a row that is a frame.
    pub(super) fn frame_entries(&mut self, row: &Row, number: u64) -> Result<Vec<Entry>, Refusal> {
        let Some(frame) = self.frame.clone() else { return Ok(Vec::new()) };
        for source in frame.sources() {
            let known = self.sources.priority(source);
            known
                .map_err(|why| Refusal::from(format!("--frame {source}.…: {source:?} is {why}")))?;
        }
        let t = match frame.of(None, FramePart::T) {
            Some(column) => {
                let text = self.frame_cell(row, column);
                let text = text.ok_or_else(|| Self::empty(row, column, "the frame's id"))?;
                self.id("t", text).map_err(|refusal| renamed(refusal, "t", &column.column))?
            }
            None => Id::Number(number),
        };
        let mut entries = Vec::new();
        for column in &frame.0 {
            let ev = match column.part {
                FramePart::Open => "open",
                FramePart::Emit => "emit",
                FramePart::Miss => "miss",
                FramePart::Request => "request",
                FramePart::Result => "result",
                FramePart::Fail => "fail",
                FramePart::T
                | FramePart::By
                | FramePart::Deadline
                | FramePart::Within
                | FramePart::Of => continue,
            };
            let Some(text) = self.frame_cell(row, column) else {
                if column.part == FramePart::Open {
                    let kind = "frames that do not say when their message came";
                    self.notes.add(kind, &row.place, || format!("column {:?}", column.column));
                }
                continue;
            };
            let time = self.instant(row, "at", text);
            let at = time.map_err(|refusal| renamed(refusal, "at", &column.column))?.nanos;
            let source = column.source.as_deref();
            let p = source.map(|source| self.sources.priority(source)).transpose()?;
            let place = row.place.clone();
            let t = Some(t.clone());
            let mut entry =
                Entry { place, row: number, ev, at, t, p, due: None, of: None, more: Vec::new() };
            self.add_parts(&mut entry, row, &frame, column)?;
            entries.push(entry);
        }
        Ok(entries)
    }

    /// Adds what other columns say of an event.
    fn add_parts(
        &mut self,
        entry: &mut Entry,
        row: &Row,
        frame: &Frame<'_>,
        column: &FrameColumn,
    ) -> Result<(), Refusal> {
        let source = column.source.as_deref();
        match column.part {
            FramePart::Open => {
                let within = frame.of(None, FramePart::Within);
                let local = frame.of(Some("local"), FramePart::Deadline);
                for (key, column) in [("deadline", local), ("within", within)] {
                    if let Some(time) = self.frame_duration(row, column)? {
                        entry.more.push((key, time.to_string()));
                    }
                }
            }
            FramePart::Request => {
                let named = frame.of(source, FramePart::Deadline);
                let given = self.deadlines.of(source.unwrap_or_default()).map(i128::from);
                let Some(deadline) = self.frame_duration(row, named)?.or(given) else {
                    let source = source.unwrap_or_default();
                    let message = format!(
                        "the request to {source} has no deadline; name its column, or state one for all, with --frame \
                         {source}.deadline=100ms"
                    );
                    return Err(match named {
                        Some(column) => Self::empty(row, column, "the request's deadline"),
                        None => Refusal::from(message),
                    });
                };
                entry.due = Some(entry.at.saturating_add(deadline));
            }
            FramePart::Result => {
                if let Some(column) = frame.of(source, FramePart::Of)
                    && let Some(text) = self.frame_cell(row, column)
                {
                    entry.of = Some(self.id("of", text)?);
                }
            }
            FramePart::Emit => {
                // Without it, whose it is follows from the results.
                let Some(column) = frame.of(None, FramePart::By) else { return Ok(()) };
                let Some(text) = self.frame_cell(row, column) else {
                    return Err(Self::empty(row, column, "the output's source"));
                };
                let p = self.sources.priority(text);
                let name = &column.column;
                let wrong = |why| Refusal::from(format!("column {name:?}: {text:?} is {why}"));
                entry.p = Some(p.map_err(wrong)?);
            }
            _ => {}
        }
        Ok(())
    }

    fn frame_duration(
        &mut self,
        row: &Row,
        column: Option<&FrameColumn>,
    ) -> Result<Option<i128>, Refusal> {
        let Some(column) = column else { return Ok(None) };
        let Some(text) = self.frame_cell(row, column) else { return Ok(None) };
        let time = self.duration(row, column.key(), text);
        Ok(Some(time.map_err(|refusal| renamed(refusal, column.key(), &column.column))?.nanos))
    }

    fn empty(row: &Row, column: &FrameColumn, what: &str) -> Refusal {
        let name = &column.column;
        let message = match row.cell(name) {
            Some("") => format!("column {name:?}, {what}, is empty"),
            Some(text) => {
                format!("column {name:?}, {what}, is {text}, which --missing says is no value")
            }
            None => format!("no column {name:?}, which --frame names for {}", column.what()),
        };
        Refusal { message, lacks: Some(name.clone()) }
    }
}

/// A refusal about a key, with the column's name.
fn renamed(refusal: Refusal, key: &str, name: &str) -> Refusal {
    let Refusal { message, lacks } = refusal;
    Refusal {
        message: message.replacen(&format!("column {key:?}"), &format!("column {name:?}"), 1),
        lacks,
    }
}
