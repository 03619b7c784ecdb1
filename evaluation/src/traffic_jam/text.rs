//! Formats the table and the other findings as text.

use std::fmt::Write;

use crate::approach::Approach;
use crate::paint::{BAD, GOOD, SOFT, paint, written};
use crate::traffic_jam::cells::{Cell, Colour};
use crate::traffic_jam::narrow::{ConstantMisses, Constants, MEDIAN, ON_BOARD, OnBoardCells};
use crate::traffic_jam::{ExtraResults, TrafficJamResult};

/// The width of a cell.
const CELL: usize = 7;

/// Explains the mark of a cell.
const HARDER: &str = "\
* Ours hits harder than local alone. Local alone does not stop there either, so
  ours gave the cloud as long as it might still stop; its result came too late,
  and the brakes bit later than local's. The guard keeps each stop of local, not
  the speed of an impact; --deadline expected weighs that too.";

pub(crate) fn text(result: &TrafficJamResult) -> String {
    written(|text| {
        table(text, result)?;
        beside(text, result)
    })
}

fn table(text: &mut String, result: &TrafficJamResult) -> std::fmt::Result {
    let TrafficJamResult { cells, phases, parameters, .. } = result;
    let responses = &parameters.response;
    write!(text, "{:>4}  {:<8} {:>8} ", "m/s", "approach", "deadline")?;
    for response in responses {
        write!(text, "{:>CELL$}", format!("{response} s"))?;
    }
    writeln!(text, "  the paper")?;
    writeln!(text, "{}", "─".repeat(24 + CELL * responses.len() + 11))?;
    for row in cells.chunk_by(|one, next| (one.speed, one.approach) == (next.speed, next.approach))
    {
        let [first, ..] = row else { continue };
        let is_new = first.approach == parameters.approach[0];
        let speed = if is_new { format!("{}", first.speed) } else { String::new() };
        let (word, deadline) = (word(first.approach), deadline(row));
        write!(text, "{speed:>4}  {word:<8} {deadline:>8} ")?;
        for cell in row {
            let (mut label, colour) = shown(cell);
            if result.is_harder(cell) {
                label = label.replace(' ', "") + "*";
            }
            text.push_str(&paint(colour, &format!("{label:>CELL$}")));
        }
        text.push_str("  ");
        for cell in row {
            let (mark, colour) = match cell.paper {
                None => ("?", SOFT),
                Some(Colour::Avoids) => ("·", GOOD),
                Some(Colour::Collides | Colour::Mixed) => ("x", BAD),
            };
            text.push_str(&paint(colour, mark));
        }
        let differ = row.iter().filter(|cell| !cell.is_as_in_paper()).count();
        writeln!(text, "{}", if differ > 0 { format!(" {differ} differ") } else { String::new() })?;
    }
    writeln!(
        text,
        "\nA cell covers {phases} places of the obstacle between two frames that local takes.\n\
         If the vehicle stops at all: the least gap that is left, in m. If it collides:\n\
         x and the greatest speed at impact, in m/s; ~ if it collides at some only.\n\
         The columns are responses of the cloud; local alone does not depend on them.\n\
         The paper: · avoids, x collides, ? not in its table."
    )?;
    if cells.iter().any(|cell| result.is_harder(cell)) {
        writeln!(text, "{HARDER}")?;
    }
    Ok(())
}

/// Returns the text of a cell.
fn shown(cell: &Cell) -> (String, anstyle::Style) {
    let gap = cell.gap.map_or(0.0, |[least, _]| least);
    let impact = cell.impact.map_or(0.0, |[_, greatest]| greatest);
    match cell.outcome {
        Colour::Avoids => (format!("{gap:.1} m"), GOOD),
        Colour::Collides => (format!("x {impact:.1}"), BAD),
        Colour::Mixed => (format!("~ {impact:.1}"), BAD),
    }
}

/// Returns the deadline of a row, or `varies` if its cells have different ones.
fn deadline(row: &[Cell]) -> String {
    let first = row.first().and_then(|cell| cell.deadline);
    let is_one = row.iter().all(|cell| cell.deadline == first);
    match first {
        Some(_) if !is_one => "varies".to_owned(),
        Some(deadline) => format!("{deadline:.4} s"),
        None => "–".to_owned(),
    }
}

fn beside(text: &mut String, result: &TrafficJamResult) -> std::fmt::Result {
    let (same, known) = result.agreement();
    let colour = if same == known { GOOD } else { BAD };
    let sum = paint(colour, &format!("{same} of the {known} cells"));
    writeln!(text, "\n{sum} that are in the paper's table are as there.")?;
    if same == known && known > 0 {
        writeln!(
            text,
            "Fitted: --deceleration, --brake-delay, --range-local, --range-cloud were chosen\n\
            so. What remains is that one choice of them serves all of these cells."
        )?;
    }
    let Some(beside) = &result.beside else { return Ok(()) };
    match &beside.narrow {
        Some(intervals) => {
            writeln!(
                text,
                "\nHow narrow that is: each parameter alone may change this far while all 90 \
                 cells stay:"
            )?;
            for interval in intervals {
                let name = format!("--{}", interval.parameter.replace('_', "-"));
                writeln!(
                    text,
                    "  {name:<18} {:>8.4} to {:<8.4}  now {}",
                    interval.least, interval.greatest, interval.value
                )?;
            }
        }
        None => {
            writeln!(
                text,
                "\nWith these parameters some of the paper's 90 cells do not come out."
            )?;
        }
    }
    let Constants { some, best } = &beside.constants;
    writeln!(text, "\nA constant deadline misses some of the paper's 30 cells of ours:")?;
    for (name, of) in [
        (
            "deadline, s",
            (|one: &ConstantMisses| one.deadline.to_string()) as fn(&ConstantMisses) -> String,
        ),
        ("cells missed", |one| one.misses.to_string()),
    ] {
        write!(text, "  {name:<14}")?;
        for one in some {
            write!(text, "{:>8}", of(one))?;
        }
        writeln!(text)?;
    }
    writeln!(
        text,
        "The best of all from 0.01 to 4.49 s, {} s, misses {}.",
        best.deadline, best.misses
    )?;
    on_board(text, beside)
}

/// A row's name, and what it shows.
type TextRow = (&'static str, fn(&OnBoardCells) -> Colour);

fn on_board(text: &mut String, beside: &ExtraResults) -> std::fmt::Result {
    let mark = |colour: Colour| match colour {
        Colour::Avoids => paint(GOOD, "·"),
        Colour::Mixed => paint(BAD, "~"),
        Colour::Collides => paint(BAD, "x"),
    };
    writeln!(
        text,
        "\nWhat the paper does not say: the cloud's model, R101, on board ({ON_BOARD} s)"
    )?;
    write!(text, "  {:<34}", "m/s")?;
    for row in &beside.on_board {
        write!(text, "{:>4}", row.speed)?;
    }
    let rows: [TextRow; 3] = [
        ("on board, pipelined", |row| row.pipelined),
        ("on board, one frame at a time", |row| row.serial),
        ("in the cloud at 0.5 s", |row| row.cloud),
    ];
    for (name, of) in rows {
        write!(text, "\n  {name:<34}")?;
        for row in &beside.on_board {
            write!(text, "   {}", mark(of(row)))?;
        }
    }
    writeln!(text, "\n  · avoids, x collides, ~ collides at some places of the obstacle only")?;
    let median = format!("{MEDIAN:.4} s");
    match beside.only_cloud {
        Some(only) => writeln!(
            text,
            "The paper's figure, where R101 on board (pipelined) collides and the cloud at its\n\
             median of {median} avoids, comes out from {:.1} to {:.1} m/s.",
            only.above, only.up_to
        ),
        None => writeln!(
            text,
            "At no speed does R101 on board collide where the cloud at {median} avoids."
        ),
    }
}

pub(crate) const fn word(approach: Approach) -> &'static str {
    match approach {
        Approach::Local => "local",
        Approach::Cloud => "cloud",
        Approach::First => "first",
        Approach::Ours => "ours",
    }
}
