//! The table and what else is found, for people.

use std::fmt::Write;

use crate::scenario::approach::Approach;
use crate::scenario::paint::{BAD, GOOD, SOFT, paint};
use crate::scenario::traffic_jam::cells::{Cell, Colour};
use crate::scenario::traffic_jam::narrow::OnBoard;
use crate::scenario::traffic_jam::{Beside, Found};

/// How wide a cell is.
const CELL: usize = 10;

/// The words for it all.
pub(crate) fn told(found: &Found) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    let _ = table(&mut text, found);
    let _ = beside(&mut text, found);
    text
}

fn table(text: &mut String, found: &Found) -> std::fmt::Result {
    let Found { responses, cells, phases, .. } = found;
    write!(text, "{:>5}  {:<8}{:>10}  ", "m/s", "approach", "deadline")?;
    for response in responses {
        write!(text, "{:>CELL$}", format!("{response} s"))?;
    }
    writeln!(text, "   the paper's")?;
    writeln!(text, "{}", "─".repeat(29 + CELL * responses.len() + 13))?;
    for row in cells.chunk_by(|one, next| (one.speed, one.approach) == (next.speed, next.approach))
    {
        let [first, ..] = row else { continue };
        let word = format!("{:?}", first.approach).to_lowercase();
        let is_new = first.approach == found.approaches[0];
        let speed = if is_new { format!("{}", first.speed) } else { String::new() };
        let deadline = deadline(row);
        write!(text, "{speed:>5}  {word:<8}{deadline:>10}  ")?;
        for cell in row {
            let (what, colour) = shown(cell);
            text.push_str(&paint(colour, &format!("{what:>CELL$}")));
        }
        text.push_str("   ");
        for cell in row {
            let (mark, colour) = match cell.paper {
                None => ("?", SOFT),
                Some(Colour::Avoids) => ("·", GOOD),
                Some(Colour::Collides | Colour::Mixed) => ("x", BAD),
            };
            text.push_str(&paint(colour, mark));
        }
        let differ = row.iter().filter(|cell| !cell.is_as_in_paper()).count();
        writeln!(
            text,
            "{}",
            if differ > 0 { format!("  {differ} differ") } else { String::new() }
        )?;
    }
    writeln!(
        text,
        "\nMetres that are left at least where the vehicle stops, and m/s at impact at most (x) where it does not,\n\
         over {phases} places of the obstacle between two frames; ~ where some collide. The cloud's response stands\n\
         above; it is nothing to local. The paper's cells: · avoids, x collides, ? not in its table."
    )
}

/// What stands in a cell.
fn shown(cell: &Cell) -> (String, anstyle::Style) {
    let gap = cell.gap.map_or(0.0, |[least, _]| least);
    let impact = cell.impact.map_or(0.0, |[_, greatest]| greatest);
    match cell.outcome {
        Colour::Avoids => (format!("{gap:.1} m"), GOOD),
        Colour::Collides => (format!("x {impact:.1}"), BAD),
        Colour::Mixed => (format!("~ {impact:.1}"), BAD),
    }
}

/// The deadline of a row, if it is one.
fn deadline(row: &[Cell]) -> String {
    let first = row.first().and_then(|cell| cell.deadline);
    let is_one = row.iter().all(|cell| cell.deadline == first);
    match first {
        Some(_) if !is_one => "varies".to_owned(),
        Some(deadline) => format!("{deadline:.4} s"),
        None => "–".to_owned(),
    }
}

fn beside(text: &mut String, found: &Found) -> std::fmt::Result {
    let (same, known) = found.agreement();
    let colour = if same == known { GOOD } else { BAD };
    let sum = paint(colour, &format!("{same} of the {known} cells"));
    writeln!(text, "\n{sum} that stand in the paper's table are as there.")?;
    let Some(beside) = &found.beside else { return Ok(()) };
    writeln!(text)?;
    match &beside.narrow {
        Some(intervals) => {
            writeln!(
                text,
                "How narrow that is: each parameter alone may lie, so that all 90 cells stay,"
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
                "With these parameters not all of the paper's 90 cells are reproduced."
            )?;
        }
    }
    let constants = beside.constants.some.iter();
    let each: Vec<String> =
        constants.map(|one| format!("{} s: {}", one.deadline, one.misses)).collect();
    writeln!(
        text,
        "\nA constant deadline misses so many of the paper's 30 cells of ours: {}.\n\
         Of all from 0.01 to 4.49 s the best, {} s, misses {}.",
        each.join(", "),
        beside.constants.best.deadline,
        beside.constants.best.misses
    )?;
    on_board(text, beside)
}

/// A row's name, and what it tells.
type Of = (&'static str, fn(&OnBoard) -> Colour);

fn on_board(text: &mut String, beside: &Beside) -> std::fmt::Result {
    let mark = |colour: Colour| match colour {
        Colour::Avoids => paint(GOOD, "·"),
        Colour::Mixed => paint(BAD, "~"),
        Colour::Collides => paint(BAD, "x"),
    };
    writeln!(text, "\nWhat the paper does not tell: the cloud's model, R101, on board (0.4077 s)")?;
    write!(text, "  {:<34}", "m/s")?;
    for row in &beside.on_board {
        write!(text, "{:>4}", row.speed)?;
    }
    let rows: [Of; 3] = [
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
    writeln!(text)?;
    match beside.only_cloud {
        Some(only) => writeln!(
            text,
            "The paper's picture, where R101 on board (pipelined) hits and the cloud at its median of 0.1862 s\n\
             avoids, is found from {:.1} to {:.1} m/s.",
            only.above, only.up_to
        ),
        None => {
            writeln!(text, "At no speed does R101 on board hit what the cloud at 0.1862 s avoids.")
        }
    }
}

/// The approach, for people.
pub(crate) const fn word(approach: Approach) -> &'static str {
    match approach {
        Approach::Local => "local",
        Approach::Cloud => "cloud",
        Approach::First => "first",
        Approach::Ours => "ours",
    }
}
