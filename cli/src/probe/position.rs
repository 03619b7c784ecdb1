//! Where the vehicle is: fixes by the time of day, from `gpsd` or from an NMEA file.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

use nmea::ParseResult;
use serde::Deserialize;
use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::sleep;

use crate::complain::complain;
use crate::fault::plain;

/// How many fixes are remembered: a day of them at 1 Hz.
const FIXES: usize = 86_400;
/// A fix says nothing of a moment further away, in milliseconds.
const NEAR_MS: u64 = 2000;
/// No sentence and no report is longer, in bytes.
const LINE: u64 = 64 * 1024;
/// How often a file that has ended is looked at again, and how long after it was lost `gpsd` is connected to again.
const AGAIN: Duration = Duration::from_millis(500);
/// Metres a second in a knot.
const KNOT: f64 = 1852.0 / 3600.0;

/// A position at a time of day.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Fix {
    /// Milliseconds since 1970.
    pub(crate) utc_ms: i64,
    /// Degrees, north is above 0.
    pub(crate) lat: f64,
    /// Degrees, east is above 0.
    pub(crate) lon: f64,
    pub(crate) speed_mps: Option<f64>,
}

/// The latest fixes, by time. Clones are the same ones.
#[derive(Clone, Default)]
pub(crate) struct Fixes(Arc<Mutex<VecDeque<Fix>>>);

impl Fixes {
    /// Adds one; what is no position is ignored.
    pub(crate) fn add(&self, fix: Fix) {
        let is_place = (-90.0..=90.0).contains(&fix.lat) && (-180.0..=180.0).contains(&fix.lon);
        if !is_place {
            return;
        }
        let speed_mps = fix.speed_mps.filter(|speed| speed.is_finite());
        let mut fixes = self.lock();
        if fixes.len() == FIXES {
            fixes.pop_front();
        }
        let index = fixes.partition_point(|other| other.utc_ms <= fix.utc_ms);
        fixes.insert(index, Fix { speed_mps, ..fix });
    }

    /// The one nearest to a time of day, if it is near.
    pub(crate) fn nearest(&self, utc_ms: i64) -> Option<Fix> {
        let fixes = self.lock();
        let index = fixes.partition_point(|fix| fix.utc_ms <= utc_ms);
        let around = [index.checked_sub(1).and_then(|index| fixes.get(index)), fixes.get(index)];
        let away = |fix: &Fix| fix.utc_ms.abs_diff(utc_ms);
        around.into_iter().flatten().copied().min_by_key(away).filter(|fix| away(fix) <= NEAR_MS)
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<Fix>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Connects to the `gpsd` at `address` and requests its reports.
///
/// # Errors
/// If it cannot be reached.
pub(crate) async fn connect(address: &str) -> io::Result<TcpStream> {
    let mut stream = TcpStream::connect(address).await?;
    stream.write_all(b"?WATCH={\"enable\":true,\"json\":true}\n").await?;
    Ok(stream)
}

/// Takes the fixes that `gpsd` reports, for ever; a connection that is lost is made again.
pub(crate) async fn follow(mut stream: TcpStream, address: String, fixes: Fixes) {
    loop {
        let why = reports(stream, &fixes).await;
        complain(format_args!("warning: gpsd at {address}: {why}; asking again"));
        stream = loop {
            sleep(AGAIN).await;
            if let Ok(stream) = connect(&address).await {
                break stream;
            }
        };
    }
}

/// Takes reports until there are no more; says why.
async fn reports(stream: TcpStream, fixes: &Fixes) -> String {
    let mut reader = tokio::io::BufReader::new(stream);
    let mut line = Vec::new();
    loop {
        line.clear();
        match (&mut reader).take(LINE).read_until(b'\n', &mut line).await {
            Ok(0) => return "it closed the connection".to_owned(),
            Ok(_) if line.last() != Some(&b'\n') => {
                return "a report of more than 64 KiB".to_owned();
            }
            Ok(_) => {
                if let Some(fix) = report(&line) {
                    fixes.add(fix);
                }
            }
            Err(error) => return plain(&error),
        }
    }
}

/// The fix in one of `gpsd`'s reports, if it is one.
fn report(line: &[u8]) -> Option<Fix> {
    #[derive(Deserialize)]
    struct Report {
        class: String,
        time: Option<String>,
        lat: Option<f64>,
        lon: Option<f64>,
        speed: Option<f64>,
    }
    let report: Report = serde_json::from_slice(line).ok()?;
    let time = report.time.filter(|_| report.class == "TPV")?;
    let time = humantime::parse_rfc3339_weak(&time).ok()?;
    let utc_ms = time.duration_since(std::time::UNIX_EPOCH).ok()?.as_millis();
    Some(Fix {
        utc_ms: i64::try_from(utc_ms).ok()?,
        lat: report.lat?,
        lon: report.lon?,
        speed_mps: report.speed,
    })
}

/// Takes the fixes of an NMEA file, and those that are written to it from now on.
///
/// # Errors
/// If there is no such file. A later error is reported and ends the reading.
pub(crate) fn read(path: &Path, fixes: Fixes) -> io::Result<()> {
    path.metadata()?;
    let path = path.to_owned();
    // A device or a pipe may take as long as it likes to say something.
    thread::Builder::new().name("nmea".to_owned()).spawn(move || {
        if let Err(error) = sentences(&path, &fixes) {
            complain(format_args!("warning: {}: {}", path.display(), plain(&error)));
        }
    })?;
    Ok(())
}

fn sentences(path: &PathBuf, fixes: &Fixes) -> io::Result<()> {
    let mut reader = BufReader::new(File::open(path)?);
    let mut line = Vec::new();
    loop {
        let room = LINE.saturating_sub(line.len() as u64);
        let read = (&mut reader).take(room).read_until(b'\n', &mut line)?;
        if line.last() == Some(&b'\n') || line.len() as u64 >= LINE {
            if let Some(fix) = str::from_utf8(&line).ok().and_then(sentence) {
                fixes.add(fix);
            }
            line.clear();
        } else if read == 0 {
            thread::sleep(AGAIN);
        }
    }
}

/// The fix in an NMEA sentence, if it is an RMC with date, time and place.
fn sentence(line: &str) -> Option<Fix> {
    let ParseResult::RMC(rmc) = nmea::parse_str(line.trim()).ok()? else { return None };
    let utc_ms = rmc.fix_date?.and_time(rmc.fix_time?).and_utc().timestamp_millis();
    let speed_mps = rmc.speed_over_ground.map(|knots| f64::from(knots) * KNOT);
    Some(Fix { utc_ms, lat: rmc.lat?, lon: rmc.lon?, speed_mps })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_of_gpsd_with_time_and_place_is_a_fix() {
        let line = br#"{"class":"TPV","device":"/dev/x","mode":3,"time":"2026-05-04T12:00:01.250Z",
            "lat":42.28,"lon":-83.74,"speed":13.5}"#;
        let expected =
            Fix { utc_ms: 1_777_896_001_250, lat: 42.28, lon: -83.74, speed_mps: Some(13.5) };
        assert_eq!(report(line), Some(expected));
        for other in [
            &br#"{"class":"SKY","time":"2026-05-04T12:00:01.250Z","lat":1,"lon":1}"#[..],
            br#"{"class":"TPV","mode":1}"#,
            br#"{"class":"TPV","time":"yesterday","lat":1,"lon":1}"#,
            b"gibberish\n",
        ] {
            assert_eq!(report(other), None);
        }
    }

    #[test]
    fn an_rmc_sentence_is_a_fix() {
        let fix =
            sentence("$GPRMC,225446.33,A,4916.45,N,12311.12,W,000.5,054.7,191194,020.3,E,A*2B\r\n");
        let fix = fix.expect("a fix");
        assert_eq!(fix.utc_ms, 785_285_686_330);
        assert!((fix.lat - 49.274_166).abs() < 1e-5 && (fix.lon + 123.185_333).abs() < 1e-5);
        assert!((fix.speed_mps.unwrap() - 0.257).abs() < 1e-3);
        for other in ["$GPRMC,225446.33,V,,,,,,,191194,,,N*5C", "$GPGGA,1", "", "$GPRMC,x*00"] {
            assert_eq!(sentence(other), None, "{other}");
        }
    }

    #[test]
    fn the_nearest_fix_counts_if_it_is_near() {
        let fixes = Fixes::default();
        let fix = |utc_ms| Fix { utc_ms, lat: 1.0, lon: 2.0, speed_mps: None };
        // Reports may overtake each other.
        for utc_ms in [1000, 3000, 2000] {
            fixes.add(fix(utc_ms));
        }
        for (at, expected) in [
            (-1001, None),
            (-1000, Some(1000)),
            (1499, Some(1000)),
            (1501, Some(2000)),
            (5000, Some(3000)),
            (5001, None),
        ] {
            assert_eq!(fixes.nearest(at).map(|fix| fix.utc_ms), expected, "{at}");
        }
        fixes.add(Fix { lat: 91.0, ..fix(9000) });
        fixes.add(Fix { lon: f64::NAN, ..fix(9000) });
        assert_eq!(fixes.nearest(9000), None);
    }

    /// Waits for one; where it never comes, that fails.
    async fn near(fixes: &Fixes, utc_ms: i64) -> Fix {
        let found = async {
            loop {
                match fixes.nearest(utc_ms) {
                    Some(fix) => break fix,
                    None => sleep(Duration::from_millis(5)).await,
                }
            }
        };
        tokio::time::timeout(Duration::from_secs(60), found).await.unwrap()
    }

    #[tokio::test]
    async fn gpsd_is_connected_to_again_and_a_report_without_end_is_left() {
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let fixes = Fixes::default();
        let stream = connect(&address).await.unwrap();
        let following = tokio::spawn(follow(stream, address, fixes.clone()));
        for second in 0..3_i64 {
            let (mut stream, _) = listener.accept().await.unwrap();
            let time = 1_777_896_000_000 + 10_000 * second;
            let since = Duration::from_millis(time.cast_unsigned());
            let since = humantime::format_rfc3339_millis(std::time::UNIX_EPOCH + since);
            let fix = format!("{{\"class\":\"TPV\",\"time\":\"{since}\",\"lat\":1,\"lon\":2}}\n");
            stream.write_all(fix.as_bytes()).await.unwrap();
            near(&fixes, time).await;
            if second % 2 == 1 {
                // It stays connected, so that only the length can end this.
                stream.write_all(&vec![b' '; usize::try_from(LINE).unwrap()]).await.unwrap();
                std::mem::forget(stream);
            }
        }
        following.abort();
    }

    #[tokio::test]
    async fn sentences_are_taken_as_a_file_grows_and_one_without_end_is_left() {
        use std::io::Write as _;

        let mut file = tempfile::NamedTempFile::new().unwrap();
        let fixes = Fixes::default();
        read(file.path(), fixes.clone()).unwrap();
        assert!(read(Path::new("/no/such/file"), fixes.clone()).is_err());
        let sentence =
            "$GPRMC,225446.33,A,4916.45,N,12311.12,W,000.5,054.7,191194,020.3,E,A*2B\r\n";
        let (one, rest) = sentence.split_at(30);
        file.write_all(&vec![b'x'; usize::try_from(LINE).unwrap()]).unwrap();
        file.write_all(one.as_bytes()).unwrap();
        file.flush().unwrap();
        // Longer than it waits where nothing comes.
        sleep(AGAIN + AGAIN / 2).await;
        file.write_all(rest.as_bytes()).unwrap();
        file.flush().unwrap();
        assert_eq!(near(&fixes, 785_285_686_330).await.utc_ms, 785_285_686_330);
    }

    #[test]
    fn only_so_many_fixes_are_remembered() {
        let fixes = Fixes::default();
        for utc_ms in (0..).take(FIXES + 3) {
            fixes.add(Fix { utc_ms: utc_ms * 1000, lat: 0.0, lon: 0.0, speed_mps: None });
        }
        let remembered = fixes.lock().len();
        assert_eq!((remembered, fixes.nearest(0)), (FIXES, None));
    }
}
