//! Folders that a command fills: each file appears whole or not at all.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use anstream::adapter::strip_str;
use tempfile::{Builder, NamedTempFile};
use thiserror::Error;

use crate::plot::{DARK, LIGHT, Plot, PlotPage};

/// A folder to write to. It is created if it does not exist, and other files in it stay.
pub struct Folder(PathBuf);

/// The reason a folder cannot be filled.
#[derive(Debug, Error)]
pub enum FolderError {
    /// The folder cannot be created, or takes no files.
    #[error("{name}: {source}; name a folder that can be written to")]
    Folder {
        /// Its path.
        name: String,
        /// The system's error.
        source: io::Error,
    },
    /// The folder is not empty.
    #[error(
        "{0}: the folder is not empty; name a new one, or replace files of the same names with \
         --force"
    )]
    NotEmpty(String),
    /// A file in it cannot be written.
    #[error("{name}: {source}; make room, or name another folder")]
    Create {
        /// The file's path.
        name: String,
        /// The system's error.
        source: io::Error,
    },
}

impl Folder {
    /// Returns the folder at `path`, if one is wanted.
    ///
    /// # Errors
    /// Returns an error if the folder cannot be created, takes no files, or is not empty and
    /// `force` is not set. The error is reported before any work is done.
    pub fn open(path: Option<&Path>, force: bool) -> Result<Option<Self>, FolderError> {
        let Some(path) = path else { return Ok(None) };
        let folder = Self(path.to_owned());
        let takes_files = fs::create_dir_all(path).and_then(|()| folder.unfinished().map(drop));
        takes_files
            .map_err(|source| FolderError::Folder { name: path.display().to_string(), source })?;
        let is_empty = fs::read_dir(path).map_or(true, |mut entries| entries.next().is_none());
        if !is_empty && !force {
            return Err(FolderError::NotEmpty(path.display().to_string()));
        }
        Ok(Some(folder))
    }

    /// Writes a file.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn put(&self, name: &str, bytes: &[u8]) -> Result<(), FolderError> {
        let path = self.0.join(name);
        self.persist(&path, bytes).map_err(|source| fault(&path, source))
    }

    fn persist(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let mut file = self.unfinished()?;
        file.write_all(bytes)?;
        file.persist(path)?;
        Ok(())
    }

    /// Returns a file with a temporary name, which is removed unless it is persisted.
    fn unfinished(&self) -> io::Result<NamedTempFile> {
        let mut builder = Builder::new();
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        builder.prefix(".").suffix(".tmp").tempfile_in(&self.0)
    }
}

fn fault(path: &Path, source: io::Error) -> FolderError {
    FolderError::Create { name: path.display().to_string(), source }
}

/// The content of a command's page.
pub struct PageContent<'a> {
    /// Its heading.
    pub title: &'a str,
    /// Paragraphs below the heading.
    pub words: &'a [&'a str],
    /// The plots, from top to bottom.
    pub plots: Vec<Plot>,
    /// The text that was printed on the terminal.
    pub reported: &'a str,
}

/// The name of the page.
const PAGE: &str = "index.html";

/// Returns the path of the page that [`show`] writes to the folder at `path`.
#[must_use]
pub fn page_of(path: &Path) -> String {
    path.join(PAGE).display().to_string()
}

/// Writes the plots, as SVG and PNG on both grounds, and `index.html`.
///
/// # Errors
/// Returns an error if a file cannot be written.
pub fn show(folder: &Folder, shown: &PageContent<'_>) -> Result<(), FolderError> {
    let PageContent { title, words, plots, reported } = shown;
    let mut figures = Vec::new();
    for plot in plots {
        let [light, dark] = [LIGHT, DARK].map(|theme| (theme.suffix, plot.on(&theme)));
        for (suffix, drawing) in [&light, &dark] {
            let name = format!("{}{suffix}", plot.name);
            folder.put(&format!("{name}.svg"), drawing.svg.as_bytes())?;
            folder.put(&format!("{name}.png"), &drawing.png)?;
        }
        figures.push((plot.caption.as_str(), [light.1.svg, dark.1.svg]));
    }
    let table = &strip_str(reported).to_string();
    let page = PlotPage { title, words, figures: &figures, table };
    folder.put(PAGE, page.html().as_bytes())
}
