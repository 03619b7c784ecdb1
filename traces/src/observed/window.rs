//! Finds opens beyond the window that the header states (P9).

use std::collections::VecDeque;

use super::gap::Opened;
use super::slack::SourceSlack;

/// The opens that came while as many others as the window holds seemed open. Whether those were
/// certainly open is known later, when no output that shows the opposite can come any more.
#[derive(Clone, Debug)]
pub(super) struct CrowdedOpens {
    window: u64,
    /// The number of timestamps that have an open and no output yet.
    waiting: u64,
    crowded: VecDeque<Opened>,
}

/// States how a line changes whether its timestamp waits for an output.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum WaitingChange {
    Begins,
    Ends,
    None,
}

impl CrowdedOpens {
    pub(super) fn new(window: u16) -> Self {
        Self { window: window.into(), waiting: 0, crowded: VecDeque::new() }
    }

    /// Returns the greatest number of timestamps that may be open at once.
    pub(super) const fn window(&self) -> u64 {
        self.window
    }

    /// Notes the change of one timestamp.
    pub(super) const fn changes(&mut self, change: WaitingChange) {
        match change {
            WaitingChange::Begins => self.waiting += 1,
            WaitingChange::Ends => self.waiting = self.waiting.saturating_sub(1),
            WaitingChange::None => {}
        }
    }

    /// Returns `true` if there is nothing to decide.
    pub(super) fn is_empty(&self) -> bool {
        self.crowded.is_empty()
    }

    /// Notes an open, after the change that it makes.
    pub(super) fn opens(&mut self, opened: Opened) {
        if self.waiting > self.window {
            self.crowded.push_back(opened);
        }
    }

    /// Returns the next open that can be decided in a trace that has certainly come to `passed`, or
    /// any open at its end.
    pub(super) fn next(&mut self, passed: Option<u64>, slack: &SourceSlack) -> Option<Opened> {
        let opened = self.crowded.front()?;
        let by = slack.reach().saturating_add(slack.tolerance());
        if passed.is_some_and(|passed| passed <= opened.at.saturating_add(by)) {
            return None;
        }
        self.crowded.pop_front()
    }
}
