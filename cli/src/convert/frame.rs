//! `--frame`: rows that have a frame each, with columns for each source; each event of a frame is a
//! view of its row.

use crate::convert::key::word;
use crate::convert::mapping::{Named, View, ViewKind};

/// The place of a frame's value.
#[derive(Clone, Debug)]
pub(super) struct FrameColumn {
    /// The source, or `None` for the frame itself.
    source: Option<String>,
    /// The kind.
    word: &'static str,
    /// The column's name; of a duration it may be the value itself, and of `by` a source.
    column: String,
}

/// The keys of a frame itself.
const OF_FRAME: [&str; 6] = ["t", "open", "within", "emit", "by", "miss"];
/// The keys of each source of a frame.
const OF_SOURCE: [&str; 6] = ["request", "deadline", "result", "fail", "of", "for"];
/// The events, those of one instant in this order, and what else says something of each: the key of
/// the trace, and the word for it of the frame itself, of local, or of the event's own source.
const EVENTS: [(&str, &[FramePart]); 6] = [
    ("open", &[("within", Whose::Frame, "within"), ("deadline", Whose::Local, "deadline")]),
    ("request", &[("deadline", Whose::Own, "deadline")]),
    ("result", &[("of", Whose::Own, "of"), ("for", Whose::Own, "for")]),
    ("fail", &[]),
    ("emit", &[("p", Whose::Frame, "by")]),
    ("miss", &[]),
];

type FramePart = (&'static str, Whose, &'static str);

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Whose {
    Frame,
    Local,
    Own,
}

/// Reads `open=COLUMN` of the frame, or `SOURCE.result=COLUMN` of a source.
pub(super) fn frame_column(text: &str) -> Result<FrameColumn, String> {
    let (what, column) = text.split_once('=').ok_or("write open=COLUMN or SOURCE.result=COLUMN")?;
    let column = column.to_owned();
    Ok(match what.rsplit_once('.') {
        None => FrameColumn { source: None, word: word("", what, &OF_FRAME)?, column },
        Some((source, what)) => {
            let source = Some(source.to_owned());
            FrameColumn { source, word: word("", what, &OF_SOURCE)?, column }
        }
    })
}

impl FrameColumn {
    pub(super) fn source(&self) -> Option<&str> {
        self.source.as_deref()
    }

    /// Returns the column as a name that the user gave.
    pub(super) fn named(&self) -> Named<'_> {
        let key = match self.word {
            "by" => "p",
            word @ ("t" | "within" | "deadline" | "of" | "for") => word,
            _ => "at",
        };
        let dot = if self.source.is_some() { "." } else { "" };
        let what = format!("{}{dot}{}", self.source.as_deref().unwrap_or_default(), self.word);
        Named { key, what: what.into(), name: (&*self.column).into() }
    }
}

/// Returns the events of each row, in order.
pub(super) fn views(columns: &[FrameColumn]) -> Result<Vec<View<'_>>, &'static str> {
    if !columns.iter().any(|column| column.word == "open") {
        return Err("no column for open; name it with --frame open=COLUMN");
    }
    let find = |source: Option<&str>, word: &str| {
        columns.iter().find(|it| it.source.as_deref() == source && it.word == word)
    };
    let mut views = Vec::new();
    for (event, parts) in EVENTS {
        for column in columns.iter().filter(|column| column.word == event) {
            let source = column.source.as_deref();
            let mut named = vec![column.named()];
            named.extend(find(None, "t").map(FrameColumn::named));
            for (key, whose, word) in parts {
                let of = match whose {
                    Whose::Frame => None,
                    Whose::Local => Some("local"),
                    Whose::Own => source,
                };
                named.extend(find(of, word).map(|part| Named { key, ..part.named() }));
            }
            let kind = ViewKind::Frame;
            views.push(View { kind, topic: None, event: Some(event), source, named });
        }
    }
    Ok(views)
}
