//! The queues to all sources of one operator: local's first, then the clouds' in the order of the
//! header.
//!
//! The engine names a source by its index here; only inputs and effects carry priorities.
//! [`queue`](crate::queue) has one queue.

use std::iter;
use std::ops::{Index, IndexMut};

use fuseline_traces::nanos;

use crate::arbiter::CLOUDS;
use crate::config::CloudConfig;
use crate::effect::Local;
use crate::item::Source;
use crate::queue::{AbandonedRequest, SourceQueue};

/// Local's index.
pub(crate) const LOCAL: usize = 0;

/// The number of sources: local and all clouds.
const SOURCES: usize = CLOUDS + 1;

/// One queue for each source. Facts that concern all of them are stored beside them, because with
/// thousands of operators no queue is in the cache.
pub(crate) struct SourceQueues<R> {
    queues: Vec<SourceQueue<R>>,
    /// The priorities by index; 0, which is local's, where there is no source.
    priorities: [u16; SOURCES],
    /// The indices of the queues that may have changed since they were [settled](Self::settle), one
    /// bit each.
    changed: u16,
    /// The instant when local's next computation counts as lost, as of the last settling of its
    /// queue.
    next_lost: Option<u64>,
    /// `true` if local's results can be lost on the way.
    may_lose_results: bool,
    /// `true` if calls to any cloud may linger.
    may_linger: bool,
}

impl<R> SourceQueues<R> {
    /// Creates empty queues.
    pub(crate) fn new(clouds: &[CloudConfig], local: Local) -> Self {
        let source = Source { priority: 0, name: "local".into() };
        let mut queues = vec![SourceQueue::new(source, local.at_once)];
        queues[LOCAL].replaceable = local.replaceable;
        for CloudConfig { priority, name, calls, linger, max_age, .. } in clouds {
            let source = Source { priority: *priority, name: name.as_str().into() };
            let mut queue = SourceQueue::new(source, *calls);
            (queue.linger, queue.max_age) = (nanos(*linger), *max_age);
            queues.push(queue);
        }
        let mut priorities = [0; SOURCES];
        for (priority, queue) in priorities.iter_mut().zip(&queues) {
            *priority = queue.source.priority;
        }
        let (changed, next_lost, may_lose_results) = (0, None, local.may_lose_results);
        let may_linger = queues.iter().any(|queue| queue.linger > 0);
        Self { queues, priorities, changed, next_lost, may_lose_results, may_linger }
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &SourceQueue<R>> {
        self.queues.iter()
    }

    /// Ends a call that has lingered long enough by `now`, if there is one. Returns it with its
    /// source's index.
    pub(crate) fn end_lingering(&mut self, now: u64) -> Option<(usize, AbandonedRequest)> {
        if !self.may_linger {
            return None;
        }
        let mut queues = self.queues.iter_mut().enumerate();
        queues.find_map(|(index, queue)| Some((index, queue.end_lingering(now)?)))
    }

    /// Returns the indices of the queues that may have changed since they were settled.
    pub(crate) fn changed(&self) -> impl Iterator<Item = usize> + use<R> {
        let mut changed = self.changed;
        iter::from_fn(move || {
            let lowest = changed.trailing_zeros();
            changed &= changed.checked_sub(1)?;
            Some(lowest as usize)
        })
    }

    /// Returns `true` if no queue may have changed.
    pub(crate) const fn is_settled(&self) -> bool {
        self.changed == 0
    }

    /// Notes that everything in this queue that could start has been started.
    pub(crate) fn settle(&mut self, index: usize) {
        if index == LOCAL {
            self.next_lost = self[LOCAL].next_lost();
        }
        self.changed &= !(1 << index);
    }

    /// Returns the index of the source with priority `p`.
    pub(crate) fn index(&self, p: u16) -> Option<usize> {
        self.priorities.iter().position(|priority| *priority == p)
    }

    /// Returns the index of cloud `p`.
    pub(crate) fn cloud(&self, p: u16) -> Option<usize> {
        self.index(p).filter(|index| *index != LOCAL)
    }

    pub(crate) fn name(&self, index: usize) -> &str {
        &self[index].source.name
    }

    /// Returns the next instant when a call has lingered long enough or a computation counts as
    /// lost. If results can be lost on the way, lost computations matter only while another
    /// computation waits.
    pub(crate) fn next_due(&self) -> Option<u64> {
        let lingering = self.queues.iter().filter(|_| self.may_linger);
        let lingering = lingering.filter_map(SourceQueue::next_lingering_end);
        let lost = self.next_lost().filter(|_| !self.may_lose_results || self[LOCAL].is_waiting());
        lost.into_iter().chain(lingering).min()
    }

    /// Returns the instant when local's next computation counts as lost.
    pub(crate) fn next_lost(&self) -> Option<u64> {
        let has_changed = self.changed & (1 << LOCAL) != 0;
        if has_changed { self[LOCAL].next_lost() } else { self.next_lost }
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
        self.changed |= 1 << index;
        &mut self.queues[index]
    }
}
