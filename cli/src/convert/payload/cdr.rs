//! [`CdrLayout`]: a ROS 2 message out of its bytes, which are CDR as the DDS standard for types has it.

use thiserror::Error;

use crate::convert::json::seconds;

/// How deep messages may lie within each other; a definition may contain itself.
const DEPTH: usize = 32;
/// How many messages within a message may have no bytes.
const EMPTY: usize = 10_000;

/// The values of a message by their paths, such as `header.stamp.sec`, and what is no array.
pub(super) type MessageFields = Vec<(String, String)>;

/// The types of a message; the first one is its own.
#[derive(Debug)]
pub(in crate::convert) struct CdrLayout {
    pub(super) types: Vec<CdrType>,
}

/// A type with its fields.
#[derive(Debug, Default)]
pub(super) struct CdrType {
    pub(super) fields: Vec<CdrField>,
    /// Whether it is a time or a duration.
    pub(super) is_time: bool,
}

#[derive(Debug)]
pub(super) struct CdrField {
    pub(super) name: String,
    pub(super) kind: FieldKind,
    pub(super) shape: FieldShape,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum FieldKind {
    Bool,
    Unsigned(usize),
    Signed(usize),
    /// Of so many bytes.
    Float(usize),
    Text,
    /// Which of the types.
    Message(usize),
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum FieldShape {
    One,
    Array(u64),
    Sequence,
}

/// Why bytes are no message of the type.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Error)]
pub(super) enum CdrError {
    #[error("it is CDR of the kind {0:#06x}; 0x0000 and 0x0001 are read")]
    Encapsulation(u16),
    #[error("its bytes end within {0}")]
    Short(&'static str),
    #[error("its type lies too deep or too often within itself")]
    Nested,
}

impl CdrLayout {
    /// The values of a message; those in arrays are passed over.
    ///
    /// # Errors
    /// If the bytes are no message of the type.
    pub(super) fn read(&self, data: &[u8]) -> Result<MessageFields, CdrError> {
        let (kind, body) = data.split_at_checked(4).ok_or(CdrError::Short("the header"))?;
        let is_little = match u16::from_be_bytes([kind[0], kind[1]]) {
            0 => false,
            1 => true,
            kind => return Err(CdrError::Encapsulation(kind)),
        };
        let cursor = CdrCursor { body, at: 0, is_little };
        let left = body.len() + EMPTY;
        let mut reader = FieldReader { types: &self.types, cursor, left, fields: Vec::new() };
        reader.message(0, Some(""), 0)?;
        Ok(reader.fields)
    }
}

struct FieldReader<'d> {
    types: &'d [CdrType],
    cursor: CdrCursor<'d>,
    /// How many more messages may be read.
    left: usize,
    fields: MessageFields,
}

impl FieldReader<'_> {
    /// Reads a message of the type; within an array there is no path, and nothing is kept.
    fn message(&mut self, of: usize, path: Option<&str>, depth: usize) -> Result<(), CdrError> {
        if depth == DEPTH || self.left == 0 {
            return Err(CdrError::Nested);
        }
        self.left -= 1;
        let CdrType { fields, is_time } = &self.types[of];
        if fields.is_empty() {
            // An empty structure has one member, which says nothing.
            return self.cursor.take(1).map(|_| ());
        }
        let first = self.fields.len();
        for field in fields {
            let own = path.map(|path| match path {
                "" => field.name.clone(),
                path => format!("{path}.{}", field.name),
            });
            match field.shape {
                FieldShape::One => self.value(field.kind, own, depth)?,
                FieldShape::Array(len) => self.array(field.kind, len, depth)?,
                FieldShape::Sequence => {
                    let len = self.cursor.unsigned(4)?;
                    self.array(field.kind, len, depth)?;
                }
            }
        }
        if let (true, Some(path), [(_, sec), (_, nanosec)]) =
            (*is_time, path, &self.fields[first..])
            && let (Ok(sec), Ok(nanosec)) = (sec.parse(), nanosec.parse())
        {
            self.fields.push((path.to_owned(), seconds(sec, nanosec)));
        }
        Ok(())
    }

    fn value(
        &mut self,
        kind: FieldKind,
        path: Option<String>,
        depth: usize,
    ) -> Result<(), CdrError> {
        let text = match kind {
            FieldKind::Message(of) => return self.message(of, path.as_deref(), depth + 1),
            FieldKind::Text => self.cursor.text()?,
            FieldKind::Bool => (self.cursor.unsigned(1)? != 0).to_string(),
            FieldKind::Unsigned(size) => self.cursor.unsigned(size)?.to_string(),
            FieldKind::Signed(size) => self.cursor.signed(size)?.to_string(),
            FieldKind::Float(size) => self.cursor.float(size)?,
        };
        self.fields.extend(path.map(|path| (path, text)));
        Ok(())
    }

    /// Passes over so many values.
    fn array(&mut self, kind: FieldKind, len: u64, depth: usize) -> Result<(), CdrError> {
        match kind {
            FieldKind::Bool => self.cursor.skip(1, len),
            FieldKind::Unsigned(size) | FieldKind::Signed(size) | FieldKind::Float(size) => {
                self.cursor.skip(size, len)
            }
            FieldKind::Text | FieldKind::Message(_) => {
                for _ in 0..len {
                    let before = self.cursor.at;
                    self.value(kind, None, depth)?;
                    // Those without bytes have no end otherwise.
                    if self.cursor.at == before {
                        break;
                    }
                }
                Ok(())
            }
        }
    }
}

/// The bytes behind the header, and how many were read.
struct CdrCursor<'d> {
    body: &'d [u8],
    at: usize,
    is_little: bool,
}

impl<'d> CdrCursor<'d> {
    /// A number's bytes, which lie at a multiple of their length.
    fn take(&mut self, size: usize) -> Result<&'d [u8], CdrError> {
        let at = self.at.next_multiple_of(size);
        let bytes = self.body.get(at..at + size).ok_or(CdrError::Short("a number"))?;
        self.at = at + size;
        Ok(bytes)
    }

    fn skip(&mut self, size: usize, len: u64) -> Result<(), CdrError> {
        if len == 0 {
            return Ok(());
        }
        let bytes = usize::try_from(len).ok().and_then(|len| len.checked_mul(size));
        let end = bytes.and_then(|bytes| self.at.next_multiple_of(size).checked_add(bytes));
        self.at = end.filter(|end| *end <= self.body.len()).ok_or(CdrError::Short("an array"))?;
        Ok(())
    }

    fn unsigned(&mut self, size: usize) -> Result<u64, CdrError> {
        let is_little = self.is_little;
        let fold = |number: u64, byte: &u8| number << 8 | u64::from(*byte);
        let bytes = self.take(size)?;
        Ok(if is_little { bytes.iter().rev().fold(0, fold) } else { bytes.iter().fold(0, fold) })
    }

    fn signed(&mut self, size: usize) -> Result<i64, CdrError> {
        let unused = 64 - 8 * u32::try_from(size).unwrap_or(8);
        Ok((self.unsigned(size)? << unused).cast_signed() >> unused)
    }

    fn float(&mut self, size: usize) -> Result<String, CdrError> {
        let bits = self.unsigned(size)?;
        Ok(match u32::try_from(bits) {
            Ok(bits) if size == 4 => f32::from_bits(bits).to_string(),
            _ => f64::from_bits(bits).to_string(),
        })
    }

    /// A text: its length with the NUL at its end, then itself.
    fn text(&mut self) -> Result<String, CdrError> {
        let len = usize::try_from(self.unsigned(4)?).unwrap_or(usize::MAX);
        let end = self.at.checked_add(len);
        let bytes = end.and_then(|end| self.body.get(self.at..end));
        let bytes = bytes.ok_or(CdrError::Short("a text"))?;
        self.at += len;
        Ok(String::from_utf8_lossy(bytes.strip_suffix(&[0]).unwrap_or(bytes)).into_owned())
    }
}

#[cfg(test)]
mod tests;
