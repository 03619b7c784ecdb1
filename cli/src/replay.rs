//! `fuseline replay`: applies inputs to the core and prints the whole trace.

use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::PathBuf;

use fuseline_engine::arbiter::Arbiter;
use fuseline_traces::packed::unpack;
use fuseline_traces::{Event, Events};

use crate::decide::AnnotatedAnswers;
use crate::exit::Exit;
use crate::fault::Fault;
use crate::input::open;
use crate::output::refuse_onto_stdout;

/// The number of bytes of the input that are read at once.
const CHUNK: usize = 64 * 1024;

#[derive(clap::Args)]
#[command(after_help = "\
Decision lines in the input are skipped, so a whole trace can be replayed. Each input is answered as
soon as it is read, so you can also type inputs by hand.

Examples:
  fuseline replay fuseline-trace.jsonl | cmp - fuseline-trace.jsonl
  some-program | fuseline replay | fuseline check")]
pub(crate) struct Args {
    /// A header and inputs, or a whole trace; - is standard input.
    #[arg(default_value = "-")]
    file: PathBuf,
}

/// Answers each input of the file on standard output.
pub(crate) fn replay(args: &Args) -> Result<Exit, Fault> {
    refuse_onto_stdout(&[&args.file])?;
    let (name, file) = open(&args.file)?;
    let file = unpack(BufReader::with_capacity(CHUNK, file))
        .map_err(|source| Fault::Open { name: name.clone(), source })?;
    let reader = Events::new(name.as_str(), BufReader::with_capacity(CHUNK, file))?;
    let arbiter = Arbiter::new(reader.header()).map_err(|source| Fault::Config { name, source })?;
    answer(reader, arbiter, BufWriter::with_capacity(CHUNK, io::stdout().lock()))?;
    Ok(Exit::Conforms)
}

fn answer<R: Read>(
    mut reader: Events<BufReader<R>>,
    mut arbiter: Arbiter,
    mut out: BufWriter<impl Write>,
) -> Result<(), Fault> {
    let mut answers = AnnotatedAnswers::default();
    let mut answer = reader.raw().to_vec();
    answer.push(b'\n');
    loop {
        out.write_all(&answer).map_err(Fault::Output)?;
        // A user who types inputs waits for the answer before the next one.
        if reader.inner().buffer().is_empty() {
            out.flush().map_err(Fault::Output)?;
        }
        answer.clear();
        match reader.next_event()? {
            Some(Event::Input(input)) => {
                answer.extend_from_slice(reader.raw());
                answer.push(b'\n');
                answers.decide(&mut arbiter, &input, reader.annotations(), &mut answer);
            }
            Some(Event::Decision(_)) => {}
            None => return out.flush().map_err(Fault::Output),
        }
    }
}
