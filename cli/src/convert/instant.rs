//! Times of day as ISO 8601 and RFC 3339 write them, and as Python's and pandas' loggers do.

use crate::convert::value::Time;

const SECOND: i128 = 1_000_000_000;

/// Nanoseconds since 1970 in UTC: `2026-11-25T18:00:00.123456789Z`, also with a space for the T, a comma for the point, with an
/// offset such as `+01:00`, with UTC or GMT at its end, or without a zone, which is UTC too.
pub(super) fn nanos(text: &str) -> Option<Time> {
    let (date, time) = text.trim().split_once(['T', 't', ' '])?;
    let (time, offset) = zone(time.trim())?;
    let days = days(date)?;
    let (clock, fraction) =
        time.split_once('.').or_else(|| time.split_once(',')).unwrap_or((time, ""));
    if !fraction.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let mut parts = clock.split(':').map(two_digits);
    let (hours, minutes, seconds) = (parts.next()??, parts.next()??, parts.next()??);
    // A leap second is the next one.
    if parts.next().is_some() || hours > 23 || minutes > 59 || seconds > 60 {
        return None;
    }
    let local = days * 86_400 + i64::from(hours * 3600 + minutes * 60 + seconds);
    let seconds = u64::try_from(local.checked_sub(offset.unwrap_or(0))?).ok()?;
    let (kept, rest) = fraction.split_at(fraction.len().min(9));
    let fraction: i128 = format!("{kept:0<9}").parse().ok()?;
    let is_up = rest.starts_with(|first| first >= '5');
    let nanos = i128::from(seconds) * SECOND + fraction + i128::from(is_up);
    u64::try_from(nanos).ok()?;
    Some(Time {
        nanos,
        is_rounded: rest.bytes().any(|byte| byte != b'0'),
        has_comma: false,
        lacks_zone: offset.is_none(),
    })
}

/// A time without its zone, and how many seconds the zone is ahead of UTC, if it has one.
fn zone(time: &str) -> Option<(&str, Option<i64>)> {
    for name in ["Z", "z", "UTC", "GMT", "utc"] {
        if let Some(time) = time.strip_suffix(name) {
            return Some((time.trim_end(), Some(0)));
        }
    }
    let Some(at) = time.find(['+', '-']) else { return Some((time, None)) };
    let (time, zone) = time.split_at(at);
    let (sign, zone) = zone.split_at(1);
    let (hours, minutes) = match zone.split_once(':') {
        Some(parts) => parts,
        None => zone.split_at_checked(2)?,
    };
    let minutes = if minutes.is_empty() { 0 } else { two_digits(minutes)? };
    let ahead = i64::from(two_digits(hours)? * 3600 + minutes * 60);
    Some((time.trim_end(), Some(if sign == "-" { -ahead } else { ahead })))
}

/// Days since 1970 of a date `YYYY-MM-DD`.
fn days(date: &str) -> Option<i64> {
    let mut parts = date.split('-');
    let year = parts.next().filter(|year| year.len() == 4)?;
    let year =
        year.bytes().all(|byte| byte.is_ascii_digit()).then(|| year.parse::<i64>().ok())??;
    let (month, day) =
        (i64::from(parts.next().and_then(two_digits)?), parts.next().and_then(two_digits)?);
    let is_leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let length = match month {
        1 | 3 | 5 | 7 | 8 | 10 | 12 => 31,
        4 | 6 | 9 | 11 => 30,
        2 if is_leap => 29,
        2 => 28,
        _ => return None,
    };
    if parts.next().is_some() || !(1..=length).contains(&day) {
        return None;
    }
    // Years that begin in March end with the leap day.
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let in_year = (153 * month + 2) / 5 + i64::from(day) - 1;
    Some(365 * year + year / 4 - year / 100 + year / 400 + in_year - 719_468)
}

fn two_digits(text: &str) -> Option<u32> {
    let is_two = text.len() == 2 && text.bytes().all(|byte| byte.is_ascii_digit());
    is_two.then(|| text.parse().ok())?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_of_day_count_from_1970() {
        for (text, seconds, nanoseconds) in [
            ("1970-01-01T00:00:00Z", 0, 0),
            ("2000-02-29T12:30:15.5Z", 951_827_415, 500_000_000),
            ("2026-11-25T18:00:00.123456789Z", 1_795_629_600, 123_456_789),
            ("2026-11-25 19:00:00+01:00", 1_795_629_600, 0),
            ("2026-11-25T12:30:00-0530", 1_795_629_600, 0),
            ("2026-11-25T18:00:00", 1_795_629_600, 0),
            ("2026-11-25 18:00:00 UTC", 1_795_629_600, 0),
            ("2026-11-25 18:00:00,123", 1_795_629_600, 123_000_000),
            ("2026-11-25T18:00:00.1234567895Z", 1_795_629_600, 123_456_790),
            ("2100-03-01T00:00:00Z", 4_107_542_400, 0),
        ] {
            let read = nanos(text).map(|time| time.nanos);
            assert_eq!(read, Some(seconds * SECOND + nanoseconds), "{text}");
        }
    }

    #[test]
    fn what_is_no_time_of_day_is_refused() {
        for text in [
            "",
            "12",
            "2026-11-25",
            "2026-13-25T18:00:00Z",
            "2026-02-29T18:00:00Z",
            "2026-11-25T24:00:00Z",
            "2026-11-25T18:00Z",
            "1969-12-31T23:59:59Z",
            "2026-11-25T18:00:00+1",
            "2555-01-01T00:00:00Z",
            "26-11-25T18:00:00Z",
            "2026-11-25T1\u{663}:00:00Z",
            "2026-1\u{663}-25T18:00:00Z",
        ] {
            assert_eq!(nanos(text), None, "{text}");
        }
    }
}
