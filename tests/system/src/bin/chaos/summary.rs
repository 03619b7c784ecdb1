//! The summary of a run under chaos, as it is printed at the end.

use std::fmt;

use crate::gauges::ResourceUsage;

/// The summary of a run.
#[derive(Debug, Default)]
pub(crate) struct Summary {
    pub(crate) seed: u64,
    pub(crate) operators: u32,
    pub(crate) messages: u64,
    pub(crate) seconds: u64,
    /// The number of disruptions.
    pub(crate) disruptions: u64,
    pub(crate) longest_output_us: u64,
    pub(crate) greatest_timer_lateness_us: u64,
    /// The medians in the calm period after each round of disruptions, and in the last calm period.
    pub(crate) taken: Vec<ResourceUsage>,
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for ResourceUsage { resident_kib, live_kib, files, tasks } in &self.taken {
            writeln!(
                f,
                "in a calm: {resident_kib} KiB, {live_kib} of them allocated, {files} open files, {tasks} tasks"
            )?;
        }
        write!(
            f,
            "{} messages of {} operators, {} disruptions, {} s, seed {}; the longest output \
             took {} ms, a timer was {} ms late",
            self.messages,
            self.operators,
            self.disruptions,
            self.seconds,
            self.seed,
            self.longest_output_us / 1000,
            self.greatest_timer_lateness_us / 1000
        )
    }
}
