//! The Trace Event Format, which ui.perfetto.dev reads: tracks of slices and instants.
//!
//! Slices of one track must not overlap, but calls to one source do. So a source has as many tracks
//! as it ever had calls at once, all with the same name. The format counts in microseconds, which
//! are written with decimals so that no nanosecond is lost.
//!
//! Each trace is a process. [`frames`](super::frames) connects several of them.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write};
use std::sync::Arc;

use fuseline_traces::{Annotations, Commit, Decision, Event, Header, Input, Origin};
use serde::Serialize;
use serde_json::json;

use crate::export::frames::{FlowPhase, TraceFrames};
use crate::export::viewer;

/// The track of forwarded and missed messages. The tracks of sources are added when they are
/// needed.
const OUTPUTS: u32 = 1;

pub(super) struct Tracks<'a, W> {
    out: W,
    /// The event that is being written.
    event: Vec<u8>,
    /// The writer of the frames that this trace shares with others.
    frames: TraceFrames<'a>,
    /// The open messages, by timestamp.
    messages: BTreeMap<u64, MessageOrigin>,
    /// The open messages whose timestamp was opened again, which is about to be refused (F1).
    repeated: BTreeSet<u64>,
    /// The sources by priority. All sources that are not registered share the key `None`.
    sources: BTreeMap<Option<u64>, SourceTrack>,
    /// `true` if an output leaves its timestamp open (F9).
    is_progressive: bool,
    /// The slices that have not ended, by timestamp and priority.
    open: BTreeMap<(u64, u64), Slice>,
    latest: u64,
    /// The number of the latest track.
    latest_track: u32,
}

/// The origin of an open message.
struct MessageOrigin {
    opened: u64,
    origin: Option<Origin>,
    age: Option<u64>,
    missing: Vec<Arc<str>>,
}

/// Local, a cloud, or all unregistered sources together.
struct SourceTrack {
    name: String,
    tracks: Vec<Track>,
}

/// Slices of one source that do not overlap.
#[derive(Clone, Copy)]
struct Track {
    number: u32,
    /// The instant at which the last slice ended, or `None` if it has not ended.
    free: Option<u64>,
}

/// A call under way.
#[derive(Clone, Copy)]
struct Slice {
    at: u64,
    due: Option<u64>,
    /// The index of the track on which it is, among its source's tracks.
    track_index: usize,
}

/// A slice or an instant as it is in the file, without its times. The keys are in alphabetical
/// order.
#[derive(Serialize)]
struct TraceEvent<'a, A> {
    args: A,
    #[serde(skip_serializing_if = "Option::is_none")]
    cat: Option<&'static str>,
    name: EventName<'a>,
    ph: &'static str,
    pid: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    s: Option<&'static str>,
    tid: u32,
}

/// An event's name, written from its parts.
struct EventName<'a> {
    t: u64,
    label: &'a str,
}

/// A number that may be `null`, for a member that may also be absent.
#[derive(Serialize)]
struct OrNull(Option<u64>);

/// The arguments of a call's slice.
#[derive(Serialize)]
struct CallArgs<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    age: Option<OrNull>,
    due: Option<u64>,
    end: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    missing: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    origin: Option<&'a str>,
    p: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    seq: Option<OrNull>,
    t: u64,
}

/// The arguments of an instant.
#[derive(Serialize)]
struct InstantArgs {
    #[serde(skip_serializing_if = "Option::is_none")]
    age: Option<u64>,
    t: u64,
}

/// Begins the file, before its traces.
pub(super) fn begin(out: &mut impl Write) -> io::Result<()> {
    out.write_all(b"{\"displayTimeUnit\":\"ns\",\"traceEvents\":[")
}

/// Ends the file, after its traces.
pub(super) fn end(out: &mut impl Write) -> io::Result<()> {
    out.write_all(b"\n]}\n")?;
    out.flush()
}

impl<'a, W: Write> Tracks<'a, W> {
    pub(super) fn new(out: W, header: &Header, frames: TraceFrames<'a>) -> io::Result<Self> {
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
            event: Vec::new(),
            frames,
            messages: BTreeMap::new(),
            repeated: BTreeSet::new(),
            is_progressive: header.commit == Commit::Progressive,
            sources: named.map(source).collect(),
            open: BTreeMap::new(),
            latest: 0,
            latest_track: OUTPUTS,
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

    /// Writes a metadata event about a track.
    fn reported(
        &mut self,
        label: &str,
        number: u32,
        key: &str,
        value: impl serde::Serialize,
    ) -> io::Result<()> {
        let event = json!({
            "ph": "M", "pid": self.frames.process(), "tid": number, "name": label, "args": {key: value},
        });
        self.put("", &event)
    }

    /// Adds one more track for a source.
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

    /// Returns the key of the source with this priority.
    fn source(&self, p: u64) -> Option<u64> {
        Some(p).filter(|p| self.sources.contains_key(&Some(*p)))
    }

    /// Returns the number of a source's first track.
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

    /// Appends an event. Its exact times come before its other keys.
    fn put(&mut self, times: &str, event: &impl Serialize) -> io::Result<()> {
        put(&mut self.out, &self.frames, &mut self.event, times, event)
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
        // An instant may be earlier than the one before (F0), but a slice cannot end before it
        // begins.
        let at = at.max(began);
        let source = self.source(p);
        self.occupy(source, track_index, Some(at));
        let times = format!("\"ts\":{},\"dur\":{},", self.time(began), micros(at - began));
        let tid = self.number(source, track_index);
        let mut args =
            CallArgs { age: None, due, end: outcome, missing: None, origin: None, p, seq: None, t };
        if let Some(MessageOrigin { origin: Some(origin), age, missing, .. }) =
            self.messages.get(&t)
            && p == 0
        {
            args.origin = Some(&origin.stream);
            args.seq = Some(OrNull(origin.seq));
            args.age = Some(OrNull(*age));
            args.missing = (!missing.is_empty()).then(|| missing.join(" "));
        }
        let name = EventName { t, label: outcome };
        let (cat, pid) = (Some("call"), self.frames.process());
        let event = TraceEvent { args, cat, name, ph: "X", pid, s: None, tid };
        put(&mut self.out, &self.frames, &mut self.event, &times, &event)
    }

    fn instant(&mut self, at: u64, track: u32, t: u64, label: &str) -> io::Result<()> {
        let mut args = InstantArgs { age: None, t };
        if track == OUTPUTS
            && let Some(MessageOrigin { opened, age: Some(age), .. }) = self.messages.get(&t)
        {
            args.age = Some(age.saturating_add(at.saturating_sub(*opened)));
        }
        let times = format!("\"ts\":{},", self.time(at));
        let (name, pid) = (EventName { t, label }, self.frames.process());
        let event = TraceEvent { args, cat: None, name, ph: "i", pid, s: Some("t"), tid: track };
        self.put(&times, &event)
    }

    /// Connects a message with the other traces' messages that come from the same frame. The arrow
    /// runs between local's slices, because every message has one.
    fn flow(&mut self, at: u64, t: u64, origin: &Origin) -> io::Result<()> {
        let Some((id, phase)) = self.frames.flow(origin, t) else { return Ok(()) };
        let Some(Slice { track_index, .. }) = self.open.get(&(t, 0)).copied() else {
            return Ok(());
        };
        let (ph, binding) = match phase {
            FlowPhase::Begin => ("s", None),
            FlowPhase::Step => ("t", None),
            FlowPhase::End => ("f", Some("e")),
        };
        let seq = origin.seq.unwrap_or_default();
        let mut event = json!({
            "ph": ph, "cat": "frame", "id": id, "pid": self.frames.process(),
            "tid": self.number(Some(0), track_index), "name": format!("{} {seq}", origin.stream),
        });
        if let Some(binding) = binding {
            event["bp"] = json!(binding);
        }
        self.put(&format!("\"ts\":{},", self.time(at)), &event)
    }

    /// Returns an instant on the clock that all traces of the file share, in microseconds.
    fn time(&self, at: u64) -> String {
        micros(self.frames.shared(at))
    }

    /// Writes an instant on a source's track.
    fn of_source(&mut self, at: u64, p: u64, t: u64, label: &str) -> io::Result<()> {
        let track = self.first(p)?;
        self.instant(at, track, t, label)
    }

    /// Ends the open slices of a timestamp, for the sources up to `last`.
    fn retire(&mut self, at: u64, t: u64, last: u64) -> io::Result<()> {
        let ended: Vec<u64> = self.open.range((t, 0)..=(t, last)).map(|((_, p), _)| *p).collect();
        for p in ended {
            // A cloud is cancelled, but local's computation continues (F7).
            self.end(at, t, p, if p == 0 { "no longer needed" } else { "cancelled" })?;
        }
        if last == u64::MAX {
            self.messages.remove(&t);
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
                // The refused open does not change the open message.
                if self.repeated.remove(&t) {
                    return Ok(());
                }
                self.end(at, t, 0, "refused")?;
                self.messages.remove(&t);
                Ok(())
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

impl<W: Write> viewer::TraceViewer for Tracks<'_, W> {
    fn event(&mut self, event: &Event, annotations: &Annotations) -> io::Result<()> {
        let at = match event {
            Event::Input(input) => input.at(),
            Event::Decision(decision) => decision.at(),
        };
        self.latest = self.latest.max(at);
        match event {
            Event::Input(Input::Open { at, t, deadline }) => {
                if self.messages.contains_key(t) {
                    self.repeated.insert(*t);
                    return Ok(());
                }
                let due = deadline.map(|deadline| at.saturating_add(deadline));
                let Annotations { origin, age, missing, .. } = annotations;
                let message = MessageOrigin {
                    opened: *at,
                    origin: origin.clone(),
                    age: *age,
                    missing: missing.clone(),
                };
                self.messages.insert(*t, message);
                self.begin(*at, *t, 0, due)?;
                origin.as_ref().map_or(Ok(()), |origin| self.flow(*at, *t, origin))
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
        Ok(())
    }
}

impl Serialize for EventName<'_> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self { t, label } = self;
        serializer.collect_str(&format_args!("timestamp {t}: {label}"))
    }
}

/// Appends an event to the file. `line` is a reused buffer.
fn put(
    out: &mut impl Write,
    frames: &TraceFrames<'_>,
    line: &mut Vec<u8>,
    times: &str,
    event: &impl Serialize,
) -> io::Result<()> {
    line.clear();
    line.extend_from_slice(if frames.take_first() { b"\n{" } else { b",\n{" });
    line.extend_from_slice(times.as_bytes());
    let brace = line.len();
    serde_json::to_writer(&mut *line, event)?;
    line.remove(brace);
    out.write_all(line)
}

/// Converts nanoseconds to microseconds exactly.
fn micros(nanos: u64) -> String {
    format!("{}.{:03}", nanos / 1000, nanos % 1000)
}
