//! Traces as they are written: one, or one for each run.

use std::io::{self, BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};

use fuseline_traces::packed::{MessageError, Messages};
use fuseline_traces::{
    Annotations, Decision, Event, Events, Header, HeaderAnnotations, Input, Line,
};

use crate::convert::files::LogFile;
use crate::convert::log::{OrderOptions, Run};
use crate::convert::notes::Notes;
use crate::convert::reading::{self, Understood};
use crate::convert::row::Problem;
use crate::convert::{Args, OptionError};
use crate::diagnostics::print_line;
use crate::exit::Exit;
use crate::fault::Fault;
use crate::input::open;
use crate::output::Output;

/// A header with its further keys.
pub(super) type AnnotatedHeader = (Header, HeaderAnnotations);

/// Reads the header that a file begins with.
pub(super) fn read_header(path: &Path) -> Result<AnnotatedHeader, Fault> {
    let (name, file) = open(path)?;
    let events = Events::observed(name, BufReader::new(file))?;
    Ok((events.header().clone(), events.header_annotations().clone()))
}

/// Writes to the output, or to standard output if there is none.
fn put(
    output: Option<&Output>,
    write: &mut dyn FnMut(&mut dyn Write) -> Result<(), Fault>,
) -> Result<Exit, Fault> {
    let mut flushed = |out: &mut dyn Write| {
        write(out)?;
        out.flush().map_err(Fault::Output)
    };
    match output {
        Some(output) => output.write(|out| flushed(out))?,
        None => flushed(&mut BufWriter::new(io::stdout().lock()))?,
    }
    Ok(Exit::Conforms)
}

/// Writes one line.
fn put_line(out: &mut dyn Write, line: &mut Vec<u8>) -> Result<(), Fault> {
    line.push(b'\n');
    let written = out.write_all(line).map_err(Fault::Output);
    line.clear();
    written
}

fn header_line((header, annotations): &AnnotatedHeader) -> Vec<u8> {
    let mut line = Vec::new();
    header.write_annotated(annotations, &mut line);
    line
}

pub(super) fn put_header(output: Option<&Output>, header: Header) -> Result<Exit, Fault> {
    let header = (header, HeaderAnnotations::default());
    put(output, &mut |out| put_line(out, &mut header_line(&header)))
}

/// Reads a log and writes its trace, or one trace for each run.
pub(super) fn write_runs(
    args: &Args,
    files: &[LogFile],
    header: &AnnotatedHeader,
    notes: Notes,
    output: Option<&Output>,
    inputs: &[&Path],
) -> Result<Exit, Fault> {
    let understand = |notes: Notes| -> Result<(Vec<Run>, Notes), Fault> {
        let Understood { log, mut notes, .. } = reading::read(args, files, Some(&header.0), notes)?;
        let (runs, _) = log.runs(OrderOptions::of(args), &mut notes)?;
        for run in &runs {
            run.doubt(&mut notes);
        }
        Ok((runs, notes))
    };
    if !args.split {
        let mut notes = Some(notes);
        // The output begins first, so that what cannot be written is known before a long log is
        // read.
        return put(output, &mut |out| {
            let (runs, notes) = understand(notes.take().unwrap_or_default())?;
            runs.iter().try_for_each(|run| write_run(out, header, run))?;
            notes.print();
            Ok(())
        });
    }
    let (runs, notes) = understand(notes)?;
    let path = args.output.as_deref().ok_or(OptionError::Split)?;
    let paths: Vec<PathBuf> = match runs.len() {
        1 => vec![path.to_owned()],
        count => (1..=count).map(|number| numbered(path, number)).collect(),
    };
    let outputs = paths.iter().map(|path| Output::new(path, inputs, args.overwrite));
    let outputs = outputs.collect::<Result<Vec<_>, _>>()?;
    for (run, output) in runs.iter().zip(&outputs) {
        put(Some(output), &mut |out| write_run(out, header, run))?;
        let first = run.entries.first().map_or_else(String::new, |entry| entry.place.within());
        let (name, count) = (output.name(), run.entries.len());
        print_line(format_args!("note: {name}: a run of {count} events, from {first}"));
    }
    notes.print();
    Ok(Exit::Conforms)
}

/// Returns `trace-2.jsonl` for `trace.jsonl`.
fn numbered(path: &Path, number: usize) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let end = path.extension().map(|end| format!(".{}", end.to_string_lossy()));
    path.with_file_name(format!("{stem}-{number}{}", end.unwrap_or_default()))
}

fn write_run(out: &mut dyn Write, header: &AnnotatedHeader, run: &Run) -> Result<(), Fault> {
    let mut line = header_line(header);
    put_line(out, &mut line)?;
    for entry in &run.entries {
        run.write(entry, &mut line)?;
        put_line(out, &mut line)?;
    }
    Ok(())
}

/// The messages of a recording that has the lines of a trace.
pub(super) struct RecordedTrace<'a> {
    file: &'a LogFile,
    messages: Messages<'a>,
    /// If true, a file that was cut off may end early.
    truncated: bool,
    /// The first event, if it came where a header was expected.
    first: Option<(Event, Annotations)>,
}

impl<'a> RecordedTrace<'a> {
    pub(super) fn open(args: &Args, file: &'a LogFile, topic: &'a str) -> Result<Self, Fault> {
        let messages = Messages::new(file.open()?, topic);
        Ok(Self { file, messages, truncated: args.truncated, first: None })
    }

    fn line(&mut self) -> Result<Option<Line>, Problem> {
        let line = self.messages.line();
        match line {
            Err(error) if self.truncated && error.is_cut() => {
                let name = &self.file.name;
                print_line(format_args!("note: {name}: the file is cut off ({error})"));
                Ok(None)
            }
            line => line.map_err(|error| self.problem(&error)),
        }
    }

    fn problem(&self, error: &MessageError) -> Problem {
        let remedy = match error {
            MessageError::None(_) => "; name another with --topic",
            MessageError::Encoding { .. } => {
                "; if they are not lines of a trace, name their fields with --column"
            }
            error if error.is_cut() => "; read everything before that with --truncated",
            _ => "",
        };
        Problem::of_file(&self.file.name, format!("{error}{remedy}"))
    }

    /// Returns the recording's own header, if it has one.
    pub(super) fn header(&mut self) -> Result<Option<AnnotatedHeader>, Problem> {
        match self.line()? {
            Some(Line::Header(header)) => {
                Ok(Some((header, self.messages.header_annotations().clone())))
            }
            Some(Line::Event(event)) => {
                self.first = Some((event, self.messages.annotations().clone()));
                Ok(None)
            }
            None => Err(self.problem(&self.messages.none())),
        }
    }

    /// Returns the next event; none at the end.
    fn event(&mut self) -> Result<Option<(Event, Annotations)>, Problem> {
        if let Some(event) = self.first.take() {
            return Ok(Some(event));
        }
        match self.line()? {
            None => Ok(None),
            Some(Line::Event(event)) => Ok(Some((event, self.messages.annotations().clone()))),
            Some(Line::Header(_)) => {
                let number = self.messages.number();
                let message = format!(
                    "message {number}: the file has a second header; put each trace in its own file"
                );
                Err(Problem::of_file(&self.file.name, message))
            }
        }
    }
}

/// Writes the trace whose lines a recording has.
pub(super) fn write_recording(
    args: &Args,
    files: &[LogFile],
    given: Option<AnnotatedHeader>,
    output: Option<&Output>,
) -> Result<Exit, Fault> {
    let [topic] = &args.topic[..] else { return Err(OptionError::Topics.into()) };
    let [file] = files else { return Err(OptionError::Recordings.into()) };
    let mut recorded = RecordedTrace::open(args, file, &topic.name)?;
    let own = recorded.header()?;
    let header = given.or(own).ok_or_else(|| no_header(file))?;
    put(output, &mut |out| {
        let mut line = header_line(&header);
        put_line(out, &mut line)?;
        let mut events = Vec::new();
        while let Some((event, annotations)) = recorded.event()? {
            if args.sort {
                events.push((event, annotations));
                continue;
            }
            event.write_annotated(&annotations, &mut line);
            put_line(out, &mut line)?;
        }
        events.sort_by_key(|(event, _)| match event {
            Event::Input(input) => Input::at(input),
            Event::Decision(decision) => Decision::at(decision),
        });
        for (event, annotations) in &events {
            event.write_annotated(annotations, &mut line);
            put_line(out, &mut line)?;
        }
        Ok(())
    })
}

/// Returns the problem of a log without a header.
pub(super) fn no_header(file: &LogFile) -> Problem {
    let message = "there is no header; give --header FILE, a file that begins with \
                   {\"fuseline\":1,…}, or make one with --write-header";
    Problem::of_file(&file.name, message)
}
