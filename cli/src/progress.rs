//! Progress on standard error: bars for long files, and the line of a command that takes a while.

use std::fmt;
use std::io::{self, IsTerminal, Read};
use std::path::Path;
use std::time::Duration;

use indicatif::{MultiProgress, ProgressBar, ProgressBarIter, ProgressStyle};

use crate::diagnostics::print_line;

/// Files shorter than this, in bytes, are read before anyone could see a bar.
const LONG: u64 = 16 << 20;

/// Makes a bar of this length, if that is known. It is hidden if standard error is no terminal.
pub(crate) fn styled(len: Option<u64>, template: &str) -> ProgressBar {
    if !io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template(template);
    let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
    len.map_or_else(ProgressBar::no_length, ProgressBar::new).with_style(style)
}

/// Makes a bar of what is read of the file at `path`, called `name`, among others; hidden if nobody
/// would see it.
pub(crate) fn bar(bars: &MultiProgress, path: &Path, name: &str) -> ProgressBar {
    let len = path.metadata().map_or(0, |metadata| metadata.len());
    if len < LONG || !io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = styled(Some(len), "{prefix:.dim} {wide_bar} {percent:>3} % {eta:>4}");
    bars.add(bar.with_prefix(name.to_owned()))
}

/// Shows progress for a file that is read alone, around its reader. The bar goes away with the
/// reader.
pub(crate) fn watched<R: Read>(path: &Path, name: &str, file: R) -> ProgressBarIter<R> {
    let bar = bar(&MultiProgress::new(), path, name);
    bar.with_finish(indicatif::ProgressFinish::AndClear).wrap_read(file)
}

/// The line of a command that takes a while. It stands below a bar on a terminal; elsewhere it is
/// printed now and then.
pub(crate) struct ProgressLine(Option<ProgressBar>);

impl ProgressLine {
    /// Begins it for a command that takes this long, if that is known.
    pub(crate) fn new(span: Option<Duration>) -> Self {
        Self(io::stderr().is_terminal().then(|| {
            // The words on a line of their own, which is cut at the terminal's edge.
            let bar = if span.is_some() { "{bar:24.cyan/dim} {prefix}" } else { "{prefix}" };
            styled(span.map(millis), &format!("{bar}\n{{wide_msg}}"))
        }))
    }

    /// Returns how often [`show`](Self::show) is to be called.
    pub(crate) const fn period(&self) -> Duration {
        match self.0 {
            Some(_) => Duration::from_millis(200),
            None => Duration::from_secs(5),
        }
    }

    /// Shows the time and how things are, `elapsed` after the beginning.
    pub(crate) fn show(&self, elapsed: Duration, time: String, state: String) {
        match &self.0 {
            Some(bar) => {
                bar.set_position(millis(elapsed));
                bar.set_prefix(time);
                bar.set_message(state);
            }
            None => print_line(format!("{time}: {state}")),
        }
    }

    /// Prints a line that stays.
    pub(crate) fn print(&self, line: impl fmt::Display) {
        match &self.0 {
            Some(bar) => bar.suspend(|| print_line(line)),
            None => print_line(line),
        }
    }

    pub(crate) fn end(&self) {
        if let Some(bar) = &self.0 {
            bar.finish_and_clear();
        }
    }
}

fn millis(span: Duration) -> u64 {
    u64::try_from(span.as_millis()).unwrap_or(u64::MAX)
}
