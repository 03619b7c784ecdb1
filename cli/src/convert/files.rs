//! The files of a log: one or several, folders of bags, packed or not.

use std::fs;
#[cfg(feature = "bags")]
use std::io::{self, Write};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fuseline_traces::packed::unpack_bytes;

use crate::convert::otlp;
use crate::convert::recorded::ConvertError;
use crate::convert::row::Notes;
#[cfg(feature = "bags")]
use crate::convert::row::{Place, Spot};
use crate::fault::Fault;
use crate::input::{self, open};

/// The format of a log.
#[derive(Clone, Copy, PartialEq, Eq, Debug, clap::ValueEnum)]
pub(crate) enum Format {
    Csv,
    /// A JSON object a line, or an array of objects.
    Jsonl,
    Mcap,
    /// A database of rosbag2.
    Db3,
    /// OpenTelemetry's spans as JSON.
    Otlp,
}

/// A file to read.
#[derive(Clone, Debug)]
pub(super) struct LogFile {
    pub(super) path: PathBuf,
    pub(super) name: Arc<str>,
    pub(super) format: Format,
    /// Whether the user said so.
    is_given: bool,
}

/// What rosbag2 writes beside the files of a bag.
const METADATA: &str = "metadata.yaml";
/// How much of a file says what it is.
const START: usize = 1 << 16;

/// The files that these paths stand for; a folder stands for the files of its bag.
///
/// # Errors
/// If a folder has none, or the format of a file is not known.
pub(super) fn files(
    paths: &[PathBuf],
    from: Option<Format>,
    notes: &mut Notes,
) -> Result<Vec<LogFile>, ConvertError> {
    let mut files = Vec::new();
    for path in paths {
        let name = input::name(path);
        if path.is_dir() {
            let parts = parts(path).filter(|parts| !parts.is_empty());
            let parts = parts.ok_or_else(|| ConvertError::Folder { file: name.clone() })?;
            for path in parts {
                files.push(file(&path, from)?);
            }
            continue;
        }
        let others = path.parent().and_then(listed).unwrap_or_default();
        if others.len() > 1 && others.contains(path) && paths.len() == 1 {
            let detail = format!("{} files; name the folder to read all of them", others.len());
            notes.add_of_file("it is one part of a bag of", &name.as_str().into(), detail);
        }
        files.push(file(path, from)?);
    }
    Ok(files)
}

fn file(path: &Path, from: Option<Format>) -> Result<LogFile, ConvertError> {
    let name = input::name(path);
    let format = from.or_else(|| format_of(path));
    let format = format.ok_or_else(|| ConvertError::Format { file: name.clone() })?;
    Ok(LogFile { path: path.to_owned(), name: name.into(), format, is_given: from.is_some() })
}

/// The files of a bag's folder, in their order.
fn parts(folder: &Path) -> Option<Vec<PathBuf>> {
    if let Some(parts) = listed(folder) {
        return Some(parts);
    }
    let is_bag = |path: &PathBuf| matches!(format_of(path), Some(Format::Mcap | Format::Db3));
    let files = fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.path()));
    let mut files: Vec<PathBuf> = files.filter(is_bag).collect();
    // Names end in numbers: bag_2 comes before bag_10.
    files.sort_by_key(|path| (path.as_os_str().len(), path.clone()));
    Some(files)
}

/// The files that a folder's `metadata.yaml` lists; a file that was packed since has another ending.
fn listed(folder: &Path) -> Option<Vec<PathBuf>> {
    let text = fs::read_to_string(folder.join(METADATA)).ok()?;
    let mut lines = text.lines().skip_while(|line| line.trim() != "relative_file_paths:").skip(1);
    let mut names = Vec::new();
    while let Some(name) = lines.next().and_then(|line| line.trim().strip_prefix("- ")) {
        names.push(name.trim().trim_matches(['"', '\'']).to_owned());
    }
    let found = |name: String| {
        let path = folder.join(&name);
        let packed = folder.join(format!("{name}.zstd"));
        if !path.exists() && packed.exists() { packed } else { path }
    };
    Some(names.into_iter().map(found).collect())
}

fn format_of(path: &Path) -> Option<Format> {
    let name = path.file_name()?.to_str()?.to_lowercase();
    let packed = [".gz", ".zst", ".zstd"].into_iter().find_map(|end| name.strip_suffix(end));
    match packed.unwrap_or(&name).rsplit_once('.')?.1 {
        "csv" | "tsv" => Some(Format::Csv),
        "jsonl" | "ndjson" | "json" => Some(Format::Jsonl),
        "mcap" => Some(Format::Mcap),
        "db3" => Some(Format::Db3),
        _ => None,
    }
}

impl LogFile {
    /// Opens it, unpacked.
    pub(super) fn open(&self) -> Result<Box<dyn BufRead>, Fault> {
        let (_, file) = open(&self.path)?;
        let unpacked = unpack_bytes(BufReader::with_capacity(START, file));
        Ok(unpacked.map_err(|error| ConvertError::read(&self.name, &error))?)
    }

    /// What it is by its first bytes: a name in .json may be that of spans.
    pub(super) fn looks_like(&self, reader: &mut dyn BufRead) -> Result<Content, ConvertError> {
        let start = reader.fill_buf().map_err(|error| ConvertError::read(&self.name, &error))?;
        let start = &start[..start.len().min(START)];
        let text = String::from_utf8_lossy(start);
        let rest = text.trim_start_matches('\u{feff}').trim_start().strip_prefix('[');
        let is_array = rest.is_some_and(|rest| rest.trim_start().starts_with(['{', ']']));
        Ok(match self.format {
            Format::Jsonl if !self.is_given && otlp::is_export(start) => Content::Spans,
            Format::Jsonl if text.trim_start().starts_with("{\"fuseline\":") => Content::Trace,
            Format::Jsonl if is_array => Content::Array,
            Format::Jsonl => Content::Lines,
            Format::Otlp => Content::Spans,
            Format::Csv => Content::Table,
            Format::Mcap | Format::Db3 => Content::Bag,
        })
    }

    /// Its place as a whole.
    #[cfg(feature = "bags")]
    pub(super) fn place(&self) -> Place {
        Place { file: Arc::clone(&self.name), spot: Spot::File }
    }

    /// A path by which a library can open it that reads files alone; what is packed gets one for now.
    #[cfg(feature = "bags")]
    pub(super) fn on_disk(&self) -> Result<(PathBuf, Option<tempfile::NamedTempFile>), Fault> {
        let mut start = [0; 4];
        let len = open(&self.path)?.1.read(&mut start).unwrap_or(0);
        let is_packed =
            start[..len].starts_with(&[0x1f, 0x8b]) || start == [0x28, 0xb5, 0x2f, 0xfd];
        if !is_packed {
            return Ok((self.path.clone(), None));
        }
        let read = |error: io::Error| ConvertError::read(&self.name, &error);
        let mut unpacked = tempfile::NamedTempFile::new().map_err(read)?;
        io::copy(&mut self.open()?, &mut unpacked).map_err(read)?;
        unpacked.flush().map_err(read)?;
        Ok((unpacked.path().to_owned(), Some(unpacked)))
    }
}

/// What a file holds.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Content {
    Table,
    Lines,
    Array,
    Spans,
    /// A trace, which needs no conversion.
    Trace,
    Bag,
}
