//! Compares a machine of the rules with the core and the reference machine, on many generated
//! inputs.
//!
//! `campaign INPUTS SEED COMMAND…` sends runs with INPUTS inputs in all to the command. It works as
//! `fuseline drive` does, but does not wait for answers. The core and the reference machine must
//! decide the same, and the command must write the same bytes. The last line says what was
//! compared. The exit code is 1 if there is a difference or the command ended.

use std::io::{self, BufReader, BufWriter, Read, Write};
use std::process::{ChildStdin, ChildStdout, Command, ExitCode, Stdio};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

use fuseline_engine::arbiter::Arbiter;
use fuseline_testkit::{Generator, Run};
use fuseline_traces::Reference;

/// One in this many of the runs that fill the greatest window is sent, because a machine of lists
/// takes seconds for it.
const FULL_WINDOWS: u64 = 200;
/// A run with more inputs than this is one of those.
const MOST_INPUTS: usize = 4_000;
/// The number of runs that the command may lag behind.
const AHEAD: usize = 4_096;
const DONE: &[u8] = b"{\"ev\":\"done\"}\n";

/// A run that was sent, and the answer that must come back.
struct SentRun {
    name: String,
    answer: Vec<u8>,
}

/// The number of runs, inputs and decisions.
#[derive(Default)]
struct CampaignExtent {
    runs: u64,
    inputs: u64,
    decisions: u64,
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some((inputs, seed, command)) = read(&arguments) else {
        eprintln!("error: usage: campaign INPUTS SEED COMMAND…");
        return ExitCode::from(2);
    };
    let child = Command::new(&command[0])
        .args(&command[1..])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn();
    let mut child = match child {
        Ok(child) => child,
        Err(error) => {
            eprintln!("error: {} does not start: {error}", command[0]);
            return ExitCode::from(2);
        }
    };
    let (stdin, stdout) = (child.stdin.take(), child.stdout.take());
    let (Some(stdin), Some(stdout)) = (stdin, stdout) else { return ExitCode::from(2) };
    let (sent, expected) = sync_channel(AHEAD);
    let comparer = thread::spawn(move || compare(stdout, &expected));
    let made = send(stdin, inputs, seed, &sent);
    drop(sent);
    let outcome = comparer.join();
    let ended = child.wait();
    let found = match (made, outcome) {
        (_, Ok(Err(difference))) | (Err(difference), _) => Err(difference),
        (_, Err(_)) => Err("the comparison panicked".to_owned()),
        (Ok(extent), Ok(Ok(()))) => Ok(extent),
    };
    match found {
        Ok(CampaignExtent { runs, inputs, decisions }) if ended.is_ok_and(|it| it.success()) => {
            println!("{inputs} inputs in {runs} runs, {decisions} decisions, no difference");
            ExitCode::SUCCESS
        }
        Ok(_) => {
            eprintln!("error: the command did not end well");
            ExitCode::FAILURE
        }
        Err(difference) => {
            eprintln!("{difference}");
            ExitCode::FAILURE
        }
    }
}

fn read(arguments: &[String]) -> Option<(u64, u64, &[String])> {
    let [inputs, seed, command @ ..] = arguments else { return None };
    if command.is_empty() {
        return None;
    }
    Some((inputs.parse().ok()?, seed.parse().ok()?, command))
}

/// Returns a run. Every second run is wide, as the runs of the first generator of `fuseline drive`
/// are.
fn run(seed: u64, number: u64) -> (String, Run) {
    let (half, clouds) = (number / 2, [4, 15]);
    let generator = |clouds| Generator { seed, commit: None, clouds };
    match number % 2 {
        0 => (format!("g-{seed}-{half}"), generator(clouds[0]).run(half)),
        _ => (format!("w-{seed}-{half}"), generator(clouds[1]).wide(half)),
    }
}

/// Sends runs until they have the requested number of inputs.
fn send(
    stdin: ChildStdin,
    wanted: u64,
    seed: u64,
    sent: &SyncSender<SentRun>,
) -> Result<CampaignExtent, String> {
    let mut stdin = BufWriter::with_capacity(1 << 16, stdin);
    let (mut extent, mut full, mut text) = (CampaignExtent::default(), 0, Vec::new());
    for number in 0.. {
        if extent.inputs >= wanted {
            break;
        }
        let (name, run) = run(seed, number);
        if run.inputs.len() > MOST_INPUTS {
            full += 1;
            if full % FULL_WINDOWS != 1 {
                continue;
            }
        }
        let (answer, decisions) =
            decide(&run).map_err(|difference| format!("{name}: {difference}"))?;
        text.clear();
        run.write(&mut text);
        extent.runs += 1;
        extent.inputs += run.inputs.len() as u64;
        extent.decisions += decisions;
        // If either fails, the other side knows why.
        if sent.send(SentRun { name, answer }).is_err() || stdin.write_all(&text).is_err() {
            return Ok(extent);
        }
    }
    // The other side finds an end that was not written.
    let _ = stdin.flush();
    Ok(extent)
}

/// Returns the decisions of both machines, as the command must write them, and their number.
fn decide(run: &Run) -> Result<(Vec<u8>, u64), String> {
    let mut core: Arbiter =
        Arbiter::new(&run.header).map_err(|error| format!("a sound configuration: {error}"))?;
    let mut reference = Reference::new(&run.header);
    let (mut found, mut expected) = (Vec::new(), Vec::new());
    let (mut answer, mut decisions) = (DONE.to_vec(), 0);
    for input in &run.inputs {
        found.clear();
        expected.clear();
        core.decide(input, |decision| found.push(decision));
        reference.apply(input, &mut expected);
        if !found.iter().eq(expected.iter().map(|(decision, _)| decision)) {
            return Err(format!("{input}: the core has {found:?}, the rules {expected:?}"));
        }
        for decision in &found {
            decision.write(&mut answer);
            answer.push(b'\n');
        }
        decisions += found.len() as u64;
        answer.extend_from_slice(DONE);
    }
    Ok((answer, decisions))
}

/// Compares what comes with what must come.
fn compare(stdout: ChildStdout, sent: &Receiver<SentRun>) -> Result<(), String> {
    let (mut stdout, mut found) = (BufReader::with_capacity(1 << 16, stdout), Vec::new());
    for SentRun { name, answer } in sent {
        found.resize(answer.len(), 0);
        let came = fill(&mut stdout, &mut found).map_err(|error| error.to_string())?;
        if came < answer.len() || found != answer {
            let (found, answer) = (found.get(..came).unwrap_or_default(), &answer);
            return Err(format!("{name}: {}", difference(found, answer)));
        }
    }
    match fill(&mut stdout, &mut [0]) {
        Ok(0) => Ok(()),
        _ => Err("the command writes more than was asked".to_owned()),
    }
}

/// Reads until the buffer is full or the input ends. Returns the number of bytes.
fn fill(from: &mut impl Read, buffer: &mut [u8]) -> io::Result<usize> {
    let mut came = 0;
    while let Some(rest) = buffer.get_mut(came..).filter(|rest| !rest.is_empty()) {
        match from.read(rest)? {
            0 => break,
            some => came += some,
        }
    }
    Ok(came)
}

/// Returns the first line that differs.
fn difference(found: &[u8], expected: &[u8]) -> String {
    let lines = |bytes: &[u8]| -> Vec<String> {
        String::from_utf8_lossy(bytes).lines().map(str::to_owned).collect()
    };
    let (found, expected) = (lines(found), lines(expected));
    let index = (0..expected.len()).find(|index| found.get(*index) != expected.get(*index));
    let index = index.unwrap_or_default();
    let line = |lines: &[String]| lines.get(index).cloned().unwrap_or_else(|| "nothing".to_owned());
    format!("line {} of its answer is {}, not {}", index + 1, line(&found), line(&expected))
}
