//! Formats the policies side by side as text.

use std::fmt::Write;

use crate::networks::policy::ResponsePolicy;
use crate::networks::{DriveRow, NetworksResult};
use crate::paint::{BAD, GOOD, paint, written};

/// The widths of a name and of a cell.
const NAME: usize = 15;
const CELL: usize = 9;

/// Returns the mean of a figure over the drives' rows, for one speed or for all.
pub(crate) fn mean(
    rows: &[DriveRow],
    speed: Option<f64>,
    policy: ResponsePolicy,
    of: impl Fn(&DriveRow) -> f64,
) -> f64 {
    let is_meant = |row: &&DriveRow| {
        row.policy == policy && speed.is_none_or(|speed| row.speed.total_cmp(&speed).is_eq())
    };
    let (mut sum, mut count) = (0.0, 0.0);
    for row in rows.iter().filter(is_meant) {
        sum += of(row);
        count += 1.0;
    }
    if count > 0.0 { sum / count } else { 0.0 }
}

/// Returns the percentage of starts that collide.
pub(crate) fn percent(row: &DriveRow) -> f64 {
    100.0 * f64::from(row.collisions) / f64::from(row.starts)
}

pub(crate) fn text(result: &NetworksResult) -> String {
    written(|text| {
        table(text, result, "collisions, %", percent)?;
        table(text, result, "energy, m²/s²", |row| row.energy)?;
        beside(text, result)
    })
}

pub(crate) fn name(policy: ResponsePolicy) -> String {
    match policy {
        ResponsePolicy::Constant(_) => format!("{policy} s"),
        _ => policy.to_string(),
    }
}

fn table(
    text: &mut String,
    result: &NetworksResult,
    title: &str,
    of: fn(&DriveRow) -> f64,
) -> std::fmt::Result {
    write!(text, "{title:<NAME$}")?;
    for policy in &result.parameters.policy {
        write!(text, "{:>CELL$}", name(*policy))?;
    }
    writeln!(text, "\n{}", "─".repeat(NAME + CELL * result.parameters.policy.len()))?;
    for speed in &result.parameters.speed {
        write!(text, "{:<NAME$}", format!("{speed} m/s"))?;
        for policy in &result.parameters.policy {
            let value = mean(&result.rows, Some(*speed), *policy, of);
            let cell = format!("{value:>CELL$.1}");
            text.push_str(&if value == 0.0 { paint(GOOD, &cell) } else { cell });
        }
        writeln!(text)?;
    }
    write!(text, "{:<NAME$}", "mean")?;
    for policy in &result.parameters.policy {
        write!(text, "{:>CELL$.1}", mean(&result.rows, None, *policy, of))?;
    }
    writeln!(text, "\n")
}

fn beside(text: &mut String, result: &NetworksResult) -> std::fmt::Result {
    let drives = result.parameters.drive.len();
    writeln!(
        text,
        "Means over {} of {} starts each. Collisions: how many\n\
         starts in a hundred end in one. Energy: the mean square of the speed at impact,\n\
         0 without one. The cloud's response is its runtime plus the drive's round trip.",
        if drives == 1 {
            "1 recorded drive".to_owned()
        } else {
            format!("{drives} recorded drives")
        },
        result.parameters.starts
    )?;
    if !result.parameters.policy.contains(&ResponsePolicy::Local) {
        return Ok(());
    }
    let others = result.parameters.policy.iter().filter(|policy| **policy != ResponsePolicy::Local);
    let worse: Vec<String> = others
        .map(|policy| {
            let count = worse(&result.rows, *policy);
            let word = format!("{} {count}", name(*policy));
            if count == 0 { paint(GOOD, &word) } else { paint(BAD, &word) }
        })
        .collect();
    writeln!(
        text,
        "\nPairs of drive and speed, out of {}, that collide more often than local alone:\n\
         {}.\n\
         The paper has no such table: its responses are constant, up to 3 s.",
        drives * result.parameters.speed.len(),
        worse.join(", ")
    )
}

/// Returns the number of pairs of a drive and a speed in which a policy collides more often than
/// local alone.
pub(crate) fn worse(rows: &[DriveRow], policy: ResponsePolicy) -> usize {
    let local = |row: &DriveRow| {
        let is = |other: &&DriveRow| {
            (other.policy, other.speed, &other.drive)
                == (ResponsePolicy::Local, row.speed, &row.drive)
        };
        rows.iter().find(is).map_or(u32::MAX, |local| local.collisions)
    };
    rows.iter().filter(|row| row.policy == policy && row.collisions > local(row)).count()
}
