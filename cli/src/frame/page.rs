//! The frame's life as a page: a bar for each operator and call, on one scale.

use std::io::{self, Write};
use std::time::Duration;

use crate::frame::life::{FrameLife, FrameStage, ms};

/// In pixels: the names, the bars, a row.
const NAMES: f64 = 200.0;
const BARS: f64 = 760.0;
const ROW: f64 = 24.0;

/// One row of the drawing.
struct FrameBar<'a> {
    name: &'a str,
    begin: Duration,
    end: Duration,
    label: String,
    class: &'static str,
}

pub(super) fn write(out: &mut impl Write, life: &FrameLife) -> io::Result<()> {
    let title = format!("{} {}: {} old at its last answer", life.stream, life.seq, ms(life.age()));
    let title = escaped(&title);
    let rows: Vec<FrameBar<'_>> = life.stages.iter().flat_map(rows).collect();
    let height = ROW * f64::from(u32::try_from(rows.len()).unwrap_or(u32::MAX)) + 8.0;
    let width = NAMES + BARS + 200.0;
    writeln!(
        out,
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>{title}</title>"
    )?;
    writeln!(
        out,
        "<style>body{{font:14px sans-serif;margin:2em}}.operator{{fill:#1c6ea4}}.call{{fill:#9bc3dd}}\
         td{{padding:.1em 1em .1em 0}}</style><h1>{title}</h1>"
    )?;
    writeln!(
        out,
        "<svg role=\"img\" aria-label=\"{title}\" width=\"{width}\" height=\"{height}\">"
    )?;
    let scale = BARS / life.age().as_secs_f64().max(1e-9);
    for (index, row) in (0u32..).zip(&rows) {
        let y = f64::from(index) * ROW;
        let x = NAMES + row.begin.as_secs_f64() * scale;
        let length = (row.end.saturating_sub(row.begin).as_secs_f64() * scale).max(1.0);
        let (name, label, text) = (escaped(row.name), escaped(&row.label), y + 16.0);
        writeln!(
            out,
            "<text x=\"0\" y=\"{text}\">{name}</text><rect class=\"{}\" x=\"{x:.1}\" y=\"{:.1}\" \
             width=\"{length:.1}\" height=\"16\"/><text x=\"{:.1}\" y=\"{text}\">{label}</text>",
            row.class,
            y + 3.0,
            x + length + 6.0
        )?;
    }
    writeln!(out, "</svg><h2>Where its time went</h2><table>")?;
    for (what, span) in life.spans() {
        writeln!(out, "<tr><td>{}<td>{}</tr>", escaped(&what), ms(span))?;
    }
    writeln!(out, "</table></html>")
}

/// An operator's row, then those of its calls.
fn rows(stage: &FrameStage) -> Vec<FrameBar<'_>> {
    let end = stage.answered.unwrap_or(stage.taken_in);
    let of =
        |begin: Duration, end: Duration, how: &str| format!("{} to {}, {how}", ms(begin), ms(end));
    let mut rows = vec![FrameBar {
        name: &stage.operator,
        begin: stage.taken_in,
        end,
        label: of(stage.taken_in, end, &stage.by),
        class: "operator",
    }];
    for call in &stage.calls {
        let end = call.ended.unwrap_or(end);
        let label = of(call.requested, end, call.how);
        rows.push(FrameBar { name: &call.cloud, begin: call.requested, end, label, class: "call" });
    }
    rows
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
