//! Plots a probe: its round trips over time, and their distribution.

mod distribution;
mod extent;
mod series;

use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;

use fuseline_testkit::networks::{DriveRow, each_row, split};

use crate::fault::Fault;
use crate::probe::plots::extent::Extent;
use crate::probe::plots::series::Series;
use fuseline_evaluation::plot::{DARK, Folder, LIGHT, PageContent, Plot, show};

/// The caption of the page.
const CAPTION: &str = "A message of 33.3 KB was due at each slot, 30 times a second unless stated otherwise, and \
    a reply of 1 KB came back. With more than 30 unanswered the sending paused until none was. The paper's figures \
    are those of its 5G drive through San Francisco.";

/// Plots the recording at `path` into a folder; says which files there are.
///
/// The page has what is printed on the terminal, if that is more than the plots say.
///
/// # Errors
/// If the recording cannot be read, or a file cannot be written; each file is whole or not there.
pub(crate) fn plot(
    path: &Path,
    folder: &Folder,
    reported: Option<&str>,
) -> Result<Vec<String>, Fault> {
    let name = path.display().to_string();
    // A recording of several networks is named with one of them.
    let (file, network) = if path.exists() { (&*name, None) } else { split(&name) };
    let unread = |source| Fault::Open { name: name.clone(), source };
    let path = if network.is_some() { Path::new(file) } else { path };
    let mut text = File::open(path).map_err(unread)?;
    // The file may grow between the two passes.
    let len = text.metadata().map_err(unread)?.len();
    let mut each = |look: &mut dyn FnMut(DriveRow)| {
        text.rewind().map_err(unread)?;
        each_row(file, network, text.by_ref().take(len), look).map_err(Fault::own)
    };
    let mut extent = Extent::default();
    each(&mut |row| extent.add(&row))?;
    let mut series = Series::new(&extent);
    each(&mut |row| series.add(&row))?;
    let about = extent.reported();
    let plots = vec![series.plot(about.clone()), distribution::plot(&extent, about.clone())];
    let files = names(&plots);
    let shown = PageContent {
        title: "Network probe",
        words: &[CAPTION],
        plots,
        reported: reported.unwrap_or(&about),
    };
    show(folder, &shown)?;
    Ok(files)
}

fn names(plots: &[Plot]) -> Vec<String> {
    let mut names = Vec::new();
    for plot in plots {
        for theme in [LIGHT, DARK] {
            names
                .extend(["svg", "png"].map(|kind| format!("{}{}.{kind}", plot.name, theme.suffix)));
        }
    }
    names.push("index.html".to_owned());
    names
}
