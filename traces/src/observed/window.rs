//! P9: opens beyond the window that the header states.

use std::collections::VecDeque;

use super::gap::Opened;
use super::slack::SourceSlack;

/// Opens that came while as many others seemed open as the window holds. Whether those certainly were is known later, once no
/// output can come any more that shows the opposite.
#[derive(Clone, Debug)]
pub(super) struct CrowdedOpens {
    window: u64,
    /// How many timestamps have an open and no output yet.
    waiting: u64,
    crowded: VecDeque<Opened>,
}

/// What a line changes about whether its timestamp waits for an output.
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

    /// How many timestamps may be open at once.
    pub(super) const fn window(&self) -> u64 {
        self.window
    }

    /// Takes a change of one timestamp.
    pub(super) const fn changes(&mut self, change: WaitingChange) {
        match change {
            WaitingChange::Begins => self.waiting += 1,
            WaitingChange::Ends => self.waiting = self.waiting.saturating_sub(1),
            WaitingChange::None => {}
        }
    }

    /// Whether there is nothing to decide.
    pub(super) fn is_empty(&self) -> bool {
        self.crowded.is_empty()
    }

    /// Takes an open, after the change that it makes.
    pub(super) fn opens(&mut self, opened: Opened) {
        if self.waiting > self.window {
            self.crowded.push_back(opened);
        }
    }

    /// The next open of which it can be decided, in a trace that has certainly come to `passed`; at its end all.
    pub(super) fn next(&mut self, passed: Option<u64>, slack: &SourceSlack) -> Option<Opened> {
        let opened = self.crowded.front()?;
        let by = slack.reach().saturating_add(slack.tolerance());
        if passed.is_some_and(|passed| passed <= opened.at.saturating_add(by)) {
            return None;
        }
        self.crowded.pop_front()
    }
}
