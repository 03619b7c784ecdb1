//! Draws bars: on board, and in the cloud behind the paper's round trips.

use plotters::prelude::*;

use crate::arbitrage::{ArbitrageResult, ArbitrageRow};
use crate::plot::{Canvas, DRAWN, Plot, TextLine, Theme, canvas, keys_of_shapes};

/// The place at which bars begin, the height of a model's row, and the place of the first row.
const LEFT: i32 = 180;
const HIGH: i32 = 54;
const TOP: i32 = 112;
/// The number of units for a second.
const SECOND: f64 = 390.0;

pub(crate) fn plots(result: &ArbitrageResult) -> Vec<Plot> {
    let (rows, reactions) = (result.rows.clone(), result.human_reaction);
    let caption = "For each of the paper's models the runtime on board, and its round trip and \
                   runtime in the cloud: at the median, with a line to the 90th percentile. The \
                   vertical lines are human reaction times.";
    vec![Plot::new("arbitrage", caption, move |theme| {
        let height = u32::try_from(rows.len()).unwrap_or(0) * 54 + 160;
        let words = (
            "Arbitrage",
            "From an image to its result, in ms; the speedup of the computation beside",
        );
        canvas(theme, (860, height), words, |canvas| {
            let keys = [("on board", 0), ("round trip, median", 2), ("runtime in the cloud", 1)];
            keys_of_shapes(theme, canvas, &keys.map(|(word, i)| (word, theme.series[i].filled())));
            let bottom = TOP + HIGH * i32::try_from(rows.len()).unwrap_or(0);
            for (at, name) in reactions.iter().zip(["fastest human", "slowest human"]) {
                let x = unit(*at);
                let line =
                    PathElement::new(vec![(x, TOP - 8), (x, bottom)], theme.soft.stroke_width(1));
                canvas.draw(&line).expect(DRAWN);
                let word = format!("{name}, {at:.0} ms");
                TextLine::new(12.0, theme.soft).centred().put(canvas, &word, (x, bottom + 16));
            }
            for (place, row) in (0..).zip(&rows) {
                model(theme, canvas, row, TOP + HIGH * place);
            }
        })
    })]
}

fn model(theme: &Theme, canvas: &Canvas<'_>, row: &ArbitrageRow, y: i32) {
    let ink = TextLine::new(13.0, theme.ink);
    ink.right().put(canvas, &row.model, (LEFT - 12, y + 18));
    let bar = |from: f64, to: f64, y: i32, colour: RGBColor| {
        let corners = [(unit(from), y), (unit(to), y + 15)];
        canvas.draw(&Rectangle::new(corners, colour.filled())).expect(DRAWN);
    };
    let median = row.at_p50 - row.in_cloud;
    bar(0.0, row.on_board, y, theme.series[0]);
    bar(0.0, median, y + 18, theme.series[2]);
    bar(median, row.at_p50, y + 18, theme.series[1]);
    let (from, to, middle) = (unit(row.at_p50), unit(row.at_p90), y + 25);
    for ends in [[(from, middle), (to, middle)], [(to, middle - 4), (to, middle + 4)]] {
        canvas.draw(&PathElement::new(ends.to_vec(), theme.ink.stroke_width(1))).expect(DRAWN);
    }
    let soft = TextLine::new(12.0, theme.soft);
    soft.put(canvas, &format!("{:.1}", row.on_board), (unit(row.on_board) + 6, y + 8));
    let words = format!("{:.1}, {:.2}×", row.at_p50, row.speedup);
    soft.put(canvas, &words, (to + 8, y + 26));
}

#[expect(clippy::cast_possible_truncation, reason = "some hundreds")]
fn unit(ms: f64) -> i32 {
    LEFT + (ms / 1e3 * SECOND).round() as i32
}
