//! Counts an operator's outputs from its trace, in bounded memory.

use std::collections::BTreeMap;

use fuseline_traces::{Commit, Decision, Event, Header, Input};

/// The number of messages without an outcome that are remembered. It is more than a window has.
const OPEN: usize = 4096;
/// The number of leading bits of a response time that the bins distinguish. A bin is at most a 32nd
/// wide.
const BITS: u32 = 6;

/// The first instant and the last, in nanoseconds; the number of messages, of missed ones and of
/// refused ones; the outputs.
pub(crate) type SummaryFields = (u64, u64, u64, u64, Vec<SlowestOutput>);
/// A source's priority and name, the greatest response of the bin in nanoseconds, and the number of
/// outputs.
pub(crate) type SlowestOutput = (u64, String, u64, u64);

/// The counts so far.
#[derive(Default)]
pub(crate) struct PyTally {
    /// The least and the greatest instant.
    span: Option<(u64, u64)>,
    messages: u64,
    missed: u64,
    refused: u64,
    /// For each message without an outcome, when it was opened, and how often it was tried.
    open: BTreeMap<u64, (u64, u64)>,
    /// The last preliminary output of each of these messages: its source and bin.
    preliminary: BTreeMap<u64, (u64, u64)>,
    /// The number of outputs by source and bin.
    outputs: BTreeMap<(u64, u64), u64>,
}

impl PyTally {
    pub(crate) fn event(&mut self, commit: Commit, event: &Event) {
        let at = match event {
            Event::Input(input) => input.at(),
            Event::Decision(decision) => decision.at(),
        };
        let (first, last) = self.span.unwrap_or((at, at));
        self.span = Some((first.min(at), last.max(at)));
        match *event {
            Event::Input(Input::Open { at, t, .. }) => {
                self.messages += 1;
                self.open.entry(t).or_insert((at, 0)).1 += 1;
                if self.open.len() > OPEN
                    && let Some((t, _)) = self.open.pop_first()
                {
                    self.preliminary.remove(&t);
                }
            }
            Event::Decision(Decision::RefuseOpen { t, .. }) => {
                self.refused += 1;
                // Another message may be open under the same timestamp.
                match self.open.get_mut(&t) {
                    Some((_, tries)) if *tries > 1 => *tries -= 1,
                    _ => drop(self.open.remove(&t)),
                }
            }
            Event::Decision(Decision::Miss { t, .. }) => {
                self.missed += 1;
                self.open.remove(&t);
            }
            Event::Decision(Decision::Emit { at, t, p }) => {
                // The judge reports an output for which no message is open.
                let Some((opened, _)) = self.open.get(&t) else { return };
                let output = (p, bin(at.saturating_sub(*opened)));
                *self.outputs.entry(output).or_default() += 1;
                if commit != Commit::Progressive {
                    self.open.remove(&t);
                } else if let Some(worse) = self.preliminary.insert(t, output)
                    && let Some(count) = self.outputs.get_mut(&worse)
                {
                    // A better output takes its place (F9).
                    *count -= 1;
                }
            }
            Event::Decision(Decision::Final { t, .. }) => {
                self.open.remove(&t);
                self.preliminary.remove(&t);
            }
            Event::Input(_) | Event::Decision(_) => {}
        }
    }

    pub(crate) fn counted(self, header: &Header) -> SummaryFields {
        let name = |p: u64| {
            let cloud = header.clouds.iter().find(|cloud| u64::from(cloud.p) == p);
            match cloud.and_then(|cloud| cloud.name.clone()) {
                Some(name) => name,
                None if p == 0 => "local".to_owned(),
                None => format!("cloud-{p}"),
            }
        };
        let outputs = self.outputs.into_iter().filter(|(_, count)| *count > 0);
        let outputs = outputs.map(|((p, bin), count)| (p, name(p), bin, count));
        let (first, last) = self.span.unwrap_or_default();
        (last - first, self.messages, self.missed, self.refused, outputs.collect())
    }
}

/// Returns the greatest response that differs from this one only in its lower bits.
const fn bin(response: u64) -> u64 {
    let shift = (u64::BITS - response.leading_zeros()).saturating_sub(BITS);
    response | ((1 << shift) - 1)
}
