//! One run through the command: each decision is compared with the reference machine's, up to the first difference.

use std::ffi::OsString;
use std::io;
use std::process::Stdio;
use std::time::Duration;

use fuseline_testkit::Run;
use fuseline_traces::{
    Decision, Event, ExpectedDecisions, Header, Input, Reference, Verdict, judge,
};

use super::peer::{Peer, PeerError, ProtocolViolation};
use crate::interrupt::Interrupt;

/// How many lines more than the rules demand are read.
const MORE: usize = 1000;

/// The command: started for the first run, and again after it misbehaved.
pub(super) struct Bench {
    command: Vec<OsString>,
    wait: Duration,
    interrupt: Interrupt,
    peer: Option<Peer>,
    /// Whether it misbehaved before: then its complaints are known already.
    misbehaved: bool,
    /// How many inputs were answered.
    pub(super) inputs: u64,
}

pub(super) enum Comparison {
    /// Every decision is what the rules demand.
    Same,
    /// The trace up to the input whose decisions are not.
    Differs(Transcript),
    /// The trace up to what was sent last.
    Misbehaves(Transcript, ProtocolViolation),
}

#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Transcript {
    pub(super) header: Header,
    pub(super) events: Vec<Event>,
}

/// Why driving ends before its time.
pub(super) enum DriveStop {
    /// Ctrl-C.
    Interrupted,
    /// The system cannot start the command.
    Start(io::Error),
}

impl Bench {
    pub(super) const fn new(command: Vec<OsString>, wait: Duration, interrupt: Interrupt) -> Self {
        Self { command, wait, interrupt, peer: None, misbehaved: false, inputs: 0 }
    }

    /// Drives the command through a run, up to the first input whose decisions differ.
    pub(super) fn try_run(&mut self, run: &Run) -> Result<Comparison, DriveStop> {
        let mut reported = Transcript { header: run.header.clone(), events: Vec::new() };
        match self.compare(run, &mut reported) {
            Ok(true) => Ok(Comparison::Same),
            Ok(false) => Ok(Comparison::Differs(reported)),
            Err(Interrupted::Stop(stop)) => Err(stop),
            Err(Interrupted::PeerError(peer_error)) => {
                // It is started afresh for the next run.
                self.peer = None;
                match peer_error {
                    PeerError::Interrupted => Err(DriveStop::Interrupted),
                    PeerError::Misbehaved(misbehaviour) => {
                        self.misbehaved = true;
                        Ok(Comparison::Misbehaves(reported, misbehaviour))
                    }
                }
            }
        }
    }

    pub(super) fn end(&mut self) -> Result<Option<ProtocolViolation>, DriveStop> {
        match self.peer.take().map_or(Ok(()), Peer::end) {
            Ok(()) => Ok(None),
            Err(PeerError::Misbehaved(misbehaviour)) => Ok(Some(misbehaviour)),
            Err(PeerError::Interrupted) => Err(DriveStop::Interrupted),
        }
    }

    fn compare(&mut self, run: &Run, reported: &mut Transcript) -> Result<bool, Interrupted> {
        let peer = match &mut self.peer {
            Some(peer) => peer,
            none => {
                let complaints = if self.misbehaved { Stdio::null() } else { Stdio::inherit() };
                let interrupt = self.interrupt.clone();
                let started = Peer::start(&self.command, complaints, self.wait, interrupt);
                none.insert(started.map_err(|error| Interrupted::Stop(DriveStop::Start(error)))?)
            }
        };
        let (mut line, mut answer, mut demands) =
            (Vec::new(), Vec::new(), ExpectedDecisions::new());
        let mut reference = Reference::new(&run.header);
        run.header.write(&mut line);
        line.push(b'\n');
        peer.exchange(&line, MORE, &mut answer)?;
        reported.events.extend(answer.iter().copied().map(Event::Decision));
        let mut same = answer.is_empty();
        for input in &run.inputs {
            if !same {
                return Ok(false);
            }
            line.clear();
            answer.clear();
            demands.clear();
            input.write(&mut line);
            line.push(b'\n');
            reference.apply(input, &mut demands);
            reported.events.push(Event::Input(*input));
            let requested = peer.exchange(&line, demands.len() + MORE, &mut answer);
            reported.events.extend(answer.iter().copied().map(Event::Decision));
            requested?;
            self.inputs += 1;
            same = are_demanded(&answer, &demands);
        }
        peer.quiet()?;
        Ok(same)
    }
}

impl Transcript {
    pub(super) fn trace(&self) -> Vec<u8> {
        let mut out = Vec::new();
        self.header.write(&mut out);
        out.push(b'\n');
        for event in &self.events {
            event.write(&mut out);
            out.push(b'\n');
        }
        out
    }

    /// What the judge says of it.
    pub(super) fn verdict(&self, name: &str) -> Option<Verdict> {
        judge(name, &self.trace()[..]).ok()
    }

    pub(super) fn run(&self) -> Run {
        Run { header: self.header.clone(), inputs: self.inputs().collect() }
    }

    /// The line that was sent last.
    pub(super) fn last(&self) -> String {
        let last = self.inputs().last();
        last.map_or_else(|| self.header.to_string(), |input| input.to_string())
    }

    pub(super) fn inputs(&self) -> impl Iterator<Item = Input> {
        self.events.iter().filter_map(|event| match event {
            Event::Input(input) => Some(*input),
            Event::Decision(_) => None,
        })
    }
}

/// What ends a run before its end.
enum Interrupted {
    PeerError(PeerError),
    Stop(DriveStop),
}

impl From<PeerError> for Interrupted {
    fn from(peer_error: PeerError) -> Self {
        Self::PeerError(peer_error)
    }
}

fn are_demanded(answer: &[Decision], demands: &ExpectedDecisions) -> bool {
    answer.iter().eq(demands.iter().map(|(decision, _)| decision))
}
