//! The keys of a line that no rule of the machine reads: whose value it is, which attempt, the message's own deadline, its
//! lineage.
//!
//! The judges read them beside the events, and a replay copies what belongs to a result to its emit. An input means the
//! same to the machine with and without them.

use std::collections::BTreeMap;
use std::sync::Arc;

/// The keys of an event beside those that the rules of the machine need; by default none.
#[derive(Clone, PartialEq, Eq, Hash, Default, Debug)]
pub struct Annotations {
    /// `of`, on a result or an emit: of which timestamp this value is, as the reply says.
    pub of: Option<u64>,
    /// `for`, on a result or an emit: for which timestamp this value is meant, as the reply says.
    pub meant_for: Option<u64>,
    /// `try`, on a request, a result or a failure of an observed trace: which attempt of the request it is about.
    pub attempt: Option<u8>,
    /// `within`, on an open: the message's own deadline in nanoseconds, from its capture where its age is known, else from
    /// the open.
    pub within: Option<u64>,
    /// `age`, on an open: the nanoseconds since the capture.
    pub age: Option<u64>,
    /// `origin` and `seq`, on an open: what the message came from.
    pub origin: Option<Origin>,
    /// `missing`, on an open: the inputs of joins on its way that nothing came from.
    pub missing: Vec<Arc<str>>,
}

/// What a result or an emit says of its value (D2, D18).
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct ValueKeys {
    /// `of`: of which timestamp it is.
    pub of: Option<u64>,
    /// `for`: for which timestamp it is meant.
    pub meant_for: Option<u64>,
}

/// The sensor's message that an operator's message came from.
#[derive(Clone, PartialEq, Eq, Hash, Default, Debug)]
pub struct Origin {
    /// `origin`: the sensor's stream.
    pub stream: Arc<str>,
    /// `seq`: the timestamp there.
    pub seq: Option<u64>,
}

/// The keys of a header beside the machine's configuration; by default none.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
pub struct HeaderAnnotations {
    /// `"local":"none"`, of observed traces: the operator has no local computation.
    pub without_local: bool,
    /// `max_age` of clouds by their priority: how many timestamps before its own a value may be of. Of all others it is 0.
    pub max_ages: BTreeMap<u64, u64>,
}

impl Annotations {
    /// None of them.
    pub const NONE: Self = Self {
        of: None,
        meant_for: None,
        attempt: None,
        within: None,
        age: None,
        origin: None,
        missing: Vec::new(),
    };

    /// Whether there is none.
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

    /// What is said of a value.
    #[must_use]
    pub const fn value(&self) -> ValueKeys {
        ValueKeys { of: self.of, meant_for: self.meant_for }
    }

    /// By when the message that is opened at `at` has its output (J2), if it has a deadline of its own.
    #[must_use]
    pub fn due(&self, at: u64) -> Option<u64> {
        let due = u128::from(at) + u128::from(self.within?);
        let due = due.saturating_sub(self.age.unwrap_or(0).into());
        Some(u64::try_from(due).unwrap_or(u64::MAX))
    }
}

impl ValueKeys {
    /// Whether nothing is said.
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
    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        !self.without_local && self.max_ages.is_empty()
    }

    /// D2: of which timestamps a value may be that source `p` sends for `t`, the earliest and the latest.
    #[must_use]
    pub fn values_of(&self, t: u64, p: u64) -> (u64, u64) {
        (t.saturating_sub(self.max_ages.get(&p).copied().unwrap_or(0)), t)
    }
}

/// D2: which values a source may send, in words.
pub(crate) fn allowed_values((first, last): (u64, u64)) -> String {
    if first == last {
        format!("a value of timestamp {last}")
    } else {
        format!("a value of timestamp {first} to {last}")
    }
}

/// D18: which values may be sent, in words.
pub(crate) fn meant_value(t: u64) -> String {
    format!("a value that is meant for timestamp {t}")
}
