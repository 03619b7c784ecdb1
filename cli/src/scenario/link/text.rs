//! Shares and gains, for people.

use std::fmt::Write;

use crate::scenario::link::{DeadlineRule, LinkResult, LinkRow, Remedy};
use crate::scenario::paint::{BAD, GOOD, SOFT, paint, written};

const NAME: usize = 24;
const CELL: usize = 7;

pub(crate) fn text(result: &LinkResult) -> String {
    written(|text| {
        writeln!(
            text,
            "Messages that are answered by the cloud in time, in %, by the uplink in Mbit/s"
        )?;
        table(text, result, "deadline", DeadlineRule::Constant, |row| row.by_cloud * 100.0)?;
        writeln!(
            text,
            "Mean time from a message to its output, in ms, nothing done about the link"
        )?;
        responses(text, result)?;
        shared(text, result)
    })
}

/// The rows' uplinks, in their order.
pub(crate) fn uplinks(result: &LinkResult) -> Vec<f64> {
    let mut uplinks: Vec<f64> = Vec::new();
    for row in &result.rows {
        if !uplinks.contains(&row.uplink_mbps) {
            uplinks.push(row.uplink_mbps);
        }
    }
    uplinks
}

fn head(text: &mut String, title: &str, result: &LinkResult) -> std::fmt::Result {
    write!(text, "{title:<NAME$}")?;
    let uplinks = uplinks(result);
    for uplink in &uplinks {
        write!(text, "{uplink:>CELL$}")?;
    }
    writeln!(text, "\n{}", "─".repeat(NAME + CELL * uplinks.len()))
}

/// A line for each size, rate and remedy.
fn table(
    text: &mut String,
    result: &LinkResult,
    title: &str,
    rule: DeadlineRule,
    of: fn(&LinkRow) -> f64,
) -> std::fmt::Result {
    head(text, title, result)?;
    let rows: Vec<&LinkRow> = result.rows.iter().filter(|row| row.policy == rule).collect();
    let mut lines: Vec<(f64, f64, Remedy)> = Vec::new();
    for row in &rows {
        let line = (row.request_kb, row.rate, row.remedy);
        if !lines.contains(&line) {
            lines.push(line);
        }
    }
    lines.sort_by(|a, b| (a.0, a.1).partial_cmp(&(b.0, b.1)).unwrap_or(std::cmp::Ordering::Equal));
    let mut before = None;
    for (kb, rate, remedy) in lines {
        if before.replace((kb, rate)) != Some((kb, rate)) {
            writeln!(text, "{}", paint(SOFT, &format!("{kb} KB at {rate} Hz")))?;
        }
        let width = NAME - 2;
        write!(text, "  {remedy:<width$}")?;
        for row in
            rows.iter().filter(|row| (row.request_kb, row.rate, row.remedy) == (kb, rate, remedy))
        {
            cell(text, of(row))?;
        }
        writeln!(text)?;
    }
    writeln!(text)
}

fn cell(text: &mut String, figure: f64) -> std::fmt::Result {
    let cell = format!("{figure:>CELL$.0}");
    let is_all = figure > 99.5;
    let is_none = figure < 0.5;
    text.write_str(&match (is_all, is_none) {
        (true, _) => paint(GOOD, &cell),
        (_, true) => paint(BAD, &cell),
        _ => cell,
    })
}

/// What waiting costs: a constant deadline beside the expected one.
fn responses(text: &mut String, result: &LinkResult) -> std::fmt::Result {
    head(text, "", result)?;
    let rows: Vec<&LinkRow> = result.rows.iter().filter(|row| row.remedy == Remedy::None).collect();
    let mut lines: Vec<(f64, f64)> = Vec::new();
    for row in &rows {
        let line = (row.request_kb, row.rate);
        if !lines.contains(&line) {
            lines.push(line);
        }
    }
    lines.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    for (kb, rate) in lines {
        for (rule, name) in
            [(DeadlineRule::Constant, "constant"), (DeadlineRule::Expected, "expected")]
        {
            write!(text, "{:<NAME$}", format!("{kb} KB, {rate} Hz, {name}"))?;
            let of =
                |row: &&&LinkRow| row.policy == rule && (row.request_kb, row.rate) == (kb, rate);
            for row in rows.iter().filter(of) {
                write!(text, "{:>CELL$.0}", row.mean_response * 1e3)?;
            }
            writeln!(text)?;
        }
    }
    writeln!(text)
}

fn shared(text: &mut String, result: &LinkResult) -> std::fmt::Result {
    writeln!(text, "Three operators on one uplink: points of AP over local, mean of all outputs")?;
    head(text, "33.3 KB, 300 KB, 1 MB", result)?;
    let mut remedies: Vec<Remedy> = Vec::new();
    for row in &result.shared {
        if !remedies.contains(&row.remedy) {
            remedies.push(row.remedy);
        }
    }
    for remedy in remedies {
        write!(text, "{remedy:<NAME$}")?;
        for row in result.shared.iter().filter(|row| row.remedy == remedy) {
            write!(text, "{:>CELL$.2}", row.gain)?;
        }
        writeln!(text)?;
    }
    writeln!(
        text,
        "\nThe most that can be gained is 4.57. A call that is given up leaves the gate, while\n\
         its bytes still wait for the link: a gate of rate times deadline never shuts."
    )
}
