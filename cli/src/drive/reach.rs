//! Describes what was driven, and what was not, with the option that reaches it.

use std::time::Duration;

use fuseline_testkit::{Coverage, Edge};
use fuseline_traces::Commit;
use indicatif::HumanCount;
use serde::Serialize;

use super::case::Suite;
use super::extent::{DrivenExtent, StepRange};
use crate::duration::in_greatest_unit;

/// A pause, or a step of the clock back, must be at least this long to count as driven, in
/// nanoseconds: an hour.
const HOUR: u64 = 3_600_000_000_000;
/// A gate must be shut for at least this many inputs in a row.
const SHUT: usize = 1_000;
/// A run of more inputs overflows a count of 16 bits.
const COUNTED: usize = 65_536;
/// The advice to reach rare cases names this many times the inputs.
const TIMES: u64 = 10;
/// The advice counts fewer inputs than this as this many.
const LEAST: u64 = 100_000;
const FULL: &str = "a full window of 1,024";

/// Something that was not driven.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
pub(super) struct NotDriven {
    pub(super) what: String,
    /// The option that reaches it.
    pub(super) option: String,
}

/// The limits of driving, by option.
#[derive(Clone, Copy, Debug)]
pub(super) struct DriveLimits {
    /// Generated runs begin while they have fewer inputs.
    pub(super) inputs: u64,
    pub(super) time: Option<Duration>,
    /// `true` if `--run` names the cases.
    pub(super) is_named: bool,
    /// `true` if results say something of their values.
    pub(super) has_values: bool,
}

/// Returns the lines about it, each with its lead.
pub(super) fn lines(extent: &DrivenExtent) -> Vec<(&'static str, String)> {
    let commits: Vec<_> =
        extent.commits.iter().map(|(rule, runs)| format!("{} {rule}", HumanCount(*runs))).collect();
    let runs = format!(
        "{}; up to {} inputs, {} clouds, priorities to {}; {} with the header of the run before",
        commits.join(", "),
        count(extent.inputs),
        extent.clouds,
        extent.priority,
        HumanCount(extent.same_header)
    );
    let range = |name: &str, range: Option<StepRange>| match range {
        Some(StepRange { least, greatest }) => {
            format!("{name} by {} to {}", in_greatest_unit(least), in_greatest_unit(greatest))
        }
        None => format!("never {name}"),
    };
    let clock = format!("{}, {}", range("forward", extent.forward), range("back", extent.back));
    let chains = format!(
        "up to {} results held for one message, up to {} outputs of one",
        extent.held, extent.outputs
    );
    let windows = match (extent.filled.first(), extent.filled.last()) {
        (Some(least), Some(most)) => format!(
            "{} filled, from {least} to {}; up to {} inputs in a row with a shut gate",
            extent.filled.len(),
            count((*most).into()),
            count(extent.shut)
        ),
        _ => "none filled".to_owned(),
    };
    let bits = extent.bits.all().map(|(name, bits)| format!("{name} {bits}"));
    let numbers = format!("bits of {}", bits.join(", "));
    vec![
        ("runs", runs),
        ("clock", clock),
        ("chains", chains),
        ("windows", windows),
        ("numbers", numbers),
    ]
}

/// Returns the part that was not driven, with the option that drives it.
pub(super) fn missing(
    suite: &Suite,
    limits: DriveLimits,
    extent: &DrivenExtent,
    reach: &Coverage,
) -> Vec<NotDriven> {
    let generator = suite.generator;
    let named =
        |what: &str, option: &str| NotDriven { what: what.to_owned(), option: option.to_owned() };
    if limits.is_named {
        return vec![named("all other cases", "leave out --run")];
    }
    let mut missing = Vec::new();
    let more = match limits.inputs {
        u64::MAX => "a greater --for or --cases".to_owned(),
        inputs => format!("--inputs {}", inputs.max(LEAST).saturating_mul(TIMES)),
    };
    let has = |commit: Commit| extent.commits.contains_key(commit.as_str());
    for commit in Commit::ALL.into_iter().filter(|commit| !has(*commit)) {
        let option = if generator.commit.is_some() { "--commit all" } else { &more };
        missing.push(named(&format!("the commit rule {commit}"), option));
    }
    if !limits.has_values {
        missing.push(named("the keys of and for", "--values"));
    }
    let most = usize::from(generator.clouds);
    if most < 15 {
        missing.push(named(&format!("more than {most} clouds"), "--clouds 15"));
    }
    let holds = has(Commit::Eager) || has(Commit::Patient);
    let any = |least: u16, most: u16| extent.filled.range(least..=most).next().is_some();
    let reaches = |range: Option<StepRange>| range.is_some_and(|range| range.greatest >= HOUR);
    let of_volume = [
        (extent.clouds >= most, format!("{most} clouds")),
        (!holds || extent.held >= most, format!("{most} results held for one message")),
        (
            !has(Commit::Progressive) || extent.outputs > most,
            format!("{} outputs of one message", most + 1),
        ),
        (any(65, 1_023), "a full window of 65 to 1,023".to_owned()),
        (any(1_024, 1_024), FULL.to_owned()),
        (reaches(extent.forward), "pauses of an hour".to_owned()),
        (reaches(extent.back), "a clock that goes back by an hour".to_owned()),
        (most == 0 || extent.shut >= SHUT, "1,000 inputs with a shut gate".to_owned()),
        (extent.same_header > 0, "the same header twice in a row".to_owned()),
        (extent.inputs > COUNTED, "runs of more than 65,536 inputs".to_owned()),
    ];
    missing.extend(
        of_volume
            .into_iter()
            .filter(|(is_driven, _)| !is_driven)
            .map(|(_, what)| named(&what, &more)),
    );
    let narrow = extent.bits.all().into_iter().filter(|(_, bits)| *bits < u64::BITS);
    for (name, bits) in narrow.filter(|(name, _)| most > 0 || *name != "limits") {
        missing.push(named(&format!("{name} of more than {bits} bits"), &more));
    }
    // Outcomes of progressive alone, or of no cloud, are named above by their cause.
    if generator.commit.is_none() && most >= 2 {
        let marks = reach.shares().into_iter().flat_map(|share| share.missing);
        let others = marks.filter(|mark| *mark != Edge::GreatestWindowFull.name());
        missing.extend(others.map(|mark| named(&mark, &more)));
    }
    missing
}

fn count(number: usize) -> HumanCount {
    HumanCount(number as u64)
}
