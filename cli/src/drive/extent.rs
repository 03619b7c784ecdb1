//! How far runs went: what lies beyond was not driven.

use std::fmt;

use fuseline_testkit::Run;
use indicatif::HumanCount;
#[cfg(feature = "full")]
use schemars::JsonSchema;
use serde::Serialize;

/// The greatest of each among the runs that passed.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize)]
#[cfg_attr(feature = "full", derive(JsonSchema))]
pub(super) struct DrivenExtent {
    /// Clouds registered.
    clouds: usize,
    /// A cloud's priority.
    priority: u16,
    window: u16,
    /// Inputs of one run.
    inputs: usize,
}

impl DrivenExtent {
    pub(super) fn add(&mut self, run: &Run) {
        let header = &run.header;
        let priority = header.clouds.iter().map(|cloud| cloud.p).max().unwrap_or_default();
        self.clouds = self.clouds.max(header.clouds.len());
        self.priority = self.priority.max(priority);
        self.window = self.window.max(header.window);
        self.inputs = self.inputs.max(run.inputs.len());
    }
}

impl fmt::Display for DrivenExtent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { clouds, priority, window, inputs } = *self;
        let inputs = HumanCount(inputs as u64);
        write!(
            f,
            "{clouds} clouds, priorities to {priority}, a window of {window}, {inputs} inputs in a \
             run; nothing beyond was driven"
        )
    }
}
