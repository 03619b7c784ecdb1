//! One run through the command: each decision is compared with the reference machine's, up to the
//! first difference.

use std::ffi::OsString;
use std::io;
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use fuseline_testkit::Run;
use fuseline_traces::{
    Commit, Decision, Event, ExpectedDecisions, Header, HeldValues, Input, Reference, ValueKeys,
    Verdict, judge,
};

use super::case::CasePlace;
use super::peer::{Peer, PeerError, ProtocolViolation};
use crate::interrupt::Interrupt;

/// At most this many lines beyond those that the rules demand are read.
const MORE: usize = 1000;
/// At most this many lines of an answer are read that is not compared.
const FED: usize = 100_000;

/// The command: started for the first run, and again after it misbehaved.
pub(super) struct Bench {
    command: Vec<OsString>,
    wait: Duration,
    interrupt: Interrupt,
    /// `true` if results say something of their values, and emits must.
    drives_values: bool,
    peer: Option<Peer>,
    /// `true` if it misbehaved before: then its complaints are known already.
    misbehaved: bool,
    /// `true` if it ever answered anything.
    has_answered: bool,
    /// The runs that the current process got before, in order.
    sent: Vec<SentCase>,
    /// The number of inputs that were answered.
    pub(super) inputs: u64,
}

/// A case that a process was sent.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct SentCase {
    pub(super) place: CasePlace,
    /// The number of its inputs that were sent: all, unless one was answered wrongly.
    pub(super) inputs: usize,
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
    /// The events, with the keys of values that results and emits have.
    pub(super) events: Vec<(Event, ValueKeys)>,
}

/// The reason why driving ends early.
#[derive(Debug)]
pub(super) enum DriveStop {
    /// Ctrl-C.
    Interrupted,
    /// The system cannot start the command.
    Start(io::Error),
    /// The command ended before it ever answered.
    Died(ExitStatus),
}

impl Bench {
    pub(super) const fn new(
        command: Vec<OsString>,
        wait: Duration,
        drives_values: bool,
        interrupt: Interrupt,
    ) -> Self {
        Self {
            command,
            wait,
            interrupt,
            drives_values,
            peer: None,
            misbehaved: false,
            has_answered: false,
            sent: Vec::new(),
            inputs: 0,
        }
    }

    /// Lets the next run begin in a new process.
    pub(super) fn restart(&mut self) {
        self.peer = None;
        self.sent.clear();
    }

    /// Drives the command through a case. A finding comes with what the same process was sent
    /// before.
    pub(super) fn try_case(
        &mut self,
        place: CasePlace,
        run: &Run,
    ) -> Result<(Comparison, Vec<SentCase>), DriveStop> {
        let outcome = self.try_run(run)?;
        let (inputs, before) = match &outcome {
            Comparison::Same => (run.inputs.len(), Vec::new()),
            Comparison::Differs(reported) | Comparison::Misbehaves(reported, _) => {
                (reported.inputs().count(), self.sent.clone())
            }
        };
        if self.peer.is_none() {
            self.sent.clear();
        } else {
            self.sent.push(SentCase { place, inputs });
        }
        Ok((outcome, before))
    }

    /// Drives the command through a run, up to the first input whose decisions differ.
    pub(super) fn try_run(&mut self, run: &Run) -> Result<Comparison, DriveStop> {
        let mut reported = Transcript { header: run.header.clone(), events: Vec::new() };
        let compared = self.compare(run, &mut reported);
        match self.settle(compared)? {
            Ok(true) => Ok(Comparison::Same),
            Ok(false) => Ok(Comparison::Differs(reported)),
            Err(misbehaviour) => Ok(Comparison::Misbehaves(reported, misbehaviour)),
        }
    }

    /// Sends a whole run, whatever the command decides; false if it misbehaves.
    pub(super) fn feed(&mut self, run: &Run) -> Result<bool, DriveStop> {
        let fed = self.exchange_all(run);
        Ok(self.settle(fed)?.is_ok())
    }

    /// Settles an exchange. A misbehaving command is started again for the next run.
    fn settle<T>(
        &mut self,
        outcome: Result<T, PeerError>,
    ) -> Result<Result<T, ProtocolViolation>, DriveStop> {
        let peer_error = match outcome {
            Ok(value) => return Ok(Ok(value)),
            Err(peer_error) => peer_error,
        };
        self.peer = None;
        match peer_error {
            PeerError::Stop(stop) => Err(stop),
            PeerError::Misbehaved(ProtocolViolation::Ended(status)) if !self.has_answered => {
                Err(DriveStop::Died(status))
            }
            PeerError::Misbehaved(misbehaviour) => {
                self.misbehaved = true;
                Ok(Err(misbehaviour))
            }
        }
    }

    pub(super) fn end(&mut self) -> Result<Option<ProtocolViolation>, DriveStop> {
        match self.peer.take().map_or(Ok(()), Peer::end) {
            Ok(()) => Ok(None),
            Err(PeerError::Misbehaved(misbehaviour)) => Ok(Some(misbehaviour)),
            Err(PeerError::Stop(stop)) => Err(stop),
        }
    }

    /// Returns the process that runs, started if none does.
    fn peer(&mut self) -> Result<&mut Peer, PeerError> {
        if self.peer.is_none() {
            let complaints = if self.misbehaved { Stdio::null() } else { Stdio::inherit() };
            let interrupt = self.interrupt.clone();
            let started = Peer::start(&self.command, complaints, self.wait, interrupt);
            self.peer = Some(started.map_err(|error| PeerError::Stop(DriveStop::Start(error)))?);
            self.sent.clear();
        }
        self.peer.as_mut().ok_or(PeerError::Stop(DriveStop::Interrupted))
    }

    fn compare(&mut self, run: &Run, reported: &mut Transcript) -> Result<bool, PeerError> {
        let (mut line, mut answer, mut demands) =
            (header_line(&run.header), Vec::new(), ExpectedDecisions::new());
        let (mut reference, mut values) = (Reference::new(&run.header), HeldValues::default());
        self.peer()?.exchange(&line, MORE, &mut answer)?;
        self.has_answered = true;
        reported.extend(&answer);
        let mut same = answer.is_empty();
        for input in &run.inputs {
            if !same {
                return Ok(false);
            }
            line.clear();
            answer.clear();
            demands.clear();
            let value = self.write(input, &mut line);
            reference.apply(input, &mut demands);
            values.apply(input, value, demands.iter().map(|(decision, _)| decision));
            reported.events.push((Event::Input(*input), value));
            let requested = self.peer()?.exchange(&line, demands.len() + MORE, &mut answer);
            if !self.drives_values {
                for (_, value) in &mut answer {
                    *value = ValueKeys::default();
                }
            }
            reported.extend(&answer);
            requested?;
            self.inputs += 1;
            same = are_demanded(&answer, &demands, &values);
        }
        self.peer()?.quiet()?;
        Ok(same)
    }

    fn exchange_all(&mut self, run: &Run) -> Result<(), PeerError> {
        let (mut line, mut answer) = (header_line(&run.header), Vec::new());
        self.peer()?.exchange(&line, MORE, &mut answer)?;
        for input in &run.inputs {
            line.clear();
            answer.clear();
            self.write(input, &mut line);
            self.peer()?.exchange(&line, FED, &mut answer)?;
        }
        self.peer()?.quiet()
    }

    /// Writes an input as it is sent, and returns what it says of its value.
    fn write(&self, input: &Input, line: &mut Vec<u8>) -> ValueKeys {
        let value = if self.drives_values { value(input) } else { ValueKeys::default() };
        Event::Input(*input).write_annotated(&value.into(), line);
        line.push(b'\n');
        value
    }
}

/// Returns the keys of a result's value: its message, or nothing. This finds a command that copies
/// the keys from the call, and one that takes the keys of another result.
fn value(input: &Input) -> ValueKeys {
    let Input::Result { at, t, p } = *input else { return ValueKeys::default() };
    let drawn = at.wrapping_add(t).wrapping_add(p);
    let says = |bit: u64| (drawn & bit != 0).then_some(t);
    ValueKeys { of: says(1), meant_for: says(2) }
}

/// The header as it is sent. The commit rule may be left out where it is eager; so it is left out
/// of those with an odd window.
fn header_line(header: &Header) -> Vec<u8> {
    let mut text = header.to_string();
    if header.commit == Commit::Eager && !header.window.is_multiple_of(2) {
        text = text.replacen(",\"commit\":\"eager\"", "", 1);
    }
    text.push('\n');
    text.into_bytes()
}

impl Transcript {
    pub(super) fn trace(&self) -> Vec<u8> {
        let mut out = Vec::new();
        self.header.write(&mut out);
        out.push(b'\n');
        for (event, value) in &self.events {
            event.write_annotated(&(*value).into(), &mut out);
            out.push(b'\n');
        }
        out
    }

    fn extend(&mut self, answer: &[(Decision, ValueKeys)]) {
        let decisions = answer.iter().map(|(decision, value)| (Event::Decision(*decision), *value));
        self.events.extend(decisions);
    }

    /// Returns the judge's finding.
    pub(super) fn verdict(&self, name: &str) -> Option<Verdict> {
        judge(name, &self.trace()[..]).ok()
    }

    pub(super) fn run(&self) -> Run {
        Run { header: self.header.clone(), inputs: self.inputs().collect() }
    }

    /// Returns the line that was sent last.
    pub(super) fn last(&self) -> String {
        let last = self.inputs().last();
        last.map_or_else(|| self.header.to_string(), |input| input.to_string())
    }

    pub(super) fn inputs(&self) -> impl Iterator<Item = Input> {
        self.events.iter().filter_map(|(event, _)| match event {
            Event::Input(input) => Some(*input),
            Event::Decision(_) => None,
        })
    }
}

fn are_demanded(
    answer: &[(Decision, ValueKeys)],
    demands: &ExpectedDecisions,
    values: &HeldValues,
) -> bool {
    let demanded = demands.iter().map(|(decision, _)| (*decision, values.sent(decision)));
    answer.iter().copied().eq(demanded)
}
