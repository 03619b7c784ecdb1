//! [`LogReader`]: the one pass over the files of a log that `convert`, `--explain` and `--write-header` share.

use std::sync::Arc;

use fuseline_traces::packed::RawMessages;

use crate::convert::Args;
use crate::convert::deadline::Deadlines;
use crate::convert::entry::{Entry, Sources};
use crate::convert::files::{self, Content, Format, LogFile};
use crate::convert::frame::Frame;
use crate::convert::json::{ArraySource, LineSource};
use crate::convert::log::{Log, LogKind};
use crate::convert::mapping::{Fixed, Mapping, Refusal};
use crate::convert::otlp::{self, SpanRecord};
use crate::convert::recorded::ConvertError;
use crate::convert::row::{Names, Notes, Problem, ProblemKind, Row, Source};
use crate::convert::service::ServiceRows;
use crate::convert::spans::SpanReader;
use crate::convert::table::TableSource;
use crate::convert::topics::{self, MessageFile, TopicSource};
use crate::convert::value::Unit;
use crate::fault::Fault;
#[cfg(feature = "bags")]
use crate::input::is_standard;

const SKIPPED: &str = "rows left out, since they cannot be read";
const UNREADABLE: &str = "rows that cannot be read, at which convert stops without --skip-bad";
const CUT: &str = "the file is cut off; read up to its last whole row";

/// Reads the files of a log.
pub(super) struct LogReader<'a> {
    args: &'a Args,
    deadlines: Deadlines,
    notes: Notes,
    log: Log,
}

/// A log that was read.
pub(super) struct Understood {
    pub(super) log: Log,
    pub(super) notes: Notes,
    pub(super) sources: Sources,
    /// Names in the log that nothing uses.
    pub(super) unused: Vec<String>,
    /// All names in the log, with some of their values.
    pub(super) described: Vec<String>,
    /// How many events were left out as the user said.
    pub(super) left_out: u64,
}

impl Args {
    fn is_mapped(&self) -> bool {
        !self.column.is_empty()
            || !self.event.is_empty()
            || self.topic.iter().any(|topic| topic.event.is_some())
    }

    /// Whether rows that cannot be read are left out; `--explain` shows the others at least.
    const fn skips_bad(&self) -> bool {
        self.skip_bad || self.explain
    }

    const fn skipped(&self) -> &'static str {
        if self.skip_bad { SKIPPED } else { UNREADABLE }
    }

    /// Whether a recording has the lines of a trace.
    pub(super) fn is_trace_in_mcap(&self, files: &[LogFile]) -> bool {
        !self.is_mapped() && files.iter().any(|file| file.format == Format::Mcap)
    }
}

impl<'a> LogReader<'a> {
    pub(super) fn new(args: &'a Args) -> Self {
        let deadlines = Deadlines::new(&args.deadline);
        Self { args, deadlines, notes: Notes::default(), log: Log::default() }
    }

    /// The files of the log.
    ///
    /// # Errors
    /// If one is of no known format.
    pub(super) fn files(&mut self) -> Result<Vec<LogFile>, Fault> {
        let files = files::files(&self.args.files, self.args.from, &mut self.notes)?;
        let is_rows = |file: &LogFile| matches!(file.format, Format::Csv | Format::Jsonl);
        if !self.args.frame.is_empty() && !files.iter().all(is_rows) {
            return Err(ConvertError::Frames.into());
        }
        #[cfg(feature = "bags")]
        if let Some(file) =
            files.iter().find(|file| file.format == Format::Db3 && is_standard(&file.path))
        {
            return Err(ConvertError::Database { file: file.name.to_string() }.into());
        }
        Ok(files)
    }

    /// Reads all of them.
    ///
    /// # Errors
    /// If something cannot be read and is not to be left out.
    pub(super) fn read(mut self, files: &[LogFile], sources: Sources) -> Result<Understood, Fault> {
        let args = self.args;
        let mut sources = sources.with_locals(&args.local);
        let frame =
            Frame::new(&args.frame).map_err(|why| ConvertError::file(&files[0].name, &why))?;
        if sources.are_gathered() {
            for source in frame.iter().flat_map(Frame::sources) {
                sources.priority(source).map_err(ConvertError::Options)?;
            }
        }
        self.log.kind = if frame.is_some() { LogKind::Frames } else { LogKind::Events };
        self.log.has_ids = frame.as_ref().is_none_or(Frame::has_ids);
        let whole = args.unit.iter().rev().find(|(key, _)| key.is_none());
        let mut mapping = Mapping {
            named: args.column.iter().map(|(key, name)| (*key, &**name)).collect(),
            events: args.event.iter().map(|(name, event)| (&**name, *event)).collect(),
            unit: whole.map_or(Unit::Ns, |(_, unit)| *unit),
            units: args.unit.iter().filter_map(|(key, unit)| Some(((*key)?, *unit))).collect(),
            missing: &args.missing,
            deadlines: &self.deadlines,
            frame,
            sources,
            names: Names::default(),
            event_names: Names::default(),
            notes: std::mem::take(&mut self.notes),
            left_out: 0,
        };
        let mut spans = Vec::new();
        for file in files {
            read_file(args, file, &mut mapping, &mut self.log, &mut spans)?;
        }
        if self.log.kind == LogKind::Spans {
            read_spans(args, &files[0].name, &spans, &mut mapping, &mut self.log)?;
        }
        if self.log.rows > 0
            && self.log.kind != LogKind::Spans
            && let Some(message) = mapping.mistyped()
        {
            if !args.explain {
                return Err(ConvertError::file(&files[0].name, &message).into());
            }
            mapping.notes.add_of_file("mistyped", &files[0].name, message);
        }
        if let Some(name) = mapping.sources.local_unseen().filter(|_| self.log.rows > 0) {
            let all = mapping.sources.found().join(", ");
            let all = if all.is_empty() { all } else { format!("; it has {all}") };
            let message = format!("no source {name:?} in the log, which --local names{all}");
            return Err(ConvertError::file(&files[0].name, &message).into());
        }
        if self.log.entries.is_empty() && !args.explain {
            let message = "no event in the log; --explain shows what was read";
            return Err(ConvertError::file(&files[0].name, message).into());
        }
        let described = mapping.names.described();
        let unused = unused(args, &mapping, self.log.kind);
        let Mapping { sources, mut notes, left_out, .. } = mapping;
        self.log.guess(&mut notes, &sources)?;
        self.log.note_unregistered(&mut notes, &sources);
        Ok(Understood { log: self.log, notes, sources, unused, described, left_out })
    }
}

/// The names in the file that nothing uses.
fn unused(args: &Args, mapping: &Mapping<'_>, kind: LogKind) -> Vec<String> {
    let names = mapping.names.iter().map(str::to_owned);
    match kind {
        LogKind::Spans => {
            let is_used = |name: &String| args.spans.uses(name) || mapping.sources.has(name);
            names.filter(|name| !is_used(name)).collect()
        }
        LogKind::Frames => {
            let is_used = |name: &String| args.frame.iter().any(|it| it.is_called(name));
            names.filter(|name| !is_used(name)).collect()
        }
        LogKind::Events => names.filter(|name| !mapping.uses(name)).collect(),
    }
}

fn read_file(
    args: &Args,
    file: &LogFile,
    mapping: &mut Mapping<'_>,
    log: &mut Log,
    spans: &mut Vec<SpanRecord>,
) -> Result<(), Fault> {
    let before = log.rows;
    let name = &file.name;
    if file.format == Format::Db3 {
        read_database(args, file, mapping, log)?;
        log.files.push(format!("{name}: {} messages", log.rows - before));
        return Ok(());
    }
    let mut reader = file.open()?;
    let content = file.looks_like(&mut *reader)?;
    let what = match content {
        Content::Trace => return Err(ConvertError::IsTrace { file: name.to_string() }.into()),
        Content::Table => {
            let source = TableSource::new(name, reader, args.separator);
            let source = source.map_err(ConvertError::from)?;
            if let Some(doubled) = source.doubled() {
                let detail = format!("{doubled:?}; the first was read");
                mapping.notes.add_of_file("two columns have the name", name, detail);
            }
            read_rows(args, source, mapping, log)?;
            "rows"
        }
        Content::Lines => {
            read_rows(args, LineSource::new(name, reader), mapping, log)?;
            "lines"
        }
        Content::Array => {
            let source = ArraySource::new(name, reader).map_err(ConvertError::from)?;
            read_rows(args, source, mapping, log)?;
            "objects"
        }
        Content::Spans => {
            let found = gather_spans(args, file, reader, mapping)?;
            log.rows += found.len() as u64;
            log.kind = LogKind::Spans;
            spans.extend(found);
            "spans"
        }
        Content::Bag => {
            let names = topics::names(&args.topic);
            let messages = MessageFile::Mcap(Box::new(RawMessages::new(reader, names)));
            let mut source = TopicSource::new(name, messages, &args.topic);
            read_rows(args, &mut source, mapping, log)?;
            source.finish(&mut mapping.notes)?;
            "messages"
        }
    };
    log.files.push(format!("{name}: {} {what}", log.rows - before));
    Ok(())
}

fn gather_spans(
    args: &Args,
    file: &LogFile,
    reader: Box<dyn std::io::BufRead>,
    mapping: &mut Mapping<'_>,
) -> Result<Vec<SpanRecord>, Fault> {
    let (spans, is_cut) = if args.truncated {
        otlp::read_truncated(&file.name, reader)?
    } else {
        (otlp::read(&file.name, reader)?, false)
    };
    if is_cut {
        mapping.notes.add_of_file(CUT, &file.name, format!("{} spans", spans.len()));
    }
    Ok(spans)
}

fn read_spans(
    args: &Args,
    file: &Arc<str>,
    spans: &[SpanRecord],
    mapping: &mut Mapping<'_>,
    log: &mut Log,
) -> Result<(), Fault> {
    let mut reader = SpanReader {
        file: Arc::clone(file),
        options: &args.spans,
        deadlines: mapping.deadlines,
        sources: &mut mapping.sources,
        names: &mut mapping.names,
        notes: &mut mapping.notes,
        skips_bad: args.skips_bad(),
        entries: Vec::new(),
        has_ids: false,
    };
    reader.read(spans)?;
    log.has_ids = reader.has_ids;
    log.entries.extend(reader.entries);
    Ok(())
}

/// `SQLite` reads the file by its name.
#[cfg(feature = "bags")]
fn read_database(
    args: &Args,
    file: &LogFile,
    mapping: &mut Mapping<'_>,
    log: &mut Log,
) -> Result<(), Fault> {
    let (path, _unpacked) = file.on_disk()?;
    let names = topics::names(&args.topic);
    let messages = crate::convert::db3::Db3Messages::open(&path, &names)
        .map_err(|error| ConvertError::at(&file.place(), &error.to_string()))?;
    let mut source = TopicSource::new(&file.name, MessageFile::Db3(messages), &args.topic);
    read_rows(args, &mut source, mapping, log)?;
    Ok(source.finish(&mut mapping.notes)?)
}

#[cfg(not(feature = "bags"))]
fn read_database(_: &Args, file: &LogFile, _: &mut Mapping<'_>, _: &mut Log) -> Result<(), Fault> {
    Err(ConvertError::NoBags { file: file.name.to_string() }.into())
}

/// Reads a source to its end.
fn read_rows(
    args: &Args,
    mut source: impl Source,
    mapping: &mut Mapping<'_>,
    log: &mut Log,
) -> Result<(), ConvertError> {
    let mut service = ServiceRows::default();
    loop {
        let row = match source.next_row() {
            Ok(None) => {
                service.finish(mapping, log);
                return Ok(());
            }
            Ok(Some(row)) => row,
            Err(problem) => match problem.kind {
                ProblemKind::Cut if args.truncated => {
                    let found = format!("{} ({})", problem.place.within(), problem.message);
                    mapping.notes.add_of_file(CUT, &problem.place.file, found);
                    service.finish(mapping, log);
                    return Ok(());
                }
                ProblemKind::Row | ProblemKind::Cut if args.skips_bad() => {
                    mapping
                        .notes
                        .add(args.skipped(), &problem.place, || without_remedy(&problem.message));
                    continue;
                }
                _ => return Err(problem.into()),
            },
        };
        let number = log.rows;
        log.rows += 1;
        for (name, value) in &row.cells {
            mapping.names.add(name);
            if args.explain {
                mapping.names.add_value(name, value);
            }
        }
        match events_of(args, &row, number, mapping, &mut service) {
            Ok(entries) => log.entries.extend(entries),
            Err(refusal) if args.skips_bad() => {
                mapping.notes.add(args.skipped(), &row.place, || without_remedy(&refusal.message));
            }
            Err(refusal) => return Err(refused(&row, &refusal, source, mapping)),
        }
    }
}

/// What is wrong, without what the user can do about it.
fn without_remedy(message: &str) -> String {
    message.split("; ").next().unwrap_or_default().to_owned()
}

/// The events of a row: one, those of a frame, or one for each meaning of its topic.
fn events_of(
    args: &Args,
    row: &Row,
    number: u64,
    mapping: &mut Mapping<'_>,
    service: &mut ServiceRows,
) -> Result<Vec<Entry>, Refusal> {
    let Some(topic) = row.topic else { return mapping.entries(row, number, &Fixed::default()) };
    let names = topics::names(&args.topic);
    let mut entries = Vec::new();
    for choice in args.topic.iter().filter(|choice| *choice.name == *names[topic]) {
        let Some(side) = choice.means(row) else { continue };
        entries.extend(mapping.entries(row, number, &choice.fixed())?);
        service.take(side, row, number);
    }
    Ok(entries)
}

/// Why a row is refused: because a name that the user gave occurs nowhere, or for its own sake.
fn refused(
    row: &Row,
    refusal: &Refusal,
    mut source: impl Source,
    mapping: &mut Mapping<'_>,
) -> ConvertError {
    if let Some(name) = &refusal.lacks {
        while !mapping.names.has(name) {
            match source.next_row() {
                Ok(Some(row)) => row.cells.iter().for_each(|(name, _)| mapping.names.add(name)),
                Err(Problem { kind: ProblemKind::Row, .. }) => {}
                Ok(None) | Err(_) => break,
            }
        }
        if let Some(message) = mapping.mistyped().filter(|_| !mapping.names.has(name)) {
            return ConvertError::file(&row.place.file, &message);
        }
    }
    ConvertError::at(&row.place, &refusal.message)
}

impl<S: Source> Source for &mut S {
    fn next_row(&mut self) -> Result<Option<Row>, Problem> {
        (**self).next_row()
    }
}
