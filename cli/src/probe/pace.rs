//! Decides when the probe sends: at every slot, unless too much is unanswered.

/// A slot with more unanswered than this starts a pause, as in the paper's drive.
pub(crate) const QUEUED: usize = 30;

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum SlotAction {
    /// A request is sent.
    Send,
    /// A pause begins: nothing is sent until nothing is unanswered.
    Pause,
    /// The pause goes on.
    Skip,
}

/// The unanswered requests, and whether they have paused the sending.
#[derive(Debug, Default)]
pub(crate) struct SendPacing {
    queued: usize,
    is_paused: bool,
}

impl SendPacing {
    /// Decides about a slot that is due.
    pub(crate) const fn slot(&mut self) -> SlotAction {
        if self.is_paused {
            return SlotAction::Skip;
        }
        if self.queued > QUEUED {
            self.is_paused = true;
            return SlotAction::Pause;
        }
        self.queued += 1;
        SlotAction::Send
    }

    /// Notes that a request was answered or failed; returns whether that ends a pause.
    pub(crate) const fn ended(&mut self) -> bool {
        self.queued = self.queued.saturating_sub(1);
        let is_over = self.is_paused && self.queued == 0;
        if is_over {
            self.is_paused = false;
        }
        is_over
    }

    pub(crate) const fn queued(&self) -> usize {
        self.queued
    }

    pub(crate) const fn is_paused(&self) -> bool {
        self.is_paused
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thirty_one_may_be_unanswered_and_then_all_must_be_answered() {
        let mut pace = SendPacing::default();
        assert!((0..31).all(|_| pace.slot() == SlotAction::Send));
        assert_eq!(
            (pace.slot(), pace.slot(), pace.queued()),
            (SlotAction::Pause, SlotAction::Skip, 31)
        );
        for _ in 0..30 {
            assert!(!pace.ended());
            assert_eq!(pace.slot(), SlotAction::Skip);
        }
        assert!(pace.ended());
        assert_eq!((pace.slot(), pace.queued(), pace.is_paused()), (SlotAction::Send, 1, false));
    }

    #[test]
    fn with_thirty_unanswered_the_next_is_sent() {
        let mut pace = SendPacing::default();
        (0..31).for_each(|_| assert_eq!(pace.slot(), SlotAction::Send));
        assert!(!pace.ended());
        assert_eq!((pace.slot(), pace.slot()), (SlotAction::Send, SlotAction::Pause));
    }
}
