//! Reads lines of the trace and writes decisions (`SPEC.md`, section 6).

use core::fmt::{self, Write};

use fuseline_core::{Admission, Cloud, Commit, Firing, Opening, Outcome, Priorities, Priority};
use serde::Deserialize;

/// A header or an input. A key that the line does not have is `None`.
#[derive(Deserialize)]
pub struct Line<'a> {
    /// The format version. Only a header has one.
    pub fuseline: Option<u64>,
    /// The name of the event. Only an input has one.
    #[serde(borrow)]
    pub ev: Option<&'a str>,
    /// The instant.
    pub at: Option<u64>,
    /// The timestamp.
    pub t: Option<u64>,
    /// The source.
    pub p: Option<u64>,
    /// The deadline of an offer, or local's deadline in an open.
    pub deadline: Option<u64>,
    /// The backlog of an offer.
    pub backlog: Option<u64>,
    /// The window of a header.
    pub window: Option<usize>,
    /// The commit rule of a header.
    #[serde(borrow)]
    pub commit: Option<&'a str>,
    /// The clouds of a header.
    pub clouds: Option<heapless::Vec<CloudLine, 15>>,
}

/// A cloud of a header.
#[derive(Deserialize)]
pub struct CloudLine {
    p: u16,
    limit: u64,
    resume: Option<u64>,
}

impl<'a> Line<'a> {
    /// Reads a line, or returns `None` if it is not JSON of the trace.
    #[must_use]
    pub fn parse(text: &'a [u8]) -> Option<Self> {
        serde_json_core::from_slice(text).ok().map(|(line, _)| line)
    }

    /// Returns the machine's configuration that a header states.
    #[must_use]
    pub fn configuration(&self) -> Option<(usize, Commit, heapless::Vec<Cloud, 15>)> {
        let commit = match self.commit {
            None | Some("eager") => Commit::Eager,
            Some("patient") => Commit::Patient,
            Some("progressive") => Commit::Progressive,
            Some(_) => return None,
        };
        let cloud = |line: &CloudLine| {
            let cloud = Cloud::new(Priority::new(line.p), line.limit);
            Cloud { resume: line.resume.unwrap_or(cloud.resume), ..cloud }
        };
        Some((self.window?, commit, self.clouds.as_ref()?.iter().map(cloud).collect()))
    }
}

/// Writes decisions.
pub struct Decisions<'a, W> {
    /// The output that lines are written to.
    pub out: &'a mut W,
    /// The machine's commit rule.
    pub commit: Commit,
    /// The machine's clock.
    pub at: u64,
}

impl<W: Write> Decisions<'_, W> {
    /// Writes the decisions of a firing.
    ///
    /// # Errors
    /// Returns an error if the output cannot be written.
    pub fn firing<const CLOUDS: usize>(&mut self, firing: &Firing<CLOUDS>) -> fmt::Result {
        let t = firing.timestamp.as_u64();
        for p in firing.timers.iter() {
            self.say("timer", t, Some(p.as_u16().into()), None)?;
        }
        self.outcome(t, 0, &firing.outcome)
    }

    /// Writes the decision on an open.
    ///
    /// # Errors
    /// Returns an error if the output cannot be written.
    pub fn opening(&mut self, t: u64, opening: Opening) -> fmt::Result {
        match opening {
            Opening::Accepted => Ok(()),
            Opening::Refused(why) => self.say("refuse", t, None, Some(&why)),
        }
    }

    /// Writes the decision on an offer.
    ///
    /// # Errors
    /// Returns an error if the output cannot be written.
    pub fn admission(&mut self, t: u64, p: u64, admission: Admission) -> fmt::Result {
        match admission {
            Admission::Admitted { due } => {
                let (at, due) = (self.at, due.as_nanos());
                writeln!(self.out, r#"{{"ev":"request","at":{at},"t":{t},"p":{p},"due":{due}}}"#)
            }
            Admission::Refused(why) => self.say("refuse", t, Some(p), Some(&why)),
        }
    }

    /// Writes the decision on a result or a failure of `p`.
    ///
    /// # Errors
    /// Returns an error if the output cannot be written.
    pub fn outcome<const CLOUDS: usize>(
        &mut self,
        t: u64,
        p: u64,
        outcome: &Outcome<CLOUDS>,
    ) -> fmt::Result {
        match outcome {
            Outcome::Dropped(why) => self.say("drop", t, Some(p), Some(why)),
            Outcome::Held => self.say("hold", t, Some(p), None),
            Outcome::Waiting => Ok(()),
            Outcome::Missed => self.say("miss", t, None, None),
            Outcome::Preliminary { by, cancelled } => self.output(t, *by, cancelled),
            Outcome::Final { by } => self.say("final", t, Some(by.as_u16().into()), None),
            Outcome::Forwarded { by, cancelled } => {
                self.output(t, *by, cancelled)?;
                match self.commit {
                    Commit::Eager | Commit::Patient => Ok(()),
                    // Under progressive, an output that is the last one is followed by `final`
                    // (F9).
                    Commit::Progressive => self.say("final", t, Some(by.as_u16().into()), None),
                }
            }
        }
    }

    fn output<const CLOUDS: usize>(
        &mut self,
        t: u64,
        by: Priority,
        cancelled: &Priorities<CLOUDS>,
    ) -> fmt::Result {
        self.say("emit", t, Some(by.as_u16().into()), None)?;
        let mut cancelled = cancelled.iter().map(|p| p.as_u16().into());
        cancelled.try_for_each(|p| self.say("cancel", t, Some(p), None))
    }

    fn say(
        &mut self,
        ev: &str,
        t: u64,
        p: Option<u64>,
        why: Option<&dyn fmt::Debug>,
    ) -> fmt::Result {
        let at = self.at;
        write!(self.out, r#"{{"ev":"{ev}","at":{at},"t":{t}"#)?;
        if let Some(p) = p {
            write!(self.out, r#","p":{p}"#)?;
        }
        if let Some(why) = why {
            self.out.write_str(r#","why":""#)?;
            // The trace writes a reason as its name in lower case.
            write!(LowerCase(self.out), "{why:?}")?;
            self.out.write_str(r#"""#)?;
        }
        self.out.write_str("}\n")
    }
}

struct LowerCase<'a>(&'a mut dyn Write);

impl Write for LowerCase<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        text.chars().try_for_each(|letter| self.0.write_char(letter.to_ascii_lowercase()))
    }
}
