//! The keys of a line that no rule of the machine reads. They name the message of a value, the
//! number of an attempt, and a message's own deadline and origin.
//!
//! The judges also read these keys, and a replay copies the keys of a result to its emit. An input
//! means the same to the machine with and without them.

use std::collections::BTreeMap;
use std::sync::Arc;

/// The keys of an event beside those that the machine's rules need. By default there are none.
#[derive(Clone, PartialEq, Eq, Hash, Default, Debug)]
pub struct Annotations {
    /// `of`, on a result or an emit: the timestamp whose message this value was computed from, as
    /// the reply says.
    pub of: Option<u64>,
    /// `for`, on a result or an emit: the timestamp that this value is meant for, as the reply
    /// says.
    pub meant_for: Option<u64>,
    /// `try`, on a request, a result or a failure of an observed trace: the number of the attempt.
    pub attempt: Option<u8>,
    /// `within`, on an open: the message's own deadline in nanoseconds. It counts from the capture
    /// if the message's age is known, and otherwise from the open.
    pub within: Option<u64>,
    /// `age`, on an open: the nanoseconds since the capture.
    pub age: Option<u64>,
    /// `origin` and `seq`, on an open: the sensor's message that this message came from.
    pub origin: Option<Origin>,
    /// `missing`, on an open: the inputs of joins on its way that contributed nothing.
    pub missing: Vec<Arc<str>>,
}

/// The keys of a result or an emit that concern its value (D2, D18).
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct ValueKeys {
    /// `of`: the timestamp whose message the value was computed from.
    pub of: Option<u64>,
    /// `for`: the timestamp that the value is meant for.
    pub meant_for: Option<u64>,
}

/// The sensor's message that an operator's message came from.
#[derive(Clone, PartialEq, Eq, Hash, Default, Debug)]
pub struct Origin {
    /// `origin`: the sensor's stream.
    pub stream: Arc<str>,
    /// `seq`: the timestamp in that stream.
    pub seq: Option<u64>,
}

/// The keys of a header beside the machine's configuration. By default there are none.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
pub struct HeaderAnnotations {
    /// `"local":"none"`, in observed traces: the operator has no local computation.
    pub without_local: bool,
    /// `max_age` of clouds by their priority: the number of timestamps by which a value may be
    /// older than its message. For other clouds it is 0.
    pub max_ages: BTreeMap<u64, u64>,
}

impl Annotations {
    /// No annotation at all.
    pub const NONE: Self = Self {
        of: None,
        meant_for: None,
        attempt: None,
        within: None,
        age: None,
        origin: None,
        missing: Vec::new(),
    };

    /// Returns `true` if there are no annotations.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        let Self { of, meant_for, attempt, within, age, origin, missing } = self;
        of.is_none()
            && meant_for.is_none()
            && attempt.is_none()
            && within.is_none()
            && age.is_none()
            && origin.is_none()
            && missing.is_empty()
    }

    /// Returns the keys that concern the value.
    #[must_use]
    pub const fn value(&self) -> ValueKeys {
        ValueKeys { of: self.of, meant_for: self.meant_for }
    }

    /// Returns the instant, in ns, at which the own deadline of a message that is opened at `at` is
    /// due (J2). Returns `None` if the message has no deadline of its own.
    #[must_use]
    pub fn due(&self, at: u64) -> Option<u64> {
        let due = u128::from(at) + u128::from(self.within?);
        let due = due.saturating_sub(self.age.unwrap_or(0).into());
        Some(u64::try_from(due).unwrap_or(u64::MAX))
    }
}

impl ValueKeys {
    /// Returns `true` if neither key is given.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.of.is_none() && self.meant_for.is_none()
    }
}

impl From<ValueKeys> for Annotations {
    fn from(ValueKeys { of, meant_for }: ValueKeys) -> Self {
        Self { of, meant_for, ..Self::NONE }
    }
}

impl HeaderAnnotations {
    /// Returns `true` if there are no annotations.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        !self.without_local && self.max_ages.is_empty()
    }

    /// Returns the first and the last timestamp that a value of source `p` for `t` may be computed
    /// from (D2).
    #[must_use]
    pub fn values_of(&self, t: u64, p: u64) -> (u64, u64) {
        (t.saturating_sub(self.max_ages.get(&p).copied().unwrap_or(0)), t)
    }
}

/// Describes the values that a source may send (D2).
pub(crate) fn allowed_values((first, last): (u64, u64)) -> String {
    if first == last {
        format!("a value of timestamp {last}")
    } else {
        format!("a value of timestamp {first} to {last}")
    }
}

/// Describes the value that may be sent for `t` (D18).
pub(crate) fn meant_value(t: u64) -> String {
    format!("a value that is meant for timestamp {t}")
}
