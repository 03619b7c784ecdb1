//! `fuseline impl`: answers with the core's decisions, by the protocol of `fuseline drive`.

use std::io::{self, BufRead, BufReader, Read, Write};

use fuseline_engine::arbiter::Arbiter;
use fuseline_traces::{Event, LINE, Line, parse_annotated};
use thiserror::Error;

use crate::decide::AnnotatedAnswers;
use crate::exit::Exit;
use crate::fault::Fault;

/// The line that ends an answer.
const DONE: &[u8] = b"{\"ev\":\"done\"}\n";
/// The number of bytes that are read at once.
const CHUNK: usize = 64 * 1024;

#[derive(clap::Args)]
#[command(after_help = "\
Reads a header and inputs, one a line, and answers each line with its decisions and then
{\"ev\":\"done\"}. A further header begins the next run.

Examples:
  fuseline drive -- fuseline impl
  fuseline impl < traces/corpus/f3-forwarded-at-once.jsonl     decisions are refused: inputs only")]
pub(crate) struct Args {}

/// A line that cannot be answered.
#[derive(Debug, Error)]
#[error("stdin:{line}:{column}: {message}")]
struct LineError {
    line: u64,
    column: u64,
    message: String,
}

/// Answers standard input until it ends.
pub(crate) fn answer(_: &Args) -> Result<Exit, Fault> {
    let mut input = BufReader::with_capacity(CHUNK, io::stdin().lock());
    let mut out = io::stdout().lock();
    let (mut arbiter, mut line, mut answer) = (None, Vec::new(), Vec::new());
    let mut answers = AnnotatedAnswers::default();
    for number in 1.. {
        line.clear();
        let most = LINE as u64 + 1;
        let read = (&mut input).take(most).read_until(b'\n', &mut line);
        if read.map_err(|source| Fault::Open { name: "stdin".to_owned(), source })? == 0 {
            break;
        }
        let fault = |message, column| Fault::own(LineError { line: number, column, message });
        let Some(text) = line.strip_suffix(b"\n") else {
            let message = "the line does not end in LF, or is longer than 64 KiB".to_owned();
            return Err(fault(message, line.len() as u64 + 1));
        };
        match (parse_annotated(text), &mut arbiter) {
            (Ok((Line::Header(header), _)), arbiter) => {
                answers = AnnotatedAnswers::default();
                let created = Arbiter::new(&header);
                let name = "stdin".to_owned();
                *arbiter = Some(created.map_err(|source| Fault::Config { name, source })?);
            }
            (Ok((Line::Event(Event::Input(input)), keys)), Some(arbiter)) => {
                answers.decide(arbiter, &input, &keys, &mut answer);
            }
            (Ok((Line::Event(Event::Input(_)), _)), None) => {
                return Err(fault(
                    "the input comes before any header; begin with a header".to_owned(),
                    1,
                ));
            }
            (Ok((Line::Event(Event::Decision(_)), _)), _) => {
                return Err(fault(
                    "the line is a decision; give a header and inputs".to_owned(),
                    1,
                ));
            }
            (Err(error), _) => return Err(fault(error.message, error.column)),
        }
        answer.extend_from_slice(DONE);
        // The other side waits for the answer unless it has already sent more.
        if input.buffer().is_empty() || answer.len() >= CHUNK {
            out.write_all(&answer).and_then(|()| out.flush()).map_err(Fault::Output)?;
            answer.clear();
        }
    }
    Ok(Exit::Conforms)
}
