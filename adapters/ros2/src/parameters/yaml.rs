//! YAML as a tree of marked nodes: the small part of it that parameter files need.

use std::collections::HashSet;

use saphyr_parser::{Event, Parser, ScalarStyle, ScanError, Span, StrInput};
use thiserror::Error;

/// The most levels of mappings and lists.
const NESTING: usize = 32;

/// A line and a column, both from 1.
pub(super) type Position = (usize, usize);

/// A value and where it begins.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Node {
    pub(super) mark: Position,
    pub(super) content: Content,
}

/// The value of a node.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) enum Content {
    /// Text; only plain text may be something other than a string.
    Scalar {
        text: String,
        is_plain: bool,
    },
    List(Vec<Node>),
    Mapping(Vec<YamlEntry>),
}

/// One key of a mapping, where it is, and its value.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct YamlEntry {
    pub(super) mark: Position,
    pub(super) key: String,
    pub(super) value: Node,
}

/// The reason why text is refused as YAML.
#[derive(Clone, PartialEq, Eq, Debug, Error)]
pub enum YamlError {
    /// It is not YAML.
    #[error("not YAML: {0}")]
    Syntax(String),
    /// An anchor or an alias, which could make a small file a huge one.
    #[error("anchors and aliases are not supported; write the value out")]
    Alias,
    /// A tag other than `!!str`.
    #[error("tags other than !!str are not supported; leave it out")]
    Tag,
    /// Too many levels.
    #[error("more than {NESTING} levels; flatten the names with dots")]
    Deep,
    /// A key that is a list or a mapping, or has control characters.
    #[error("a key must be a name")]
    Key,
    /// A key twice in one mapping.
    #[error("{0} is given twice; leave one out")]
    Twice(String),
    /// A second document.
    #[error("a second document begins here; leave it out, or make it a file of its own")]
    Documents,
}

/// Returns the document in the text, if there is one.
///
/// # Errors
/// The first thing that is wrong, with its position.
pub(super) fn read(text: &str) -> Result<Option<Node>, (Position, YamlError)> {
    let mut reader = YamlReader { events: Parser::new_from_str(text) };
    let mut root = None;
    loop {
        let (event, mark) = reader.next()?;
        match event {
            Event::StreamEnd => return Ok(root),
            Event::DocumentStart(_) if root.is_some() => return Err((mark, YamlError::Documents)),
            Event::DocumentStart(_) => {
                let (event, mark) = reader.next()?;
                root = Some(reader.node(event, mark, 0)?);
            }
            // The parser puts values into documents.
            _ => {}
        }
    }
}

struct YamlReader<'a> {
    events: Parser<'a, StrInput<'a>>,
}

type YamlResult<T> = Result<T, (Position, YamlError)>;

impl<'a> YamlReader<'a> {
    fn next(&mut self) -> YamlResult<(Event<'a>, Position)> {
        match self.events.next_event() {
            Some(Ok((event, span))) => Ok((event, begin(span))),
            Some(Err(error)) => Err(syntax(&error)),
            None => Ok((Event::StreamEnd, (1, 1))),
        }
    }

    /// Returns the value that begins with the event, `depth` levels down.
    fn node(&mut self, event: Event<'a>, mark: Position, depth: usize) -> YamlResult<Node> {
        if depth > NESTING {
            return Err((mark, YamlError::Deep));
        }
        let content = match event {
            Event::Scalar(text, style, 0, tag) => {
                let is_text = tag
                    .as_ref()
                    .is_some_and(|tag| tag.is_yaml_core_schema() && tag.suffix == "str");
                if tag.is_some() && !is_text {
                    return Err((mark, YamlError::Tag));
                }
                let is_plain = style == ScalarStyle::Plain && !is_text;
                Content::Scalar { text: text.into_owned(), is_plain }
            }
            Event::SequenceStart(0, None) => Content::List(self.list(depth)?),
            Event::MappingStart(0, None) => Content::Mapping(self.mapping(depth)?),
            Event::SequenceStart(0, Some(_)) | Event::MappingStart(0, Some(_)) => {
                return Err((mark, YamlError::Tag));
            }
            Event::Alias(_)
            | Event::Scalar(..)
            | Event::SequenceStart(..)
            | Event::MappingStart(..) => return Err((mark, YamlError::Alias)),
            _ => return Err((mark, YamlError::Syntax("a value is missing".to_owned()))),
        };
        Ok(Node { mark, content })
    }

    fn list(&mut self, depth: usize) -> YamlResult<Vec<Node>> {
        let mut list = Vec::new();
        loop {
            match self.next()? {
                (Event::SequenceEnd, _) => return Ok(list),
                (event, mark) => list.push(self.node(event, mark, depth + 1)?),
            }
        }
    }

    fn mapping(&mut self, depth: usize) -> YamlResult<Vec<YamlEntry>> {
        let mut mapping = Vec::new();
        let mut keys = HashSet::new();
        loop {
            let (event, mark) = match self.next()? {
                (Event::MappingEnd, _) => return Ok(mapping),
                (event, mark) => (event, mark),
            };
            let key = self.node(event, mark, depth + 1)?;
            let key = match key.content {
                // A terminal would take them for commands when the name is printed.
                Content::Scalar { text, .. } if !text.contains(char::is_control) => text,
                Content::Scalar { .. } | Content::List(_) | Content::Mapping(_) => {
                    return Err((mark, YamlError::Key));
                }
            };
            if !keys.insert(key.clone()) {
                return Err((mark, YamlError::Twice(key)));
            }
            let (event, at) = self.next()?;
            let value = self.node(event, at, depth + 1)?;
            mapping.push(YamlEntry { mark, key, value });
        }
    }
}

fn begin(span: Span) -> Position {
    (span.start.line(), span.start.col() + 1)
}

fn syntax(error: &ScanError) -> (Position, YamlError) {
    let mark = error.marker();
    // It may name a character of the text.
    let info = error.info().replace(char::is_control, "\u{fffd}");
    ((mark.line(), mark.col() + 1), YamlError::Syntax(info))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn error(text: &str) -> String {
        let ((line, column), error) = read(text).unwrap_err();
        format!("{line}:{column}: {error}")
    }

    #[test]
    fn what_parameter_files_do_not_need_is_refused() {
        let cases = [
            ("a: &x 1", "1:4: anchors and aliases are not supported; write the value out"),
            ("a: &x [1]", "1:4: anchors and aliases are not supported; write the value out"),
            ("a: !!int 1", "1:4: tags other than !!str are not supported; leave it out"),
            ("a: !x [1]", "1:4: tags other than !!str are not supported; leave it out"),
            ("? [a]\n: 1", "1:3: a key must be a name"),
            (r#"{"\e[31m": 1}"#, "1:2: a key must be a name"),
            ("a: 1\nb: 2\na: 3", "3:1: a is given twice; leave one out"),
            (
                "a: 1\n---\nb: 2",
                "2:1: a second document begins here; leave it out, or make it a file of its own",
            ),
        ];
        for (text, expected) in cases {
            assert_eq!(error(text), expected, "{text}");
        }
        assert!(error("a: [1").contains("not YAML: "), "{}", error("a: [1"));
        assert!(error("a: *x").contains("not YAML: "), "{}", error("a: *x"));
    }

    #[test]
    fn nesting_is_bounded() {
        let nested = |levels| "[".repeat(levels) + &"]".repeat(levels);
        assert!(read(&nested(33)).is_ok());
        assert_eq!(error(&nested(34)), "1:34: more than 32 levels; flatten the names with dots");
        assert!(read(&nested(100_000)).is_err());
    }

    #[test]
    fn an_empty_text_has_no_document() {
        assert_eq!(read("").unwrap(), None);
        assert_eq!(read("# nothing\n").unwrap(), None);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2_000))]
        #[test]
        fn any_text_is_a_tree_or_an_error(
            text in r#"[ \n\t:,?!&*#|>%@`'"\\a1~.{}\[\]-]{0,40}|.{0,40}"#,
        ) {
            drop(read(&text));
        }
    }
}
