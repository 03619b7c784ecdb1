//! An operator's machine, in the smallest of three capacities that has room for the window.
//!
//! A machine's memory, and the number of keys that it reads when a timer changes, depend on its
//! capacity, not on its window. Its answers do not.

use crate::arbiter::{Answer, Arbiter, CLOUDS};
use fuseline_core::{Commit, ConfigError, Firing, OfferRefusal};
use fuseline_traces::{Header, Input};

/// The firings before the current input, and the instants when they were served.
pub(crate) type ServedFirings = Vec<(u64, Firing<CLOUDS>)>;

/// The smallest of three [`Arbiter`]s, of 3, 24 and 190 KiB, that has room for the window.
pub(crate) enum SizedArbiter {
    Small(Arbiter<CLOUDS, SMALL>),
    Middle(Arbiter<CLOUDS, MIDDLE>),
    Large(Arbiter<CLOUDS, LARGE>),
}

/// The default window.
const SMALL: usize = 16;
const MIDDLE: usize = 128;
/// The greatest window.
const LARGE: usize = 1024;

/// Makes the same call on any of the three.
macro_rules! of_any_size {
    ($sized:expr, $arbiter:ident => $call:expr) => {
        match $sized {
            SizedArbiter::Small($arbiter) => $call,
            SizedArbiter::Middle($arbiter) => $call,
            SizedArbiter::Large($arbiter) => $call,
        }
    };
}

impl SizedArbiter {
    /// # Errors
    /// Returns the first [`ConfigError`] that holds. For a window it says that 1024 is the
    /// greatest.
    pub(crate) fn new(header: &Header) -> Result<Self, ConfigError> {
        Ok(match usize::from(header.window) {
            1..=SMALL => Self::Small(Arbiter::new(header)?),
            17..=MIDDLE => Self::Middle(Arbiter::new(header)?),
            _ => Self::Large(Arbiter::new(header)?),
        })
    }

    /// Applies an input, and appends the firings before it to `fired`.
    pub(crate) fn apply(&mut self, input: &Input, fired: &mut ServedFirings) -> Answer<CLOUDS> {
        let fired = |at, firing: &_| fired.push((at, *firing));
        of_any_size!(self, arbiter => arbiter.apply(input, fired))
    }

    pub(crate) fn next_due(&self) -> Option<u64> {
        of_any_size!(self, arbiter => arbiter.next_due())
    }

    pub(crate) fn now(&self) -> u64 {
        of_any_size!(self, arbiter => arbiter.now())
    }

    pub(crate) fn offer_refusal(
        &self,
        source: (u64, u64),
        deadline: u64,
        backlog: u64,
    ) -> Option<OfferRefusal> {
        of_any_size!(self, arbiter => arbiter.offer_refusal(source, deadline, backlog))
    }

    pub(crate) fn commit(&self) -> Commit {
        of_any_size!(self, arbiter => arbiter.fusion().commit())
    }

    /// Returns `true` if no message is open.
    pub(crate) fn is_idle(&self) -> bool {
        of_any_size!(self, arbiter => arbiter.fusion().is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fuseline_core::{OpenRefusal, Opening};

    fn sized(window: u16) -> Result<SizedArbiter, ConfigError> {
        let commit = fuseline_traces::Commit::Eager;
        SizedArbiter::new(&Header { operator: None, window, commit, clouds: Vec::new() })
    }

    /// Each window has room for as many messages as it says (F1).
    #[test]
    fn window_has_room_for_its_messages() {
        for window in [1, 15, 16, 17, 128, 129, 1024] {
            let mut arbiter = sized(window).unwrap();
            let fired = &mut ServedFirings::new();
            for t in 0..window.into() {
                let answer = arbiter.apply(&Input::Open { at: t, t, deadline: None }, fired);
                assert_eq!(answer, Answer::Open { t, opening: Opening::Accepted }, "of {window}");
            }
            let answer = arbiter.apply(&Input::Open { at: 2000, t: 2000, deadline: None }, fired);
            let opening = Opening::Refused(OpenRefusal::Full);
            assert_eq!(answer, Answer::Open { t: 2000, opening }, "{window}");
        }
    }

    #[test]
    fn the_machine_is_the_smallest_that_has_room() {
        assert!(matches!(sized(16), Ok(SizedArbiter::Small(_))));
        assert!(matches!(
            [sized(17), sized(128)],
            [Ok(SizedArbiter::Middle(_)), Ok(SizedArbiter::Middle(_))]
        ));
        assert!(matches!(sized(129), Ok(SizedArbiter::Large(_))));
    }

    #[test]
    fn impossible_window_is_refused_with_the_greatest() {
        for window in [0, 1025] {
            let refused = sized(window).err();
            let window = window.into();
            assert_eq!(refused, Some(ConfigError::Window { window, capacity: LARGE }));
        }
    }
}
