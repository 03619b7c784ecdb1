//! Reports the policies side by side.

use std::iter;

use crate::networks::policy::ResponsePolicy;
use crate::networks::{DriveRow, NetworksResult};
use crate::report::{Cell, Report};

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

pub(crate) fn reports(result: &NetworksResult) -> Vec<Report> {
    let mut collisions = table(result, "collisions, %", percent);
    let mut energy = table(result, "energy, m²/s²", |row| row.energy);
    let parameters = &result.parameters;
    let drives = match parameters.drive.len() {
        1 => "1 recorded drive".to_owned(),
        drives => format!("{drives} recorded drives"),
    };
    energy.notes.push(format!(
        "Means over {drives} of {} starts each. Collisions: how many starts in a hundred end in \
        one. Energy: the mean square of the speed at impact, 0 without one. The cloud's response \
        is its runtime plus the drive's round trip.",
        parameters.starts
    ));
    if parameters.policy.contains(&ResponsePolicy::Local) {
        let mut row = vec!["worse than local".into()];
        row.extend(parameters.policy.iter().map(|policy| match worse(&result.rows, *policy) {
            _ if *policy == ResponsePolicy::Local => "–".into(),
            count => Cell::rated(count == 0, count),
        }));
        collisions.rows.push(row);
        energy.notes.push(format!(
            "Worse than local: the pairs of drive and speed, out of {}, that collide more often \
            than local alone. The paper has no such table: its responses are constant, up to 3 s.",
            parameters.drive.len() * parameters.speed.len()
        ));
    }
    vec![collisions, energy]
}

pub(crate) fn name(policy: ResponsePolicy) -> String {
    match policy {
        ResponsePolicy::Constant(_) => format!("{policy} s"),
        _ => policy.to_string(),
    }
}

/// Reports the means of a figure, speed by speed and for all speeds.
fn table(result: &NetworksResult, title: &str, of: fn(&DriveRow) -> f64) -> Report {
    let policies = &result.parameters.policy;
    let row = |speed: Option<f64>| {
        let name = speed.map_or("mean".to_owned(), |speed| format!("{speed} m/s"));
        let cells = policies.iter().map(|policy| {
            let value = mean(&result.rows, speed, *policy, of);
            let text = format!("{value:.1}");
            if value == 0.0 { Cell::rated(true, text) } else { text.into() }
        });
        iter::once(name.into()).chain(cells).collect()
    };
    let columns =
        iter::once(title.into()).chain(policies.iter().map(|policy| name(*policy).into()));
    let speeds = result.parameters.speed.iter().copied().map(Some).chain([None]);
    Report { columns: columns.collect(), rows: speeds.map(row).collect(), ..Report::default() }
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
