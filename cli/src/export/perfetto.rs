//! The Trace Event Format, which ui.perfetto.dev reads: tracks of slices and instants.
//!
//! Requests of one cloud overlap, so that each is an asynchronous slice of its cloud's track. Instants are microseconds there,
//! written as decimals, so that no nanosecond is lost.

use std::collections::BTreeMap;
use std::io::Write;

use fuseline_traces::{Decision, Event, Header, Input};
use serde_json::json;

use crate::export::ExportError;

/// The process of all tracks; local's has number 0, a cloud's its priority's, outputs the one beyond all priorities.
const PROCESS: u32 = 1;
const OUTPUTS: u64 = 1 << 16;

/// A file that is being written.
pub(super) struct Tracks<W> {
    out: W,
    /// When the slices began that have not ended, by timestamp and priority.
    open: BTreeMap<(u64, u64), u64>,
    latest: u64,
    is_first: bool,
}

impl<W: Write> Tracks<W> {
    pub(super) fn new(mut out: W, header: &Header) -> Result<Self, ExportError> {
        out.write_all(b"{\"displayTimeUnit\":\"ns\",\"traceEvents\":[")?;
        let mut tracks = Self { out, open: BTreeMap::new(), latest: 0, is_first: true };
        let operator = header.operator.as_deref().unwrap_or("operator");
        tracks.named("process_name", 0, operator)?;
        tracks.named("thread_name", 0, "local")?;
        for cloud in &header.clouds {
            let p = u64::from(cloud.p);
            let name =
                cloud.name.as_ref().map_or_else(|| format!("p {p}"), |n| format!("p {p} {n}"));
            tracks.named("thread_name", p, &name)?;
        }
        tracks.named("thread_name", OUTPUTS, "outputs")?;
        Ok(tracks)
    }

    fn named(&mut self, kind: &str, track: u64, name: &str) -> Result<(), ExportError> {
        self.put(
            None,
            &json!({
                "ph": "M", "pid": PROCESS, "tid": track, "name": kind, "args": {"name": name},
            }),
        )
    }

    /// Appends an event, at an instant if it has one: in microseconds, exactly.
    fn put(&mut self, at: Option<u64>, event: &serde_json::Value) -> Result<(), ExportError> {
        self.out.write_all(if self.is_first { b"\n{" } else { b",\n{" })?;
        self.is_first = false;
        if let Some(at) = at {
            write!(self.out, "\"ts\":{}.{:03},", at / 1000, at % 1000)?;
        }
        let event = event.to_string();
        self.out.write_all(event.trim_start_matches('{').as_bytes())?;
        Ok(())
    }

    fn begin(&mut self, at: u64, t: u64, p: u64, due: Option<u64>) -> Result<(), ExportError> {
        if self.open.insert((t, p), at).is_some() {
            return Ok(());
        }
        self.put(
            Some(at),
            &json!({
                "ph": "b", "cat": "request", "id": format!("{t}.{p}"), "pid": PROCESS, "tid": p,
                "name": format!("t {t}"), "args": {"t": t, "p": p, "due": due},
            }),
        )
    }

    fn end(&mut self, at: u64, t: u64, p: u64, how: &str) -> Result<(), ExportError> {
        let Some(began) = self.open.remove(&(t, p)) else { return Ok(()) };
        // F0: an instant may go back, a slice cannot.
        let at = at.max(began);
        self.put(
            Some(at),
            &json!({
                "ph": "e", "cat": "request", "id": format!("{t}.{p}"), "pid": PROCESS, "tid": p,
                "name": format!("t {t}"), "args": {"end": how},
            }),
        )
    }

    fn instant(&mut self, at: u64, track: u64, t: u64, what: &str) -> Result<(), ExportError> {
        self.put(
            Some(at),
            &json!({
                "ph": "i", "s": "t", "pid": PROCESS, "tid": track,
                "name": format!("{what} t {t}"), "args": {"t": t},
            }),
        )
    }

    /// Ends what a timestamp still has.
    fn retire(&mut self, at: u64, t: u64) -> Result<(), ExportError> {
        let left: Vec<u64> =
            self.open.range((t, 0)..=(t, u64::MAX)).map(|((_, p), _)| *p).collect();
        for p in left {
            // F7: local computes on, a cloud is cancelled.
            self.end(at, t, p, if p == 0 { "retired" } else { "cancelled" })?;
        }
        Ok(())
    }

    fn decision(&mut self, decision: &Decision) -> Result<(), ExportError> {
        match *decision {
            Decision::Request { at, t, p, due } => self.begin(at, t, p, Some(due)),
            Decision::Hold { at, t, p } => self.instant(at, p, t, "hold"),
            Decision::Timer { at, t, p } => self.end(at, t, p, "timer"),
            Decision::Cancel { at, t, p } => self.end(at, t, p, "cancelled"),
            Decision::Drop { at, t, p, why } => {
                self.instant(at, track(p), t, &format!("drop {why}"))
            }
            Decision::RefuseOpen { at, t, why } => {
                self.instant(at, 0, t, &format!("refuse {why}"))?;
                self.end(at, t, 0, "refused")
            }
            Decision::RefuseOffer { at, t, p, why } => {
                self.instant(at, track(p), t, &format!("refuse {why}"))
            }
            Decision::Emit { at, t, p } => {
                self.instant(at, OUTPUTS, t, &format!("p {p}"))?;
                self.retire(at, t)
            }
            Decision::Miss { at, t } => {
                self.instant(at, OUTPUTS, t, "miss")?;
                self.retire(at, t)
            }
        }
    }
}

impl<W: Write> super::Writer for Tracks<W> {
    fn event(&mut self, event: &Event) -> Result<(), ExportError> {
        let at = match event {
            Event::Input(input) => input.at(),
            Event::Decision(decision) => decision.at(),
        };
        self.latest = self.latest.max(at);
        match event {
            Event::Input(Input::Open { at, t, deadline }) => {
                self.begin(*at, *t, 0, deadline.map(|deadline| at.saturating_add(deadline)))
            }
            Event::Input(Input::Result { at, t, p }) => self.end(*at, *t, *p, "result"),
            Event::Input(Input::Fail { at, t, p }) => self.end(*at, *t, *p, "failure"),
            Event::Input(Input::Offer { .. } | Input::Tick { .. }) => Ok(()),
            Event::Decision(decision) => self.decision(decision),
        }
    }

    fn finish(mut self: Box<Self>) -> Result<(), ExportError> {
        let left: Vec<(u64, u64)> = self.open.keys().copied().collect();
        for (t, p) in left {
            self.end(self.latest, t, p, "open")?;
        }
        self.out.write_all(b"\n]}\n")?;
        self.out.flush()?;
        Ok(())
    }
}

/// An unregistered cloud has no track of its own.
fn track(p: u64) -> u64 {
    if p < OUTPUTS { p } else { 0 }
}
