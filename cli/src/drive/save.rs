//! Saves the runs that show a finding.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::report::ReportedFinding;
use crate::fault::Fault;
use crate::output;

/// Returns the files of a case with this many runs before it, in the order in which they are
/// driven. No file of these names is there, unless files are to be replaced.
pub(super) fn paths(folder: &Path, case: &str, before: usize, replaces: bool) -> Vec<PathBuf> {
    let named = |stem: &str| -> Vec<PathBuf> {
        if before == 0 {
            return vec![folder.join(format!("{stem}.jsonl"))];
        }
        let width = (before + 1).to_string().len();
        (1..=before + 1).map(|n| folder.join(format!("{stem}-run{n:0width$}.jsonl"))).collect()
    };
    let is_free =
        |paths: &Vec<PathBuf>| replaces || paths.iter().all(|it| it.symlink_metadata().is_err());
    let stems = (1_u64..).map(|n| if n == 1 { case.to_owned() } else { format!("{case}-{n}") });
    stems.map(|stem| named(&stem)).find(is_free).unwrap_or_default()
}

/// Saves the runs that show a finding.
pub(super) fn save(entry: &ReportedFinding, replaced: output::Overwrite) -> Result<(), Fault> {
    let before = entry.need.runs().iter().map(|run| {
        let mut text = Vec::new();
        run.write(&mut text);
        text
    });
    for (path, text) in entry.saved.iter().zip(before.chain([entry.finding.reported.trace()])) {
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(|source| create(folder, source))?;
        }
        output::file(path, &[], replaced)?;
        fs::write(path, text).map_err(|source| create(path, source))?;
    }
    Ok(())
}

fn create(path: &Path, source: io::Error) -> Fault {
    Fault::Create { name: path.display().to_string(), source }
}
