//! Writes the fuzz targets' seeds from the corpus: `cargo run -p fuseline-tests --example seeds`.
//!
//! Existing seeds stay, findings included, unless a new one has the same name.

use std::collections::HashSet;
use std::fs;
use std::io::{self, Write};
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;
use fuseline_testkit::{Coverage, Mark, Run};
use fuseline_tests::fuzz::{self, Edit, EditKind};
use fuseline_traces::corpus::{CASES, Example};
use fuseline_traces::{LINE, Rule};

const SEEDS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../fuzz/seeds");

fn main() -> io::Result<()> {
    let run = |case: &Example| {
        (case.name, Run::read(case.name, case.trace.as_bytes()).expect("the corpus can be read"))
    };
    let runs: Vec<(&str, Run)> = CASES.iter().map(run).collect();
    for (name, run) in &runs {
        write("step", name, &fuzz::bytes_of(run))?;
    }
    for (name, bytes) in edited(&runs) {
        write("judge", &name, &bytes)?;
    }
    for (name, bytes) in files()? {
        write("trace_parse", name, &bytes)?;
    }
    Ok(())
}

fn write(target: &str, name: &str, bytes: &[u8]) -> io::Result<()> {
    let folder = Path::new(SEEDS).join(target);
    fs::create_dir_all(&folder)?;
    fs::write(folder.join(name), bytes)
}

/// Returns edited traces. Each breaks a rule by an edit that did not break it before, or reaches
/// more.
fn edited(runs: &[(&str, Run)]) -> Vec<(String, Vec<u8>)> {
    let (mut all, mut broken) = (Coverage::default(), HashSet::new());
    let mut seeds = Vec::new();
    for (name, run) in runs {
        for edit in edits() {
            let bytes = [edit.bytes(), fuzz::bytes_of(run)].concat();
            let mut reach = Coverage::default();
            fuzz::judge(&bytes, &mut reach).expect("core and judge agree");
            let reached: Vec<Mark> =
                fuzz::marks_of_judge().into_iter().filter(|mark| reach.has(*mark)).collect();
            let rule = Rule::ALL.into_iter().find(|rule| reach.has(Mark::Violation(*rule)));
            let more = reached.iter().filter(|mark| all.mark(**mark)).count();
            if broken.insert((edit.op as u8, rule)) || more > 0 {
                seeds.push((format!("{name}-{:?}-{}", edit.op, edit.index).to_lowercase(), bytes));
            }
        }
    }
    seeds
}

/// Returns each edit at each of the first indices, which changes one field by one.
fn edits() -> impl Iterator<Item = Edit> {
    let words = (0..6).map(|word| std::array::from_fn(|other| i8::from(other == word)));
    let words: Vec<[i8; 6]> = words.collect();
    EditKind::ALL.into_iter().flat_map(move |op| {
        let words = words.clone();
        (0..12).flat_map(move |index| {
            let changes =
                if op == EditKind::Rewrite || op == EditKind::Insert { words.len() } else { 1 };
            words.clone().into_iter().take(changes).map(move |by| Edit { op, index, by })
        })
    })
}

/// Returns what the corpus lacks: files that are not traces, unusual files that are, and every
/// line.
fn files() -> io::Result<Vec<(&'static str, Vec<u8>)>> {
    let header = "{\"fuseline\":1,\"window\":1,\"clouds\":[]}\n";
    let tick = "{\"ev\":\"tick\",\"at\":1}\n";
    let with = |line: &str| format!("{header}{line}").into_bytes();
    let odd = concat!(
        r#"{ "x":{"a":[1e3,null,"\u00e9"],"a":0} , "at":"#,
        "\t",
        r#"18446744073709551615,"ev":"ti\u0063k"}"#,
        "\n"
    );
    let long = format!("{header}{}\n", " ".repeat(LINE + 1));
    let whole = gzip(&with(tick))?;
    let broken: Vec<u8> = whole[..whole.len() - 9].to_vec();
    let header_of_all = concat!(
        r#"{"clouds":[{"x":[],"name":"a\"\n\ud83d\ude97","limit":3,"p":65535,"resume":1},"#,
        r#"{"p":1,"limit":18446744073709551615}],"commit":"patient","operator":"é","#,
        r#""window":1024,"fuseline":1}"#,
        "\n"
    );
    let annotated = concat!(
        r#"{"fuseline":1,"window":1,"clouds":[{"p":1,"limit":1,"max_age":3}]}"#,
        "\n",
        r#"{"ev":"open","at":9,"t":7,"within":50,"age":3,"origin":"camera/\u0066ront","seq":41}"#,
        "\n",
        r#"{"ev":"result","at":12,"t":7,"p":0,"of":6}"#,
        "\n",
        r#"{"ev":"emit","at":12,"t":7,"p":0,"of":6}"#,
        "\n"
    );
    Ok(vec![
        ("annotated", annotated.into()),
        (
            "attempt-in-a-strict-trace",
            with("{\"ev\":\"fail\",\"at\":1,\"t\":1,\"p\":1,\"try\":0}\n"),
        ),
        ("blank-line", with("\n")),
        ("byte-order-mark", format!("\u{feff}{header}").into_bytes()),
        (
            "clouds-alike",
            header.replace("[]", "[{\"p\":1,\"limit\":1},{\"p\":1,\"limit\":1}]").into(),
        ),
        ("crlf", header.replace('\n', "\r\n").into()),
        (
            "deep",
            with(&format!(
                "{{\"ev\":\"tick\",\"at\":1,\"x\":{}1{}}}\n",
                "[".repeat(300),
                "]".repeat(300)
            )),
        ),
        ("empty", Vec::new()),
        ("float", with("{\"ev\":\"tick\",\"at\":1.0}\n")),
        ("gzip", whole),
        ("gzip-broken", broken),
        ("gzip-line-too-long", gzip(long.as_bytes())?),
        ("header-of-all", header_of_all.into()),
        ("header-twice", with(header)),
        ("invalid-utf-8", [header.as_bytes(), b"{\"ev\":\"\xff\"}\n"].concat()),
        ("key-of-another-event", with("{\"ev\":\"tick\",\"at\":1,\"t\":1}\n")),
        ("key-twice", with("{\"ev\":\"tick\",\"at\":1,\"at\":1}\n")),
        ("key-unknown", with("{\"ev\":\"tick\",\"at\":1,\"y\":1}\n")),
        ("no-header", tick.into()),
        ("null", with("{\"ev\":\"open\",\"at\":1,\"t\":1,\"deadline\":null}\n")),
        ("number-too-great", with("{\"ev\":\"tick\",\"at\":18446744073709551616}\n")),
        ("odd-tick", with(odd)),
        (
            "resume-not-below-limit",
            header.replace("[]", "[{\"p\":1,\"limit\":1,\"resume\":1}]").into(),
        ),
        ("seq-without-origin", with("{\"ev\":\"open\",\"at\":1,\"t\":1,\"seq\":1}\n")),
        ("unterminated", with(tick.trim_end())),
        ("window-0", header.replace("\"window\":1", "\"window\":0").into()),
    ])
}

fn gzip(bytes: &[u8]) -> io::Result<Vec<u8>> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes)?;
    encoder.finish()
}
