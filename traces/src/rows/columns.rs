//! [`Columns`]: how a file calls the keys and events of a trace, and how it writes their values.

use std::borrow::Cow;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::rc::Rc;

use super::instant;

/// The keys that an event may have, with those that are instants and durations.
const KEYS: [(&str, bool); 14] = [
    ("ev", false),
    ("at", true),
    ("t", false),
    ("p", false),
    ("due", true),
    ("deadline", true),
    ("backlog", false),
    ("why", false),
    ("of", false),
    ("try", false),
    ("within", true),
    ("age", true),
    ("origin", false),
    ("seq", false),
];

/// Events, with the keys that each may have beside `ev` and `at`.
const EVENTS: [(&str, &[&str]); 14] = [
    ("open", &["t", "deadline", "within", "age", "origin", "seq"]),
    ("offer", &["t", "p", "deadline", "backlog"]),
    ("result", &["t", "p", "of", "try"]),
    ("fail", &["t", "p", "try"]),
    ("tick", &[]),
    ("timer", &["t", "p"]),
    ("refuse", &["t", "p", "why"]),
    ("request", &["t", "p", "due", "deadline", "try"]),
    ("hold", &["t", "p"]),
    ("drop", &["t", "p", "why"]),
    ("emit", &["t", "p", "of"]),
    ("final", &["t", "p"]),
    ("miss", &["t"]),
    ("cancel", &["t", "p"]),
];

/// The keys that are instants of a clock, which a file may write as times of day.
const INSTANTS: [&str; 2] = ["at", "due"];

/// The unit of a file's instants and durations.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Unit {
    /// Nanoseconds.
    Ns,
    /// Microseconds.
    Us,
    /// Milliseconds.
    Ms,
    /// Seconds.
    S,
}

/// Where the keys stand and how they are written.
#[derive(Clone, Debug)]
pub struct Columns<'a> {
    named: BTreeMap<&'a str, &'a str>,
    /// What the file calls an event; the empty event is left out.
    events: BTreeMap<&'a str, &'a str>,
    unit: Unit,
    /// Of some keys.
    units: BTreeMap<&'a str, Unit>,
    /// What stands for a key wherever it is not in the file.
    fixed: BTreeMap<&'a str, String>,
    /// The priorities of sources by their names.
    sources: BTreeMap<String, u64>,
    /// Where sources are gathered as the file calls them, instead of being looked up.
    gathered: Option<Rc<RefCell<Vec<String>>>>,
}

/// `KEY=NAME`: a key of the trace, and the column that it stands in.
///
/// # Errors
/// What to write instead.
pub fn column(text: &str) -> Result<(&'static str, String), String> {
    let (key, name) = text.split_once('=').ok_or("write KEY=NAME, such as at=stamp")?;
    let known = KEYS.iter().find(|(known, _)| *known == key);
    let (key, _) = known.ok_or_else(|| {
        let known: Vec<&str> = KEYS.iter().map(|(known, _)| *known).collect();
        format!("no key {key:?}; it is one of {}", known.join(", "))
    })?;
    Ok((key, name.to_owned()))
}

/// `NAME=EV`: what the file calls an event of a trace; `NAME=` leaves those events out.
///
/// # Errors
/// What to write instead.
pub fn event(text: &str) -> Result<(String, &'static str), String> {
    let (name, event) = text.split_once('=').ok_or("write NAME=EV, such as response=result")?;
    if event.is_empty() {
        return Ok((name.to_owned(), ""));
    }
    let known = EVENTS.iter().find(|(known, _)| *known == event);
    let (event, _) = known.ok_or_else(|| format!("no event {event:?} in a trace"))?;
    Ok((name.to_owned(), event))
}

/// `UNIT` or `KEY=UNIT`: the unit of all times, or of one key's.
///
/// # Errors
/// What to write instead.
pub fn unit(text: &str) -> Result<(Option<&'static str>, Unit), String> {
    let (key, name) = match text.split_once('=') {
        Some((key, name)) => (Some(key), name),
        None => (None, text),
    };
    let unit = Unit::ALL.into_iter().find(|unit| unit.as_str() == name);
    let unit = unit.ok_or_else(|| format!("no unit {name:?}; it is one of ns, us, ms, s"))?;
    let Some(key) = key else { return Ok((None, unit)) };
    let times = KEYS.iter().filter(|(_, is_time)| *is_time).map(|(key, _)| *key);
    let found = times.clone().find(|known| *known == key);
    let found = found.ok_or_else(|| {
        format!("no time {key:?}; it is one of {}", times.collect::<Vec<_>>().join(", "))
    });
    found.map(|key| (Some(key), unit))
}

impl Unit {
    /// All of them, from the shortest.
    pub const ALL: [Self; 4] = [Self::Ns, Self::Us, Self::Ms, Self::S];

    /// Its name.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Ns => "ns",
            Self::Us => "us",
            Self::Ms => "ms",
            Self::S => "s",
        }
    }
}

impl<'a> Columns<'a> {
    /// The columns of keys that have other names than theirs, what the file calls some events, and
    /// its unit.
    #[must_use]
    pub fn new(
        named: &'a [(&'static str, String)],
        events: &'a [(String, &'static str)],
        unit: Unit,
    ) -> Self {
        Self {
            named: named.iter().map(|(key, name)| (*key, &**name)).collect(),
            events: events.iter().map(|(name, event)| (&**name, *event)).collect(),
            unit,
            units: BTreeMap::new(),
            fixed: BTreeMap::new(),
            sources: BTreeMap::new(),
            gathered: None,
        }
    }

    /// The same, where some keys have units of their own.
    #[must_use]
    pub fn with_units(mut self, units: impl IntoIterator<Item = (&'a str, Unit)>) -> Self {
        self.units.extend(units);
        self
    }

    /// The same, where this stands for some keys of all events.
    #[must_use]
    pub fn with_fixed(mut self, fixed: impl IntoIterator<Item = (&'a str, String)>) -> Self {
        self.fixed.extend(fixed);
        self
    }

    /// The same, where `p` may be the name of a source instead of its priority.
    #[must_use]
    pub fn with_sources(mut self, sources: impl IntoIterator<Item = (String, u64)>) -> Self {
        self.sources.extend(sources);
        self
    }

    /// The same, which takes any name for a source and gathers the sources of requests, results and so on here, each once
    /// and as the file calls it, without local.
    #[must_use]
    pub fn gathering(mut self, sources: Rc<RefCell<Vec<String>>>) -> Self {
        self.gathered = Some(sources);
        self
    }

    /// The keys, with whether each is a time, and what the file calls it; and whether the user said so.
    pub(super) fn keys(&self) -> impl Iterator<Item = (&'static str, bool, &str, bool)> {
        KEYS.into_iter().map(|(key, is_time)| match self.named.get(key) {
            Some(name) => (key, is_time, *name, true),
            None => (key, is_time, key, false),
        })
    }

    /// Whether the key has a value without the file: one that was given, or a deadline that is named as a time.
    pub(super) fn is_fixed(&self, key: &str) -> bool {
        self.fixed.contains_key(key) || self.constant(key).is_some()
    }

    /// A deadline that the user named as a time, the same for all requests.
    fn constant(&self, key: &str) -> Option<&str> {
        let name = self.named.get(key).filter(|_| key == "deadline")?;
        self.time(key, name).map(|_| *name)
    }

    /// What is found in the file as a line of a trace; none if it is to be left out. `cell` has what stands for a key, or
    /// nothing.
    pub(super) fn line<'c>(
        &self,
        cell: impl Fn(&str) -> Option<Cow<'c, str>>,
    ) -> Result<Option<String>, String> {
        let cell = |key: &str| match self.fixed.get(key) {
            Some(text) => Some(Cow::Borrowed(&**text)),
            None => cell(key).filter(|text| !text.is_empty()),
        };
        let name = cell("ev").unwrap_or_default();
        let is_own = self.fixed.contains_key("ev");
        let event = if is_own { None } else { self.events.get(&*name).copied() };
        let event = event.unwrap_or(&name);
        if event.is_empty() && self.events.contains_key(&*name) {
            return Ok(None);
        }
        let Some((_, takes)) = EVENTS.iter().find(|(known, _)| *known == event) else {
            // In one line, whatever the cell holds.
            let shown = name.escape_debug();
            return Err(format!(
                "unknown event {name:?}; say what it is with --event {shown}=EV, or leave it out with --event {shown}="
            ));
        };
        let mut line = format!("{{\"ev\":\"{event}\"");
        for (key, is_time, column, _) in self.keys() {
            // An open's deadline is local's, and no request's.
            let is_requested = matches!(event, "offer" | "request");
            let constant = || self.constant(key).filter(|_| is_requested).map(Cow::Borrowed);
            let Some(text) = cell(key).or_else(constant) else { continue };
            if !(key == "at" || takes.contains(&key)) {
                continue;
            }
            let value = self.value(key, is_time, &text);
            let value =
                value.map_err(|wanted| format!("column {column:?}: {text:?} is {wanted}"))?;
            // To a string: it cannot fail.
            let _ = write!(line, ",\"{key}\":{value}");
        }
        line.push('}');
        Ok(Some(line))
    }

    /// A cell as JSON, or what it is not.
    pub(super) fn value(&self, key: &str, is_time: bool, text: &str) -> Result<String, String> {
        let no_number = || "not a number that fits".to_owned();
        match key {
            "why" | "origin" => Ok(serde_json::Value::from(text).to_string()),
            "p" => self.source(text).map(|p| p.to_string()),
            _ if is_time => {
                let time = self.time(key, text);
                time.map(|nanos| nanos.to_string()).ok_or_else(no_number)
            }
            // ROS numbers messages by their stamps.
            "t" => {
                let number = text.parse().ok().or_else(|| instant_of(text));
                number.map(|number: u64| number.to_string()).ok_or_else(no_number)
            }
            _ => text.parse().map(|number: u64| number.to_string()).map_err(|_| no_number()),
        }
    }

    /// A time in nanoseconds: a number in the key's unit or its own, as 5ms, or a time of day where it is an instant.
    pub(super) fn time(&self, key: &str, text: &str) -> Option<u64> {
        let unit = self.units.get(key).copied().unwrap_or(self.unit);
        let time_of_day = || INSTANTS.contains(&key).then(|| instant::nanos(text)).flatten();
        nanos(text, unit).or_else(|| with_unit(text)).or_else(time_of_day)
    }

    /// The priority of a source, which the file calls by that or by its name.
    pub(super) fn source(&self, name: &str) -> Result<u64, String> {
        if let Some(gathered) = &self.gathered {
            let mut gathered = gathered.borrow_mut();
            if !matches!(name, "0" | "local") && !gathered.iter().any(|known| known == name) {
                gathered.push(name.to_owned());
            }
            return Ok(0);
        }
        if let Ok(p) = name.parse() {
            return Ok(p);
        }
        self.sources.get(name).copied().ok_or_else(|| {
            let known: Vec<&str> = self.sources.keys().map(String::as_str).collect();
            match &known[..] {
                [] => "not a number that fits".to_owned(),
                known => format!("no source; the header has {}", known.join(", ")),
            }
        })
    }
}

/// Nanoseconds of a time of day, or of a time with its unit.
fn instant_of(text: &str) -> Option<u64> {
    with_unit(text).or_else(|| instant::nanos(text))
}

/// A number with its unit, such as 0.5s.
fn with_unit(text: &str) -> Option<u64> {
    Unit::ALL.into_iter().find_map(|unit| nanos(text.strip_suffix(unit.as_str())?, unit))
}

/// A decimal number of units, exactly.
fn nanos(text: &str, unit: Unit) -> Option<u64> {
    let digits = match unit {
        Unit::Ns => 0,
        Unit::Us => 3,
        Unit::Ms => 6,
        Unit::S => 9,
    };
    let (whole, part) = text.split_once('.').unwrap_or((text, ""));
    let part = part.trim_end_matches('0');
    let is_number = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    if whole.is_empty() || part.len() > digits || !is_number(whole) || !is_number(part) {
        return None;
    }
    format!("{whole}{part:0<digits$}").parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimals_are_read_exactly_or_not_at_all() {
        for (text, unit, read) in [
            ("12", Unit::Ns, Some(12)),
            ("12.50", Unit::Us, Some(12_500)),
            ("0.000000001", Unit::S, Some(1)),
            ("18446744073709.551615", Unit::Ms, Some(u64::MAX)),
            ("18446744073709.551616", Unit::Ms, None),
            ("1.5", Unit::Ns, None),
            ("-1", Unit::Ns, None),
            ("+1", Unit::Ns, None),
            ("1e3", Unit::Ns, None),
            (".5", Unit::S, None),
        ] {
            assert_eq!(nanos(text, unit), read, "{text}");
        }
    }

    #[test]
    fn a_time_may_have_its_own_unit() {
        let columns = Columns::new(&[], &[], Unit::S);
        for (text, read) in [
            ("5ms", Some(5_000_000)),
            ("0.5s", Some(500_000_000)),
            ("7ns", Some(7)),
            ("1.5us", Some(1_500)),
            ("2", Some(2_000_000_000)),
            ("5 m", None),
            ("ms", None),
            ("-5ms", None),
            ("1.5ns", None),
        ] {
            assert_eq!(columns.time("deadline", text), read, "{text}");
        }
    }
}
