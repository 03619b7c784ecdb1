//! Reports the runs, the greatest speeds, and the hypotheses.

use crate::jaywalking::JaywalkingResult;
use crate::jaywalking::planning::PlanCallOutcome;
use crate::paper::PAPER;
use crate::report::{Cell, Report};

pub(crate) fn reports(result: &JaywalkingResult) -> Vec<Report> {
    let mut reports = vec![runs(result), greatest(result)];
    reports.extend(result.mean_response.map(|mean| hypotheses(result, mean)));
    reports
}

fn runs(result: &JaywalkingResult) -> Report {
    let word = |collides: bool| Cell::rated(!collides, if collides { "hits" } else { "avoids" });
    let printed = &PAPER.jaywalking.collides;
    let mut rows = Vec::new();
    for pair in result.runs.chunks(2) {
        let [swerve, brake] = pair else { continue };
        let (plan, paper) = if swerve.cached {
            ("cached", printed.cached_contingency)
        } else {
            ("on board", printed.local_planner)
        };
        let (cloud, is_in_paper) = match swerve.cloud {
            PlanCallOutcome::Unasked => ("not asked for", true),
            PlanCallOutcome::InTime => ("in time, valid, matches", true),
            PlanCallOutcome::Late => ("after its deadline", false),
            PlanCallOutcome::Expired => ("in time, expired", false),
            PlanCallOutcome::OtherHypothesis => ("in time, for another case", false),
            PlanCallOutcome::Silent => ("never comes", false),
        };
        rows.push(vec![
            cloud.into(),
            swerve.speed.into(),
            plan.into(),
            format!("{:.3} s", swerve.response).into(),
            word(swerve.collides),
            word(brake.collides),
            if is_in_paper { word(paper) } else { "–".into() },
        ]);
    }
    let columns =
        ["the cloud's plan", "m/s", "plan used", "response", "swerve", "brake", "the paper"];
    Report {
        title: None,
        columns: columns.map(Cell::from).into(),
        rows,
        notes: vec!["The paper's car swerves.".to_owned()],
    }
}

fn greatest(result: &JaywalkingResult) -> Report {
    let shown = |speed: Option<f64>| speed.map_or("any".to_owned(), |speed| format!("{speed:.2}"));
    let rows = result.greatest.iter().map(|row| {
        vec![
            format!("{} s", row.response).into(),
            shown(row.swerve).into(),
            shown(row.brake).into(),
        ]
    });
    let ends = result.greatest.first().zip(result.greatest.last());
    let note = |verb: &str, board: Option<f64>, cached: Option<f64>| {
        let (board, cached) = board.zip(cached).filter(|(board, cached)| board < cached)?;
        let range = format!("above {board:.2} up to {cached:.2} m/s");
        Some(format!("By {verb}, only the cached plan avoids {range}."))
    };
    let notes = ends.map(|(board, cached)| {
        [note("swerving", board.swerve, cached.swerve), note("braking", board.brake, cached.brake)]
    });
    Report {
        title: Some("The greatest speed up to which nobody is touched, in m/s:".to_owned()),
        columns: ["response", "swerve", "brake"].map(Cell::from).into(),
        rows: rows.collect(),
        notes: notes.into_iter().flatten().flatten().collect(),
    }
}

/// Reports the events that may happen, and whether their plans are ready.
fn hypotheses(result: &JaywalkingResult, mean: f64) -> Report {
    let rows = result.hypotheses.iter().map(|row| {
        let plan = if row.cached { "cached" } else { "on board" };
        let response = format!("{:.3} s", row.response);
        vec![row.name.as_str().into(), row.probability.into(), plan.into(), response.into()]
    });
    Report {
        title: Some(
            "If something else happens, and the plans are requested the likeliest first:"
                .to_owned(),
        ),
        columns: ["hypothesis", "probability", "plan used", "response"].map(Cell::from).into(),
        rows: rows.collect(),
        notes: vec![format!("The mean response by probability is {mean:.3} s.")],
    }
}
