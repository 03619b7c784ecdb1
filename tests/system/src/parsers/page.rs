//! The page of a report. Its data come from a trace, and must remain data.

use std::collections::BTreeSet;
use std::io::BufReader;
use std::sync::LazyLock;

use fuseline_report::{JudgeMode, PageWriter};
use fuseline_traces::observed::Slack;
use fuseline_traces::{Events, Header};
use serde_json::Value;

use crate::parsers::{Ends, ParserResult, fit};

pub(super) const ENDS: &[&str] = &["no trace", "judged", "in disorder", "observed"];

/// The greatest number of events of a trace.
const EVENTS: usize = 10_000;
const SLACK: Slack = Slack { tolerance: 1_000, lateness: 1_000_000 };

/// The element that contains the data.
const DATA: &str = r#"<script type="application/json" id="data">"#;

/// The text before and after the data of any page.
static AROUND: LazyLock<(Vec<u8>, Vec<u8>)> = LazyLock::new(|| {
    let mut page = Vec::new();
    PageWriter::default().write(&mut page).expect("memory takes it");
    let begin = find(&page, DATA.as_bytes()).expect("a page has data") + DATA.len();
    let len = find(&page[begin..], b"</script>").expect("the data end");
    (page[..begin].to_vec(), page[begin + len..].to_vec())
});

/// Checks a page. The first line is the file's name, and the trace follows.
pub(super) fn check(bytes: &[u8], ends: &mut Ends) -> ParserResult {
    let end = bytes.iter().position(|byte| *byte == b'\n').unwrap_or(bytes.len());
    let name = String::from_utf8_lossy(&bytes[..end]);
    let trace = bytes.get(end + 1..).unwrap_or_default();
    page(None, &name, trace, ends)?;
    page(Some(SLACK), &name, trace, ends)
}

fn page(mode: JudgeMode, name: &str, trace: &[u8], ends: &mut Ends) -> ParserResult {
    let read = if mode.is_none() { Events::new } else { Events::observed };
    let Ok(mut reader) = read("page".to_owned(), BufReader::new(trace)) else {
        ends.insert("no trace");
        return Ok(());
    };
    let header = reader.header().clone();
    let (mut page, mut count) = (PageWriter::default(), 0);
    let mut sheet = page.begin(mode, name, &header);
    // The trace is read up to its first mistake, as if it ended there.
    while let Ok(Some(event)) = reader.next_event()
        && count < EVENTS
    {
        if let Err(error) = sheet.event(reader.line(), event) {
            ends.insert("in disorder");
            let message = error.to_string();
            // A file's name is shown unchanged, even if it has control characters.
            return fit(message.strip_prefix(name).unwrap_or(&message));
        }
        count += 1;
    }
    let found = sheet.finish();
    ends.insert(if mode.is_none() { "judged" } else { "observed" });
    let mut html = Vec::new();
    page.write(&mut html).map_err(|error| error.to_string())?;
    let reported = embedded(&html)?;
    if reported["conforms"] != found.conforms
        || reported["ev"].as_str().map(str::len) != Some(count)
    {
        return Err(format!("{count} events, {:?} is reported as {reported}", found.conforms));
    }
    names(&reported, name, &header)?;
    whole(&reported, count)
}

/// Returns the only trace in a page's data. Nothing in the data may end their element.
fn embedded(html: &[u8]) -> Result<Value, String> {
    let (before, after) = &*AROUND;
    let data = html.strip_prefix(&before[..]).and_then(|page| page.strip_suffix(&after[..]));
    let data = data.ok_or("what stands around the data is changed by them")?;
    // This character begins everything that ends the element for a browser's parser, or begins a
    // comment in it.
    if data.contains(&b'<') {
        return Err(format!("data that end their element: {}", data.escape_ascii()));
    }
    let mut data: Value = serde_json::from_slice(data).map_err(|error| error.to_string())?;
    Ok(data["traces"][0].take())
}

/// Checks that names are shown unchanged.
fn names(reported: &Value, name: &str, header: &Header) -> ParserResult {
    let sources = reported["sources"].as_array().map(Vec::as_slice).unwrap_or_default();
    let names: BTreeSet<&str> =
        sources.iter().filter_map(|source| source["name"].as_str()).collect();
    let is_there = |name: Option<&str>| name.is_none_or(|name| names.contains(name));
    let are_there = header.clouds.iter().all(|cloud| is_there(cloud.name.as_deref()));
    if reported["file"] != name
        || reported["operator"].as_str() != header.operator.as_deref()
        || !are_there
    {
        return Err(format!("{name:?} with {header:?} is reported as {reported}"));
    }
    Ok(())
}

/// Checks that all columns have the same length.
fn whole(reported: &Value, count: usize) -> ParserResult {
    let len = |key: &str| reported[key].as_array().map(Vec::len);
    let timestamps = len("timestamps");
    let fates = timestamps.zip(len("sources")).map(|(t, sources)| t * sources);
    if [len("at"), len("t"), len("p")] != [Some(count); 3]
        || len("outcome") != timestamps
        || reported["fates"].as_str().map(str::len) != fates
    {
        return Err(format!("the columns do not fit: {reported}"));
    }
    Ok(())
}

fn find(text: &[u8], part: &[u8]) -> Option<usize> {
    text.windows(part.len()).position(|window| window == part)
}
