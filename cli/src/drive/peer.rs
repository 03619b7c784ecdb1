//! The command under judgement: a process group of its own that gets one line at a time and has a
//! bounded time to answer.
//!
//! This module finds what breaks the protocol. The module `trial` compares the decisions.

use std::ffi::OsString;
use std::io::{self, Read, Write};
use std::os::unix::process::CommandExt;
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use fuseline_traces::{Decision, Event, LINE, Line, ValueKeys, parse_annotated};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::{Errno, ioctl_fionbio};
use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process_group, waitid};
use serde::Deserialize;
use serde::de::IgnoredAny;
use thiserror::Error;

use super::trial::DriveStop;
use crate::interrupt::Interrupt;

/// The line that ends an answer.
const DONE: &[u8] = br#"{"ev":"done"}"#;
/// A wait looks for Ctrl-C this often.
const SLICE: Duration = Duration::from_millis(50);
/// The number of bytes that are read at once.
const CHUNK: usize = 64 * 1024;
/// A command that closed its output may take this long to end.
const ENDING: Duration = Duration::from_millis(500);
/// The number of characters that are shown of a line that cannot be read.
const SHOWN: usize = 160;

/// The running command. Dropping this kills it and all that it started in its group.
pub(super) struct Peer {
    child: Child,
    reaped: bool,
    input: Option<ChildStdin>,
    output: Option<ChildStdout>,
    chunk: Box<[u8]>,
    /// The bytes read so far; the lines before `consumed` have been handled.
    read: Vec<u8>,
    consumed: usize,
    wait: Duration,
    interrupt: Interrupt,
}

/// The reason why an exchange ended early.
#[derive(Debug)]
pub(super) enum PeerError {
    Stop(DriveStop),
    Misbehaved(ProtocolViolation),
}

/// A way to break the protocol.
#[derive(Debug, Error)]
pub(super) enum ProtocolViolation {
    #[error(
        "it did not answer within {} s; check that it flushes its output after each answer",
        .0.as_secs_f64()
    )]
    Silent(Duration),
    #[error("it ended before it answered: {0}")]
    Ended(ExitStatus),
    #[error("it closed its output before it answered")]
    Closed,
    #[error("it answered {line:?}, column {column}: {message}")]
    Garbage { line: String, column: u64, message: String },
    #[error("it answered with a line that is not a decision: {0}")]
    NoDecision(String),
    #[error("it answered more than {0} lines without {{\"ev\":\"done\"}}")]
    Endless(usize),
    #[error("it answered a line over 64 KiB")]
    TooLong,
    #[error("it wrote {0:?} after {{\"ev\":\"done\"}}, before it was asked again")]
    Unasked(String),
    #[error("it was still running after {} s, although its input had ended", .0.as_secs_f64())]
    Lingers(Duration),
    #[error("it ended with a failure: {0}")]
    Failed(ExitStatus),
}

impl ProtocolViolation {
    /// Returns `true` if trying again would only wait as long again.
    pub(super) const fn is_slow(&self) -> bool {
        matches!(self, Self::Silent(_) | Self::Closed)
    }
}

/// `{"ev":"done"}`, however it is spaced.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DoneLine<'a> {
    ev: &'a str,
    #[serde(default, rename = "x")]
    _x: Option<IgnoredAny>,
}

impl Peer {
    /// Starts the command; its standard error goes to `complaints`.
    ///
    /// # Errors
    /// If the system cannot start it.
    pub(super) fn start(
        command: &[OsString],
        complaints: Stdio,
        wait: Duration,
        interrupt: Interrupt,
    ) -> io::Result<Self> {
        let (program, args) = command.split_first().ok_or(io::ErrorKind::NotFound)?;
        let mut child = Command::new(program)
            .args(args)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(complaints)
            .process_group(0)
            .spawn()?;
        let (input, output) = (child.stdin.take(), child.stdout.take());
        let (read, consumed, chunk) = (Vec::new(), 0, vec![0; CHUNK].into());
        let peer =
            Self { child, reaped: false, input, output, chunk, read, consumed, wait, interrupt };
        if let Some(input) = &peer.input {
            ioctl_fionbio(input, true)?;
        }
        if let Some(output) = &peer.output {
            ioctl_fionbio(output, true)?;
        }
        Ok(peer)
    }

    /// Sends a line and takes the decisions up to `done`, at most this many.
    pub(super) fn exchange(
        &mut self,
        line: &[u8],
        most: usize,
        answer: &mut Vec<(Decision, ValueKeys)>,
    ) -> Result<(), PeerError> {
        self.quiet()?;
        let until = Instant::now() + self.wait;
        self.send(line, until)?;
        for lines in 0.. {
            let line = self.line(until)?;
            if is_done(line) {
                break;
            }
            if lines == most {
                return Err(ProtocolViolation::Endless(most).into());
            }
            answer.push(decision(line)?);
        }
        Ok(())
    }

    /// Checks that the command has written nothing that was not requested.
    pub(super) fn quiet(&mut self) -> Result<(), PeerError> {
        if self.consumed == self.read.len() {
            self.read.clear();
            self.consumed = 0;
            // If it ended meanwhile, the next request shows that.
            let _ = self.take();
        }
        match self.read.get(self.consumed..) {
            None | Some([]) => Ok(()),
            Some(rest) => Err(ProtocolViolation::Unasked(shown(first_line(rest))).into()),
        }
    }

    /// Ends the input and waits until the command ends, with code 0; what it writes then is
    /// a violation.
    pub(super) fn end(mut self) -> Result<(), PeerError> {
        self.quiet()?;
        self.input = None;
        let until = Instant::now() + self.wait;
        while !self.has_ended() {
            if Instant::now() >= until {
                return Err(ProtocolViolation::Lingers(self.wait).into());
            }
            self.pause(PollFlags::IN, Duration::from_millis(2))?;
            self.quiet()?;
            // A closed output can always be read: its end.
            std::thread::sleep(Duration::from_millis(1));
        }
        // Everything that it wrote before its end has arrived now, so an extra line is always seen.
        self.quiet()?;
        match self.reap() {
            Some(status) if !status.success() => Err(ProtocolViolation::Failed(status).into()),
            Some(_) | None => Ok(()),
        }
    }

    fn send(&mut self, mut line: &[u8], until: Instant) -> Result<(), PeerError> {
        while let (Some(input), [_, ..]) = (&mut self.input, line) {
            match input.write(line) {
                Ok(written) => line = line.get(written..).unwrap_or_default(),
                Err(error) if is_passing(&error) => self.until(until, PollFlags::OUT)?,
                // It has ended or does not read: its output, or its end, says more.
                Err(_) => return Ok(()),
            }
        }
        Ok(())
    }

    /// Returns the next line, without its end.
    fn line(&mut self, until: Instant) -> Result<&[u8], PeerError> {
        let mut looked = self.consumed;
        loop {
            let fresh = self.read.get(looked..).unwrap_or_default();
            let end = fresh.iter().position(|byte| *byte == b'\n').map(|end| looked + end);
            looked = end.unwrap_or(self.read.len());
            if looked - self.consumed > LINE {
                return Err(ProtocolViolation::TooLong.into());
            }
            if let Some(end) = end {
                let start = std::mem::replace(&mut self.consumed, end + 1);
                return Ok(self.read.get(start..end).unwrap_or_default());
            }
            self.until(until, PollFlags::IN)?;
            match self.take() {
                Ok(Some(0)) | Err(_) => return Err(self.disconnected().into()),
                Ok(_) => {}
            }
        }
    }

    /// Waits until it can be read from or written to.
    fn until(&mut self, until: Instant, flags: PollFlags) -> Result<(), PeerError> {
        loop {
            let remaining = until.saturating_duration_since(Instant::now());
            if self.pause(flags, remaining.min(SLICE))? {
                return Ok(());
            }
            if remaining.is_zero() {
                return Err(ProtocolViolation::Silent(self.wait).into());
            }
        }
    }

    /// Waits at most this long; says whether it can be read from or written to.
    fn pause(&self, flags: PollFlags, most: Duration) -> Result<bool, PeerError> {
        if self.interrupt.is_set() {
            return Err(PeerError::Stop(DriveStop::Interrupted));
        }
        let most = Timespec { tv_sec: 0, tv_nsec: most.subsec_nanos().into() };
        let mut ends = [match (&self.input, &self.output) {
            (Some(input), _) if flags == PollFlags::OUT => PollFd::new(input, flags),
            (_, Some(output)) => PollFd::new(output, flags),
            (_, None) => return Ok(true),
        }];
        Ok(poll(&mut ends, Some(&most)).is_ok_and(|ready| ready > 0))
    }

    /// Reads what is there; 0 is the end, `None` means nothing yet.
    fn take(&mut self) -> io::Result<Option<usize>> {
        let Some(output) = &mut self.output else { return Ok(Some(0)) };
        match output.read(&mut self.chunk) {
            Ok(len) => {
                self.read.extend_from_slice(self.chunk.get(..len).unwrap_or_default());
                Ok(Some(len))
            }
            Err(error) if is_passing(&error) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Returns how the command ended after it closed its output.
    fn disconnected(&mut self) -> ProtocolViolation {
        let until = Instant::now() + ENDING;
        while !self.has_ended() {
            if Instant::now() >= until {
                return ProtocolViolation::Closed;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        self.reap().map_or(ProtocolViolation::Closed, ProtocolViolation::Ended)
    }

    /// Returns how the command ended, once it has ended. Processes that it started are ended too.
    fn reap(&mut self) -> Option<ExitStatus> {
        self.kill();
        self.reaped = true;
        self.child.wait().ok()
    }

    /// Returns `true` if the command itself has ended. It stays to be reaped, so that its group
    /// keeps its number.
    fn has_ended(&self) -> bool {
        let options = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
        self.id().is_none_or(|id| {
            !matches!(waitid(WaitId::Pid(id), options), Ok(None) | Err(Errno::INTR))
        })
    }

    /// Kills it with all that it started in its group.
    fn kill(&self) {
        if let Some(id) = self.id() {
            // A process that has ended cannot be killed.
            let _ = kill_process_group(id, Signal::KILL);
        }
    }

    fn id(&self) -> Option<Pid> {
        i32::try_from(self.child.id()).ok().and_then(Pid::from_raw)
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        // Once it is reaped, its number may be another's.
        if !self.reaped {
            self.kill();
            let _ = self.child.wait();
        }
    }
}

impl From<ProtocolViolation> for PeerError {
    fn from(misbehaviour: ProtocolViolation) -> Self {
        Self::Misbehaved(misbehaviour)
    }
}

/// Returns `true` if the call is to be tried again.
fn is_passing(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
}

fn is_done(line: &[u8]) -> bool {
    line == DONE || serde_json::from_slice::<DoneLine>(line).is_ok_and(|done| done.ev == "done")
}

/// Returns the decision in a line, and what it says of its value.
fn decision(line: &[u8]) -> Result<(Decision, ValueKeys), ProtocolViolation> {
    match parse_annotated(line) {
        Ok((Line::Event(Event::Decision(decision)), keys)) => Ok((decision, keys.value())),
        Ok((Line::Event(Event::Input(_)) | Line::Header(_), _)) => {
            Err(ProtocolViolation::NoDecision(shown(line)))
        }
        Err(error) => {
            let (column, message) = (error.column, error.message);
            Err(ProtocolViolation::Garbage { line: shown(line), column, message })
        }
    }
}

fn first_line(bytes: &[u8]) -> &[u8] {
    bytes.split(|byte| *byte == b'\n').next().unwrap_or_default()
}

/// Returns the beginning of a line, to show.
fn shown(line: &[u8]) -> String {
    let text = String::from_utf8_lossy(line);
    let mut shown: String = text.chars().take(SHOWN).collect();
    if shown.len() < text.len() {
        shown.push('…');
    }
    shown
}
