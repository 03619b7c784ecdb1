//! The state of a stateful operator, such as a tracker, which goes along with its messages (E10).

use std::fmt;

use crate::shared::SharedState;

/// The state from which an operator computes its next message; clones share it.
///
/// Local begins with [`current`](Self::current) and gives what comes of it to [`computed`](Self::computed); a message handler
/// sends [`current`](Self::current) along, and [`use_state`](crate::Setup::use_state) takes over that of each result that is
/// sent. The state of the latest message is kept, and of one message that of the result that was sent: no state goes back to an
/// earlier message, and what was computed from an older state is not computed again (A55).
///
/// ```
/// # use fuseline_tokio::CarriedState;
/// let tracks = CarriedState::new(vec!["a van"]);
/// tracks.computed(0, vec!["a van", "a shadow"]); // local's
/// tracks.sent(0, vec!["a van", "a bicycle"]); // a cloud's result for the same message was sent
/// assert_eq!(tracks.current(), ["a van", "a bicycle"]);
/// ```
pub struct CarriedState<S>(SharedState<StateOf<S>>);

/// A state, and what it is of.
struct StateOf<S> {
    state: S,
    /// Of which message; none at first.
    of: Option<u64>,
    is_sent: bool,
}

impl<S: Clone> CarriedState<S> {
    /// A state that begins as `state`.
    #[must_use]
    pub fn new(state: S) -> Self {
        Self(SharedState::new(StateOf { state, of: None, is_sent: false }))
    }

    /// The state to begin the next message with.
    #[must_use]
    pub fn current(&self) -> S {
        self.0.with(|current| current.state.clone())
    }

    /// Local computed a message to this state; it is not known yet whether its result is sent.
    pub fn computed(&self, timestamp: u64, state: S) {
        self.replace(timestamp, state, false);
    }

    /// The result with this state was sent for a message.
    pub fn sent(&self, timestamp: u64, state: S) {
        self.replace(timestamp, state, true);
    }

    fn replace(&self, timestamp: u64, state: S, is_sent: bool) {
        self.0.with(|current| {
            // E10: the latest message's, and of one message that of the result that was sent.
            if (current.of, current.is_sent) <= (Some(timestamp), is_sent) {
                *current = StateOf { state, of: Some(timestamp), is_sent };
            }
        });
    }
}

impl<S> Clone for CarriedState<S> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<S> fmt::Debug for CarriedState<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("CarriedState").finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// E10.
    #[test]
    fn the_state_is_that_of_the_latest_message_and_of_the_result_that_was_sent() {
        let state = CarriedState::new("at first");
        let expect = |expected| assert_eq!(state.current(), expected);
        state.computed(3, "local's of 3");
        expect("local's of 3");
        state.sent(3, "the cloud's of 3");
        state.computed(3, "local's of 3, late");
        expect("the cloud's of 3");
        state.computed(4, "local's of 4");
        state.sent(3, "a better one's of 3");
        expect("local's of 4");
        state.sent(4, "a cloud's of 4");
        state.sent(4, "a better one's of 4");
        expect("a better one's of 4");
    }
}
