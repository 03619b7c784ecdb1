//! `fuseline run`, run in a directory of its own, and its report.

use std::path::Path;
use std::process::Output;

use serde_json::Value;

use super::{err, fuseline, out};

/// Runs it in a directory of its own.
pub(crate) fn run_in(directory: &Path, args: &[&str]) -> Output {
    fuseline(&[&["run"], args].concat()).current_dir(directory).output().unwrap()
}

/// Returns the report that `--json` printed.
pub(crate) fn report(output: &Output) -> Value {
    assert_eq!(out(output).lines().count(), 1, "{}{}", out(output), err(output));
    serde_json::from_str(out(output)).unwrap()
}

/// Returns the sum of these counts.
pub(crate) fn sum<'a>(counts: impl IntoIterator<Item = &'a Value>) -> u64 {
    counts.into_iter().map(|count| count.as_u64().unwrap()).sum()
}

/// Checks that the outcomes of messages and requests add up.
pub(crate) fn adds_up(report: &Value) {
    let messages = report["messages"].as_u64().unwrap();
    let sources = report["sources"].as_array().unwrap();
    let forwarded = sum(sources.iter().map(|source| &source["forwarded"]));
    let ends = [&report["missed"], &report["refused"], &report["open"]];
    assert_eq!(forwarded + sum(ends), messages, "{report}");
    for source in sources {
        let fates = source["requests"].as_object().unwrap();
        let refused = report["refused"].as_u64().unwrap();
        // Each message taken on was offered once to each cloud, and given to local.
        assert_eq!(sum(fates.values()), messages - refused, "{source}");
        assert_eq!(fates["forwarded"], source["forwarded"]);
    }
    // Fusion, progressive, local and each cloud alone, who is first; and the constant, where that
    // is another.
    let constant = usize::from(report["policy"] != "constant");
    assert_eq!(
        report["policies"].as_array().unwrap().len(),
        sources.len() + 3 + constant,
        "{report}"
    );
}
