//! Rows of CSV, and the lines that errors name, of every command that reads them; drawn traces as
//! rows and objects.

use std::collections::BTreeMap;
use std::fs;
use std::time::{Duration, UNIX_EPOCH};

use crate::common::drawn::DrawnTrace;
use crate::common::{err, out, run};
use fuseline_testkit::Rng;
use serde_json::{Value, json};

/// Returns what each command says of a file whose row at line 5 is wrong, after an empty line.
fn complaints(end: &str) -> Vec<String> {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, rows: &[&str]| {
        let path = dir.path().join(name);
        fs::write(&path, rows.join(end)).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let events = write("events.csv", &["at,ev,t", "0,open,1", "", "1,open,2", "x,open,3"]);
    let header = write("header.jsonl", &["{\"fuseline\":1,\"window\":4,\"clouds\":[]}\n"]);
    let drive = write("drive.csv", &["sent_ms,rtt_ms", "0,10", "", "100,10", "200,x"]);
    let probed = write("probed.csv", &["sent_ms,rtt_ms", "0,10", "", "100,10", "200,-7"]);
    let short = write("short.csv", &["sent_ms,rtt_ms", "0,10", "", "100,10", "200"]);
    let calls = write("calls.csv", &["response_s,answered", "0.1,1", "", "0.2,1", "0.3,2"]);
    let plots = dir.path().join("plots");
    let cloud = |drive: &str| format!("name=a,priority=1,model=DINO-SWIN-Small,drive={drive}");
    let clouds = [cloud(&drive), cloud(&short)];
    let trace = dir.path().join("trace.jsonl");
    let trace = trace.to_str().unwrap();
    let calls_of = [
        vec!["convert", "--header", &header, &events],
        vec!["run", "--for", "1s", "--trace", trace, "--cloud", &clouds[0]],
        vec!["run", "--for", "1s", "--trace", trace, "--cloud", &clouds[1]],
        vec!["deadline", "--speed", "10", "--calls", &calls],
        vec!["probe", "--plot", &probed, "-o", plots.to_str().unwrap()],
        vec!["probe", "--plot", &short, "-o", plots.to_str().unwrap()],
    ];
    let first_error = |args: Vec<&str>| {
        let done = run(&args, "");
        assert_eq!(done.status.code(), Some(2), "{args:?}");
        err(&done).replace(dir.path().to_str().unwrap(), "")
    };
    calls_of.into_iter().map(first_error).collect()
}

#[test]
fn an_error_names_the_line_of_its_row_whatever_ends_the_lines() {
    for end in ["\n", "\r\n"] {
        let complaints = complaints(end);
        let files = ["events", "drive", "short", "calls", "probed", "short"];
        for (complaint, file) in complaints.iter().zip(files) {
            assert!(complaint.contains(&format!("/{file}.csv:5: ")), "{complaint}");
            assert_eq!(complaint.lines().count(), 1, "{complaint}");
        }
    }
}

/// The keys of events that a file may have, and whether each is a time.
const KEYS: [(&str, bool); 15] = [
    ("seq", false),
    ("origin", false),
    ("age", true),
    ("within", true),
    ("try", false),
    ("of", false),
    ("for", false),
    ("why", false),
    ("backlog", false),
    ("deadline", true),
    ("due", true),
    ("p", false),
    ("t", false),
    ("ev", false),
    ("at", true),
];
const UNITS: [(&str, usize); 4] = [("ns", 0), ("us", 3), ("ms", 6), ("s", 9)];

/// States how a file calls keys and events and writes times.
struct DrawnFormat {
    rng: Rng,
    names: BTreeMap<&'static str, String>,
    events: BTreeMap<String, String>,
    /// The units of all times, and of deadlines.
    units: [(&'static str, usize); 2],
    /// The sources with names.
    sources: BTreeMap<u64, String>,
    separator: char,
}

impl DrawnFormat {
    /// Names are within `outer` or have a blank.
    fn draw(number: u64, trace: &DrawnTrace, outer: &str) -> Self {
        let mut rng = Rng::with_seed(number);
        // Keys that mean something else in many logs are read only where they are named, and what
        // is named must occur.
        let is_named = |key: &str| {
            ["seq", "origin", "age", "within", "try", "of", "for", "why"].contains(&key)
        };
        let text = trace.text();
        let occurs = |key: &str| text.contains(&format!("\"{key}\":"));
        let names =
            KEYS.iter().filter(|(key, _)| occurs(key) && (is_named(key) || rng.u64(0..2) == 0));
        let names = names.map(|(key, _)| (*key, format!("{outer}{key}"))).collect();
        let mut events = BTreeMap::new();
        for ev in ["open", "request", "result", "emit", "final"] {
            if rng.u64(0..2) == 0 {
                events.insert(ev.to_owned(), format!("has {ev}"));
            }
        }
        let clouds = trace.header.clouds.iter();
        let clouds = clouds.filter_map(|cloud| Some((u64::from(cloud.p), cloud.name.clone()?)));
        let sources = clouds.chain([(0, "local".to_owned())]).collect();
        let units = [(); 2].map(|()| UNITS[rng.index(UNITS.len())]);
        let separator = [',', ';', '\t'][rng.index(3)];
        Self { rng, names, events, units, sources, separator }
    }

    fn name<'a>(&'a self, key: &'a str) -> &'a str {
        self.names.get(key).map_or(key, String::as_str)
    }

    /// The options that say so.
    fn options(&self) -> Vec<String> {
        let mut options = Vec::new();
        let mut add = |option: &str, values: Vec<String>| {
            options.extend([option.to_owned(), values.join(",")]);
        };
        if !self.names.is_empty() {
            add("--column", self.names.iter().map(|(key, name)| format!("{key}={name}")).collect());
        }
        let events = self.events.iter().map(|(ev, name)| format!("{name}={ev}"));
        add("--event", events.chain(["heartbeat=".to_owned()]).collect());
        let [all, deadline] = self.units.map(|(unit, _)| unit);
        add("--unit", vec![all.to_owned(), format!("deadline={deadline}")]);
        let separator = if self.separator == '\t' { "tab" } else { &self.separator.to_string() };
        add("--separator", vec![separator.to_owned()]);
        options
    }

    /// Returns what a file has for a key's value.
    fn text(&mut self, key: &str, value: &Value) -> String {
        let number = value.as_u64();
        match key {
            "ev" => {
                let ev = value.as_str().unwrap();
                self.events.get(ev).cloned().unwrap_or_else(|| ev.to_owned())
            }
            "p" if self.rng.u64(0..2) == 0 => {
                let name = self.sources.get(&number.unwrap()).cloned();
                name.unwrap_or_else(|| value.to_string())
            }
            _ if KEYS.contains(&(key, true)) => self.time(key, number.unwrap()),
            _ => value.as_str().map_or_else(|| value.to_string(), ToOwned::to_owned),
        }
    }

    /// A time in the key's unit, with one of its own, or as a time of day.
    fn time(&mut self, key: &str, nanos: u64) -> String {
        let [(_, all), (_, deadline)] = self.units;
        match self.rng.u64(0..4) {
            0 => {
                let (unit, digits) = UNITS[self.rng.index(UNITS.len())];
                decimal(nanos, digits) + unit
            }
            1 if matches!(key, "at" | "due") => {
                let at = UNIX_EPOCH + Duration::from_nanos(nanos);
                humantime::format_rfc3339_nanos(at).to_string()
            }
            _ => decimal(nanos, if key == "deadline" { deadline } else { all }),
        }
    }

    fn csv(&mut self, lines: &[BTreeMap<String, Value>]) -> String {
        let names = KEYS.iter().map(|(key, _)| self.name(key).to_owned());
        let mut rows = vec![names.collect::<Vec<_>>()];
        for line in lines {
            let cell = |(key, _): &(&str, bool)| {
                line.get(*key).map_or_else(String::new, |value| self.text(key, value))
            };
            rows.push(KEYS.iter().map(cell).collect());
        }
        let quoted = |cell: &String| format!("\"{}\"", cell.replace('"', "\"\""));
        let separator = self.separator.to_string();
        let rows =
            rows.iter().map(|row| row.iter().map(quoted).collect::<Vec<_>>().join(&separator));
        rows.collect::<Vec<_>>().join("\n") + "\n"
    }

    fn json(&mut self, lines: &[BTreeMap<String, Value>]) -> String {
        let mut text = String::new();
        for line in lines {
            let mut object = json!({});
            for (key, value) in line {
                let is_time = KEYS.contains(&(key.as_str(), true));
                let value = if is_time && self.rng.u64(0..3) == 0 {
                    let nanos = value.as_u64().unwrap();
                    let part = ["nanosec", "nsec"][self.rng.index(2)];
                    json!({"sec": nanos / 1_000_000_000, part: nanos % 1_000_000_000})
                } else if is_time || key == "p" || value.is_string() {
                    json!(self.text(key, value))
                } else {
                    value.clone()
                };
                let place =
                    self.name(key).split('.').fold(&mut object, |within, key| &mut within[key]);
                *place = value;
            }
            text.extend([format!("{object}\n\n")]);
        }
        text
    }
}

fn decimal(nanos: u64, digits: usize) -> String {
    let unit = 10_u64.pow(u32::try_from(digits).unwrap());
    if digits == 0 {
        nanos.to_string()
    } else {
        format!("{}.{:0digits$}", nanos / unit, nanos % unit)
    }
}

/// D10: whatever a file calls keys, events and sources, and in whatever units its times are.
#[test]
fn a_trace_written_as_rows_or_objects_is_converted_back() {
    let dir = tempfile::tempdir().unwrap();
    for number in 0..12 {
        let mut trace = DrawnTrace::draw(number);
        for (_, annotations) in &mut trace.events {
            // A list has no place in a cell.
            annotations.missing.clear();
        }
        let text = trace.text();
        let mut lines: Vec<BTreeMap<String, Value>> =
            text.lines().skip(1).map(|line| serde_json::from_str(line).unwrap()).collect();
        lines.insert(
            lines.len() / 2,
            [("ev", json!("heartbeat")), ("at", json!(1))]
                .map(|(key, value)| (key.to_owned(), value))
                .into(),
        );
        let header = dir.path().join("header.jsonl");
        fs::write(&header, text.lines().next().unwrap().to_owned() + "\n").unwrap();
        for (name, outer) in [("events.csv", "the "), ("events.jsonl", "a.within.")] {
            let mut format = DrawnFormat::draw(number, &trace, outer);
            let written =
                if name.ends_with("csv") { format.csv(&lines) } else { format.json(&lines) };
            let file = dir.path().join(name);
            fs::write(&file, &written).unwrap();
            let options = format.options();
            let options: Vec<&str> = options.iter().map(String::as_str).collect();
            let paths = [&header, &file].map(|path| path.to_str().unwrap());
            let args = [&["convert", "--header", paths[0], paths[1]], &options[..]].concat();
            let converted = run(&args, "");
            assert_eq!(err(&converted), "", "{options:?}");
            assert_eq!(out(&converted), text, "{options:?}: {written}");
        }
    }
}

/// D10: each cell is an event, those of one row in the order of what they are, and all in that of
/// their instants.
#[test]
fn frames_have_an_event_for_each_cell() {
    let dir = tempfile::tempdir().unwrap();
    let [header, file] = ["header.jsonl", "frames.csv"].map(|name| dir.path().join(name));
    let clouds = r#"[{"p":7,"name":"west","limit":31},{"p":2,"limit":31}]"#;
    let first =
        format!("{{\"fuseline\":1,\"window\":16,\"commit\":\"eager\",\"clouds\":{clouds}}}");
    fs::write(&header, first.clone() + "\n").unwrap();
    for number in 0..12 {
        let mut rng = Rng::with_seed(number);
        // In no order: the parts decide.
        let mut columns = ["open", "emit", "by", "miss", "local.result", "local.fail"]
            .map(ToOwned::to_owned)
            .to_vec();
        for cloud in ["west", "2"] {
            columns.extend(["request", "result", "fail"].map(|what| format!("{cloud}.{what}")));
        }
        columns.push("west.deadline".to_owned());
        let has_t = rng.u64(0..2) == 0;
        columns.extend(has_t.then(|| "t".to_owned()));
        for last in (1..columns.len()).rev() {
            columns.swap(last, rng.index(last + 1));
        }
        let frame: Vec<String> =
            columns.iter().map(|column| format!("{column}={column} of it")).collect();
        let frame = frame.join(",") + ",2.deadline=40us";
        let mut rows =
            columns.iter().map(|column| format!("{column} of it")).collect::<Vec<_>>().join(",");
        let mut events: Vec<(u64, String)> = Vec::new();
        for row in 0..rng.u64(1..9) {
            let t = if has_t { 3 * row + 5 } else { row };
            let mut cells = BTreeMap::new();
            for column in &columns {
                let time = (rng.u64(0..3) > 0).then(|| rng.u64(0..100));
                let cell = match column.as_str() {
                    "t" => Some(t.to_string()),
                    "by" => Some(["west", "local", "2", "7"][rng.index(4)].to_owned()),
                    "west.deadline" => Some(rng.u64(0..100).to_string()),
                    _ => time.map(|at| at.to_string()),
                };
                cells.extend(cell.map(|cell| (column.as_str(), cell)));
            }
            let line =
                columns.iter().map(|column| cells.get(&**column).cloned().unwrap_or_default());
            rows.extend([format!("\n{}", line.collect::<Vec<_>>().join(","))]);
            let order = ["open", "request", "result", "fail", "emit", "miss"];
            events.extend(order.iter().flat_map(|part| events_of(t, part, &columns, &cells)));
        }
        events.sort_by_key(|(at, _)| *at);
        fs::write(&file, rows + "\n").unwrap();
        let paths = [&header, &file].map(|path| path.to_str().unwrap());
        let args = ["convert", "--header", paths[0], "--unit", "us", "--frame", &frame, paths[1]];
        let converted = run(&args, "");
        let expected = events.into_iter().map(|(_, line)| line + "\n").collect::<String>();
        assert_eq!(out(&converted), first.clone() + "\n" + &expected, "{}", err(&converted));
    }
}

/// The events of one kind in a row, in the order of their columns.
fn events_of(
    t: u64,
    part: &str,
    columns: &[String],
    cells: &BTreeMap<&str, String>,
) -> Vec<(u64, String)> {
    let micros = |text: &String| text.parse::<u64>().unwrap() * 1000;
    let of_part = columns.iter().filter(|it| it.split('.').next_back() == Some(part));
    let events = of_part.filter_map(|column| {
        let at = micros(cells.get(&**column)?);
        let p = match column.split('.').next()? {
            "west" => 7,
            "2" => 2,
            _ => 0,
        };
        let by = match cells["by"].as_str() {
            "local" => 0,
            "2" => 2,
            _ => 7,
        };
        let deadline = if p == 7 { micros(&cells["west.deadline"]) } else { 40_000 };
        let rest = match part {
            "open" | "miss" => String::new(),
            "emit" => format!(",\"p\":{by}"),
            "request" => format!(",\"p\":{p},\"due\":{}", at + deadline),
            _ => format!(",\"p\":{p}"),
        };
        Some((at, format!("{{\"ev\":\"{part}\",\"at\":{at},\"t\":{t}{rest}}}")))
    });
    events.collect()
}
