//! SARIF 2.1.0.

use std::collections::BTreeMap;
use std::io::{self, Write};

use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};
use serde_json::{Value, json};

use crate::results::{Level, Problem, Subject, rules};

/// The characters of a path that are percent-encoded in a URI.
const PATH: &AsciiSet =
    &NON_ALPHANUMERIC.remove(b'/').remove(b'-').remove(b'_').remove(b'.').remove(b'~');

pub(super) fn write(judged: &[Subject], out: &mut dyn Write) -> io::Result<()> {
    let rules = rules(judged);
    let places: BTreeMap<&str, usize> = rules.keys().copied().zip(0..).collect();
    let problems = judged.iter().flat_map(|judged| &judged.problems);
    let unread: Vec<Value> = judged.iter().filter_map(notification).collect();
    let log = json!({
        "$schema": "https://json.schemastore.org/sarif-2.1.0.json",
        "version": "2.1.0",
        "runs": [{
            "tool": { "driver": {
                "name": "fuseline",
                "semanticVersion": env!("CARGO_PKG_VERSION"),
                "rules": rules.iter().map(rule).collect::<Vec<_>>(),
            } },
            "invocations": [{
                "executionSuccessful": unread.is_empty(),
                "toolExecutionNotifications": unread,
            }],
            "results": problems.map(|problem| result(problem, &places)).collect::<Vec<_>>(),
        }],
    });
    serde_json::to_writer_pretty(&mut *out, &log)?;
    writeln!(out)
}

fn rule((id, sentence): (&&str, &&str)) -> Value {
    json!({ "id": id, "shortDescription": { "text": sentence } })
}

fn result(problem: &Problem, places: &BTreeMap<&str, usize>) -> Value {
    json!({
        "ruleId": problem.rule.0,
        "ruleIndex": places.get(problem.rule.0),
        "level": match problem.level {
            Level::Violation => "error",
            Level::Doubt => "warning",
            Level::Accepted => "note",
        },
        "message": { "text": problem.text },
        "locations": [location(&problem.file, problem.line)],
    })
}

/// Returns why a trace was not judged.
fn notification(judged: &Subject) -> Option<Value> {
    let why = judged.verdict.as_ref().err()?;
    let locations = [location(&judged.name, None)];
    Some(json!({ "level": "error", "message": { "text": why }, "locations": locations }))
}

fn location(file: &str, line: Option<u64>) -> Value {
    let uri = utf8_percent_encode(file, PATH).to_string();
    let mut physical = json!({ "artifactLocation": { "uri": uri } });
    if let Some(line) = line {
        physical["region"] = json!({ "startLine": line });
    }
    json!({ "physicalLocation": physical })
}
