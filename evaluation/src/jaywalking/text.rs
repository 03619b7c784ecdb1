//! Formats the runs and the greatest speeds as text.

use std::fmt::Write;

use crate::jaywalking::JaywalkingResult;
use crate::jaywalking::geometry::Manoeuvre;
use crate::jaywalking::planning::PlanCallOutcome;
use crate::paint::{BAD, GOOD, paint, written};
use crate::paper::PAPER;

pub(crate) fn text(result: &JaywalkingResult) -> String {
    written(|text| {
        runs(text, result)?;
        greatest(text, result)?;
        hypotheses(text, result)
    })
}

/// Writes the events that may happen, and whether their plans are ready.
fn hypotheses(text: &mut String, result: &JaywalkingResult) -> std::fmt::Result {
    let Some(mean) = result.mean_response else { return Ok(()) };
    writeln!(
        text,
        "\nIf something else happens, and the plans are requested the likeliest first:"
    )?;
    writeln!(
        text,
        "  {:<24}{:>12}{:>12}{:>10}",
        "hypothesis", "probability", "plan used", "response"
    )?;
    for row in &result.hypotheses {
        let plan = if row.cached { "cached" } else { "on board" };
        let response = format!("{:.3} s", row.response);
        writeln!(text, "  {:<24}{:>12}{plan:>12}{response:>10}", row.name, row.probability)?;
    }
    writeln!(text, "The mean response by probability is {mean:.3} s.")
}

fn runs(text: &mut String, result: &JaywalkingResult) -> std::fmt::Result {
    writeln!(
        text,
        "{:>4}  {:<26}{:<9}{:>9}  {:<8}{:<8}the paper",
        "m/s", "the cloud's plan", "plan used", "response", "swerve", "brake"
    )?;
    writeln!(text, "{}", "─".repeat(78))?;
    for pair in result.runs.chunks(2) {
        let [swerve, brake] = pair else { continue };
        let plan = if swerve.cached { "cached" } else { "on board" };
        let printed = if swerve.cached {
            &PAPER.jaywalking.collides.cached_contingency
        } else {
            &PAPER.jaywalking.collides.local_planner
        };
        let paper = match swerve.cloud {
            PlanCallOutcome::Unasked | PlanCallOutcome::InTime => word(*printed),
            PlanCallOutcome::Late
            | PlanCallOutcome::Expired
            | PlanCallOutcome::OtherHypothesis
            | PlanCallOutcome::Silent => "–".to_owned(),
        };
        writeln!(
            text,
            "{:>4}  {:<26}{:<9}{:>9}  {}{}{paper}",
            swerve.speed,
            became(swerve.cloud),
            plan,
            format!("{:.3} s", swerve.response),
            padded(swerve.collides),
            padded(brake.collides)
        )?;
    }
    writeln!(text, "\nThe paper's car swerves; x: it hits the person.\n")
}

const fn became(cloud: PlanCallOutcome) -> &'static str {
    match cloud {
        PlanCallOutcome::Unasked => "not asked for",
        PlanCallOutcome::InTime => "in time, valid, matches",
        PlanCallOutcome::Late => "after its deadline",
        PlanCallOutcome::Expired => "in time, expired",
        PlanCallOutcome::OtherHypothesis => "in time, for another case",
        PlanCallOutcome::Silent => "never comes",
    }
}

fn word(collides: bool) -> String {
    if collides { paint(BAD, "x hits") } else { paint(GOOD, "avoids") }
}

/// Pads the word here, because a format width would count the codes of its colour.
fn padded(collides: bool) -> String {
    word(collides) + "  "
}

fn greatest(text: &mut String, result: &JaywalkingResult) -> std::fmt::Result {
    writeln!(text, "The greatest speed up to which nobody is touched, in m/s:")?;
    writeln!(text, "  {:>10}{:>10}{:>10}", "response", "swerve", "brake")?;
    let shown = |speed: Option<f64>| speed.map_or("any".to_owned(), |speed| format!("{speed:.2}"));
    for row in &result.greatest {
        let (swerve, brake) = (shown(row.swerve), shown(row.brake));
        writeln!(text, "  {:>10}{swerve:>10}{brake:>10}", format!("{} s", row.response))?;
    }
    let (swerve, brake) = (Manoeuvre::Swerve, Manoeuvre::Brake);
    let only = |manoeuvre: Manoeuvre| {
        let of = |index: usize| {
            let row = result.greatest.get(index)?;
            if manoeuvre == Manoeuvre::Swerve { row.swerve } else { row.brake }
        };
        let (board, cached) = (of(0)?, of(result.greatest.len().checked_sub(1)?)?);
        (board < cached).then(|| format!("above {board:.2} up to {cached:.2} m/s"))
    };
    for (manoeuvre, verb) in [(swerve, "swerving"), (brake, "braking")] {
        if let Some(range) = only(manoeuvre) {
            writeln!(text, "By {verb}, only the cached plan avoids {range}.")?;
        }
    }
    Ok(())
}
