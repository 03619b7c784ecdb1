//! CDR: compares the key of a serialized message with an independent reading.

use bytes::Bytes;
use fuseline_ros2::Payload;
use fuseline_ros2::key::{IntegerKind, KeyError, MessageKey};

use crate::parsers::{Ends, ParserResult};

pub(super) const ENDS: &[&str] =
    &["no message", "too short", "no stamp", "header", "uint32", "int32", "uint64", "int64"];

/// This value of the byte for the place announces a place in the next four bytes.
const FAR: u8 = u8::MAX;

/// Checks the key of a message. The first byte is the key's kind, then come its place and a
/// serialized message.
pub(super) fn check(bytes: &[u8], ends: &mut Ends) -> ParserResult {
    let [kind, near, rest @ ..] = bytes else { return Ok(()) };
    let (offset, message) = match rest.split_first_chunk::<4>() {
        Some((far, rest)) if *near == FAR => (u32::from_le_bytes(*far), rest),
        _ => (u32::from(*near), rest),
    };
    let (key, size, is_signed) = match kind % 5 {
        0 => (MessageKey::Header, 8, true),
        1 => (MessageKey::Integer { offset, kind: IntegerKind::U32 }, 4, false),
        2 => (MessageKey::Integer { offset, kind: IntegerKind::I32 }, 4, true),
        3 => (MessageKey::Integer { offset, kind: IntegerKind::U64 }, 8, false),
        _ => (MessageKey::Integer { offset, kind: IntegerKind::I64 }, 8, true),
    };
    let Some(payload) = Payload::from_serialized(&Bytes::copy_from_slice(message)) else {
        ends.insert("no message");
        let is_plain = matches!(message, [0, 0 | 1, _, _, ..]);
        return if is_plain { Err(format!("refused: {message:?}")) } else { Ok(()) };
    };
    let again = payload.to_serialized();
    if again[..2] != message[..2] || again[4..] != message[4..] {
        return Err(format!("{message:?} is passed on as {again:?}"));
    }
    let (body, is_big) = (&message[4..], message[1] == 0);
    let at = |from: usize, size, is_signed| {
        let end = from.checked_add(size).filter(|end| *end <= body.len())?;
        Some(number(&body[from..end], is_big, is_signed))
    };
    let expected = match key {
        MessageKey::Header => match (at(0, 4, true), at(4, 4, false)) {
            (Some(sec), Some(nanosec)) if nanosec < 1_000_000_000 => {
                Ok(sec * 1_000_000_000 + nanosec)
            }
            (Some(_), Some(_)) => Err(KeyError::Nanosec),
            _ => Err(KeyError::Short),
        },
        MessageKey::Integer { .. } => {
            let from = usize::try_from(offset).map_err(|error| error.to_string())?;
            at(from, size, is_signed).ok_or(KeyError::Short)
        }
    };
    let found = key.read(&payload.body, payload.big_endian);
    ends.insert(match (&found, key) {
        (Err(KeyError::Short), _) => "too short",
        (Err(KeyError::Nanosec), _) => "no stamp",
        (Ok(_), MessageKey::Header) => "header",
        (Ok(_), MessageKey::Integer { kind, .. }) => kind.name(),
    });
    let found = found.map(|stamp| stamp.to_string());
    if found != expected.map(|number| number.to_string()) {
        return Err(format!("{key} of {message:?} is {found:?}, not {expected:?}"));
    }
    Ok(())
}

/// Reads a number digit by digit.
fn number(bytes: &[u8], is_big: bool, is_signed: bool) -> i128 {
    let digit = |number: i128, byte: &u8| number * 256 + i128::from(*byte);
    let number =
        if is_big { bytes.iter().fold(0, digit) } else { bytes.iter().rev().fold(0, digit) };
    let all = 1_i128 << (8 * bytes.len());
    if is_signed && number >= all / 2 { number - all } else { number }
}
