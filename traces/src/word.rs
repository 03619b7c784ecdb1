//! The keys of a line, and which kind of line must or may have which key.

use crate::parse::Form;

/// The kind of a line.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum LineKind {
    Header,
    Open,
    Offer,
    Result,
    Fail,
    Tick,
    Timer,
    Refuse,
    Request,
    Hold,
    Drop,
    Emit,
    Final,
    Miss,
    Cancel,
}

/// A key of a line's object.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Key {
    Fuseline,
    Operator,
    Window,
    Commit,
    Local,
    Clouds,
    Ev,
    At,
    T,
    P,
    Deadline,
    Backlog,
    Due,
    Why,
    Of,
    For,
    Try,
    Within,
    Age,
    Origin,
    Seq,
    Missing,
    X,
}

/// A set of keys.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub(crate) struct Keys(u32);

impl LineKind {
    /// The events, for people.
    pub(crate) const EVENTS: &str = "open, offer, result, fail, tick, timer, refuse, request, hold, drop, emit, final, miss, cancel";

    /// Returns the event with this word.
    pub(crate) fn named(name: &str) -> Option<Self> {
        Some(match name {
            "open" => Self::Open,
            "offer" => Self::Offer,
            "result" => Self::Result,
            "fail" => Self::Fail,
            "tick" => Self::Tick,
            "timer" => Self::Timer,
            "refuse" => Self::Refuse,
            "request" => Self::Request,
            "hold" => Self::Hold,
            "drop" => Self::Drop,
            "emit" => Self::Emit,
            "final" => Self::Final,
            "miss" => Self::Miss,
            "cancel" => Self::Cancel,
            _ => return None,
        })
    }

    /// Returns the word that a trace uses.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Header => "header",
            Self::Open => "open",
            Self::Offer => "offer",
            Self::Result => "result",
            Self::Fail => "fail",
            Self::Tick => "tick",
            Self::Timer => "timer",
            Self::Refuse => "refuse",
            Self::Request => "request",
            Self::Hold => "hold",
            Self::Drop => "drop",
            Self::Emit => "emit",
            Self::Final => "final",
            Self::Miss => "miss",
            Self::Cancel => "cancel",
        }
    }

    /// Returns the keys that such a line must have.
    pub(crate) const fn required(self) -> Keys {
        use Key::{At, Backlog, Clouds, Deadline, Due, Ev, Fuseline, P, T, Why, Window};
        match self {
            Self::Header => Keys::of(&[Fuseline, Window, Clouds]),
            Self::Offer => Keys::of(&[Ev, At, T, P, Deadline, Backlog]),
            Self::Tick => Keys::of(&[Ev, At]),
            Self::Refuse => Keys::of(&[Ev, At, T, Why]),
            Self::Request => Keys::of(&[Ev, At, T, P, Due]),
            Self::Drop => Keys::of(&[Ev, At, T, P, Why]),
            Self::Open | Self::Miss => Keys::of(&[Ev, At, T]),
            Self::Result
            | Self::Fail
            | Self::Timer
            | Self::Hold
            | Self::Emit
            | Self::Final
            | Self::Cancel => Keys::of(&[Ev, At, T, P]),
        }
    }

    /// Returns the keys that such a line may have, with those that it must have.
    pub(crate) const fn keys(self, form: Form) -> Keys {
        use Key::{Age, Commit, Deadline, For, Missing, Of, Operator, Origin, P, Seq, Within, X};
        let more = match self {
            Self::Header => Keys::of(&[Operator, Commit, X]),
            Self::Open => Keys::of(&[Deadline, Within, Age, Origin, Seq, Missing, X]),
            Self::Refuse => Keys::of(&[P, X]),
            Self::Result | Self::Emit => Keys::of(&[Of, For, X]),
            Self::Offer
            | Self::Fail
            | Self::Tick
            | Self::Timer
            | Self::Request
            | Self::Hold
            | Self::Drop
            | Self::Final
            | Self::Miss
            | Self::Cancel => Keys::of(&[X]),
        };
        let observed = match form {
            Form::Strict => Keys(0),
            Form::Observed | Form::WithoutLocal => self.keys_of_observed(),
        };
        Keys(self.required().0 | more.0 | observed.0)
    }

    /// Returns the keys that such a line may have only in observed traces.
    pub(crate) const fn keys_of_observed(self) -> Keys {
        match self {
            Self::Header => Keys::of(&[Key::Local]),
            Self::Request | Self::Result | Self::Fail => Keys::of(&[Key::Try]),
            Self::Open
            | Self::Offer
            | Self::Tick
            | Self::Timer
            | Self::Refuse
            | Self::Hold
            | Self::Drop
            | Self::Emit
            | Self::Final
            | Self::Miss
            | Self::Cancel => Keys(0),
        }
    }

    /// Describes a line of this kind and its keys, for people.
    pub(crate) fn takes(self, form: Form) -> String {
        let article = if self == Self::Open || self == Self::Offer || self == Self::Emit {
            "an"
        } else {
            "a"
        };
        let keys: Vec<_> = self.keys(form).iter().map(Key::name).collect();
        format!("{article} {} line; it takes {}", self.name(), keys.join(", "))
    }
}

impl Key {
    /// The number of keys.
    pub(crate) const COUNT: usize = Self::ALL.len();

    /// All keys, in the order in which they are written.
    const ALL: [Self; 23] = [
        Self::Fuseline,
        Self::Operator,
        Self::Window,
        Self::Commit,
        Self::Local,
        Self::Clouds,
        Self::Ev,
        Self::At,
        Self::T,
        Self::P,
        Self::Deadline,
        Self::Backlog,
        Self::Due,
        Self::Why,
        Self::Of,
        Self::For,
        Self::Try,
        Self::Within,
        Self::Age,
        Self::Origin,
        Self::Seq,
        Self::Missing,
        Self::X,
    ];

    /// Returns the key with this name.
    pub(crate) fn named(name: &str) -> Option<Self> {
        Some(match name {
            "ev" => Self::Ev,
            "at" => Self::At,
            "t" => Self::T,
            "p" => Self::P,
            "why" => Self::Why,
            "deadline" => Self::Deadline,
            "backlog" => Self::Backlog,
            "due" => Self::Due,
            "of" => Self::Of,
            "for" => Self::For,
            "try" => Self::Try,
            "within" => Self::Within,
            "age" => Self::Age,
            "origin" => Self::Origin,
            "seq" => Self::Seq,
            "missing" => Self::Missing,
            "x" => Self::X,
            "fuseline" => Self::Fuseline,
            "operator" => Self::Operator,
            "window" => Self::Window,
            "commit" => Self::Commit,
            "local" => Self::Local,
            "clouds" => Self::Clouds,
            _ => return None,
        })
    }

    /// Returns the name of the key as it is written.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Fuseline => "fuseline",
            Self::Operator => "operator",
            Self::Window => "window",
            Self::Commit => "commit",
            Self::Local => "local",
            Self::Clouds => "clouds",
            Self::Ev => "ev",
            Self::At => "at",
            Self::T => "t",
            Self::P => "p",
            Self::Deadline => "deadline",
            Self::Backlog => "backlog",
            Self::Due => "due",
            Self::Why => "why",
            Self::Of => "of",
            Self::For => "for",
            Self::Try => "try",
            Self::Within => "within",
            Self::Age => "age",
            Self::Origin => "origin",
            Self::Seq => "seq",
            Self::Missing => "missing",
            Self::X => "x",
        }
    }
}

impl Keys {
    /// Returns the set of these keys.
    pub(crate) const fn of(keys: &[Key]) -> Self {
        let mut bits = 0;
        let mut at = 0;
        while at < keys.len() {
            bits |= 1 << keys[at] as u32;
            at += 1;
        }
        Self(bits)
    }

    /// Adds a key. Returns `false` if it was a member.
    pub(crate) const fn insert(&mut self, key: Key) -> bool {
        let before = self.0;
        self.0 |= 1 << key as u32;
        self.0 != before
    }

    pub(crate) const fn contains(self, key: Key) -> bool {
        self.0 & (1 << key as u32) != 0
    }

    pub(crate) const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Returns the keys that are in both sets.
    pub(crate) const fn within(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// Returns the keys that are not in `other`.
    pub(crate) const fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// Returns the key that is written first.
    pub(crate) fn first(self) -> Option<Key> {
        Key::ALL.get(self.0.trailing_zeros() as usize).copied()
    }

    /// Returns the keys in the order in which they are written.
    pub(crate) fn iter(self) -> impl Iterator<Item = Key> {
        Key::ALL.into_iter().filter(move |key| self.contains(*key))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_have_their_names_and_places() {
        for (place, key) in Key::ALL.into_iter().enumerate() {
            assert_eq!(Key::named(key.name()), Some(key));
            assert_eq!(key as usize, place);
        }
    }
}
