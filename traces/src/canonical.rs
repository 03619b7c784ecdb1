//! Reads event lines in one pass if they are exactly as [`Event::write_annotated`](crate::Event)
//! writes them.
//!
//! Nearly all lines of a trace are such lines. A line with another order of keys, a blank or a rare
//! key is left to the parser, and so is every error.

use crate::event::{Decision, Event, Input};
use crate::parse::Form;
use crate::reason::{DropReason, OfferRefusal, OpenRefusal};

/// The greatest length of a line's instant and timestamp, with the key between them.
const STAMP: usize = 19 + 5 + 19;

/// The instant and the timestamp of the previous line, as they were written. Decisions have those
/// of their input, so most lines repeat them.
#[derive(Debug)]
pub(crate) struct StampBefore {
    bytes: [u8; STAMP],
    /// The number of bytes in use; 0 before the first line.
    len: usize,
    at: u64,
    t: u64,
}

/// An event as it was written.
pub(crate) struct CanonicalLine {
    pub(crate) event: Event,
    /// The timestamp whose message the value of a result or an emit was computed from.
    pub(crate) of: Option<u64>,
    /// The length of the line in bytes, without its end.
    pub(crate) len: usize,
}

/// Returns the event of the line at the start of `bytes`, or `None` if the line is not canonical or
/// not complete.
#[inline]
pub(crate) fn event(bytes: &[u8], form: Form, before: &mut StampBefore) -> Option<CanonicalLine> {
    let mut rest = UnreadBytes(bytes);
    rest.take(b"{\"ev\":\"")?;
    let kind = rest.kind()?;
    let mut of = None;
    let event = if kind == Kind::Tick {
        Event::Input(Input::Tick { at: rest.number()? })
    } else {
        let (at, t) = rest.stamp(before)?;
        match kind {
            Kind::Open => {
                let deadline = match rest.take(b",\"deadline\":") {
                    Some(()) if form == Form::WithoutLocal => return None,
                    Some(()) => Some(rest.number()?),
                    None => None,
                };
                Event::Input(Input::Open { at, t, deadline })
            }
            Kind::Miss => Event::Decision(Decision::Miss { at, t }),
            _ if rest.take(b",\"p\":").is_some() => {
                let p = rest.number()?;
                if matches!(kind, Kind::Result | Kind::Emit) && rest.take(b",\"of\":").is_some() {
                    of = Some(rest.number()?);
                }
                rest.event_of_source(kind, at, t, p)?
            }
            // Among the lines with a reason, only those of opens have no source.
            Kind::Refuse => {
                let why = rest.reason(&OpenRefusal::ALL, OpenRefusal::as_str)?;
                Event::Decision(Decision::RefuseOpen { at, t, why })
            }
            _ => return None,
        }
    };
    rest.take(b"}")?;
    Some(CanonicalLine { event, of, len: bytes.len() - rest.0.len() })
}

/// The kind of a line. The kinds are tried in this order.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Open,
    Offer,
    Result,
    Request,
    Refuse,
    Fail,
    Final,
    Tick,
    Timer,
    Hold,
    Drop,
    Emit,
    Miss,
    Cancel,
}

/// The unread rest of a line.
#[derive(Clone, Copy)]
struct UnreadBytes<'a>(&'a [u8]);

impl Default for StampBefore {
    fn default() -> Self {
        Self { bytes: [0; STAMP], len: 0, at: 0, t: 0 }
    }
}

impl UnreadBytes<'_> {
    /// Takes a token if it comes next.
    #[inline]
    fn take<const N: usize>(&mut self, token: &[u8; N]) -> Option<()> {
        let (next, rest) = self.0.split_first_chunk()?;
        if next != token {
            return None;
        }
        self.0 = rest;
        Some(())
    }

    /// Takes the event's word and the key of the instant.
    #[inline]
    fn kind(&mut self) -> Option<Kind> {
        let (word, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        match word {
            b"open" => self.take(b"\",\"at\":").map(|()| Kind::Open),
            b"offe" => self.take(b"r\",\"at\":").map(|()| Kind::Offer),
            b"resu" => self.take(b"lt\",\"at\":").map(|()| Kind::Result),
            b"requ" => self.take(b"est\",\"at\":").map(|()| Kind::Request),
            b"refu" => self.take(b"se\",\"at\":").map(|()| Kind::Refuse),
            b"fail" => self.take(b"\",\"at\":").map(|()| Kind::Fail),
            b"fina" => self.take(b"l\",\"at\":").map(|()| Kind::Final),
            b"tick" => self.take(b"\",\"at\":").map(|()| Kind::Tick),
            b"time" => self.take(b"r\",\"at\":").map(|()| Kind::Timer),
            b"hold" => self.take(b"\",\"at\":").map(|()| Kind::Hold),
            b"drop" => self.take(b"\",\"at\":").map(|()| Kind::Drop),
            b"emit" => self.take(b"\",\"at\":").map(|()| Kind::Emit),
            b"miss" => self.take(b"\",\"at\":").map(|()| Kind::Miss),
            b"canc" => self.take(b"el\",\"at\":").map(|()| Kind::Cancel),
            _ => None,
        }
    }

    /// Takes the instant, the timestamp and the key between them.
    #[inline]
    fn stamp(&mut self, before: &mut StampBefore) -> Option<(u64, u64)> {
        if let Some((stamp, rest)) = self.0.split_at_checked(before.len)
            && let Some(next) = rest.first()
            && !next.is_ascii_digit()
            && Some(stamp) == before.bytes.get(..before.len)
            && before.len > 0
        {
            self.0 = rest;
            return Some((before.at, before.t));
        }
        let all = self.0;
        let at = self.number()?;
        self.take(b",\"t\":")?;
        let t = self.number()?;
        let stamp = all.get(..all.len() - self.0.len())?;
        before.bytes.get_mut(..stamp.len())?.copy_from_slice(stamp);
        (before.len, before.at, before.t) = (stamp.len(), at, t);
        Some((at, t))
    }

    /// Takes the rest of a line whose event has a source.
    #[inline]
    fn event_of_source(&mut self, kind: Kind, at: u64, t: u64, p: u64) -> Option<Event> {
        let decision = match kind {
            Kind::Offer => {
                self.take(b",\"deadline\":")?;
                let deadline = self.number()?;
                self.take(b",\"backlog\":")?;
                let backlog = self.number()?;
                return Some(Event::Input(Input::Offer { at, t, p, deadline, backlog }));
            }
            Kind::Result => return Some(Event::Input(Input::Result { at, t, p })),
            Kind::Fail => return Some(Event::Input(Input::Fail { at, t, p })),
            Kind::Request => {
                self.take(b",\"due\":")?;
                Decision::Request { at, t, p, due: self.number()? }
            }
            Kind::Refuse => {
                let why = self.reason(&OfferRefusal::ALL, OfferRefusal::as_str)?;
                Decision::RefuseOffer { at, t, p, why }
            }
            Kind::Drop => {
                let why = self.reason(&DropReason::ALL, DropReason::as_str)?;
                Decision::Drop { at, t, p, why }
            }
            Kind::Timer => Decision::Timer { at, t, p },
            Kind::Hold => Decision::Hold { at, t, p },
            Kind::Emit => Decision::Emit { at, t, p },
            Kind::Final => Decision::Final { at, t, p },
            Kind::Cancel => Decision::Cancel { at, t, p },
            Kind::Open | Kind::Tick | Kind::Miss => return None,
        };
        Some(Event::Decision(decision))
    }

    /// Takes one of these reasons.
    fn reason<T: Copy>(&mut self, all: &[T], name: fn(T) -> &'static str) -> Option<T> {
        self.take(b",\"why\":\"")?;
        let end = self.0.iter().position(|byte| *byte == b'"')?;
        let (word, rest) = self.0.split_at_checked(end)?;
        let why = all.iter().copied().find(|why| name(*why).as_bytes() == word)?;
        self.0 = rest;
        self.take(b"\"")?;
        Some(why)
    }

    /// Takes a whole number of at most 19 digits, which always fits.
    #[inline]
    fn number(&mut self) -> Option<u64> {
        // Priorities and queues usually have one digit.
        if let [digit @ b'0'..=b'9', after, ..] = self.0
            && !after.is_ascii_digit()
        {
            self.0 = self.0.get(1..)?;
            return Some(u64::from(digit - b'0'));
        }
        self.long_number()
    }

    fn long_number(&mut self) -> Option<u64> {
        let (mut bytes, mut value) = (self.0, 0_u64);
        while let Some((eight, rest)) = bytes.split_first_chunk() {
            let (digits, count) = leading_digits(u64::from_le_bytes(*eight));
            value = value.wrapping_mul(*POWERS.get(count)?).wrapping_add(digits);
            if count < 8 {
                return self.numbered(value, bytes.get(count..)?);
            }
            bytes = rest;
        }
        // Fewer than eight bytes are left.
        while let Some((digit @ b'0'..=b'9', rest)) = bytes.split_first() {
            value = value.wrapping_mul(10).wrapping_add(u64::from(digit - b'0'));
            bytes = rest;
        }
        self.numbered(value, bytes)
    }

    /// Takes a number that ends where `rest` begins, if it is written in the canonical form.
    #[inline]
    fn numbered(&mut self, value: u64, rest: &[u8]) -> Option<u64> {
        let len = self.0.len() - rest.len();
        let zero_led = len > 1 && self.0.first() == Some(&b'0');
        if len == 0 || len > 19 || zero_led {
            return None;
        }
        self.0 = self.0.get(len..)?;
        Some(value)
    }
}

/// The powers of 10 by the number of digits that were read.
const POWERS: [u64; 9] = [1, 10, 100, 1000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000];

/// Returns the number that the leading digits of eight bytes form, and the number of these digits.
/// The first byte is the lowest.
///
/// The digits are moved up so that zeros lead them. Then pairs of digits become numbers below 100,
/// pairs of those become numbers below 10,000, and so on, in one multiplication each (D. Lemire,
/// *Quickly parsing eight digits*, 2018).
#[inline]
const fn leading_digits(bytes: u64) -> (u64, usize) {
    let ones = bytes ^ 0x3030_3030_3030_3030;
    // Sets the high bit of each byte that is above 9. A carry reaches only later bytes.
    let others = (ones | ones.wrapping_add(0x7676_7676_7676_7676)) & 0x8080_8080_8080_8080;
    let bits = others.trailing_zeros() & !7;
    if bits == 0 {
        return (0, 0);
    }
    let ones = ones << (64 - bits);
    let pairs = ones.wrapping_mul(10).wrapping_add(ones >> 8) & 0x00FF_00FF_00FF_00FF;
    let fours = pairs.wrapping_mul(100).wrapping_add(pairs >> 16) & 0x0000_FFFF_0000_FFFF;
    let eight = fours.wrapping_mul(10_000).wrapping_add(fours >> 32) & 0xFFFF_FFFF;
    (eight, (bits / 8) as usize)
}
