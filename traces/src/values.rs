//! The keys of an emit's value, which are the same as the accepted result's.

use std::collections::BTreeMap;

use crate::annotations::ValueKeys;
use crate::event::{Decision, Input};

/// Follows a machine's decisions, so that an emit can have the value keys of its result. They name
/// the message that the value was computed from (D2), and the message that it is meant for (D18).
///
/// It stores an entry for each held result that has a value key, so its memory is bounded like the
/// machine's.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
pub struct HeldValues {
    /// The value keys by timestamp and source.
    held: BTreeMap<(u64, u64), ValueKeys>,
    /// The value keys that the last input sent, by timestamp.
    sent: Vec<(u64, ValueKeys)>,
}

impl HeldValues {
    /// Returns `true` if an input with these value keys would change nothing here. It then need not
    /// be applied.
    #[must_use]
    pub fn is_idle(&self, value: ValueKeys) -> bool {
        value.is_empty() && self.sent.is_empty() && self.held.is_empty()
    }

    /// Notes an input, its value keys, and all decisions about it, in order.
    pub fn apply<'a>(
        &mut self,
        input: &Input,
        value: ValueKeys,
        decisions: impl DoubleEndedIterator<Item = &'a Decision> + Clone,
    ) {
        self.sent.clear();
        let is_dropped = matches!(decisions.clone().next_back(), Some(Decision::Drop { .. }));
        // Only an accepted result has a value to send. A dropped result must not replace a held
        // value.
        if let (Input::Result { t, p, .. }, false) = (input, value.is_empty() || is_dropped) {
            self.held.insert((*t, *p), value);
        }
        for decision in decisions {
            let Decision::Emit { t, p, .. } = *decision else { continue };
            self.sent.extend(self.held.get(&(t, p)).map(|value| (t, *value)));
            self.held.retain(|(held, _), _| *held != t);
        }
    }

    /// Returns the value keys of the value that this decision about the last input sends, as far as
    /// they are known.
    #[must_use]
    pub fn sent(&self, decision: &Decision) -> ValueKeys {
        let Decision::Emit { t: sent, .. } = decision else { return ValueKeys::default() };
        self.sent.iter().find(|(t, _)| t == sent).map_or_else(ValueKeys::default, |(_, it)| *it)
    }
}
