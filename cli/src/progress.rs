//! Progress on long files, on standard error where that is a terminal.

use std::io::{self, IsTerminal, Read};
use std::path::Path;

use indicatif::{MultiProgress, ProgressBar, ProgressBarIter, ProgressStyle};

/// Files shorter than this, in bytes, are read before anyone could see a bar.
const LONG: u64 = 16 << 20;

/// A bar of what is read of the file at `path`, called `name`, among others; hidden where nobody would see it.
pub(crate) fn bar(bars: &MultiProgress, path: &Path, name: &str) -> ProgressBar {
    let len = path.metadata().map_or(0, |metadata| metadata.len());
    if len < LONG || !io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{prefix:.dim} {wide_bar} {percent:>3} % {eta:>4}");
    let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
    bars.add(ProgressBar::new(len).with_style(style).with_prefix(name.to_owned()))
}

/// The same for a file that is read alone, around what reads it. The bar goes away with the reader.
pub(crate) fn watched<R: Read>(path: &Path, name: &str, file: R) -> ProgressBarIter<R> {
    let bar = bar(&MultiProgress::new(), path, name);
    bar.with_finish(indicatif::ProgressFinish::AndClear).wrap_read(file)
}
