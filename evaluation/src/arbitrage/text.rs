//! Formats the table as text.

use std::fmt::Write;

use crate::arbitrage::ArbitrageResult;
use crate::paint::{BAD, GOOD, paint, written};

pub(crate) fn text(result: &ArbitrageResult) -> String {
    written(|text| {
        writeln!(
            text,
            "{:<20}{:>8}{:>8}{:>9}{:>8}{:>8}{:>8}{:>8}{:>8}",
            "ms", "board", "cloud", "speedup", "even at", "p50", "p90", "p99", "first"
        )?;
        writeln!(text, "{}", "─".repeat(85))?;
        for row in &result.rows {
            write!(
                text,
                "{:<20}{:>8.1}{:>8.1}{:>9}{:>8.1}",
                row.model,
                row.on_board,
                row.in_cloud,
                format!("{:.2}×", row.speedup),
                row.break_even
            )?;
            for at in [row.at_p50, row.at_p90, row.at_p99] {
                let cell = format!("{at:>8.1}");
                text.push_str(&paint(if at < row.on_board { GOOD } else { BAD }, &cell));
            }
            writeln!(text, "{:>8}", format!("{:.1} %", row.first * 100.0))?;
        }
        let [least, greatest] = result.human_reaction;
        writeln!(
            text,
            "\nEven at: the round trip at which both are equally fast. p50 to p99: the cloud's\n\
             runtime plus the paper's round trip. First: the share of {} recorded networks, by\n\
             time, for which the cloud is first. Humans react in {least:.0} to {greatest:.0} ms.",
            result.drives.len()
        )
    })
}
