//! [`CdrLayout`]: a ROS 2 message out of its bytes, which are CDR as the DDS standard for types has it.

use std::sync::Arc;

use thiserror::Error;

use crate::convert::json::{joined, seconds};
use crate::convert::row::Cells;

/// Messages lie within each other at most to this depth.
const DEPTH: usize = 32;
/// At most this many messages within a message may have no bytes.
const EMPTY: usize = 10_000;

/// The types of a message; the first one is its own.
#[derive(Debug)]
pub(in crate::convert) struct CdrLayout {
    pub(super) types: Vec<CdrType>,
}

/// A type with its fields.
#[derive(Debug, Default)]
pub(super) struct CdrType {
    pub(super) fields: Vec<CdrField>,
    /// `true` if it is a time or a duration.
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
    /// A number of this many bytes, like the next two kinds.
    Unsigned(usize),
    Signed(usize),
    Float(usize),
    Text,
    /// A message of the type with this index.
    Message(usize),
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum FieldShape {
    One,
    Array(u64),
    Sequence,
}

/// The reason why bytes are no message of a type.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Error)]
pub(in crate::convert) enum CdrError {
    #[error(
        "its CDR encapsulation is {0:#06x}; convert reads plain CDR, which is 0x0000 or 0x0001"
    )]
    Encapsulation(u16),
    #[error("it ends within {0}")]
    Short(&'static str),
    #[error("its type is nested too deeply, or has too many messages within")]
    Nested,
}

impl CdrLayout {
    /// Returns the values of a message by their paths, such as `header.stamp.sec`; those in arrays
    /// are passed over.
    pub(super) fn read(&self, data: &[u8]) -> Result<Cells, CdrError> {
        let (kind, body) = data.split_at_checked(4).ok_or(CdrError::Short("the header"))?;
        let is_little = match u16::from_be_bytes([kind[0], kind[1]]) {
            0 => false,
            1 => true,
            kind => return Err(CdrError::Encapsulation(kind)),
        };
        let (types, left) = (&*self.types, body.len() + EMPTY);
        let mut reader = FieldReader { types, body, at: 0, is_little, left, cells: Vec::new() };
        reader.message(0, Some(""), 0)?;
        Ok(reader.cells)
    }
}

struct FieldReader<'d> {
    types: &'d [CdrType],
    /// The bytes behind the header, and how many were read.
    body: &'d [u8],
    at: usize,
    is_little: bool,
    /// The number of messages that may still be read.
    left: usize,
    cells: Cells,
}

impl<'d> FieldReader<'d> {
    /// Reads a message of the type; within an array there is no path, and nothing is kept.
    fn message(&mut self, of: usize, path: Option<&str>, depth: usize) -> Result<(), CdrError> {
        if depth == DEPTH || self.left == 0 {
            return Err(CdrError::Nested);
        }
        self.left -= 1;
        let CdrType { fields, is_time } = &self.types[of];
        if fields.is_empty() {
            // An empty structure has one member, which says nothing.
            return self.take(1).map(|_| ());
        }
        let first = self.cells.len();
        for field in fields {
            let own = path.map(|path| joined(path, &field.name));
            match field.shape {
                FieldShape::One => self.value(field.kind, own, depth)?,
                FieldShape::Array(len) => self.array(field.kind, len, depth)?,
                FieldShape::Sequence => {
                    let len = self.unsigned(4)?;
                    self.array(field.kind, len, depth)?;
                }
            }
        }
        if let (true, Some(path), [(_, sec), (_, nanosec)]) = (*is_time, path, &self.cells[first..])
            && let (Ok(sec), Ok(nanosec)) = (sec.parse(), nanosec.parse())
        {
            self.cells.push((path.into(), seconds(sec, nanosec)));
        }
        Ok(())
    }

    fn value(
        &mut self,
        kind: FieldKind,
        path: Option<Arc<str>>,
        depth: usize,
    ) -> Result<(), CdrError> {
        let text = match kind {
            FieldKind::Message(of) => return self.message(of, path.as_deref(), depth + 1),
            FieldKind::Text => self.text()?,
            FieldKind::Bool => (self.unsigned(1)? != 0).to_string(),
            FieldKind::Unsigned(size) => self.unsigned(size)?.to_string(),
            FieldKind::Signed(size) => {
                let unused = 64 - 8 * u32::try_from(size).unwrap_or(8);
                ((self.unsigned(size)? << unused).cast_signed() >> unused).to_string()
            }
            FieldKind::Float(size) => {
                let bits = self.unsigned(size)?;
                let short = u32::try_from(bits).ok().filter(|_| size == 4).map(f32::from_bits);
                short.map_or_else(|| f64::from_bits(bits).to_string(), |short| short.to_string())
            }
        };
        self.cells.extend(path.map(|path| (path, text)));
        Ok(())
    }

    /// Passes over this many values.
    fn array(&mut self, kind: FieldKind, len: u64, depth: usize) -> Result<(), CdrError> {
        let size = match kind {
            FieldKind::Bool => 1,
            FieldKind::Unsigned(size) | FieldKind::Signed(size) | FieldKind::Float(size) => size,
            FieldKind::Text | FieldKind::Message(_) => {
                for _ in 0..len {
                    let before = self.at;
                    self.value(kind, None, depth)?;
                    // Values without bytes would never end otherwise.
                    if self.at == before {
                        break;
                    }
                }
                return Ok(());
            }
        };
        if len > 0 {
            let bytes = usize::try_from(len).ok().and_then(|len| len.checked_mul(size));
            let end = bytes.and_then(|bytes| self.at.next_multiple_of(size).checked_add(bytes));
            let end = end.filter(|end| *end <= self.body.len());
            self.at = end.ok_or(CdrError::Short("an array"))?;
        }
        Ok(())
    }

    /// Takes a number's bytes, which lie at a multiple of their length.
    fn take(&mut self, size: usize) -> Result<&'d [u8], CdrError> {
        let at = self.at.next_multiple_of(size);
        let bytes = self.body.get(at..at + size).ok_or(CdrError::Short("a number"))?;
        self.at = at + size;
        Ok(bytes)
    }

    fn unsigned(&mut self, size: usize) -> Result<u64, CdrError> {
        let is_little = self.is_little;
        let fold = |number: u64, byte: &u8| number << 8 | u64::from(*byte);
        let bytes = self.take(size)?;
        Ok(if is_little { bytes.iter().rev().fold(0, fold) } else { bytes.iter().fold(0, fold) })
    }

    /// Reads a text: its length with the NUL at its end, then itself.
    fn text(&mut self) -> Result<String, CdrError> {
        let len = usize::try_from(self.unsigned(4)?).unwrap_or(usize::MAX);
        let end = self.at.checked_add(len);
        let bytes = end.and_then(|end| self.body.get(self.at..end));
        let bytes = bytes.ok_or(CdrError::Short("a text"))?;
        self.at += len;
        Ok(String::from_utf8_lossy(bytes.strip_suffix(&[0]).unwrap_or(bytes)).into_owned())
    }
}
