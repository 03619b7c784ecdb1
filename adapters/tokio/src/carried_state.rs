//! The state of a stateful operator, such as a tracker, that is carried from message to message
//! (E10).

use std::fmt;

use crate::shared::SharedState;

/// Holds the state from which an operator computes its next message. Clones share it.
///
/// Local begins with [`current`](Self::current) and passes the state after its computation to
/// [`computed`](Self::computed). A message handler sends [`current`](Self::current) along to the
/// cloud, and [`use_state`](crate::Setup::use_state) takes over the state of each result that is
/// sent. The state of the latest message is kept. Among the states of one message, the state of the
/// result that was sent is kept. The state never goes back to an earlier message, and nothing is
/// computed again because an older state was used (A55).
///
/// ```
/// # use fuseline_tokio::CarriedState;
/// let tracks = CarriedState::new(vec!["a van"]);
/// tracks.computed(0, vec!["a van", "a shadow"]); // local's
/// tracks.sent(0, vec!["a van", "a bicycle"]); // a cloud's result for the same message was sent
/// assert_eq!(tracks.current(), ["a van", "a bicycle"]);
/// ```
pub struct CarriedState<S>(SharedState<StateOf<S>>);

/// A state, and the message that it belongs to.
struct StateOf<S> {
    state: S,
    /// The message's timestamp; `None` at first.
    of: Option<u64>,
    is_sent: bool,
}

impl<S: Clone> CarriedState<S> {
    /// Creates a carried state that begins as `state`.
    #[must_use]
    pub fn new(state: S) -> Self {
        Self(SharedState::new(StateOf { state, of: None, is_sent: false }))
    }

    /// Returns the state with which to begin the next message.
    #[must_use]
    pub fn current(&self) -> S {
        self.0.with(|current| current.state.clone())
    }

    /// Notes the state after local computed a message. It is not known yet whether that result is
    /// sent.
    pub fn computed(&self, timestamp: u64, state: S) {
        self.replace(timestamp, state, false);
    }

    /// Notes the state of the result that was sent for a message.
    pub fn sent(&self, timestamp: u64, state: S) {
        self.replace(timestamp, state, true);
    }

    fn replace(&self, timestamp: u64, state: S, is_sent: bool) {
        self.0.with(|current| {
            // The state of the latest message is kept. For the same message, the state of the sent
            // result wins (E10).
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

    /// The state is the latest message's, and for one message the sent result's (E10).
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
