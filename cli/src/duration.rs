//! Durations: how options and files give them, and how they are shown.

use std::time::Duration;

pub(crate) use fuseline_evaluation::duration::{ANY, SHORTEST, duration, seconds};
use indicatif::HumanCount;

/// Returns a duration in milliseconds.
pub(crate) fn ms(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}

/// Shows whole milliseconds.
pub(crate) fn whole(duration: Duration) -> String {
    format!("{:.0} ms", ms(duration))
}

/// Shows milliseconds to a tenth.
pub(crate) fn tenths(duration: Duration) -> String {
    format!("{:.1} ms", ms(duration))
}

/// Shows milliseconds to a tenth if they are fewer than ten, and whole ones otherwise.
pub(crate) fn short(duration: Duration) -> String {
    if ms(duration) < 9.95 { tenths(duration) } else { whole(duration) }
}

/// Shows seconds, to a tenth unless they are whole.
pub(crate) fn secs(duration: Duration) -> String {
    let decimals = usize::from(duration.subsec_millis() != 0);
    format!("{:.decimals$} s", duration.as_secs_f64())
}

/// Shows nanoseconds in their greatest whole unit.
pub(crate) fn in_greatest_unit(nanoseconds: u64) -> String {
    const UNITS: [(u64, &str); 7] = [
        (86_400_000_000_000, "days"),
        (3_600_000_000_000, "h"),
        (60_000_000_000, "min"),
        (1_000_000_000, "s"),
        (1_000_000, "ms"),
        (1_000, "µs"),
        (1, "ns"),
    ];
    let (unit, name) =
        UNITS.into_iter().find(|(unit, _)| nanoseconds >= *unit).unwrap_or((1, "ns"));
    format!("{} {name}", HumanCount(nanoseconds / unit))
}

/// Shows nanoseconds, which may be negative, to a thousandth of their greatest unit.
pub(crate) fn in_words(nanos: i128) -> String {
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
    let part = format!("{:03}", size % unit * 1000 / unit);
    let part = part.trim_end_matches('0');
    let point = if part.is_empty() { "" } else { "." };
    format!("{sign}{}{point}{part} {name}", size / unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn greatest_unit_is_whole() {
        let texts =
            [0, 999, 1_000, 59_999_999_999, 86_400_000_000_000, u64::MAX].map(in_greatest_unit);
        assert_eq!(texts, ["0 ns", "999 ns", "1 µs", "59 s", "1 days", "213,503 days"]);
    }

    #[test]
    fn words_have_a_sign_and_up_to_three_decimals() {
        let words = [-1_500_000, 0, 999, 172_800_000_000_000, 1_000_500_000].map(in_words);
        assert_eq!(words, ["-1.5 ms", "0 ns", "999 ns", "2 days", "1 s"]);
    }

    #[test]
    fn few_milliseconds_have_a_tenth() {
        let texts = [9_940, 9_960, 3_027_400].map(|us| short(Duration::from_micros(us)));
        assert_eq!(texts, ["9.9 ms", "10 ms", "3027 ms"]);
        assert_eq!([7_000, 7_500].map(|ms| secs(Duration::from_millis(ms))), ["7 s", "7.5 s"]);
    }
}
