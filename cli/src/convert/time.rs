//! Numbers, times and ids as logs and options write them: the one place that parses them, and that
//! says what was expected.

use std::fmt;
use std::sync::Arc;

use chrono::{DateTime, FixedOffset};

const SECOND: i128 = 1_000_000_000;

/// The unit of a file's instants and durations.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Unit {
    Ns,
    Us,
    Ms,
    S,
}

/// A time in nanoseconds, and what had to be taken as read.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub(super) struct Time {
    pub(super) nanos: i128,
    /// `true` if it had more decimals than nanoseconds have.
    pub(super) is_rounded: bool,
    /// `true` if it has a comma before its decimals.
    pub(super) has_comma: bool,
    /// `true` if it is a time of day without a zone.
    pub(super) lacks_zone: bool,
}

/// A message's id in a log: a number, or a text that gets one.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) enum Id {
    Number(u64),
    Text(Arc<str>),
}

impl Unit {
    const ALL: [(&str, Self, i32); 4] =
        [("ns", Self::Ns, 0), ("us", Self::Us, 3), ("ms", Self::Ms, 6), ("s", Self::S, 9)];

    /// Returns the unit of this name.
    pub(super) fn named(name: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|(known, ..)| *known == name);
        let found = found.map(|(_, unit, _)| unit);
        found.ok_or_else(|| format!("there is no unit {name:?}; give ns, us, ms or s"))
    }

    /// Returns its name, and how many digits it has more than a nanosecond.
    const fn described(self) -> (&'static str, i32) {
        let (name, _, digits) = Self::ALL[self as usize];
        (name, digits)
    }
}

impl fmt::Display for Id {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => number.fmt(f),
            Self::Text(text) => text.fmt(f),
        }
    }
}

/// Reads a duration: a number in the unit or with its own, such as `5ms`.
pub(super) fn duration(text: &str, unit: Unit) -> Result<Time, String> {
    let (name, digits) = unit.described();
    let time = decimal(text, digits).or_else(|| with_unit(text));
    let time = time.ok_or_else(|| {
        format!("not a duration; write a number of {name}, or a number with its unit such as 5ms")
    })?;
    if time.nanos < 0 {
        let text = text.trim();
        return Err(format!("a negative duration; {}", none_of(text)));
    }
    Ok(time)
}

/// Reads a duration in an option, such as `40ms`, `0.5s` or `1m 30s`, in nanoseconds.
pub(super) fn stated(text: &str) -> Option<u64> {
    let long = || i128::try_from(humantime::parse_duration(text).ok()?.as_nanos()).ok();
    u64::try_from(with_unit(text).map(|time| time.nanos).or_else(long)?).ok()
}

/// Reads an instant: a number in the unit or with its own, or a time of day.
pub(super) fn instant(text: &str, unit: Unit) -> Result<Time, String> {
    let (name, digits) = unit.described();
    let time = decimal(text, digits).or_else(|| with_unit(text)).or_else(|| time_of_day(text));
    if time.is_some_and(|time| time.nanos > u64::MAX.into()) {
        return Err("an instant after the year 2554; is --unit right?".to_owned());
    }
    time.ok_or_else(|| {
        format!(
            "not an instant; write a number of {name}, a number with its unit such as 5ms, or a \
             time of day such as 2026-11-25T18:00:00.5Z"
        )
    })
}

/// Reads the id of a message. A whole number is that number however it is written; ROS numbers
/// messages by their stamps.
pub(super) fn id(text: &str) -> Result<Id, String> {
    if let Ok(number) = text.parse() {
        return Ok(Id::Number(number));
    }
    let number = decimal(text, 0);
    if text.starts_with('-') && number.is_some() {
        return Err(format!(
            "a negative number, which cannot be the id of a message; {}",
            none_of(text)
        ));
    }
    if is_no_value(text) {
        return Err("not an id".to_owned());
    }
    let time = with_unit(text).or_else(|| time_of_day(text)).or(number);
    Ok(time.and_then(whole).map_or_else(|| Id::Text(text.into()), Id::Number))
}

/// Reads a whole number, such as `3` or `3.0`.
pub(super) fn number(text: &str) -> Result<u64, String> {
    let number = decimal(text, 0).and_then(whole);
    number.ok_or_else(|| "not a whole number from 0 to 2^64 - 1".to_owned())
}

fn whole(time: Time) -> Option<u64> {
    u64::try_from(time.nanos).ok().filter(|_| !time.is_rounded)
}

/// Returns `true` if it is what programs write where there is no value.
pub(super) fn is_no_value(text: &str) -> bool {
    let text = text.to_lowercase();
    let word = text.strip_prefix('-').unwrap_or(&text);
    ["nan", "none", "null", "nil", "nat", "n/a", "na", "inf", "infinity"].contains(&word)
}

/// Returns the remedy for a text that may mean no value.
pub(super) fn none_of(text: &str) -> String {
    format!("if it stands for no value, say so with --missing={text}")
}

/// Reads a number with its unit, such as `0.5s`.
fn with_unit(text: &str) -> Option<Time> {
    let units = [("µs", Unit::Us, 3), ("μs", Unit::Us, 3)].into_iter().chain(Unit::ALL);
    let mut read =
        units.filter_map(|(name, _, digits)| decimal(text.strip_suffix(name)?.trim_end(), digits));
    read.next()
}

/// Reads a decimal number of units that have this many digits more, rounded to a whole one: with a
/// sign, with a point or a comma, with an exponent.
fn decimal(text: &str, digits: i32) -> Option<Time> {
    let text = text.trim();
    let sign = if text.starts_with('-') { -1 } else { 1 };
    let text = text.strip_prefix(['-', '+']).unwrap_or(text);
    let (mantissa, exponent) = match text.split_once(['e', 'E']) {
        Some((mantissa, exponent)) => (mantissa, exponent.parse::<i32>().ok()?),
        None => (text, 0),
    };
    let has_comma = mantissa.contains(',');
    let (whole, part) = mantissa.split_once(['.', ',']).unwrap_or((mantissa, ""));
    let all = format!("{whole}{part}");
    if all.is_empty() || !all.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let figures = all.trim_start_matches('0');
    if figures.is_empty() {
        return Some(Time { has_comma, ..Time::default() });
    }
    // The position of the point in the remaining digits.
    let place = |text: &str| i64::try_from(text.len()).ok();
    let point = place(whole)? - (place(&all)? - place(figures)?);
    let point = point + i64::from(exponent) + i64::from(digits);
    // 2^127 has 39 digits.
    if point > 38 {
        return None;
    }
    let kept = usize::try_from(point).unwrap_or(0);
    let (integer, rest) = figures.split_at(kept.min(figures.len()));
    let integer: i128 = format!("0{integer:0<kept$}").parse().ok()?;
    // Below one tenth nothing is rounded up.
    let is_up = point >= 0 && rest.starts_with(['5', '6', '7', '8', '9']);
    let is_rounded = rest.bytes().any(|byte| byte != b'0');
    let nanos = sign * (integer + i128::from(is_up));
    Some(Time { nanos, is_rounded, has_comma, lacks_zone: false })
}

/// Reads a time of day since 1970, as ISO 8601 and RFC 3339 write it, and as Python's and pandas'
/// loggers do: also with a space for the T, a comma for the point, with UTC or GMT at its end, or
/// without a zone, which is UTC too.
fn time_of_day(text: &str) -> Option<Time> {
    let text = text.trim().replacen(',', ".", 1).replace("GMT", "UTC");
    let read = |end: &str| format!("{text}{end}").parse::<DateTime<FixedOffset>>().ok();
    let zoned = read("").or_else(|| read(":00"));
    let lacks_zone = zoned.is_none();
    let time = zoned.or_else(|| read("Z"))?;
    let fraction = text.split_once('.').map_or("", |(_, fraction)| fraction);
    let digits = fraction.split(|c: char| !c.is_ascii_digit()).next().unwrap_or("");
    let rest = digits.get(9..).unwrap_or("");
    // A leap second is the next one.
    let nanos = i128::from(time.timestamp()) * SECOND + i128::from(time.timestamp_subsec_nanos());
    let nanos = nanos + i128::from(rest.starts_with(['5', '6', '7', '8', '9']));
    u64::try_from(nanos).ok()?;
    let is_rounded = rest.bytes().any(|byte| byte != b'0');
    Some(Time { nanos, is_rounded, has_comma: false, lacks_zone })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimals_are_rounded_to_a_nanosecond() {
        for (text, unit, nanos, is_rounded) in [
            ("12", Unit::Ns, Some(12), false),
            ("12.50", Unit::Us, Some(12_500), false),
            ("18446744073709.551616", Unit::Ms, Some(1 << 64), false),
            ("0.30000000000000004", Unit::S, Some(300_000_000), true),
            ("9.2e-05", Unit::S, Some(92_000), false),
            ("5.551115123125783e-17", Unit::S, Some(0), true),
            ("0,5", Unit::S, Some(500_000_000), false),
            ("-0.005", Unit::S, Some(-5_000_000), false),
            ("+1", Unit::Ns, Some(1), false),
            (".5", Unit::S, Some(500_000_000), false),
            ("1.5", Unit::Ns, Some(2), true),
            ("0.04", Unit::Ns, Some(0), true),
            ("0.0015", Unit::Us, Some(2), true),
            ("0e99", Unit::S, Some(0), false),
            ("1e99", Unit::S, None, false),
            ("NaN", Unit::S, None, false),
            ("1.2.3", Unit::S, None, false),
            ("-+1", Unit::S, None, false),
            (".", Unit::S, None, false),
            ("1_000", Unit::S, None, false),
        ] {
            let read = decimal(text, unit.described().1);
            assert_eq!(read.map(|time| time.nanos), nanos, "{text}");
            assert_eq!(read.is_some_and(|time| time.is_rounded), is_rounded, "{text}");
        }
    }

    #[test]
    fn durations_may_have_their_own_unit() {
        for (text, read) in [
            ("5ms", Some(5_000_000)),
            ("1.5 us", Some(1_500)),
            ("1.5µs", Some(1_500)),
            ("2", Some(2_000_000_000)),
            ("5 m", None),
            ("ms", None),
            ("-5ms", None),
        ] {
            let found = duration(text, Unit::S).ok().map(|time| time.nanos);
            assert_eq!(found, read, "{text}");
        }
        let all = ["0.5s", "1m 30s", "40", "-1s"].map(stated);
        assert_eq!(all, [Some(500_000_000), Some(90_000_000_000), None, None]);
    }

    #[test]
    fn whole_numbers_and_stamps_are_ids() {
        for (text, read) in [
            ("12", Id::Number(12)),
            ("12.0", Id::Number(12)),
            ("7.000000001s", Id::Number(7_000_000_001)),
            ("1970-01-01T00:00:01Z", Id::Number(1_000_000_000)),
            ("12.5", Id::Text("12.5".into())),
            ("split1-0", Id::Text("split1-0".into())),
        ] {
            assert_eq!(id(text), Ok(read), "{text}");
        }
        assert!(id("-1").unwrap_err().contains("--missing=-1"));
        assert_eq!(id("NaN"), Err("not an id".to_owned()));
    }

    #[test]
    fn times_of_day_count_from_1970() {
        for (text, seconds, nanoseconds) in [
            ("2026-11-25T18:00:00.123456789Z", 1_795_629_600, 123_456_789),
            ("2026-11-25 19:00:00+01:00", 1_795_629_600, 0),
            ("2026-11-25 19:00:00+01", 1_795_629_600, 0),
            ("2026-11-25T12:30:00-0530", 1_795_629_600, 0),
            ("2026-11-25T18:00:00", 1_795_629_600, 0),
            ("2026-11-25 18:00:00.5 GMT", 1_795_629_600, 500_000_000),
            ("2026-11-25 18:00:00,123", 1_795_629_600, 123_000_000),
            ("2026-11-25T18:00:00.1234567895+00:00", 1_795_629_600, 123_456_790),
        ] {
            let read = time_of_day(text).map(|time| time.nanos);
            assert_eq!(read, Some(seconds * SECOND + nanoseconds), "{text}");
        }
        for text in ["", "12", "2026-11-25", "1969-12-31T23:59:59Z", "2555-01-01T00:00:00Z"] {
            assert_eq!(time_of_day(text), None, "{text}");
        }
    }
}
