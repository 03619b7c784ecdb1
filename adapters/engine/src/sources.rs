//! The queues to all sources of one operator, local's first, then the clouds' in the header's order.
//!
//! Everywhere in the engine a source is named by its index here; only inputs and effects carry priorities. What a queue does is
//! in [`queue`](crate::queue).

use std::ops::{Index, IndexMut};

use fuseline_traces::Header;

use crate::effect::Local;
use crate::item::Source;
use crate::queue::{AbandonedRequest, SourceQueue};

/// Local's index.
pub(crate) const LOCAL: usize = 0;

/// One queue a source.
pub(crate) struct SourceQueues<R> {
    queues: Vec<SourceQueue<R>>,
    /// Whether local's results can be lost on the way.
    is_lossy: bool,
    /// Whether calls to any cloud may linger.
    may_linger: bool,
}

impl<R> SourceQueues<R> {
    /// Empty queues; `at_once[i]` bounds the calls under way to the header's cloud `i`, which is 1 if it is not given.
    pub(crate) fn new(header: &Header, at_once: &[usize], local: Local) -> Self {
        let source = Source { priority: 0, name: "local".into() };
        let mut queues = vec![SourceQueue::new(source, local.at_once)];
        for (i, cloud) in header.clouds.iter().enumerate() {
            let name = match &cloud.name {
                Some(name) => name.as_str().into(),
                None => format!("cloud-{}", cloud.p).into(),
            };
            let at_once = at_once.get(i).copied().unwrap_or(1);
            queues.push(SourceQueue::new(Source { priority: cloud.p, name }, at_once));
        }
        Self { queues, is_lossy: local.lossy, may_linger: false }
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &SourceQueue<R>> {
        self.queues.iter()
    }

    /// Lets calls to a cloud run on for so long, in ns, after they were due.
    pub(crate) fn set_linger(&mut self, index: usize, linger: u64) {
        self.queues[index].linger = linger;
        self.may_linger |= linger > 0;
    }

    /// Ends a call that has lingered long enough by `now`, if there is one; returns its source's index too.
    pub(crate) fn end_lingering(&mut self, now: u64) -> Option<(usize, AbandonedRequest)> {
        if !self.may_linger {
            return None;
        }
        let mut queues = self.queues.iter_mut().enumerate();
        queues.find_map(|(index, queue)| Some((index, queue.end_lingering(now)?)))
    }

    pub(crate) const fn len(&self) -> usize {
        self.queues.len()
    }

    /// The index of the source with priority `p`.
    pub(crate) fn index(&self, p: u16) -> Option<usize> {
        self.iter().position(|queue| queue.source.priority == p)
    }

    /// The index of cloud `p`.
    pub(crate) fn cloud(&self, p: u16) -> Option<usize> {
        self.index(p).filter(|index| *index != LOCAL)
    }

    pub(crate) fn name(&self, index: usize) -> &str {
        &self[index].source.name
    }

    /// When the next call has lingered long enough, or a computation counts as lost: of one that is lost on the way only if that
    /// makes room for one that waits.
    pub(crate) fn next_due(&self) -> Option<u64> {
        let lingering = self.queues.iter().filter(|_| self.may_linger);
        let lingering = lingering.filter_map(SourceQueue::next_lingering_end);
        let lost = self[LOCAL].next_lost().filter(|_| !self.is_lossy || self[LOCAL].is_waiting());
        lost.into_iter().chain(lingering).min()
    }
}

impl<R> Index<usize> for SourceQueues<R> {
    type Output = SourceQueue<R>;

    fn index(&self, index: usize) -> &SourceQueue<R> {
        &self.queues[index]
    }
}

impl<R> IndexMut<usize> for SourceQueues<R> {
    fn index_mut(&mut self, index: usize) -> &mut SourceQueue<R> {
        &mut self.queues[index]
    }
}
