//! Recorded networks: round-trip times of a moving vehicle by the moment of sending, built in or
//! read from CSV.
//!
//! A [`Drive`] takes the time as an argument, so a test in virtual time, a simulation and a proxy
//! can use it. A handle on tokio sleeps for its round trip, and `fuseline serve --forward` delays
//! the requests to a server.

use std::fs::File;
use std::io::{self, Read};
use std::time::Duration;

use fuseline_traces::rows::{TableError, TableReader};
use thiserror::Error;

/// The greatest size of a drive file. The recorded ones are a thousandth of it.
const FILE_BYTES: u64 = 64 << 20;
/// The longest round trip. Greater figures are mistaken units.
const LONGEST_MS: f64 = 86_400_000.0;
/// The longest drive is a year.
const LONGEST: Duration = Duration::from_secs(365 * 86_400);

macro_rules! built_in {
    ($($name:literal),* $(,)?) => {
        &[$(($name, include_str!(concat!("../data/", $name, ".csv")))),*]
    };
}

/// The drives inside the library, by name.
const BUILT_IN: &[(&str, &str)] = built_in![
    "cicv5g/arterial_n78_v80",
    "cicv5g/rural_n8_v0",
    "cicv5g/rural_n8_v10",
    "cicv5g/strong_to_weak_n8_v30",
    "cicv5g/urban_n78_v40",
    "cicv5g/weak_to_strong_n8_v50",
    "vnperf/downtown",
    "vnperf/highway",
];

/// A recorded drive through one network, as round-trip times by the moment of sending.
///
/// A drive that is over starts again from its beginning.
///
/// ```
/// use core::time::Duration;
/// use fuseline_testkit::networks::Drive;
///
/// let drive = Drive::load("cicv5g/rural_n8_v10")?;
/// assert_eq!(drive.round_trip(Duration::from_millis(55)), Some(Duration::from_millis(25)));
/// # Ok::<(), fuseline_testkit::networks::DriveError>(())
/// ```
#[derive(Clone, PartialEq, Debug)]
pub struct Drive {
    name: String,
    /// The samples, ascending, the first at 0.
    samples: Vec<Sample>,
    length: Duration,
    /// `true` for each rate, up and down, that is recorded.
    has_rate: [bool; 2],
}

/// The state of the network for messages sent from `at` until the next sample.
#[derive(Clone, Copy, PartialEq, Debug)]
struct Sample {
    at: Duration,
    /// The round trip, or `None` while the network was unavailable.
    round_trip: Option<Duration>,
    /// The rates up and down in bits per second; 0 if they are not recorded.
    rates: [u64; 2],
}

/// A row of a recording.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct DriveRow {
    /// The instant of sending, in seconds, as the recording counts it.
    pub sent: f64,
    /// The time since the first row.
    pub at: Duration,
    /// The round trip, or `None` while the network was unavailable.
    pub round_trip: Option<Duration>,
    /// The rates up and down in bits per second; 0 if they are not recorded.
    pub rates: [u64; 2],
    /// The number of requests that were unanswered then, if it is recorded.
    pub queued: Option<u64>,
}

/// The reason why a drive cannot be used. Its message names the place.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the fields are what the words say")]
pub enum DriveError {
    /// There is no such drive.
    #[error("no built-in drive and no readable file {name:?} ({source}); built in are {}", names())]
    Open { name: String, source: io::Error },
    /// The file is too long.
    #[error("{name}: more than 64 MiB; give a shorter recording")]
    TooLarge { name: String },
    /// The file is not CSV.
    #[error("{name}:{}: {source}; a drive is CSV with a line of column names first", source.line)]
    Csv { name: String, source: TableError },
    /// The file has no column of times.
    #[error("{name}:1: no time column; name one `sent_ms` or `second`")]
    NoTime { name: String },
    /// The file has no such network.
    #[error("{name}:1: no column {wanted:?}; it has {found}")]
    NoColumn { name: String, wanted: String, found: String },
    /// The file has several networks, and the name selects none.
    #[error("{name}:1: the file has several networks; name one of them: {name}:{}", .found.join(&format!(" or {name}:")))]
    ManyColumns { name: String, found: Vec<String> },
    /// A field is not a round trip.
    #[error("{name}:{line}: {column} is {found:?}; it must be milliseconds from 0 to a day, or -1")]
    RoundTrip { name: String, line: u64, column: String, found: String },
    /// An instant is not after the previous one.
    #[error(
        "{name}:{line}: {column} is {found:?}; it must be a number greater than the line before, \
         within a year of the first"
    )]
    Time { name: String, line: u64, column: String, found: String },
    /// The drive is too short.
    #[error("{name}: the drive has fewer than two rows; give at least two")]
    TooShort { name: String },
    /// A field is not a rate.
    #[error(
        "{name}:{line}: {column} is {found:?}; it must be 0, or Mbit/s from 0.001 to 1000000, and not 0 in all rows"
    )]
    Rate { name: String, line: u64, column: String, found: String },
}

impl Drive {
    /// Loads the drive called `name`: a built-in drive, or otherwise a CSV file. If the recording
    /// has several networks, `:network` follows the name.
    ///
    /// # Errors
    /// Returns the first [`DriveError`] that holds.
    pub fn load(name: &str) -> Result<Self, DriveError> {
        let (file, network) = split(name);
        if let Some((_, text)) = BUILT_IN.iter().find(|(built_in, _)| *built_in == file) {
            return Self::read(file, network, text.as_bytes());
        }
        let text = File::open(file)
            .map_err(|source| DriveError::Open { name: file.to_owned(), source })?;
        Self::read(file, network, text)
    }

    /// Returns a network without delay.
    #[must_use]
    pub fn direct() -> Self {
        let sample = Sample { at: Duration::ZERO, round_trip: Some(Duration::ZERO), rates: [0; 2] };
        let (name, length) = ("no drive".to_owned(), Duration::from_secs(1));
        Self { name, samples: vec![sample], length, has_rate: [false; 2] }
    }

    /// Reads a recording from CSV, at most 64 MiB, as [`each_row`] describes it. `file` names it in
    /// errors.
    ///
    /// # Errors
    /// Returns the first [`DriveError`] that holds.
    pub fn read(file: &str, network: Option<&str>, text: impl Read) -> Result<Self, DriveError> {
        let mut samples: Vec<Sample> = Vec::new();
        let text = SizeLimit { text, remaining: FILE_BYTES };
        let has_rate = each_row(file, network, text, |row| {
            let DriveRow { at, round_trip, rates, .. } = row;
            samples.push(Sample { at, round_trip, rates });
        })?;
        let [.., before, last] = samples[..] else {
            return Err(DriveError::TooShort { name: file.to_owned() });
        };
        // The last sample lasts as long as the one before it.
        let length = last.at + last.at.abs_diff(before.at);
        let name = network.map_or_else(|| file.to_owned(), |network| format!("{file}:{network}"));
        Ok(Self { name, samples, length, has_rate })
    }

    /// Returns the samples: the moment from which on each holds, and its round trip, or `None`
    /// while the network was unavailable.
    #[must_use]
    pub fn samples(&self) -> impl ExactSizeIterator<Item = (Duration, Option<Duration>)> {
        self.samples.iter().map(|sample| (sample.at, sample.round_trip))
    }

    /// Returns `true` if a rate of the link, up or down, is recorded.
    #[must_use]
    pub const fn has_rates(&self) -> bool {
        self.has_rate[0] || self.has_rate[1]
    }

    /// Returns the link's rate one way at `moment`, in bits per second, and how long it lasts, or
    /// `None` if it is not recorded.
    #[must_use]
    pub fn rate(&self, way: usize, moment: Duration) -> Option<(u64, Duration)> {
        self.has_rate[way].then(|| {
            let within = nanos(moment.as_nanos() % self.length.as_nanos());
            let next = self.samples.partition_point(|sample| sample.at <= within);
            let until = self.samples.get(next).map_or(self.length, |sample| sample.at);
            (self.samples[next.saturating_sub(1)].rates[way], until.saturating_sub(within))
        })
    }

    /// Returns the length of the drive, after which it starts again.
    #[must_use]
    pub const fn length(&self) -> Duration {
        self.length
    }

    /// Returns the drive's name, with the network.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the share of the drive, from 0 to 1, in which the round trip is shorter than
    /// `seconds`.
    #[must_use]
    pub fn share_below(&self, seconds: f64) -> f64 {
        let ends = self.samples.iter().skip(1).map(|sample| sample.at).chain([self.length]);
        let is_short =
            |sample: &Sample| sample.round_trip.is_some_and(|trip| trip.as_secs_f64() < seconds);
        let short = self.samples.iter().zip(ends).filter(|(sample, _)| is_short(sample));
        let short: Duration = short.map(|(sample, end)| end.saturating_sub(sample.at)).sum();
        short.as_secs_f64() / self.length.as_secs_f64()
    }

    /// Returns the delay after which a message sent at `moment` (since the drive's beginning) is
    /// back, or `None` if it never is.
    ///
    /// The delay is the round trip of the latest sample at that moment. While the network was
    /// unavailable (`-1`), a message waits until a sample has a round trip again, and then takes
    /// that one as well.
    #[must_use]
    pub fn round_trip(&self, moment: Duration) -> Option<Duration> {
        let within = nanos(moment.as_nanos() % self.length.as_nanos());
        let sent = self.samples.partition_point(|sample| sample.at <= within).saturating_sub(1);
        let (later, earlier) = (self.samples.get(sent..)?, self.samples.get(..sent)?);
        if let Some(round_trip) = later.first()?.round_trip {
            return Some(round_trip);
        }
        let again = earlier.iter().map(|sample| (sample, self.length));
        let mut from_now = later.iter().map(|sample| (sample, Duration::ZERO)).chain(again);
        from_now.find_map(|(sample, laps)| {
            let round_trip = sample.round_trip?;
            Some((sample.at + laps).saturating_sub(within) + round_trip)
        })
    }
}

/// Reads a recording from CSV and hands out each row in order, so that memory does not grow with
/// them. `file` names it in errors. Returns `true` for each rate, up and down, that is recorded.
///
/// The first line names the columns: a time column, `sent_ms` or `second`, and `rtt_ms`, or several
/// `<network>_rtt_ms` from which `network` selects one. A round trip of −1 means that the network
/// was unavailable. `uplink_mbps` and `downlink_mbps`, with the same prefix, are the rates of the
/// link in Mbit/s. `queued` is the number of unanswered requests. Other columns are ignored.
///
/// # Errors
/// Returns the first [`DriveError`] that holds.
pub fn each_row(
    file: &str,
    network: Option<&str>,
    text: impl Read,
    mut look: impl FnMut(DriveRow),
) -> Result<[bool; 2], DriveError> {
    let owned = || file.to_owned();
    let fault = |source| csv_error(file, source);
    let mut rows = TableReader::new(text, &csv::ReaderBuilder::new());
    let columns = rows.names().map_err(fault)?;
    let (time, unit) = columns
        .iter()
        .position(|column| column == "sent_ms")
        .map(|i| (i, 0.001))
        .or_else(|| columns.iter().position(|column| column == "second").map(|i| (i, 1.0)))
        .ok_or_else(|| DriveError::NoTime { name: owned() })?;
    let round_trip = find_network(file, network, &columns)?;
    let rates = find_rates(&columns[round_trip], &columns);
    let queued = columns.iter().position(|column| column == "queued");
    let named = |i: usize| columns[i].escape_debug().to_string();
    let (mut first, mut before, mut last_line) = (None, None, 1);
    let mut has_flowed = [false; 2];
    while let Some((line, row)) = rows.next_row().map_err(fault)? {
        let field = |i: usize| row.get(i).unwrap_or_default();
        let sent = field(time).parse().ok().map(|time: f64| time * unit);
        let start = *first.get_or_insert(sent.unwrap_or_default());
        let (sent, at) = sent
            .and_then(|sent| Some((sent, Duration::try_from_secs_f64(sent - start).ok()?)))
            .filter(|(_, at)| *at <= LONGEST && before.is_none_or(|before| *at > before))
            .ok_or_else(|| DriveError::Time {
                name: owned(),
                line,
                column: named(time),
                found: field(time).to_owned(),
            })?;
        let round_trip =
            parse_round_trip(field(round_trip)).map_err(|NotMillis| DriveError::RoundTrip {
                name: owned(),
                line,
                column: named(round_trip),
                found: field(round_trip).to_owned(),
            })?;
        let bits = |rate: Option<usize>| {
            rate.map_or(Some(0), |i| parse_rate(field(i))).ok_or_else(|| {
                let (column, found) =
                    (rate.map_or_else(String::new, named), rate.map_or("", field));
                DriveError::Rate { name: owned(), line, column, found: found.to_owned() }
            })
        };
        let rates = [bits(rates[0])?, bits(rates[1])?];
        has_flowed = [0, 1].map(|way| has_flowed[way] || rates[way] > 0);
        let queued = queued.and_then(|i| field(i).parse().ok());
        look(DriveRow { sent, at, round_trip, rates, queued });
        (before, last_line) = (Some(at), line);
    }
    for (rate, has_flowed) in rates.iter().zip(has_flowed) {
        if let Some(i) = rate.filter(|_| !has_flowed) {
            let (column, found) = (named(i), "0".to_owned());
            return Err(DriveError::Rate { name: owned(), line: last_line, column, found });
        }
    }
    Ok(rates.map(|rate| rate.is_some()))
}

/// Returns the names of the built-in drives.
pub fn built_in() -> impl Iterator<Item = &'static str> {
    BUILT_IN.iter().map(|(name, _)| *name)
}

/// Splits the name of a drive into its file and its network, if it names one.
#[must_use]
pub fn split(name: &str) -> (&str, Option<&str>) {
    match name.rsplit_once(':') {
        Some((file, network)) if !network.contains(['/', '\\']) => (file, Some(network)),
        Some(_) | None => (name, None),
    }
}

fn names() -> String {
    let names: Vec<&str> = built_in().collect();
    names.join(", ")
}

/// Returns the column of `network`. If no network is named, returns the only column of round trips.
fn find_network(
    file: &str,
    network: Option<&str>,
    columns: &csv::StringRecord,
) -> Result<usize, DriveError> {
    let networks: Vec<(usize, &str)> = columns
        .iter()
        .enumerate()
        .filter_map(|(i, column)| Some((i, column.strip_suffix("rtt_ms")?)))
        .filter_map(|(i, column)| {
            Some((i, if column.is_empty() { column } else { column.strip_suffix('_')? }))
        })
        .collect();
    match (network, &networks[..]) {
        (Some(wanted), found) => found.iter().find(|(_, network)| *network == wanted),
        (None, [only]) => Some(only),
        (None, found) if found.len() > 1 => {
            let found =
                found.iter().map(|(_, network)| network.escape_debug().to_string()).collect();
            return Err(DriveError::ManyColumns { name: file.to_owned(), found });
        }
        (None, _) => None,
    }
    .map(|(i, _)| *i)
    .ok_or_else(|| DriveError::NoColumn {
        name: file.to_owned(),
        wanted: network.map_or_else(|| "rtt_ms".to_owned(), |network| format!("{network}_rtt_ms")),
        // The list is on one line, whatever the columns are called.
        found: columns.iter().collect::<Vec<_>>().join(", ").escape_debug().to_string(),
    })
}

/// Returns the columns of the link's rates that belong to this column of round trips.
fn find_rates(round_trip: &str, columns: &csv::StringRecord) -> [Option<usize>; 2] {
    let prefix = round_trip.strip_suffix("rtt_ms").unwrap_or_default();
    ["uplink_mbps", "downlink_mbps"]
        .map(|name| columns.iter().position(|column| column.strip_prefix(prefix) == Some(name)))
}

/// Converts Mbit/s to bits per second.
fn parse_rate(field: &str) -> Option<u64> {
    let mbits: f64 = field.parse().ok()?;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the range")]
    (mbits == 0.0 || (0.001..=1e6).contains(&mbits)).then(|| (mbits * 1e6).round() as u64)
}

/// Converts milliseconds to a round trip; −1 means that there is no network.
fn parse_round_trip(field: &str) -> Result<Option<Duration>, NotMillis> {
    match field.parse() {
        Ok(-1.0) => Ok(None),
        Ok(ms) if (0.0..=LONGEST_MS).contains(&ms) => {
            Ok(Some(Duration::from_secs_f64(ms / 1000.0)))
        }
        Ok(_) | Err(_) => Err(NotMillis),
    }
}

/// A field is neither a round trip nor −1.
struct NotMillis;

/// Converts a remainder of a length in nanoseconds; both are within 584 years.
fn nanos(nanos: u128) -> Duration {
    Duration::from_nanos(u64::try_from(nanos).unwrap_or(u64::MAX))
}

/// Converts an error, which may be the end that [`SizeLimit`] made.
fn csv_error(file: &str, source: TableError) -> DriveError {
    let name = file.to_owned();
    match source.source.kind() {
        csv::ErrorKind::Io(error) if error.kind() == io::ErrorKind::FileTooLarge => {
            DriveError::TooLarge { name }
        }
        _ => DriveError::Csv { name, source },
    }
}

/// Refuses to read more than this many bytes, so that no file fills the memory.
struct SizeLimit<R> {
    text: R,
    remaining: u64,
}

impl<R: Read> Read for SizeLimit<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let len = self.text.read(buffer)?;
        self.remaining = self
            .remaining
            .checked_sub(len as u64)
            .ok_or_else(|| io::Error::from(io::ErrorKind::FileTooLarge))?;
        Ok(len)
    }
}
