//! Reports the table and the other findings.

use std::fmt::Debug;
use std::iter;

use crate::report::{Cell, Report};
use crate::traffic_jam::cells::{self, Colour};
use crate::traffic_jam::narrow::{
    ConstantMisses, Constants, Interval, MEDIAN, ON_BOARD, OnBoardCells,
};
use crate::traffic_jam::{ExtraResults, TrafficJamResult};

/// Explains the mark of a cell.
const HARDER: &str = "\
    A star means that ours hits harder than local alone. Local alone does not stop there either, \
    so ours gave the cloud as long as it might still stop. The cloud's result came too late, and \
    the brakes bit later than local's. The guard keeps each stop of local, not the speed of an \
    impact; --deadline expected weighs that too.";

pub(crate) fn reports(result: &TrafficJamResult) -> Vec<Report> {
    let mut reports = vec![table(result)];
    if let Some(beside) = &result.beside {
        match &beside.narrow {
            Some(intervals) => reports.push(narrow(intervals)),
            None => reports[0].notes.push(
                "With these parameters some of the paper's 90 cells do not come out.".to_owned(),
            ),
        }
        reports.extend([constants(&beside.constants), on_board(beside)]);
    }
    reports
}

fn table(result: &TrafficJamResult) -> Report {
    let TrafficJamResult { cells, phases, parameters, .. } = result;
    let mut columns = Vec::from(["m/s", "approach", "deadline"].map(Cell::from));
    columns.extend(parameters.response.iter().map(|response| format!("{response} s").into()));
    columns.push("paper".into());
    let rows = cells.chunk_by(|one, next| (one.speed, one.approach) == (next.speed, next.approach));
    let rows = rows.map(|row| {
        let mut line =
            vec![row[0].speed.into(), word(row[0].approach).into(), deadline(row).into()];
        line.extend(row.iter().map(|cell| shown(cell, result.is_harder(cell))));
        let marks = row.iter().map(|cell| match cell.paper {
            None => '?',
            Some(Colour::Avoids) => '·',
            Some(Colour::Collides | Colour::Mixed) => 'x',
        });
        let is_as_in_paper = row.iter().all(cells::Cell::is_as_in_paper);
        line.push(Cell::rated(
            is_as_in_paper,
            marks.collect::<String>() + if is_as_in_paper { "" } else { "≠" },
        ));
        line
    });
    let mut notes = vec![format!(
        "Each cell covers {phases} places of the obstacle between two frames that local takes. If \
        the vehicle always stops, a cell has the least gap that is left, in m. If it collides, a \
        cell has x and the greatest speed at impact, in m/s, or ~ if it collides at some places \
        only. The columns are responses of the cloud; local alone does not depend on them. The \
        paper's cells: · avoids, x collides, ? is not in its table; ≠ if some differ from ours."
    )];
    if cells.iter().any(|cell| result.is_harder(cell)) {
        notes.push(HARDER.to_owned());
    }
    let (same, known) = result.agreement();
    notes.push(format!("{same} of the {known} cells that are in the paper's table are as there."));
    if same == known && known > 0 {
        notes.push(
            "Fitted: --deceleration, --brake-delay, --range-local, --range-cloud were chosen so. \
            Still, one choice of them reproduces all of these cells."
                .to_owned(),
        );
    }
    Report { title: None, columns, rows: rows.collect(), notes }
}

/// Returns a cell of the table.
fn shown(cell: &cells::Cell, is_harder: bool) -> Cell {
    let gap = cell.gap.map_or(0.0, |[least, _]| least);
    let impact = cell.impact.map_or(0.0, |[_, greatest]| greatest);
    let text = match cell.outcome {
        Colour::Avoids => format!("{gap:.1} m"),
        Colour::Collides if is_harder => format!("x{impact:.1}*"),
        Colour::Mixed if is_harder => format!("~{impact:.1}*"),
        Colour::Collides => format!("x {impact:.1}"),
        Colour::Mixed => format!("~ {impact:.1}"),
    };
    Cell::rated(cell.outcome == Colour::Avoids, text)
}

/// Returns the deadline of a row, or `varies` if its cells have different ones.
fn deadline(row: &[cells::Cell]) -> String {
    match row[0].deadline {
        first if row.iter().any(|cell| cell.deadline != first) => "varies".to_owned(),
        Some(deadline) => format!("{deadline:.4} s"),
        None => "–".to_owned(),
    }
}

fn narrow(intervals: &[Interval]) -> Report {
    let rows = intervals.iter().map(|interval| {
        let Interval { parameter, value, least, greatest } = interval;
        let name = format!("--{}", parameter.replace('_', "-"));
        let ends = [least, greatest].map(|end| Cell::from(format!("{end:.4}")));
        iter::once(name.into()).chain(ends).chain([(*value).into()]).collect()
    });
    Report {
        title: Some(
            "How narrow that is: each parameter alone may change this far while all 90 cells stay."
                .to_owned(),
        ),
        columns: ["option", "least", "greatest", "now"].map(Cell::from).into(),
        rows: rows.collect(),
        notes: Vec::new(),
    }
}

fn constants(Constants { some, best }: &Constants) -> Report {
    let line = |name: &str, of: &dyn Fn(&ConstantMisses) -> Cell| {
        iter::once(name.into()).chain(some.iter().map(of)).collect()
    };
    Report {
        title: Some("A constant deadline misses some of the paper's 30 cells of ours:".to_owned()),
        columns: line("deadline", &|one| format!("{} s", one.deadline).into()),
        rows: vec![line("cells missed", &|one| one.misses.into())],
        notes: vec![format!(
            "The best constant from 0.01 to 4.49 s is {} s. It misses {}.",
            best.deadline, best.misses
        )],
    }
}

fn on_board(beside: &ExtraResults) -> Report {
    let line = |name: &str, of: &dyn Fn(&OnBoardCells) -> Cell| {
        iter::once(name.into()).chain(beside.on_board.iter().map(of)).collect()
    };
    let ends = |outcome| Cell::rated(outcome == Colour::Avoids, word(outcome));
    let note = match beside.only_cloud {
        Some(only) => format!(
            "The paper's figure, where R101 on board (pipelined) collides and the cloud at its \
            median of {MEDIAN:.4} s avoids, comes out from {:.1} to {:.1} m/s.",
            only.above, only.up_to
        ),
        None => format!(
            "At no speed does R101 on board collide where the cloud at {MEDIAN:.4} s avoids."
        ),
    };
    Report {
        title: Some(format!(
            "What the paper does not say: the cloud's model, R101, on board ({ON_BOARD} s)."
        )),
        columns: line("R101", &|row| format!("{} m/s", row.speed).into()),
        rows: vec![
            line("on board, pipelined", &|row| ends(row.pipelined)),
            line("on board, one frame at a time", &|row| ends(row.serial)),
            line("in the cloud at 0.5 s", &|row| ends(row.cloud)),
        ],
        notes: vec![note],
    }
}

/// Returns the word of an approach or an outcome.
fn word(of: impl Debug) -> String {
    format!("{of:?}").to_lowercase()
}
