//! Reports when the cloud is first.

use crate::arbitrage::{ArbitrageResult, ArbitrageRow};
use crate::report::{Cell, Report};

pub(crate) fn reports(result: &ArbitrageResult) -> Vec<Report> {
    let row = |row: &ArbitrageRow| {
        let ms = |at: f64| format!("{at:.1}");
        let after = |at: f64| Cell::rated(at < row.on_board, ms(at));
        vec![
            row.model.as_str().into(),
            ms(row.on_board).into(),
            ms(row.in_cloud).into(),
            format!("{:.2}×", row.speedup).into(),
            ms(row.break_even).into(),
            after(row.at_p50),
            after(row.at_p90),
            after(row.at_p99),
            format!("{:.1} %", row.first * 100.0).into(),
        ]
    };
    let columns = ["ms", "board", "cloud", "speedup", "even", "p50", "p90", "p99", "first"];
    let [least, greatest] = result.human_reaction;
    let note = format!(
        "Even: the round trip at which both are equally fast. p50 to p99: the cloud's runtime plus \
        the paper's round trip. First: the share of {} recorded networks, by time, for which the \
        cloud is first. Humans react in {least:.0} to {greatest:.0} ms.",
        result.drives.len()
    );
    vec![Report {
        title: None,
        columns: columns.map(Cell::from).into(),
        rows: result.rows.iter().map(row).collect(),
        notes: vec![note],
    }]
}
