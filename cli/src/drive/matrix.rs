//! The report as a table of all cases, as Markdown or as a page that stands alone.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use indicatif::HumanCount;

use super::report::{CaseOutcome, DriveReport};
use crate::exit::Exit;

/// The number of characters of the suite's digest that are shown.
const DIGEST: usize = 16;

/// The file of a table, and its format.
#[derive(Clone, Debug)]
pub(super) struct TableWriter {
    path: PathBuf,
    form: TableForm,
}

#[derive(Clone, Copy, Debug)]
enum TableForm {
    Markdown,
    Html,
}

/// One case, or several with the same outcome.
struct CaseRow {
    case: String,
    mark: CaseOutcome,
    word: String,
}

impl TableWriter {
    /// Takes the form from the file's name.
    pub(super) fn new(path: &str) -> Result<Self, String> {
        let path = PathBuf::from(path);
        let form = match path.extension().and_then(|end| end.to_str()) {
            Some("md") => TableForm::Markdown,
            Some("html") => TableForm::Html,
            Some(_) | None => return Err("give a file that ends in .md or .html".to_owned()),
        };
        Ok(Self { path, form })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn text(&self, report: &DriveReport) -> String {
        match self.form {
            TableForm::Markdown => markdown(report),
            TableForm::Html => html(report),
        }
    }
}

fn rows(report: &DriveReport) -> Vec<CaseRow> {
    let row =
        |case: &str, mark: CaseOutcome| CaseRow { case: case.to_owned(), mark, word: mark.word() };
    let mut rows: Vec<_> = report.fixed.iter().map(|(id, mark)| row(id, *mark)).collect();
    let (suite, all, passed) = (&report.suite, report.suite.generated, report.passed);
    let span = |from: u64, to: u64| match to - from {
        1 => suite.id(from),
        _ => format!("{} to {}", suite.id(from), suite.id(to - 1)),
    };
    let of = |from: u64, to: u64, mark: CaseOutcome| {
        let count =
            if to - from > 1 { format!(" ({})", HumanCount(to - from)) } else { String::new() };
        CaseRow { case: span(from, to), mark, word: mark.word() + &count }
    };
    if passed > 0 {
        rows.push(of(0, passed, CaseOutcome::Passes));
    }
    let mut next = passed;
    if let Some((id, mark)) = &report.failed {
        rows.push(row(id, *mark));
        next += 1;
    }
    if next < all {
        rows.push(of(next, all, CaseOutcome::NotRun));
    }
    rows
}

fn suite(report: &DriveReport) -> String {
    let digest: String = report.suite.hash().chars().take(DIGEST).collect();
    let generator = &report.suite.generator;
    let passed = report.fixed_count(|mark| mark == CaseOutcome::Passes);
    let generated = match (HumanCount(report.passed), report.suite.generated) {
        (_, 0) => String::new(),
        (passed, all) => format!(", {passed} of {} generated runs", HumanCount(all)),
    };
    format!(
        "Passed: {passed} of {} fixed cases{generated}. Fuseline {}, suite sha256 {digest}…, \
         generator {}, seed {}, commit rule {}, up to {} clouds",
        report.fixed.len(),
        env!("CARGO_PKG_VERSION"),
        generator.version.number(),
        generator.seed,
        generator.commit.map_or("all", fuseline_traces::Commit::as_str),
        generator.most_clouds()
    )
}

/// Returns the marks that the runs reached and missed, by kind.
fn reached(report: &DriveReport) -> Vec<(String, String)> {
    let shares = report.reach.shares().into_iter();
    let line = shares.map(|share| {
        let missing = if share.missing.is_empty() {
            String::new()
        } else {
            format!("; not {}", share.missing.join(", "))
        };
        (share.kind.to_owned(), format!("{} of {}{missing}", share.reached, share.all))
    });
    line.collect()
}

fn verdict(report: &DriveReport) -> &'static str {
    match report.exit() {
        Exit::Conforms => "conforms",
        Exit::Differs => "does not conform",
        Exit::Doubt => "is in doubt",
        Exit::BadInput => "was not driven to the end",
    }
}

fn markdown(report: &DriveReport) -> String {
    let name = &report.name;
    let mut text = format!("# `{name}` {}\n\n{}.\n", verdict(report), suite(report));
    for entry in report.reported() {
        let _ = write!(text, "\n```text\n{}\n```\n", entry.text());
    }
    if let Some(misbehaviour) = &report.at_end {
        let _ = write!(text, "\nAfter the last case {misbehaviour}.\n");
    }
    text.push_str("\n| case | result |\n|---|---|\n");
    for CaseRow { case, word, .. } in rows(report) {
        let _ = writeln!(text, "| {case} | {word} |");
    }
    text.push_str("\n| reached by the runs that pass | |\n|---|---|\n");
    for (kind, count) in reached(report) {
        let _ = writeln!(text, "| {kind} | {count} |");
    }
    text
}

const STYLE: &str = "\
:root{color-scheme:light dark;--ink:#1a1a1a;--dim:#5f6368;--paper:#fff;--line:#d9dce0;--good:#116329;\
--bad:#b3261e;--tint:#f4f5f7}
@media (prefers-color-scheme:dark){:root{--ink:#e6e6e6;--dim:#9aa0a6;--paper:#16181b;--line:#33373d;\
--good:#6fdd8b;--bad:#ff8a80;--tint:#1f2226}}
body{font:16px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--paper);max-width:60rem;\
margin:2rem auto;padding:0 1rem}
h1{font-size:1.4rem;line-height:1.3;overflow-wrap:anywhere}
pre{font:13px/1.5 ui-monospace,monospace}code{font:1em ui-monospace,monospace}
pre{background:var(--tint);border:1px solid var(--line);border-radius:6px;padding:.8rem;\
white-space:pre-wrap;overflow-wrap:anywhere}
.dim{color:var(--dim)}.good{color:var(--good)}.bad{color:var(--bad);font-weight:600}
table{border-collapse:collapse;width:100%;margin:1rem 0}
th,td{text-align:left;padding:.25rem .6rem;border-bottom:1px solid var(--line);vertical-align:top}
td:last-child{white-space:nowrap}table.reached td:last-child{white-space:normal}
";

fn html(report: &DriveReport) -> String {
    let (name, verdict) = (escaped(&report.name), verdict(report));
    let colour = if report.exit() == Exit::Conforms { "good" } else { "bad" };
    let mut text = format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n<title>{name} {verdict}</title>\n\
         <style>\n{STYLE}</style>\n\
         <h1><code>{name}</code> <span class=\"{colour}\">{verdict}</span></h1>\n\
         <p class=\"dim\">{}.</p>\n",
        escaped(&suite(report))
    );
    for entry in report.reported() {
        let _ = writeln!(text, "<pre>{}</pre>", escaped(&entry.text()));
    }
    if let Some(misbehaviour) = &report.at_end {
        let _ = writeln!(
            text,
            "<p class=\"bad\">After the last case {}.</p>",
            escaped(&misbehaviour.to_string())
        );
    }
    text.push_str("<table>\n<tr><th>case<th>result\n");
    for CaseRow { case, mark, word } in rows(report) {
        let colour = match mark {
            CaseOutcome::Passes => "good",
            CaseOutcome::Breaks(_) | CaseOutcome::Misbehaves => "bad",
            CaseOutcome::NotRun => "dim",
        };
        let _ = writeln!(text, "<tr><td>{}<td class=\"{colour}\">{word}", escaped(&case));
    }
    text.push_str(
        "</table>\n<table class=\"reached\">\n<tr><th>reached by the runs that pass<th>\n",
    );
    for (kind, count) in reached(report) {
        let _ = writeln!(text, "<tr><td>{kind}<td>{}", escaped(&count));
    }
    text.push_str("</table>\n</html>\n");
    text
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
