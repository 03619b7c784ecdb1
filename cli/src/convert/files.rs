//! The files of a log: one or several, folders of bags, packed or not.

use std::fs;
use std::io::{self, BufRead, BufReader, Cursor};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fuseline_traces::packed::unpack_bytes;

use crate::convert::notes::Notes;
use crate::convert::otlp;
use crate::convert::row::{Place, Problem, Spot};
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
    /// `true` if the user said so.
    is_given: bool,
}

/// The content of a file.
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

/// The note about a file that belongs to others.
pub(super) const PART: &str = "it is one file of a bag";
/// This many bytes at the beginning of a file decide what the file is.
const START: usize = 1 << 16;

/// Returns the files that these paths stand for; a folder stands for the files of its bag.
pub(super) fn files(
    paths: &[PathBuf],
    from: Option<Format>,
    notes: &mut Notes,
) -> Result<Vec<LogFile>, Problem> {
    let mut files = Vec::new();
    for path in paths {
        let name = input::name(path).into();
        let parts = if path.is_dir() {
            let parts = parts(path).filter(|parts| !parts.is_empty());
            parts.ok_or_else(|| {
                let message =
                    "the folder has no metadata.yaml, .mcap or .db3 file; name one of its files";
                Problem::of_file(&name, message)
            })?
        } else {
            let others = path.parent().and_then(listed).unwrap_or_default();
            if others.len() > 1 && others.contains(path) && paths.len() == 1 {
                let detail = format!(
                    "the bag has {} files; name the folder to read all of them",
                    others.len()
                );
                notes.add_of_file(PART, &name, detail);
            }
            vec![path.clone()]
        };
        for path in parts {
            files.push(LogFile::new(path, from)?);
        }
    }
    Ok(files)
}

/// Returns the files of a bag's folder, in their order.
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

/// Returns the files that a folder's `metadata.yaml` lists; a file that was packed since has
/// another ending.
fn listed(folder: &Path) -> Option<Vec<PathBuf>> {
    let text = fs::read_to_string(folder.join("metadata.yaml")).ok()?;
    let lines = text.lines().map(str::trim).skip_while(|line| *line != "relative_file_paths:");
    let names = lines.skip(1).map_while(|line| line.strip_prefix("- "));
    let found = |name: &str| {
        let name = name.trim().trim_matches(['"', '\'']);
        let (path, packed) = (folder.join(name), folder.join(format!("{name}.zstd")));
        if !path.exists() && packed.exists() { packed } else { path }
    };
    Some(names.map(found).collect())
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
    fn new(path: PathBuf, from: Option<Format>) -> Result<Self, Problem> {
        let name: Arc<str> = input::name(&path).into();
        let Some(format) = from.or_else(|| format_of(&path)) else {
            let message = "the name does not end in .csv, .jsonl, .mcap or .db3, packed or not; \
                           give the format with --from";
            return Err(Problem::of_file(&name, message));
        };
        Ok(Self { path, name, format, is_given: from.is_some() })
    }

    fn problem(&self, error: &io::Error) -> Problem {
        Problem::of_read(&Place::new(&self.name, Spot::File), error)
    }

    /// Opens it, unpacked; texts are UTF-8 without a mark.
    pub(super) fn open(&self) -> Result<Box<dyn BufRead>, Fault> {
        let (_, file) = open(&self.path)?;
        let unpacked = unpack_bytes(BufReader::with_capacity(START, file));
        let mut unpacked = unpacked.map_err(|error| self.problem(&error))?;
        match unpacked.fill_buf().map_err(|error| self.problem(&error))? {
            [0xef, 0xbb, 0xbf, ..] => unpacked.consume(3),
            // UTF-16, as Excel and PowerShell write it.
            [mark @ (0xff | 0xfe), 0xff | 0xfe, ..] => {
                let unit = if *mark == 0xff { u16::from_le_bytes } else { u16::from_be_bytes };
                let mut bytes = Vec::new();
                unpacked.read_to_end(&mut bytes).map_err(|error| self.problem(&error))?;
                let units = bytes[2..].chunks_exact(2).map(|pair| unit([pair[0], pair[1]]));
                let text = char::decode_utf16(units).map(|it| it.unwrap_or('\u{fffd}'));
                return Ok(Box::new(Cursor::new(text.collect::<String>())));
            }
            _ => {}
        }
        Ok(unpacked)
    }

    /// Returns the content by its first bytes, because a file in .json may have spans.
    pub(super) fn content(&self, reader: &mut dyn BufRead) -> Result<Content, Problem> {
        let start = reader.fill_buf().map_err(|error| self.problem(&error))?;
        let text = String::from_utf8_lossy(&start[..start.len().min(START)]);
        let text = text.trim_start();
        let is_array =
            || text.strip_prefix('[').is_some_and(|rest| rest.trim_start().starts_with(['{', ']']));
        Ok(match self.format {
            Format::Jsonl if !self.is_given && otlp::is_export(text) => Content::Spans,
            Format::Jsonl if text.starts_with("{\"fuseline\":") => Content::Trace,
            Format::Jsonl if is_array() => Content::Array,
            Format::Jsonl => Content::Lines,
            Format::Otlp => Content::Spans,
            Format::Csv => Content::Table,
            Format::Mcap | Format::Db3 => Content::Bag,
        })
    }

    /// Returns a path by which a library can open it that reads files alone; what is packed gets
    /// one for now.
    pub(super) fn on_disk(&self) -> Result<(PathBuf, Option<tempfile::NamedTempFile>), Fault> {
        let read = |error: io::Error| self.problem(&error);
        let mut start = [0; 4];
        let len = open(&self.path)?.1.read(&mut start).map_err(read)?;
        if !matches!(start[..len], [0x1f, 0x8b, ..] | [0x28, 0xb5, 0x2f, 0xfd]) {
            return Ok((self.path.clone(), None));
        }
        let mut unpacked = tempfile::NamedTempFile::new().map_err(read)?;
        io::copy(&mut self.open()?, &mut unpacked).map_err(read)?;
        Ok((unpacked.path().to_owned(), Some(unpacked)))
    }
}
