//! [`LogReader`]: the one pass over the files of a log that `convert`, `--explain` and `--write-header` share.

use std::sync::Arc;

use fuseline_traces::Header;
use fuseline_traces::packed::RawMessages;

use crate::convert::Args;
use crate::convert::entry::{Entry, Sources};
use crate::convert::files::{Content, LogFile, PART};
use crate::convert::frame;
use crate::convert::json::{LineRows, array};
use crate::convert::log::{Log, LogKind};
use crate::convert::mapping::{Mapping, Named, View, ViewKind};
use crate::convert::notes::{Names, Notes, listed, unknown};
use crate::convert::otlp::{self, SpanRecord};
use crate::convert::row::{Problem, ProblemKind, ReadRow, Row};
use crate::convert::spans::SpanReader;
use crate::convert::table::TableRows;
use crate::convert::time::Unit;
use crate::convert::topics::{self, Recording, ServiceRows, TopicRows, side};
use crate::fault::Fault;

const SKIPPED: &str = "rows skipped, because they cannot be read";
const UNREADABLE: &str = "rows that cannot be read, at which convert stops without --skip-bad";
const CUT: &str = "the file is cut off; read up to its last whole row";

/// Reads the files of a log.
struct LogReader<'a> {
    args: &'a Args,
    mapping: Mapping<'a>,
    views: Vec<View<'a>>,
    /// The names that the user gave, with the options.
    given: (&'static str, Vec<Named<'a>>),
    topics: Vec<&'a str>,
    /// The topics that recordings have, if there is one, and those among them that have messages.
    recorded: Option<Names>,
    spoken: Names,
    log: Log,
    spans: Vec<SpanRecord>,
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
    /// The number of events that were left out at the user's request.
    pub(super) left_out: u64,
}

/// Reads all files; without a header any source is taken.
pub(super) fn read(
    args: &Args,
    files: &[LogFile],
    header: Option<&Header>,
    notes: Notes,
) -> Result<Understood, Fault> {
    let mut reader = LogReader::new(args, header, notes)
        .map_err(|message| Problem::of_file(&files[0].name, message))?;
    for file in files {
        reader.read_file(file)?;
    }
    Ok(reader.finish(&files[0].name)?)
}

impl<'a> LogReader<'a> {
    fn new(args: &'a Args, header: Option<&Header>, notes: Notes) -> Result<Self, String> {
        let topics = topics::names(&args.topic);
        let given: (_, Vec<Named<'_>>) = if args.frame.is_empty() {
            let named = args.column.iter();
            let named =
                named.map(|(key, name)| Named { key, what: (*key).into(), name: name.into() });
            (ViewKind::Column.option_and_noun().0, named.collect())
        } else {
            (
                ViewKind::Frame.option_and_noun().0,
                args.frame.iter().map(|column| column.named()).collect(),
            )
        };
        let column = |topic, event, source| {
            // The last one counts.
            let named = given.1.iter().rev().cloned().collect();
            View { kind: ViewKind::Column, topic, event, source, named }
        };
        let of_topics = args.topic.iter().map(|choice| {
            let topic = topics.iter().position(|name| *name == choice.name);
            column(topic, choice.event, choice.source.as_deref())
        });
        let views = if args.frame.is_empty() {
            of_topics.chain([column(None, None, None)]).collect()
        } else {
            frame::views(&args.frame)?
        };
        let mut sources = Sources::new(header, &args.local);
        let of_frames = args.frame.iter().filter_map(|it| Some(("--frame", it.source()?)));
        let of_topics = args.topic.iter().filter_map(|it| Some(("--topic", it.source.as_deref()?)));
        for (option, source) in of_frames.chain(of_topics) {
            let known = sources.priority(source);
            known.map_err(|why| format!("{option} {source}.…: {source:?} is {why}"))?;
        }
        let mapping = Mapping {
            events: args.event.iter().map(|(name, event)| (&**name, *event)).collect(),
            unit: args.unit.iter().rev().find(|(key, _)| key.is_none()).map_or(Unit::Ns, |it| it.1),
            units: args.unit.iter().filter_map(|(key, unit)| Some(((*key)?, *unit))).collect(),
            missing: &args.missing,
            deadlines: &args.deadline,
            sources,
            names: Names::default(),
            notes,
            left_out: 0,
        };
        let mut log = Log::default();
        if !args.frame.is_empty() {
            log.kind = LogKind::Frames;
        }
        log.has_ids = args.frame.is_empty() || given.1.iter().any(|named| named.key == "t");
        let (recorded, spoken, spans) = Default::default();
        Ok(Self { args, mapping, views, given, topics, recorded, spoken, log, spans })
    }

    /// Leaves out a row that cannot be read, if that is to be; `--explain` shows the others at
    /// least.
    fn skip(&mut self, problem: Problem) -> Result<(), Problem> {
        let Some(kind) = self.skipped() else { return Err(problem) };
        let detail = || problem.without_remedy();
        self.mapping.notes.add_with(kind, &problem.place, detail, || problem.remedy());
        Ok(())
    }

    fn skipped(&self) -> Option<&'static str> {
        let unreadable = self.args.explain.then_some(UNREADABLE);
        if self.args.skip_bad { Some(SKIPPED) } else { unreadable }
    }

    fn read_file(&mut self, file: &LogFile) -> Result<(), Fault> {
        let (args, name, before) = (self.args, &file.name, self.log.rows);
        if file.format == crate::convert::files::Format::Db3 {
            self.read_database(file)?;
            self.log.files.push(format!("{name}: {} messages", self.log.rows - before));
            return Ok(());
        }
        let mut reader = file.open()?;
        let what = match file.content(&mut *reader)? {
            Content::Trace => {
                let message = "it is a trace already; judge it with `fuseline check`";
                return Err(Problem::of_file(name, message).into());
            }
            Content::Table => {
                let rows = TableRows::new(name, reader, args.separator)?;
                if let Some(doubled) = rows.doubled() {
                    let detail = format!("{doubled:?}; the first was read");
                    self.mapping.notes.add_of_file("two columns have the name", name, detail);
                }
                self.read_rows(rows)?;
                "rows"
            }
            Content::Lines => {
                self.read_rows(LineRows::new(name, reader))?;
                "lines"
            }
            Content::Array => {
                self.read_rows(array(name, &mut reader)?)?;
                "objects"
            }
            Content::Spans => {
                self.log.kind = LogKind::Spans;
                for span in otlp::read(name, reader)? {
                    match span {
                        Ok(span) => self.spans.push(span),
                        Err(problem) => self.lose(problem)?,
                    }
                }
                self.log.rows = self.spans.len() as u64;
                "spans"
            }
            Content::Bag => {
                self.read_recording(file, RawMessages::new(reader, self.topics.clone()))?;
                "messages"
            }
        };
        self.log.files.push(format!("{name}: {} {what}", self.log.rows - before));
        Ok(())
    }

    /// Lets `SQLite` read the file by its name.
    fn read_database(&mut self, file: &LogFile) -> Result<(), Fault> {
        let (path, _unpacked) = file.on_disk()?;
        let messages = crate::convert::db3::Db3Messages::open(&path, &self.topics);
        let messages = messages.map_err(|message| Problem::of_file(&file.name, message))?;
        Ok(self.read_recording(file, messages)?)
    }

    fn read_recording(&mut self, file: &LogFile, recording: impl Recording) -> Result<(), Problem> {
        let mut rows = TopicRows::new(&file.name, Box::new(recording), &self.topics);
        self.read_rows(&mut rows)?;
        let recorded = self.recorded.get_or_insert_default();
        rows.recording.topics().iter().for_each(|topic| recorded.add(topic));
        Ok(())
    }

    /// Takes what cannot be read: the end of a file that is cut off, or a row that can be left out.
    fn lose(&mut self, problem: Problem) -> Result<(), Problem> {
        match problem.kind {
            ProblemKind::Cut if self.args.truncated => {
                let found = format!("{} ({})", problem.place.within(), problem.without_remedy());
                self.mapping.notes.add_of_file(CUT, &problem.place.file, found);
                Ok(())
            }
            ProblemKind::File => Err(problem),
            _ => self.skip(problem),
        }
    }

    /// Reads a source to its end.
    fn read_rows(&mut self, mut rows: impl Iterator<Item = ReadRow>) -> Result<(), Problem> {
        let mut service = ServiceRows::default();
        while let Some(row) = rows.next() {
            let row = match row {
                Ok(row) => row,
                Err(problem) => {
                    let is_end = problem.kind == ProblemKind::Cut;
                    self.lose(problem)?;
                    if is_end {
                        break;
                    }
                    continue;
                }
            };
            let number = self.log.rows;
            self.log.rows += 1;
            for (name, value) in &row.cells {
                self.mapping.names.add(name);
                if self.args.explain {
                    self.mapping.names.add_value(name, value);
                }
            }
            match self.entries(&row, number, &mut service) {
                Ok(entries) => self.log.entries.extend(entries),
                Err(problem) => {
                    let problem = self.skip(problem).err();
                    problem.map_or(Ok(()), |problem| Err(self.explained(problem, &mut rows)))?;
                }
            }
        }
        service.finish(&mut self.mapping.notes, &mut self.log);
        Ok(())
    }

    /// Returns the events of a row: one, those of a frame, or one for each meaning of its topic.
    fn entries(
        &mut self,
        row: &Row,
        number: u64,
        service: &mut ServiceRows,
    ) -> Result<Vec<Entry>, Problem> {
        let mut entries = Vec::new();
        for view in self.views.iter().filter(|view| view.topic == row.topic) {
            if let Some(topic) = row.topic {
                let name = self.topics[topic];
                self.spoken.add(name);
                let Some(side) = side(name, view.event, row) else { continue };
                service.take(side, row, number);
            }
            entries.extend(self.mapping.entry(row, number, view)?);
        }
        Ok(entries)
    }

    /// Says why a row is refused: a name that the user gave occurs nowhere, or the row itself is
    /// wrong.
    fn explained(&mut self, problem: Problem, rows: &mut dyn Iterator<Item = ReadRow>) -> Problem {
        let ProblemKind::Lacks(name) = &problem.kind else { return problem };
        while !self.mapping.names.has(name) {
            match rows.next() {
                Some(Ok(row)) => {
                    row.cells.iter().for_each(|(name, _)| self.mapping.names.add(name));
                }
                Some(Err(Problem { kind: ProblemKind::Row, .. })) => {}
                Some(Err(_)) | None => break,
            }
        }
        let mistyped = self.mapping.mistyped(self.given.0, &self.given.1);
        let mistyped = mistyped.filter(|_| !self.mapping.names.has(name));
        mistyped.map_or(problem.clone(), |message| Problem::of_file(&problem.place.file, message))
    }

    /// Reads spans, once all files were read, and looks for names that occur nowhere.
    fn finish(mut self, file: &Arc<str>) -> Result<Understood, Problem> {
        if self.log.kind == LogKind::Spans {
            self.read_spans(file)?;
        }
        for message in self.mistyped(file) {
            if !self.args.explain {
                return Err(Problem::of_file(file, message));
            }
            self.mapping.notes.add_of_file("mistyped", file, message);
        }
        if self.log.entries.is_empty() && !self.args.explain {
            let message = "the log has no event; see with --explain what was read";
            return Err(Problem::of_file(file, message));
        }
        let Self { args, mut mapping, mut log, views, given, recorded, .. } = self;
        let topics = recorded.iter().flat_map(Names::iter).map(|it| format!("topic {it}"));
        let described = topics.chain(mapping.names.described()).collect();
        let is_used = |name: &str| match log.kind {
            LogKind::Spans => args.spans.uses(name) || mapping.sources.has(name),
            LogKind::Frames => given.1.iter().any(|named| named.name == name),
            LogKind::Events => views.iter().any(|view| view.uses(name)),
        };
        let unused = mapping.names.iter().filter(|name| !is_used(name)).map(str::to_owned);
        let unused = unused.collect();
        log.guess(&mut mapping.notes, &mapping.sources)?;
        log.note_unregistered(&mut mapping.notes, &mapping.sources);
        log.note_silent_sources(&mut mapping.notes, &mapping.sources);
        let Mapping { sources, notes, left_out, .. } = mapping;
        Ok(Understood { log, notes, sources, unused, described, left_out })
    }

    fn read_spans(&mut self, file: &Arc<str>) -> Result<(), Problem> {
        // The units of spans are their own.
        self.mapping.unit = Unit::Ns;
        self.mapping.units.clear();
        let (options, skipped) = (&self.args.spans, self.skipped());
        let mapping = &mut self.mapping;
        let mut reader =
            SpanReader { options, mapping, skipped, entries: Vec::new(), has_ids: false };
        reader.read(file, &self.spans)?;
        self.log.has_ids = reader.has_ids;
        self.log.entries.extend(reader.entries);
        Ok(())
    }

    /// Names that the user gave and that occur nowhere.
    fn mistyped(&mut self, file: &Arc<str>) -> Vec<String> {
        let Self { args, mapping, .. } = self;
        let mut all = Vec::new();
        for (choice, recorded) in args.topic.iter().zip(self.recorded.iter().cycle()) {
            let name = &choice.name;
            if !recorded.has(name) && mapping.notes.has(PART) {
                mapping.notes.add_of_file("no topic in this part", file, name.clone());
            } else if !recorded.has(name) {
                let option = format!("--topic {}", choice.option);
                all.push(unknown("topic", name, &option, recorded.iter()));
            } else if !self.spoken.has(name) {
                mapping.notes.add_of_file("no message of topic", file, name.clone());
            }
        }
        if self.log.rows == 0 {
            return all;
        }
        if self.log.kind != LogKind::Spans {
            all.extend(mapping.mistyped(self.given.0, &self.given.1));
        }
        let sources = &mapping.sources;
        let unknown_source = |name: &str, option: String| {
            let has = listed(name, sources.names().filter(|known| *known != name));
            let file = if sources.are_gathered() { "log" } else { "header" };
            format!("{option}: the log has no source {name:?}; the {file} has {has}")
        };
        all.extend(sources.local_unseen().map(|name| unknown_source(name, "--local".to_owned())));
        for name in args.deadline.iter().filter_map(|(name, _)| name.as_deref()) {
            if !sources.has(name) {
                all.push(unknown_source(name, format!("--deadline {name}=")));
            }
        }
        all
    }
}
