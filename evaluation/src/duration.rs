//! Durations as options and files give them: a number with its unit.

use std::ops::RangeInclusive;
use std::time::Duration;

use humantime::{format_duration, parse_duration};

/// The range without bounds.
pub const ANY: RangeInclusive<Duration> = Duration::ZERO..=Duration::MAX;
/// The shortest duration that is not 0.
pub const SHORTEST: Duration = Duration::from_nanos(1);

/// Reads a duration such as `500ms`, `0.5s` or `1h 30m` that lies within `allowed`.
///
/// # Errors
/// Returns a text that says what is wanted, with an example. If only the unit is missing, the text
/// repeats the number with the example's unit.
pub fn duration(
    text: &str,
    example: &str,
    allowed: &RangeInclusive<Duration>,
) -> Result<Duration, String> {
    let text = text.trim();
    let read = decimal(text).or_else(|| parse_duration(text).ok());
    read.filter(|read| allowed.contains(read)).ok_or_else(|| {
        let (least, most) = (*allowed.start(), format_duration(*allowed.end()));
        let range = match (least, *allowed.end()) {
            (Duration::ZERO, Duration::MAX) => "0 or more".to_owned(),
            (SHORTEST, _) => format!("more than 0 and up to {most}"),
            (Duration::ZERO, _) => format!("from 0 to {most}"),
            _ => format!("from {} to {most}", format_duration(least)),
        };
        let unit = example.trim_start_matches(|it: char| it.is_ascii_digit() || it == '.');
        let is_bare = text.parse::<f64>().is_ok_and(|number| number >= 0.0);
        let remedy = if is_bare { format!(": write {text}{unit}") } else { String::new() };
        format!("it must be {range} with a unit, such as {example}{remedy}")
    })
}

/// Returns a duration in seconds, as the nearest floating-point number.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "2^53 ns are 104 days")]
pub fn seconds(duration: Duration) -> f64 {
    duration.as_nanos() as f64 / 1e9
}

/// Reads a number with or without a fraction and one unit, exactly. Digits below a nanosecond are
/// dropped.
fn decimal(text: &str) -> Option<Duration> {
    let digits = text.find(|it: char| !it.is_ascii_digit() && it != '.')?;
    let (number, unit) = text.split_at(digits);
    let nanos: u128 = match unit {
        "ns" => 1,
        "us" | "µs" => 1_000,
        "ms" => 1_000_000,
        "s" => 1_000_000_000,
        "m" | "min" => 60_000_000_000,
        "h" => 3_600_000_000_000,
        _ => return None,
    };
    let (whole, fraction) = number.split_once('.').unwrap_or((number, ""));
    let fraction = fraction.get(..18).unwrap_or(fraction);
    let parts = |text: &str| if text.is_empty() { Some(0) } else { text.parse::<u128>().ok() };
    let scale = 10_u128.pow(u32::try_from(fraction.len()).ok()?);
    let total = parts(whole)?.checked_mul(nanos)? + parts(fraction)? * nanos / scale;
    (!number.trim_matches('.').is_empty()).then_some(())?;
    Some(Duration::from_nanos(u64::try_from(total).ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn duration_is_read_exactly_with_its_unit() {
        for (text, nanos) in [
            ("118.2ms", 118_200_000),
            ("0.3017s", 301_700_000),
            ("3.027s", 3_027_000_000),
            (".5s", 500_000_000),
            ("1.5m", 90_000_000_000),
            ("1h 30m", 5_400_000_000_000),
            ("2us", 2_000),
            ("0s", 0),
        ] {
            assert_eq!(duration(text, "1s", &ANY), Ok(Duration::from_nanos(nanos)), "{text}");
        }
        assert_eq!(seconds(Duration::from_millis(3_027)).to_string(), "3.027");
    }

    #[test]
    fn number_without_unit_is_refused_with_the_remedy() {
        let second = SHORTEST..=Duration::from_secs(1);
        for (text, allowed, expected) in [
            ("500", &ANY, "it must be 0 or more with a unit, such as 2ms: write 500ms"),
            (
                "0",
                &second,
                "it must be more than 0 and up to 1s with a unit, such as 2ms: write 0ms",
            ),
            ("2s", &second, "it must be more than 0 and up to 1s with a unit, such as 2ms"),
            ("-1s", &ANY, "it must be 0 or more with a unit, such as 2ms"),
            (".s", &ANY, "it must be 0 or more with a unit, such as 2ms"),
            ("", &ANY, "it must be 0 or more with a unit, such as 2ms"),
        ] {
            assert_eq!(duration(text, "2ms", allowed), Err(expected.to_owned()), "{text}");
        }
    }
}
