//! Follows frames through several operators: which messages of several traces come from the same
//! frame, and how far apart the traces' clocks are.
//!
//! The clock of each trace begins at its operator's start. A message's instant minus its age is the
//! capture of its frame on that clock. A frame that two traces share shows how far apart their
//! clocks are.

use std::cell::Cell;
use std::collections::BTreeMap;

use fuseline_traces::{Annotations, Event, Input, Origin};

/// A sensor's stream and a timestamp there.
type FrameKey = (String, u64);

/// The frames of all traces that are exported together.
#[derive(Default)]
pub(super) struct Frames {
    /// For each frame, the first message of each trace that comes from it.
    shared: BTreeMap<FrameKey, SharedFrame>,
    /// The offset that is added to the instants of each trace.
    offsets: Vec<i128>,
    /// `true` if nothing was written yet.
    is_first: Cell<bool>,
}

/// One frame.
#[derive(Default)]
struct SharedFrame {
    /// The number of the frame, from 1.
    number: usize,
    messages: Vec<FrameMessage>,
}

/// One trace's message that comes from the frame.
struct FrameMessage {
    trace: usize,
    t: u64,
    opened: u64,
    /// The instant of its capture on its trace's clock, if its age is known.
    captured: Option<i128>,
}

/// One trace's view of the frames.
pub(super) struct TraceFrames<'a> {
    frames: &'a Frames,
    trace: usize,
}

/// The place of a message along its frame's arrow.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum FlowPhase {
    Begin,
    Step,
    End,
}

impl Frames {
    /// Creates the frames of `traces` traces.
    pub(super) fn new(traces: usize) -> Self {
        Self { shared: BTreeMap::new(), offsets: vec![0; traces], is_first: Cell::new(true) }
    }

    /// Notes an event of a trace.
    pub(super) fn event(&mut self, trace: usize, event: &Event, annotations: &Annotations) {
        let (Event::Input(Input::Open { at, t, .. }), Some(key)) =
            (event, annotations.origin.as_ref().and_then(frame_key))
        else {
            return;
        };
        let captured = annotations.age.map(|age| i128::from(*at) - i128::from(age));
        let messages = &mut self.shared.entry(key).or_default().messages;
        if messages.iter().all(|message| message.trace != trace) {
            messages.push(FrameMessage { trace, t: *t, opened: *at, captured });
        }
    }

    /// Computes how far apart the clocks are, and sorts each frame's messages. It is called after
    /// all events.
    pub(super) fn align(&mut self) {
        let mut known = vec![false; self.offsets.len()];
        if let Some(first) = known.first_mut() {
            *first = true;
        }
        // This repeats, because a trace may share frames only with a trace whose offset becomes
        // known on the way.
        while self.align_next(&mut known) {}
        let least = self.offsets.iter().copied().min().unwrap_or_default();
        for offset in &mut self.offsets {
            *offset -= least;
        }
        for (number, frame) in (1..).zip(self.shared.values_mut()) {
            frame.number = number;
            frame.messages.sort_by_key(|it| i128::from(it.opened) + self.offsets[it.trace]);
        }
    }

    /// Returns one trace's view.
    pub(super) const fn of(&self, trace: usize) -> TraceFrames<'_> {
        TraceFrames { frames: self, trace }
    }

    fn align_next(&mut self, known: &mut [bool]) -> bool {
        for SharedFrame { messages, .. } in self.shared.values() {
            let captured = |is_known: bool| {
                let mut of = messages.iter().filter(|it| known[it.trace] == is_known);
                of.find_map(|it| Some((it.trace, it.captured?)))
            };
            if let (Some((from, there)), Some((to, here))) = (captured(true), captured(false)) {
                self.offsets[to] = self.offsets[from] + there - here;
                known[to] = true;
                return true;
            }
        }
        false
    }
}

impl TraceFrames<'_> {
    /// Returns the number of this trace's process, from 1.
    pub(super) fn process(&self) -> usize {
        self.trace + 1
    }

    /// Returns `true` on the first call, when none of the file's events has been written.
    pub(super) fn take_first(&self) -> bool {
        self.frames.is_first.replace(false)
    }

    /// Returns an instant of this trace on the clock that all share.
    pub(super) fn shared(&self, at: u64) -> u64 {
        let offset = self.frames.offsets.get(self.trace).copied().unwrap_or_default();
        u64::try_from(i128::from(at) + offset).unwrap_or(u64::MAX)
    }

    /// Returns the number of the frame that a message comes from, and the message's place along the
    /// arrow, or `None` if no other trace has the frame.
    pub(super) fn flow(&self, origin: &Origin, t: u64) -> Option<(usize, FlowPhase)> {
        let key = frame_key(origin)?;
        let SharedFrame { number, messages } = self.frames.shared.get(&key)?;
        if messages.len() < 2 {
            return None;
        }
        let place = messages.iter().position(|it| it.trace == self.trace && it.t == t)?;
        let phase = match place {
            0 => FlowPhase::Begin,
            place if place + 1 == messages.len() => FlowPhase::End,
            _ => FlowPhase::Step,
        };
        Some((*number, phase))
    }
}

fn frame_key(origin: &Origin) -> Option<FrameKey> {
    Some((origin.stream.to_string(), origin.seq?))
}
