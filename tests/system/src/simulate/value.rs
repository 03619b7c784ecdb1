//! The inputs and outputs: values that name their source, message and instant, and are counted.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A message from the camera.
pub(crate) struct Frame {
    pub(crate) serial: usize,
    _alive: LiveCounter,
}

/// A result.
pub(crate) struct ResultValue {
    pub(crate) reported: ValueLabel,
    _alive: LiveCounter,
}

/// The bytes of a sample on a node's topic.
pub(crate) struct SampleBytes {
    bytes: Vec<u8>,
    _alive: LiveCounter,
}

/// A value's label.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct ValueLabel {
    /// The source's priority.
    pub(crate) p: u16,
    /// The timestamp that the source was given. On a node's topics it is the key.
    pub(crate) t: u64,
    /// The message that the source was given.
    pub(crate) serial: usize,
    /// The instant when it was made, in ns.
    pub(crate) at: u64,
}

/// The number of instances of one kind, and the greatest number so far.
#[derive(Clone, Default)]
pub(crate) struct InstanceCounts(Arc<[AtomicUsize; 2]>);

struct LiveCounter(InstanceCounts);

impl Frame {
    pub(crate) fn new(serial: usize, instance_counts: &InstanceCounts) -> Self {
        Self { serial, _alive: instance_counts.born() }
    }
}

impl ResultValue {
    pub(crate) fn new(reported: ValueLabel, instance_counts: &InstanceCounts) -> Self {
        Self { reported, _alive: instance_counts.born() }
    }
}

impl SampleBytes {
    pub(crate) fn new(bytes: Vec<u8>, instance_counts: &InstanceCounts) -> Self {
        Self { bytes, _alive: instance_counts.born() }
    }
}

impl ValueLabel {
    /// Returns the label as a result's bytes, which begin with the key.
    pub(crate) fn bytes(self) -> Vec<u8> {
        [self.t, self.serial as u64, self.at, self.p.into()].map(u64::to_le_bytes).concat()
    }

    /// Reads a label from all bytes of a result.
    pub(crate) fn read(bytes: &[u8]) -> Option<Self> {
        let mut numbers = bytes.chunks_exact(8).map(|it| it.try_into().map(u64::from_le_bytes));
        let mut next = || numbers.next()?.ok();
        let (t, serial) = (next()?, next()?.try_into().ok()?);
        let label = Self { t, serial, at: next()?, p: next()?.try_into().ok()? };
        (label.bytes() == bytes).then_some(label)
    }
}

impl InstanceCounts {
    pub(crate) fn now(&self) -> usize {
        self.0[0].load(Ordering::Relaxed)
    }

    pub(crate) fn most(&self) -> usize {
        self.0[1].load(Ordering::Relaxed)
    }

    fn born(&self) -> LiveCounter {
        let now = self.0[0].fetch_add(1, Ordering::Relaxed) + 1;
        self.0[1].fetch_max(now, Ordering::Relaxed);
        LiveCounter(self.clone())
    }
}

impl AsRef<[u8]> for SampleBytes {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

impl Drop for LiveCounter {
    fn drop(&mut self) {
        self.0.0[0].fetch_sub(1, Ordering::Relaxed);
    }
}
