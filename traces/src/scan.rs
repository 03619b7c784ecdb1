//! A cursor over one line that knows its column.
//!
//! It reads the usual parts of a trace itself, one known key or whole number at a time. It leaves
//! escapes and skipped values to `serde_json`.

use std::borrow::Cow;

use serde::de::IgnoredAny;

use crate::parse::{ParseError, brief};

/// The greatest number of digits that always fit in 64 bits.
const FITS: usize = 19;

/// A place in the line, between two tokens or within one.
pub(crate) struct Scan<'a> {
    text: &'a str,
    at: usize,
}

impl<'a> Scan<'a> {
    /// Creates a cursor at the start of a line.
    pub(crate) const fn new(text: &'a str) -> Self {
        Self { text, at: 0 }
    }

    /// Returns the offset of the next byte.
    pub(crate) const fn offset(&self) -> usize {
        self.at
    }

    /// Returns the next byte that is not white space, if there is one, without taking it.
    #[inline]
    pub(crate) fn peek(&mut self) -> Option<u8> {
        loop {
            let next = *self.text.as_bytes().get(self.at)?;
            if !matches!(next, b' ' | b'\t' | b'\r') {
                return Some(next);
            }
            self.at += 1;
        }
    }

    /// Takes `wanted` if it comes next.
    #[inline]
    pub(crate) fn take(&mut self, wanted: u8) -> bool {
        let found = self.peek() == Some(wanted);
        self.at += usize::from(found);
        found
    }

    /// Takes `wanted`, or returns an error that it is missing.
    #[inline]
    pub(crate) fn expect(&mut self, wanted: u8, place: &str) -> Result<(), ParseError> {
        if self.take(wanted) {
            return Ok(());
        }
        self.missing(wanted, place)
    }

    #[cold]
    fn missing(&self, wanted: u8, place: &str) -> Result<(), ParseError> {
        let wanted = char::from(wanted);
        Err(self.fault(format!("expected `{wanted}` {place}, found {}", self.found())))
    }

    /// Takes the comma or the closing bracket of an object or a list. Returns `true` if it
    /// continues.
    #[inline]
    pub(crate) fn more(&mut self, first: bool, close: u8) -> Result<bool, ParseError> {
        match self.peek() {
            Some(next) if next == close => self.at += 1,
            Some(b',') if !first => {
                self.at += 1;
                return Ok(true);
            }
            _ if first => return Ok(true),
            _ => return Err(self.stuck(close)),
        }
        Ok(false)
    }

    #[cold]
    fn stuck(&self, close: u8) -> ParseError {
        let close = char::from(close);
        self.fault(format!("expected `,` or `{close}`, found {}", self.found()))
    }

    /// Takes `token` if it comes at once, without white space.
    #[inline]
    pub(crate) fn take_all(&mut self, token: &[u8]) -> bool {
        let rest = self.text.as_bytes().get(self.at..).unwrap_or_default();
        let found = rest.starts_with(token);
        self.at += if found { token.len() } else { 0 };
        found
    }

    /// Takes a key and its colon. Returns the key and its place.
    #[inline]
    pub(crate) fn key(&mut self) -> Result<(usize, Cow<'a, str>), ParseError> {
        self.peek();
        let offset = self.at;
        let name = self.string("a key")?;
        self.expect(b':', "after a key")?;
        Ok((offset, name))
    }

    /// Ends the line.
    pub(crate) fn end(&mut self) -> Result<(), ParseError> {
        match self.peek() {
            None => Ok(()),
            Some(_) => Err(self.fault("more after the object; a line is one object".into())),
        }
    }

    /// Takes a string. Returns it without its quotes.
    pub(crate) fn string(&mut self, what: &str) -> Result<Cow<'a, str>, ParseError> {
        if self.peek() != Some(b'"') {
            return Err(self.fault(format!("expected {what} in quotes, found {}", self.found())));
        }
        let start = self.at + 1;
        let rest = self.text.as_bytes().get(start..).unwrap_or_default();
        let end = rest.iter().position(|byte| matches!(byte, b'"' | b'\\' | ..0x20));
        if let Some(len) = end.filter(|len| rest.get(*len) == Some(&b'"')) {
            self.at = start + len + 1;
            return Ok(Cow::Borrowed(self.text.get(start..start + len).unwrap_or_default()));
        }
        self.value::<String>().map(Cow::Owned)
    }

    /// Takes a whole number.
    pub(crate) fn number(&mut self) -> Result<u64, ParseError> {
        self.peek();
        let rest = self.text.as_bytes().get(self.at..).unwrap_or_default();
        let (near, far) = rest.split_at(rest.len().min(FITS));
        let mut value = 0_u64;
        let mut len = 0;
        for byte in near.iter().take_while(|byte| byte.is_ascii_digit()) {
            value = 10 * value + u64::from(byte - b'0');
            len += 1;
        }
        let mut value = Some(value);
        if len == FITS {
            for byte in far.iter().take_while(|byte| byte.is_ascii_digit()) {
                let digit = u64::from(byte - b'0');
                value = value.and_then(|value| value.checked_mul(10)?.checked_add(digit));
                len += 1;
            }
        }
        let broken = matches!(rest.get(len), Some(b'.' | b'e' | b'E' | b'+' | b'-'));
        let zero_led = len > 1 && rest.first() == Some(&b'0');
        match value {
            Some(value) if len > 0 && !broken && !zero_led => {
                self.at += len;
                Ok(value)
            }
            _ => Err(self.no_number()),
        }
    }

    #[cold]
    fn no_number(&self) -> ParseError {
        const WANTED: &str = "a whole number from 0 to 18446744073709551615, digits alone";
        self.fault(format!("expected {WANTED}, found {}", self.found()))
    }

    /// Takes any JSON value, whatever it contains.
    pub(crate) fn skip(&mut self) -> Result<(), ParseError> {
        self.value::<IgnoredAny>().map(|_| ())
    }

    /// Returns an error at the next byte.
    pub(crate) fn fault(&self, message: String) -> ParseError {
        ParseError::at(self.at, message)
    }

    /// Takes a value by `serde_json`.
    fn value<T: serde::Deserialize<'a>>(&mut self) -> Result<T, ParseError> {
        let rest = self.text.get(self.at..).unwrap_or_default();
        let mut values = serde_json::Deserializer::from_str(rest).into_iter::<T>();
        match values.next() {
            Some(Ok(value)) => {
                self.at += values.byte_offset();
                Ok(value)
            }
            Some(Err(error)) => {
                let message = error.to_string();
                let cause = message.rsplit_once(" at line ").map_or(&*message, |(cause, _)| cause);
                let offset = self.at + error.column().saturating_sub(1);
                Err(ParseError::at(offset, format!("{cause}; a line is one JSON object")))
            }
            None => Err(self.fault(format!("expected a value, found {}", self.found()))),
        }
    }

    /// Returns the next few characters, for an error.
    fn found(&self) -> String {
        let rest = self.text.get(self.at..).unwrap_or_default();
        let end = match rest.chars().next() {
            None => return "the line's end".into(),
            Some('"') => {
                rest.get(1..).and_then(|tail| tail.find('"')).map_or(rest.len(), |at| at + 2)
            }
            Some('{' | '}' | '[' | ']' | ':' | ',') => 1,
            Some(_) => rest.find([' ', ',', ':', '}', ']', '{', '[', '"']).unwrap_or(rest.len()),
        };
        format!("`{}`", brief(rest.get(..end).unwrap_or(rest)))
    }
}
