//! Numbers, times and identifiers as logs write them: the one place that parses them, and that says what was expected.

use std::fmt;
use std::sync::Arc;

use crate::convert::instant;

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
    /// Whether it had more decimals than nanoseconds have.
    pub(super) is_rounded: bool,
    /// Whether it has a comma before its decimals.
    pub(super) has_comma: bool,
    /// Whether it is a time of day without a zone.
    pub(super) lacks_zone: bool,
}

/// What a log calls a message: a number, or a text that gets one.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub(super) enum Id {
    Number(u64),
    Text(Arc<str>),
}

impl Unit {
    /// All of them, from the shortest.
    pub(super) const ALL: [Self; 4] = [Self::Ns, Self::Us, Self::Ms, Self::S];

    pub(super) const fn as_str(self) -> &'static str {
        match self {
            Self::Ns => "ns",
            Self::Us => "us",
            Self::Ms => "ms",
            Self::S => "s",
        }
    }

    /// The unit of this name.
    pub(super) fn named(name: &str) -> Result<Self, String> {
        let unit = Self::ALL.into_iter().find(|unit| unit.as_str() == name);
        unit.ok_or_else(|| format!("no unit {name:?}; it is one of ns, us, ms, s"))
    }

    const fn digits(self) -> i64 {
        match self {
            Self::Ns => 0,
            Self::Us => 3,
            Self::Ms => 6,
            Self::S => 9,
        }
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

/// A duration: a number in the unit or with its own, such as `5ms`.
pub(super) fn duration(text: &str, unit: Unit) -> Result<Time, String> {
    let time = decimal(text, unit.digits()).or_else(|| with_unit(text));
    let time = time.ok_or_else(|| {
        format!(
            "no duration; it takes a number of {}, or one with its unit such as 5ms",
            unit.as_str()
        )
    })?;
    if time.nanos < 0 {
        let value = text.trim();
        return Err(format!(
            "a negative duration; if it stands for no value, say so with --missing={value}"
        ));
    }
    Ok(time)
}

/// An instant: a number in the unit or with its own, or a time of day.
pub(super) fn instant(text: &str, unit: Unit) -> Result<Time, String> {
    let time = decimal(text, unit.digits()).or_else(|| with_unit(text));
    time.or_else(|| instant::nanos(text)).ok_or_else(|| {
        format!(
            "no instant; it takes a number of {}, one with its unit such as 5ms, or a time of day such as \
             2026-11-25T18:00:00.5Z",
            unit.as_str()
        )
    })
}

/// What a message is called. A whole number is that number however it is written; ROS numbers messages by their stamps.
pub(super) fn id(text: &str) -> Result<Id, String> {
    if let Ok(number) = text.parse() {
        return Ok(Id::Number(number));
    }
    if text.starts_with('-') && decimal(text, 0).is_some() {
        return Err(format!(
            "a negative number, which names no message; if it stands for no value, say so with --missing={text}"
        ));
    }
    if is_no_value(text) {
        return Err("no id".to_owned());
    }
    let time = with_unit(text).or_else(|| instant::nanos(text)).or_else(|| decimal(text, 0));
    let whole = time.filter(|time| !time.is_rounded);
    let number = whole.and_then(|time| u64::try_from(time.nanos).ok());
    Ok(number.map_or_else(|| Id::Text(text.into()), Id::Number))
}

/// Whether it is what programs write where there is no value.
pub(super) fn is_no_value(text: &str) -> bool {
    let words =
        ["nan", "none", "null", "nil", "nat", "n/a", "na", "inf", "-inf", "infinity", "-infinity"];
    words.contains(&&*text.to_lowercase())
}

/// A whole number, such as `3` or `3.0`.
pub(super) fn number(text: &str) -> Result<u64, String> {
    let whole = decimal(text, 0).filter(|time| !time.is_rounded);
    let number = whole.and_then(|time| u64::try_from(time.nanos).ok());
    number.ok_or_else(|| "no number; it takes a whole one from 0 to 2^64 - 1".to_owned())
}

/// A number with its unit, such as `0.5s`.
pub(super) fn with_unit(text: &str) -> Option<Time> {
    let units = [("µs", Unit::Us), ("μs", Unit::Us)];
    let mut units = units.into_iter().chain(Unit::ALL.map(|unit| (unit.as_str(), unit)));
    units.find_map(|(name, unit)| decimal(text.strip_suffix(name)?.trim_end(), unit.digits()))
}

/// A decimal number of units that have so many digits more, rounded to a whole one: with a sign, with a point or a comma, with
/// an exponent.
fn decimal(text: &str, digits: i64) -> Option<Time> {
    let text = text.trim();
    let (is_negative, text) = match text.strip_prefix('-') {
        Some(text) => (true, text),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    };
    let (mantissa, exponent) = match text.split_once(['e', 'E']) {
        Some((mantissa, exponent)) => (mantissa, exponent.parse::<i32>().ok()?),
        None => (text, 0),
    };
    let has_comma = mantissa.contains(',');
    let (whole, part) = mantissa.split_once(['.', ',']).unwrap_or((mantissa, ""));
    let is_number = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    if whole.len() + part.len() == 0 || !is_number(whole) || !is_number(part) {
        return None;
    }
    let all = format!("{whole}{part}");
    let all_digits = all.trim_start_matches('0');
    // Where the point stands in what is left of the digits.
    let point =
        i64::try_from(whole.len()).ok()? - i64::try_from(all.len() - all_digits.len()).ok()?;
    let point = point + i64::from(exponent) + digits;
    if all_digits.is_empty() {
        return Some(Time { has_comma, ..Time::default() });
    }
    // 2^127 has 39 digits.
    if point > 38 {
        return None;
    }
    let kept = usize::try_from(point).unwrap_or(0);
    let (integer, rest) = all_digits.split_at(kept.min(all_digits.len()));
    let integer: i128 = format!("0{integer:0<kept$}").parse().ok()?;
    // Below one tenth nothing is rounded up.
    let is_up = point >= 0 && rest.starts_with(|first| first >= '5');
    let is_rounded = rest.bytes().any(|byte| byte != b'0');
    let nanos = integer + i128::from(is_up);
    let nanos = if is_negative { -nanos } else { nanos };
    Some(Time { nanos, is_rounded, has_comma, lacks_zone: false })
}

/// The name among these that is closest to another, and all of them, the closest first.
pub(super) fn closest<'n>(name: &str, all: impl Iterator<Item = &'n str>) -> Vec<&'n str> {
    let mut all: Vec<&str> = all.collect();
    let lower = name.to_lowercase();
    all.sort_by_key(|known| strsim::damerau_levenshtein(&lower, &known.to_lowercase()));
    all
}

/// The names that there are, the closest to another first, for an error.
pub(super) fn listed<'n>(name: &str, all: impl Iterator<Item = &'n str>) -> String {
    const SHOWN: usize = 12;
    let all = closest(name, all);
    let more = all.len().saturating_sub(SHOWN);
    let shown = all.into_iter().take(SHOWN).collect::<Vec<_>>().join(", ");
    if more > 0 { format!("{shown} and {more} more") } else { shown }
}

/// A time in words, such as `1.5 ms`.
pub(super) fn shown(nanos: i128) -> String {
    let sign = if nanos < 0 { "-" } else { "" };
    let size = nanos.unsigned_abs();
    let (unit, name) = match size {
        0..1_000 => (1, "ns"),
        1_000..1_000_000 => (1_000, "us"),
        1_000_000..1_000_000_000 => (1_000_000, "ms"),
        1_000_000_000..172_800_000_000_000 => (1_000_000_000, "s"),
        172_800_000_000_000..63_115_200_000_000_000 => (86_400_000_000_000, "days"),
        _ => (31_557_600_000_000_000, "years"),
    };
    let (whole, part) = (size / unit, size % unit * 1000 / unit);
    let part = format!("{part:03}");
    match part.trim_end_matches('0') {
        "" => format!("{sign}{whole} {name}"),
        part => format!("{sign}{whole}.{part} {name}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimals_are_rounded_to_a_nanosecond() {
        for (text, unit, nanos, is_rounded) in [
            ("12", Unit::Ns, Some(12), false),
            ("12.50", Unit::Us, Some(12_500), false),
            ("0.000000001", Unit::S, Some(1), false),
            ("18446744073709.551616", Unit::Ms, Some(1 << 64), false),
            ("0.30000000000000004", Unit::S, Some(300_000_000), true),
            ("9.2e-05", Unit::S, Some(92_000), false),
            ("5.551115123125783e-17", Unit::S, Some(0), true),
            ("1.7956296e18", Unit::Ns, Some(1_795_629_600_000_000_000), false),
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
            ("", Unit::S, None, false),
            (".", Unit::S, None, false),
            ("1_000", Unit::S, None, false),
        ] {
            let read = decimal(text, unit.digits());
            assert_eq!(read.map(|time| time.nanos), nanos, "{text}");
            assert_eq!(read.is_some_and(|time| time.is_rounded), is_rounded, "{text}");
        }
    }

    #[test]
    fn duration_may_have_its_own_unit() {
        for (text, read) in [
            ("5ms", Some(5_000_000)),
            ("0.5s", Some(500_000_000)),
            ("7ns", Some(7)),
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
        assert_eq!(id("NaN"), Err("no id".to_owned()));
    }
}
