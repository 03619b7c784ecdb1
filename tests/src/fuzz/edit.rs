//! One change of a trace's decisions, with unchanged inputs.

use fuseline_traces::{Decision, DropReason, Event, OfferRefusal, OpenRefusal};

use super::bytes::Bytes;

/// A change of one line of a trace.
///
/// If it cannot be made, for instance in a trace without a decision, nothing changes.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Edit {
    /// The kind of change.
    pub op: EditKind,
    /// The index of the event to change, modulo their number. If the kind needs a decision, the
    /// next one is changed.
    pub index: u16,
    /// The differences between the decision that [`EditKind::Rewrite`] and [`EditKind::Insert`]
    /// write and the event that is there: in its kind, `at`, `t`, `p`, reason and due instant. All
    /// 0 means the same.
    pub by: [i8; 6],
}

/// The kind of an edit.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum EditKind {
    /// Changes nothing.
    #[default]
    Keep,
    /// Removes a decision.
    Remove,
    /// A decision stands twice.
    Repeat,
    /// Swaps an event and the next one, unless both are inputs.
    Swap,
    /// Replaces a decision.
    Rewrite,
    /// Inserts a decision before an event, or at the end.
    Insert,
}

impl EditKind {
    /// All kinds.
    pub const ALL: [Self; 6] =
        [Self::Keep, Self::Remove, Self::Repeat, Self::Swap, Self::Rewrite, Self::Insert];
}

impl Edit {
    pub(super) fn read(bytes: &mut Bytes<'_>) -> Self {
        let op = EditKind::ALL[usize::from(bytes.byte()) % EditKind::ALL.len()];
        let index = bytes.short();
        Self { op, index, by: std::array::from_fn(|_| bytes.byte().cast_signed()) }
    }

    /// Returns the bytes of this edit, which come before a run's.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        let mut bytes = vec![self.op as u8];
        bytes.extend(self.index.to_le_bytes());
        bytes.extend(self.by.map(i8::cast_unsigned));
        bytes
    }

    /// Returns the trace's events after this edit.
    pub(super) fn apply(&self, events: &[Event]) -> Vec<Event> {
        let mut edited = events.to_vec();
        if events.is_empty() {
            return edited;
        }
        let index = usize::from(self.index) % events.len();
        let mut from_here = (index..events.len()).chain(0..index);
        let decision = from_here.find(|index| matches!(events[*index], Event::Decision(_)));
        match (self.op, decision) {
            (EditKind::Remove, Some(index)) => drop(edited.remove(index)),
            (EditKind::Repeat, Some(index)) => edited.insert(index, events[index]),
            (EditKind::Rewrite, Some(index)) => edited[index] = self.written(&events[index]),
            (EditKind::Insert, _) => {
                let index = usize::from(self.index) % (events.len() + 1);
                let near = events.get(index).or(events.last());
                edited.splice(index..index, near.map(|near| self.written(near)));
            }
            (EditKind::Swap, _) => {
                let both_inputs =
                    edited[index..].iter().take(2).all(|event| matches!(event, Event::Input(_)));
                if !both_inputs && index + 1 < edited.len() {
                    edited.swap(index, index + 1);
                }
            }
            (EditKind::Keep, _)
            | (EditKind::Remove | EditKind::Repeat | EditKind::Rewrite, None) => {}
        }
        edited
    }

    /// Returns a decision that differs from an event by these amounts.
    fn written(&self, near: &Event) -> Event {
        let [kind, at, t, p, why, due] = self.by;
        let was = LineFields::of(near);
        let more = |value: u64, by: i8| value.wrapping_add_signed(by.into());
        let (at, t, p) = (more(was.at, at), more(was.t, t), more(was.p, p));
        let turned = |index: usize, by: i8, all: usize| index.wrapping_add_signed(by.into()) % all;
        let of_open = OpenRefusal::ALL[turned(was.why, why, OpenRefusal::ALL.len())];
        let of_offer = OfferRefusal::ALL[turned(was.why, why, OfferRefusal::ALL.len())];
        let dropped = DropReason::ALL[turned(was.why, why, DropReason::ALL.len())];
        Event::Decision(match turned(was.kind, kind, 10) {
            0 => Decision::Timer { at, t, p },
            1 => Decision::RefuseOpen { at, t, why: of_open },
            2 => Decision::RefuseOffer { at, t, p, why: of_offer },
            3 => Decision::Request { at, t, p, due: more(was.due, due) },
            4 => Decision::Hold { at, t, p },
            5 => Decision::Drop { at, t, p, why: dropped },
            6 => Decision::Emit { at, t, p },
            7 => Decision::Miss { at, t },
            8 => Decision::Final { at, t, p },
            _ => Decision::Cancel { at, t, p },
        })
    }
}

/// The fields of a line; 0 where the line has no such key.
#[derive(Default)]
struct LineFields {
    kind: usize,
    at: u64,
    t: u64,
    p: u64,
    why: usize,
    due: u64,
}

impl LineFields {
    fn of(event: &Event) -> Self {
        let words = |kind, at, t, p| Self { kind, at, t, p, ..Self::default() };
        match *event {
            Event::Input(input) => words(0, input.at(), input.t().unwrap_or_default(), 0),
            Event::Decision(decision) => match decision {
                Decision::Timer { at, t, p } => words(0, at, t, p),
                Decision::RefuseOpen { at, t, why } => {
                    Self { why: why.index(), ..words(1, at, t, 0) }
                }
                Decision::RefuseOffer { at, t, p, why } => {
                    Self { why: why.index(), ..words(2, at, t, p) }
                }
                Decision::Request { at, t, p, due } => Self { due, ..words(3, at, t, p) },
                Decision::Hold { at, t, p } => words(4, at, t, p),
                Decision::Drop { at, t, p, why } => Self { why: why.index(), ..words(5, at, t, p) },
                Decision::Emit { at, t, p } => words(6, at, t, p),
                Decision::Miss { at, t } => words(7, at, t, 0),
                Decision::Final { at, t, p } => words(8, at, t, p),
                Decision::Cancel { at, t, p } => words(9, at, t, p),
            },
        }
    }
}
