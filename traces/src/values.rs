//! What an emit says of the value that it sends: what the accepted result said.

use std::collections::BTreeMap;

use crate::annotations::ValueKeys;
use crate::event::{Decision, Input};

/// Goes along with a machine's decisions, so that an emit can say of which timestamp its value is (D2),
/// and for which one it is meant (D18).
///
/// It holds an entry for each held result that has one, so its memory is bounded as the machine's is.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
pub struct HeldValues {
    /// By timestamp and source.
    held: BTreeMap<(u64, u64), ValueKeys>,
    /// What the last input sent, by timestamp.
    sent: Vec<(u64, ValueKeys)>,
}

impl HeldValues {
    /// Whether an input that says this of its value changes nothing here, so that it need not be applied.
    #[must_use]
    pub fn is_idle(&self, value: ValueKeys) -> bool {
        value.is_empty() && self.sent.is_empty() && self.held.is_empty()
    }

    /// Takes an input, what it says of its value, and all that was decided about it, in order.
    pub fn apply<'a>(
        &mut self,
        input: &Input,
        value: ValueKeys,
        decisions: impl DoubleEndedIterator<Item = &'a Decision> + Clone,
    ) {
        self.sent.clear();
        let is_dropped = matches!(decisions.clone().next_back(), Some(Decision::Drop { .. }));
        // A value comes with an accepted result alone; one that is dropped must not replace what is held.
        if let (Input::Result { t, p, .. }, false) = (input, value.is_empty() || is_dropped) {
            self.held.insert((*t, *p), value);
        }
        for decision in decisions {
            let Decision::Emit { t, p, .. } = *decision else { continue };
            self.sent.extend(self.held.get(&(t, p)).map(|value| (t, *value)));
            self.held.retain(|(held, _), _| *held != t);
        }
    }

    /// What this decision about the last input says of the value that it sends, as far as that is known.
    #[must_use]
    pub fn sent(&self, decision: &Decision) -> ValueKeys {
        let Decision::Emit { t: sent, .. } = decision else { return ValueKeys::default() };
        self.sent.iter().find(|(t, _)| t == sent).map_or_else(ValueKeys::default, |(_, it)| *it)
    }
}
