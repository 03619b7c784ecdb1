//! Of which timestamp the value is that an emit sends: that of the result which was accepted.

use std::collections::BTreeMap;

use crate::event::{Decision, Input};

/// Goes along with a machine's decisions, so that an emit can say of which timestamp its value is (D2).
///
/// It holds an entry for each held result that has one, so its memory is bounded as the machine's is.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
pub struct HeldValues {
    /// `of` by timestamp and source.
    held: BTreeMap<(u64, u64), u64>,
    /// `of` of what the last input sent, by timestamp.
    sent: Vec<(u64, u64)>,
}

impl HeldValues {
    /// Whether an input that says `of` changes nothing here, so that it need not be applied.
    #[must_use]
    pub fn is_idle(&self, of: Option<u64>) -> bool {
        of.is_none() && self.sent.is_empty() && self.held.is_empty()
    }

    /// Takes an input, what it says of its value, and all that was decided about it, in order.
    pub fn apply<'a>(
        &mut self,
        input: &Input,
        of: Option<u64>,
        decisions: impl DoubleEndedIterator<Item = &'a Decision> + Clone,
    ) {
        self.sent.clear();
        let is_dropped = matches!(decisions.clone().next_back(), Some(Decision::Drop { .. }));
        // A value comes with an accepted result alone; one that is dropped must not replace what is held.
        if let (Input::Result { t, p, .. }, Some(of), false) = (input, of, is_dropped) {
            self.held.insert((*t, *p), of);
        }
        for decision in decisions {
            let Decision::Emit { t, p, .. } = *decision else { continue };
            self.sent.extend(self.held.get(&(t, p)).map(|of| (t, *of)));
            self.held.retain(|(held, _), _| *held != t);
        }
    }

    /// Of which timestamp the value is that this decision about the last input sends, if that is known.
    #[must_use]
    pub fn of(&self, decision: &Decision) -> Option<u64> {
        let Decision::Emit { t: sent, .. } = decision else { return None };
        self.sent.iter().find(|(t, _)| t == sent).map(|(_, of)| *of)
    }
}
