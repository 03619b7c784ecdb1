//! Lines of the trace (`SPEC.md`, section 6): what is read of them, and decisions written.

use core::fmt::{self, Write};

use fuseline_core::{
    Admission, Cloud, Commit, DropReason, Firing, OfferRefusal, OpenRefusal, Opening, Outcome,
    Priority,
};
use serde::Deserialize;

/// A header or an input, whichever of its keys are there.
#[derive(Deserialize)]
pub struct Line<'a> {
    /// The version: a header.
    pub fuseline: Option<u64>,
    /// What happened: an input.
    #[serde(borrow)]
    pub ev: Option<&'a str>,
    /// When.
    pub at: Option<u64>,
    /// The timestamp.
    pub t: Option<u64>,
    /// The source.
    pub p: Option<u64>,
    /// Of an offer, or local's.
    pub deadline: Option<u64>,
    /// Of an offer.
    pub backlog: Option<u64>,
    /// Of a header.
    pub window: Option<usize>,
    /// Of a header.
    #[serde(borrow)]
    pub commit: Option<&'a str>,
    /// Of a header.
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
    /// Reads a line; none if it is no JSON of the trace.
    #[must_use]
    pub fn parse(text: &'a [u8]) -> Option<Self> {
        serde_json_core::from_slice(text).ok().map(|(line, _)| line)
    }

    /// What a header says of the machine.
    #[must_use]
    pub fn configuration(&self) -> Option<(usize, Commit, heapless::Vec<Cloud, 15>)> {
        let commit = if self.commit == Some("patient") { Commit::Patient } else { Commit::Eager };
        let cloud = |line: &CloudLine| {
            let cloud = Cloud::new(Priority::new(line.p), line.limit);
            Cloud { resume: line.resume.unwrap_or(cloud.resume), ..cloud }
        };
        Some((self.window?, commit, self.clouds.as_ref()?.iter().map(cloud).collect()))
    }
}

/// Writes decisions.
pub struct Decisions<'a, W> {
    /// Where to.
    pub out: &'a mut W,
    /// The machine's clock.
    pub at: u64,
}

impl<W: Write> Decisions<'_, W> {
    /// What a firing led to.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn firing<const CLOUDS: usize>(&mut self, firing: &Firing<CLOUDS>) -> fmt::Result {
        let t = firing.timestamp.as_u64();
        for p in firing.timers.iter() {
            self.say("timer", t, Some(p.as_u16().into()), "")?;
        }
        self.outcome(t, 0, &firing.outcome)
    }

    /// What became of an open.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn opening(&mut self, t: u64, opening: Opening) -> fmt::Result {
        match opening {
            Opening::Accepted => Ok(()),
            Opening::Refused(OpenRefusal::Order) => self.say("refuse", t, None, "order"),
            Opening::Refused(OpenRefusal::Full) => self.say("refuse", t, None, "full"),
            Opening::Refused(OpenRefusal::Deadline) => self.say("refuse", t, None, "deadline"),
        }
    }

    /// What became of an offer.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn admission(&mut self, t: u64, p: u64, admission: Admission) -> fmt::Result {
        let why = match admission {
            Admission::Admitted { due } => {
                let (at, due) = (self.at, due.as_nanos());
                return writeln!(
                    self.out,
                    r#"{{"ev":"request","at":{at},"t":{t},"p":{p},"due":{due}}}"#
                );
            }
            Admission::Refused(OfferRefusal::Unknown) => "unknown",
            Admission::Refused(OfferRefusal::Closed) => "closed",
            Admission::Refused(OfferRefusal::Duplicate) => "duplicate",
            Admission::Refused(OfferRefusal::Outranked) => "outranked",
            Admission::Refused(OfferRefusal::Deadline) => "deadline",
            Admission::Refused(OfferRefusal::Queue) => "queue",
        };
        self.say("refuse", t, Some(p), why)
    }

    /// What became of a result or a failure of `p`.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn outcome<const CLOUDS: usize>(
        &mut self,
        t: u64,
        p: u64,
        outcome: &Outcome<CLOUDS>,
    ) -> fmt::Result {
        match outcome {
            Outcome::Dropped(why) => self.say("drop", t, Some(p), reason(*why)),
            Outcome::Held => self.say("hold", t, Some(p), ""),
            Outcome::Waiting => Ok(()),
            Outcome::Missed => self.say("miss", t, None, ""),
            Outcome::Forwarded { by, cancelled } => {
                self.say("emit", t, Some(by.as_u16().into()), "")?;
                let mut cancelled = cancelled.iter().map(|p| p.as_u16().into());
                cancelled.try_for_each(|p| self.say("cancel", t, Some(p), ""))
            }
        }
    }

    fn say(&mut self, ev: &str, t: u64, p: Option<u64>, why: &str) -> fmt::Result {
        let at = self.at;
        write!(self.out, r#"{{"ev":"{ev}","at":{at},"t":{t}"#)?;
        if let Some(p) = p {
            write!(self.out, r#","p":{p}"#)?;
        }
        if !why.is_empty() {
            write!(self.out, r#","why":"{why}""#)?;
        }
        self.out.write_str("}\n")
    }
}

const fn reason(why: DropReason) -> &'static str {
    match why {
        DropReason::Unknown => "unknown",
        DropReason::Superseded => "superseded",
        DropReason::Unsolicited => "unsolicited",
        DropReason::Duplicate => "duplicate",
        DropReason::Late => "late",
    }
}
