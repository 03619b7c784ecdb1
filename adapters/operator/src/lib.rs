//! What every adapter shares: the core, driven by inputs and answering in the words of the trace.

mod arbiter;

pub use arbiter::Arbiter;
