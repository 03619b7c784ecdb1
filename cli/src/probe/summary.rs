//! The summary, for people and for `--json`.

use std::fmt;
use std::path::Path;

use fuseline_evaluation::{TripQuantiles, paper_round_trips};
use serde::Serialize;

use crate::duration::{ms, seconds, short};
use crate::percentile::{Percentiles, shown};
use crate::probe::figures::{Figures, RequestCounts};
use crate::probe::options::Args;
use crate::table::{counted, percent, table};

/// The result of a probe.
#[derive(Debug, Serialize)]
pub(crate) struct ProbeSummary {
    url: String,
    /// `true` if the user ended it.
    interrupted: bool,
    rate: f64,
    runtime_ms: f64,
    deadline_ms: f64,
    #[serde(flatten)]
    counts: RequestCounts,
    paused_ms: f64,
    /// Round trips of answers.
    answers_ms: Percentiles,
    /// The response times over all slots.
    slots_ms: Percentiles,
    /// The paper's.
    paper_ms: TripQuantiles,
    csv: String,
    /// The page with the plots.
    pub(crate) page: Option<String>,
    /// Files in the folder for plots.
    pub(crate) plots: Vec<String>,
}

impl ProbeSummary {
    pub(crate) fn new(
        (args, csv): (&Args, &Path),
        url: &str,
        figures: &Figures,
        interrupted: bool,
    ) -> Self {
        Self {
            url: url.to_owned(),
            interrupted,
            rate: args.rate,
            runtime_ms: seconds(args.runtime) * 1e3,
            deadline_ms: seconds(args.deadline) * 1e3,
            counts: figures.counts,
            paused_ms: ms(figures.paused),
            answers_ms: figures.answers.reported(),
            slots_ms: figures.slots.reported(),
            paper_ms: paper_round_trips(),
            csv: csv.display().to_string(),
            page: None,
            plots: Vec::new(),
        }
    }
}

impl fmt::Display for ProbeSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let RequestCounts {
            slots,
            sent,
            answered,
            failed,
            unanswered,
            in_time,
            pauses,
            skipped,
            missed,
        } = self.counts;
        if self.interrupted {
            writeln!(f, "Interrupted; this is the probe so far.")?;
        }
        writeln!(
            f,
            "{} at {} a second.\n\
             {sent} sent: {answered} answered, {failed} failed, {unanswered} unanswered at the end.\n\
             {}, {:.1} s in all; {skipped} skipped.",
            counted(slots, "slot"),
            self.rate,
            counted(pauses, "pause"),
            self.paused_ms / 1000.0,
            skipped = counted(skipped, "slot"),
        )?;
        if missed > 0 {
            writeln!(f, "This host was busy and missed {}.", counted(missed, "slot"))?;
        }
        let row = |name: &str, Percentiles { p50, p90, p99, max }: Percentiles, of| {
            let [p50, p90, p99, max] = [p50, p90, p99, max].map(|quantile| shown(quantile, short));
            [name.to_owned(), p50, p90, p99, max, percent(in_time, of)]
        };
        let TripQuantiles { p50, p90, p99 } = self.paper_ms;
        let [p50, p90, p99] = [p50, p90, p99].map(|ms| format!("{ms} ms"));
        let rows = [
            row("answers", self.answers_ms, answered),
            row("slots", self.slots_ms, slots - missed),
            ["paper's 5G drive".to_owned(), p50, p90, p99, "–".to_owned(), "–".to_owned()],
        ];
        let header = ["round trip", "p50", "p90", "p99", "max", "in time"];
        writeln!(f, "\n{}\n", table(header, rows, 1..6))?;
        writeln!(
            f,
            "Slots: a skipped slot counts until its pause ends, and a failed slot never ends.\n\
             In time: the round trip leaves {} ms to compute within {} ms. Lost: {} of what was \
             sent.\n\
             {}: the recording, for fuseline run --drive west={}",
            self.runtime_ms,
            self.deadline_ms,
            percent(failed + unanswered, sent),
            self.csv,
            self.csv,
        )
    }
}

/// Describes the plots.
pub(crate) fn plotted(folder: &Path, files: &[String]) -> String {
    let svgs = files.iter().filter_map(|file| file.strip_suffix(".svg"));
    let names: Vec<&str> = svgs.filter(|name| !name.ends_with("-dark")).collect();
    format!("{}: index.html, and as SVG and PNG: {}\n", folder.display(), names.join(", "))
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use fuseline_report::Quantile;

    use super::*;

    #[test]
    fn the_papers_drive_stands_beside() {
        let TripQuantiles { p50, p90, p99 } = paper_round_trips();
        assert_eq!([p50, p90, p99].map(|ms| format!("{ms}")), ["68", "336", "3027"]);
    }

    /// Each figure is another one, so that none can stand in another's place.
    #[test]
    fn each_count_share_and_quantile_stands_where_it_belongs() {
        let ms = |ms: f64| Some(Quantile::Exactly(Duration::from_secs_f64(ms / 1e3)));
        let counts = RequestCounts {
            slots: 1000,
            sent: 800,
            answered: 600,
            failed: 150,
            unanswered: 50,
            in_time: 300,
            pauses: 1,
            skipped: 190,
            missed: 10,
        };
        let mut summary = ProbeSummary {
            url: "http://h".to_owned(),
            interrupted: true,
            rate: 30.5,
            runtime_ms: 118.0,
            deadline_ms: 500.0,
            counts,
            paused_ms: 2340.0,
            answers_ms: Percentiles { p50: ms(9.94), p90: ms(9.96), p99: ms(3027.4), max: None },
            slots_ms: Percentiles {
                p50: ms(12.0),
                p90: Some(Quantile::AtLeast(Duration::from_millis(40))),
                p99: Some(Quantile::Never),
                max: Some(Quantile::Never),
            },
            paper_ms: paper_round_trips(),
            csv: "drive.csv".to_owned(),
            page: None,
            plots: Vec::new(),
        };
        let text = summary.to_string();
        let words = |line: &str| line.split_whitespace().collect::<Vec<_>>().join(" ");
        let lines: Vec<String> = text.lines().map(words).collect();
        assert_eq!(
            lines,
            [
                "Interrupted; this is the probe so far.",
                "1000 slots at 30.5 a second.",
                "800 sent: 600 answered, 150 failed, 50 unanswered at the end.",
                "1 pause, 2.3 s in all; 190 slots skipped.",
                "This host was busy and missed 10 slots.",
                "",
                "round trip p50 p90 p99 max in time",
                lines[7].as_str(),
                "answers 9.9 ms 10 ms 3027 ms – 50.0 %",
                "slots 12 ms ≥ 40 ms never never 30.3 %",
                "paper's 5G drive 68 ms 336 ms 3027 ms – –",
                "",
                "Slots: a skipped slot counts until its pause ends, and a failed slot never ends.",
                "In time: the round trip leaves 118 ms to compute within 500 ms. Lost: 25.0 % of \
                 what was sent.",
                "drive.csv: the recording, for fuseline run --drive west=drive.csv",
            ]
        );
        assert!(lines[7].starts_with('─'));
        summary.interrupted = false;
        summary.counts = RequestCounts { slots: 1, skipped: 1, ..RequestCounts::default() };
        let text = summary.to_string();
        assert!(text.starts_with("1 slot at 30.5 a second.\n0 sent: "), "{text}");
        assert!(text.contains("\n0 pauses, 2.3 s in all; 1 slot skipped.\n\n"), "{text}");
        assert!(text.contains("Lost: – of what was sent."), "{text}");
    }

    #[test]
    fn names_each_plot_once() {
        let files = ["a.svg", "a-dark.svg", "a.png", "b.svg"].map(ToOwned::to_owned);
        let all = plotted(Path::new("plots"), &files);
        assert_eq!(all, "plots: index.html, and as SVG and PNG: a, b\n");
    }
}
