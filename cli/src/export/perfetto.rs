//! The Trace Event Format, which ui.perfetto.dev reads: tracks of slices and instants.
//!
//! Slices of one track must not overlap there, and calls to one source do: a source has as many
//! tracks as calls were ever under way at once, all with its name. Instants are microseconds there,
//! written as decimals, so that no nanosecond is lost.

use std::collections::BTreeMap;
use std::io::{self, Write};

use fuseline_traces::{Commit, Decision, Event, Header, Input};
use serde_json::json;

use crate::export::viewer;

/// The process of all tracks.
const PROCESS: u32 = 1;
/// The track of what was forwarded or missed; tracks of sources are added as they are needed.
const OUTPUTS: u32 = 1;

pub(super) struct Tracks<W> {
    out: W,
    /// By priority; all sources that are not registered share the last one.
    sources: BTreeMap<Option<u64>, SourceTrack>,
    /// Whether an output leaves its timestamp open (F9).
    is_progressive: bool,
    /// The slices that have not ended, by timestamp and priority.
    open: BTreeMap<(u64, u64), Slice>,
    latest: u64,
    /// The number of the latest track.
    latest_track: u32,
    is_first: bool,
}

/// Local, a cloud, or all that is neither.
struct SourceTrack {
    name: String,
    tracks: Vec<Track>,
}

/// Slices of one source that do not overlap.
#[derive(Clone, Copy)]
struct Track {
    number: u32,
    /// When the last slice ended; none while it has not.
    free: Option<u64>,
}

/// A call under way.
#[derive(Clone, Copy)]
struct Slice {
    at: u64,
    due: Option<u64>,
    /// Which of its source's tracks it is on.
    track_index: usize,
}

impl<W: Write> Tracks<W> {
    pub(super) fn new(mut out: W, header: &Header) -> io::Result<Self> {
        out.write_all(b"{\"displayTimeUnit\":\"ns\",\"traceEvents\":[")?;
        let local = (Some(0), "local".to_owned());
        let clouds = header.clouds.iter().map(|cloud| {
            let p = u64::from(cloud.p);
            (Some(p), cloud.name.clone().unwrap_or_else(|| format!("cloud {p}")))
        });
        let others = (None, "not registered".to_owned());
        let named = [local].into_iter().chain(clouds).chain([others]);
        let source = |(p, name)| (p, SourceTrack { name, tracks: Vec::new() });
        let mut tracks = Self {
            out,
            is_progressive: header.commit == Commit::Progressive,
            sources: named.map(source).collect(),
            open: BTreeMap::new(),
            latest: 0,
            latest_track: OUTPUTS,
            is_first: true,
        };
        let operator = header.operator.as_deref().unwrap_or("operator");
        tracks.reported("process_name", OUTPUTS, "name", operator)?;
        tracks.track(OUTPUTS, "outputs")?;
        let sources: Vec<Option<u64>> = tracks.sources.keys().copied().collect();
        for p in sources.into_iter().flatten() {
            tracks.add(Some(p))?;
        }
        Ok(tracks)
    }

    /// Adds a track of this name below the others.
    fn track(&mut self, number: u32, name: &str) -> io::Result<()> {
        self.reported("thread_name", number, "name", name)?;
        self.reported("thread_sort_index", number, "sort_index", number)
    }

    /// Says something about a track.
    fn reported(
        &mut self,
        label: &str,
        number: u32,
        key: &str,
        value: impl serde::Serialize,
    ) -> io::Result<()> {
        let event = json!({
            "ph": "M", "pid": PROCESS, "tid": number, "name": label, "args": {key: value},
        });
        self.put("", &event)
    }

    /// One more track for a source.
    fn add(&mut self, p: Option<u64>) -> io::Result<()> {
        self.latest_track += 1;
        let number = self.latest_track;
        let Some(source) = self.sources.get_mut(&p) else { return Ok(()) };
        source.tracks.push(Track { number, free: Some(0) });
        let name = match source.tracks.len() {
            1 => source.name.clone(),
            others => format!("{} ({others})", source.name),
        };
        self.track(number, &name)
    }

    /// The source of that priority.
    fn source(&self, p: u64) -> Option<u64> {
        Some(p).filter(|p| self.sources.contains_key(&Some(*p)))
    }

    /// The number of a source's first track.
    fn first(&mut self, p: u64) -> io::Result<u32> {
        let p = self.source(p);
        if self.sources.get(&p).is_none_or(|source| source.tracks.is_empty()) {
            self.add(p)?;
        }
        Ok(self.number(p, 0))
    }

    fn number(&self, p: Option<u64>, track_index: usize) -> u32 {
        let track = self.sources.get(&p).and_then(|source| source.tracks.get(track_index));
        track.map_or(OUTPUTS, |track| track.number)
    }

    /// Appends an event; its times, exact, stand before its other keys.
    fn put(&mut self, times: &str, event: &serde_json::Value) -> io::Result<()> {
        self.out.write_all(if self.is_first { b"\n{" } else { b",\n{" })?;
        self.is_first = false;
        let event = event.to_string();
        write!(self.out, "{times}{}", event.trim_start_matches('{'))
    }

    fn begin(&mut self, at: u64, t: u64, p: u64, due: Option<u64>) -> io::Result<()> {
        if self.open.contains_key(&(t, p)) {
            return Ok(());
        }
        let source = self.source(p);
        let is_free = |track: &Track| track.free.is_some_and(|free| free <= at);
        let tracks = self.sources.get(&source).map_or(&[][..], |source| &source.tracks);
        let track_index = tracks.iter().position(is_free).unwrap_or(tracks.len());
        if track_index == tracks.len() {
            self.add(source)?;
        }
        self.occupy(source, track_index, None);
        self.open.insert((t, p), Slice { at, due, track_index });
        Ok(())
    }

    fn occupy(&mut self, p: Option<u64>, track_index: usize, free: Option<u64>) {
        let track = self.sources.get_mut(&p).and_then(|source| source.tracks.get_mut(track_index));
        if let Some(track) = track {
            track.free = free;
        }
    }

    fn end(&mut self, at: u64, t: u64, p: u64, outcome: &str) -> io::Result<()> {
        let Some(Slice { at: began, due, track_index }) = self.open.remove(&(t, p)) else {
            return Ok(());
        };
        // F0: an instant may go back, a slice cannot.
        let at = at.max(began);
        let source = self.source(p);
        self.occupy(source, track_index, Some(at));
        let times = format!("\"ts\":{},\"dur\":{},", micros(began), micros(at - began));
        self.put(
            &times,
            &json!({
                "ph": "X", "cat": "call", "pid": PROCESS, "tid": self.number(source, track_index),
                "name": format!("timestamp {t}: {outcome}"),
                "args": {"t": t, "p": p, "due": due, "end": outcome},
            }),
        )
    }

    fn instant(&mut self, at: u64, track: u32, t: u64, label: &str) -> io::Result<()> {
        self.put(
            &format!("\"ts\":{},", micros(at)),
            &json!({
                "ph": "i", "s": "t", "pid": PROCESS, "tid": track,
                "name": format!("timestamp {t}: {label}"), "args": {"t": t},
            }),
        )
    }

    /// An instant on a source's track.
    fn of_source(&mut self, at: u64, p: u64, t: u64, label: &str) -> io::Result<()> {
        let track = self.first(p)?;
        self.instant(at, track, t, label)
    }

    /// Ends what a timestamp still has of sources up to this one.
    fn retire(&mut self, at: u64, t: u64, last: u64) -> io::Result<()> {
        let ended: Vec<u64> = self.open.range((t, 0)..=(t, last)).map(|((_, p), _)| *p).collect();
        for p in ended {
            // F7: local computes on, a cloud is cancelled.
            self.end(at, t, p, if p == 0 { "no longer needed" } else { "cancelled" })?;
        }
        Ok(())
    }

    fn decision(&mut self, decision: &Decision) -> io::Result<()> {
        match *decision {
            Decision::Request { at, t, p, due } => self.begin(at, t, p, Some(due)),
            Decision::Hold { at, t, p } => self.of_source(at, p, t, "result held"),
            Decision::Timer { at, t, p } => self.end(at, t, p, "timer fired"),
            Decision::Cancel { at, t, p } => self.end(at, t, p, "cancelled"),
            Decision::Drop { at, t, p, why } => {
                self.of_source(at, p, t, &format!("dropped, {why}"))
            }
            Decision::RefuseOpen { at, t, why } => {
                self.of_source(at, 0, t, &format!("refused, {why}"))?;
                self.end(at, t, 0, "refused")
            }
            Decision::RefuseOffer { at, t, p, why } => {
                self.of_source(at, p, t, &format!("refused, {why}"))
            }
            Decision::Emit { at, t, p } => {
                let name = self.sources.get(&self.source(p)).map(|source| source.name.clone());
                self.instant(at, OUTPUTS, t, &format!("from {}", name.unwrap_or_default()))?;
                self.retire(at, t, if self.is_progressive { p } else { u64::MAX })
            }
            Decision::Final { at, t, .. } => {
                self.instant(at, OUTPUTS, t, "final")?;
                self.retire(at, t, u64::MAX)
            }
            Decision::Miss { at, t } => {
                self.instant(at, OUTPUTS, t, "missed")?;
                self.retire(at, t, u64::MAX)
            }
        }
    }
}

impl<W: Write> viewer::TraceViewer for Tracks<W> {
    fn event(&mut self, event: &Event) -> io::Result<()> {
        let at = match event {
            Event::Input(input) => input.at(),
            Event::Decision(decision) => decision.at(),
        };
        self.latest = self.latest.max(at);
        match event {
            Event::Input(Input::Open { at, t, deadline }) => {
                let due = deadline.map(|deadline| at.saturating_add(deadline));
                self.begin(*at, *t, 0, due)
            }
            Event::Input(Input::Result { at, t, p }) => self.end(*at, *t, *p, "result"),
            Event::Input(Input::Fail { at, t, p }) => self.end(*at, *t, *p, "failure"),
            Event::Input(Input::Offer { .. } | Input::Tick { .. }) => Ok(()),
            Event::Decision(decision) => self.decision(decision),
        }
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        let remaining: Vec<(u64, u64)> = self.open.keys().copied().collect();
        for (t, p) in remaining {
            self.end(self.latest, t, p, "still open")?;
        }
        self.out.write_all(b"\n]}\n")?;
        self.out.flush()
    }
}

/// Microseconds, exactly.
fn micros(nanos: u64) -> String {
    format!("{}.{:03}", nanos / 1000, nanos % 1000)
}
