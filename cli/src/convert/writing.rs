//! Traces as they are written: one, or one for each run.

use std::io::{self, BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};

use fuseline_traces::{Decision, Event, Events, Header, Input};

use crate::complain::complain;
use crate::convert::Args;
use crate::convert::entry::Sources;
use crate::convert::files::LogFile;
use crate::convert::log::{OrderOptions, Run};
use crate::convert::mcap::McapInput;
use crate::convert::reading::{LogReader, Understood};
use crate::convert::recorded::{AnnotatedHeader, ConvertError};
use crate::convert::row::Notes;
use crate::exit::Exit;
use crate::fault::Fault;
use crate::input::open;
use crate::output::Output;

/// Reads the header that a file begins with.
pub(super) fn read_header(path: &Path) -> Result<AnnotatedHeader, Fault> {
    let (name, file) = open(path)?;
    let events = Events::observed(name, BufReader::new(file))?;
    Ok((events.header().clone(), events.header_annotations().clone()))
}

/// The sources that a header has, with their priorities.
pub(super) fn sources(header: &Header) -> impl Iterator<Item = (String, u64)> {
    let named = header.clouds.iter().map(|cloud| {
        let name = cloud.name.clone().unwrap_or_else(|| cloud.p.to_string());
        (name, u64::from(cloud.p))
    });
    [("local".to_owned(), 0)].into_iter().chain(named)
}

pub(super) fn put_header(output: Option<&Output>, header: &Header) -> Result<Exit, Fault> {
    put(output, &mut |out| {
        let mut line = Vec::new();
        header.write(&mut line);
        line.push(b'\n');
        out.write_all(&line).and_then(|()| out.flush()).map_err(Fault::Output)
    })
}

/// Writes to the output, or to standard output if there is none.
fn put(
    output: Option<&Output>,
    write: &mut dyn FnMut(&mut dyn Write) -> Result<(), Fault>,
) -> Result<Exit, Fault> {
    match output {
        Some(output) => output.write(|out| write(out))?,
        None => write(&mut BufWriter::new(io::stdout().lock()))?,
    }
    Ok(Exit::Conforms)
}

/// Reads a log and writes its trace, or one trace for each run.
pub(super) fn write_runs(
    args: &Args,
    reader: LogReader<'_>,
    files: &[LogFile],
    header: &AnnotatedHeader,
    sources: &Sources,
    output: Option<&Output>,
    inputs: &[&Path],
) -> Result<Exit, Fault> {
    let order = OrderOptions { is_sorted: args.sort, is_split: args.split, is_unique: args.unique };
    let understand = |reader: LogReader<'_>| -> Result<(Vec<Run>, Notes), Fault> {
        let Understood { log, mut notes, .. } = reader.read(files, sources.clone())?;
        let (runs, _) = log.runs(order, &mut notes)?;
        for run in &runs {
            run.doubt(&mut notes);
        }
        Ok((runs, notes))
    };
    if !args.split {
        let mut reader = Some(reader);
        // The output begins first, so that what cannot be written is known before a long log is read.
        return put(output, &mut |out| {
            let Some(reader) = reader.take() else { return Ok(()) };
            let (runs, notes) = understand(reader)?;
            for run in &runs {
                write_run(out, header, run)?;
            }
            notes.complain();
            Ok(())
        });
    }
    let (runs, notes) = understand(reader)?;
    let path = args.output.as_deref().ok_or(ConvertError::Split)?;
    let paths: Vec<PathBuf> = match runs.len() {
        1 => vec![path.to_owned()],
        count => (1..=count).map(|number| numbered(path, number)).collect(),
    };
    let outputs = paths.iter().map(|path| Output::new(path, inputs, args.overwrite));
    let outputs = outputs.collect::<Result<Vec<_>, _>>()?;
    for (run, output) in runs.iter().zip(&outputs) {
        put(Some(output), &mut |out| write_run(out, header, run))?;
        let first = run.entries.first().map_or_else(String::new, |entry| entry.place.within());
        complain(format_args!(
            "note: {}: a run of {} events, from {first}",
            output.name(),
            run.entries.len()
        ));
    }
    notes.complain();
    Ok(Exit::Conforms)
}

/// `trace-2.jsonl` for `trace.jsonl`.
fn numbered(path: &Path, number: usize) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let end = path.extension().map(|end| format!(".{}", end.to_string_lossy()));
    path.with_file_name(format!("{stem}-{number}{}", end.unwrap_or_default()))
}

fn write_run(out: &mut dyn Write, header: &AnnotatedHeader, run: &Run) -> Result<(), Fault> {
    let mut line = Vec::new();
    header.0.write_annotated(&header.1, &mut line);
    line.push(b'\n');
    out.write_all(&line).map_err(Fault::Output)?;
    for entry in &run.entries {
        line.clear();
        run.write(entry, &mut line)?;
        line.push(b'\n');
        out.write_all(&line).map_err(Fault::Output)?;
    }
    out.flush().map_err(Fault::Output)
}

/// Writes the trace whose lines a recording has.
pub(super) fn write_recording(
    args: &Args,
    files: &[LogFile],
    given: Option<AnnotatedHeader>,
    output: Option<&Output>,
) -> Result<Exit, Fault> {
    let [topic] = &args.topic[..] else { return Err(ConvertError::Topics.into()) };
    let [file] = files else {
        let message = "one recording at a time; its parts are read with --column".to_owned();
        return Err(ConvertError::Options(message).into());
    };
    let name = file.name.to_string();
    if args.explain {
        return Err(ConvertError::IsTrace { file: name }.into());
    }
    let mut recorded = McapInput::new(&name, file.open()?, &topic.name);
    let own = recorded.header()?;
    let (header, annotations) =
        given.or(own).ok_or_else(|| ConvertError::NoHeader { file: name.clone() })?;
    put(output, &mut |out| {
        let mut line = Vec::new();
        header.write_annotated(&annotations, &mut line);
        line.push(b'\n');
        let mut events = Vec::new();
        while let Some((event, annotations)) = recorded.next_event()? {
            if args.sort {
                events.push((event, annotations));
                continue;
            }
            event.write_annotated(&annotations, &mut line);
            line.push(b'\n');
            out.write_all(&line).map_err(Fault::Output)?;
            line.clear();
        }
        events.sort_by_key(|(event, _)| at(event));
        for (event, annotations) in &events {
            event.write_annotated(annotations, &mut line);
            line.push(b'\n');
        }
        out.write_all(&line).and_then(|()| out.flush()).map_err(Fault::Output)
    })
}

const fn at(event: &Event) -> u64 {
    match event {
        Event::Input(input) => Input::at(input),
        Event::Decision(decision) => Decision::at(decision),
    }
}
