//! [`Items`], an operator's output, and its reader for progressive operators (F9).

use std::collections::BTreeMap;
use std::sync::Arc;

use fuseline_engine::{Ending, Item};

use crate::stream::{Reader, StreamMessage};

/// An operator's output. It has one item for each accepted message; under progressive it has one or
/// more, with the last one marked.
pub type Items<O> = Reader<Item<O>>;

impl<O: Clone + Send + Sync + 'static> Reader<Item<O>> {
    /// Returns this reader without preliminary items: it gives one item for each message, under
    /// progressive too.
    ///
    /// The reader keeps at most one preliminary item for each open message. If no better result
    /// comes, it gives that item as forwarded once it is final. The value is copied if other
    /// readers share it. A preliminary item that was read before this call is not given again: the
    /// item of its message is then final, without a value.
    #[must_use]
    pub fn last_only(mut self) -> Self {
        let mut preliminary = BTreeMap::<u64, Arc<Item<O>>>::new();
        self.filter = Some(Box::new(move |message: StreamMessage<Item<O>>| {
            let StreamMessage { timestamp, message: item, lineage } = message;
            if !item.is_last() {
                preliminary.insert(item.timestamp, item);
                return None;
            }
            let item = match (&item.ending, preliminary.remove(&item.timestamp)) {
                (Ending::Final(_), Some(earlier)) => {
                    let earlier = Arc::unwrap_or_clone(earlier);
                    Arc::new(Arc::unwrap_or_clone(item).instead_of(earlier))
                }
                _ => item,
            };
            Some(StreamMessage { timestamp, message: item, lineage })
        }));
        self
    }
}
