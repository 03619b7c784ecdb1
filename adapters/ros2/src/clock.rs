//! The time that the node's own messages are stamped with.

use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};

use crate::key::{MessageKey, Stamp};
use crate::middleware::{ReceivedPayload, time_of_day};
use crate::parameters::Value;
use crate::report::RosTime;
use crate::settings::Qos;

/// The topic of simulated time, its type, and what is required of it.
pub(crate) const CLOCK: (&str, &str, Qos) = (
    "/clock",
    "rosgraph_msgs/msg/Clock",
    Qos { reliable: false, transient_local: false, depth: 1 },
);

/// The time that the node's own messages are stamped with: of day, or what was last on `/clock`.
pub(crate) struct Clock {
    simulated: AtomicI64,
    is_simulated: AtomicBool,
}

impl Clock {
    pub(crate) fn new(is_simulated: bool) -> Self {
        Self { simulated: AtomicI64::new(0), is_simulated: AtomicBool::new(is_simulated) }
    }

    /// Takes a time that came on the topic.
    pub(crate) fn take(&self, sample: ReceivedPayload) {
        // A `rosgraph_msgs/Clock` is one time, as a header's stamp is.
        let time = sample.ok().and_then(|it| MessageKey::Header.read(&it.body, it.big_endian).ok());
        if let Some(nanos) = time.and_then(Stamp::nanos) {
            self.simulated.store(nanos, Ordering::Relaxed);
        }
    }

    /// Applies a parameter that was set; all but `use_sim_time` are ignored.
    pub(crate) fn set(&self, name: &str, value: &Value) {
        if let ("use_sim_time", Value::Bool(value)) = (name, value) {
            self.is_simulated.store(*value, Ordering::Relaxed);
        }
    }

    pub(crate) fn now(&self) -> RosTime {
        let is_simulated = self.is_simulated.load(Ordering::Relaxed);
        let simulated = self.simulated.load(Ordering::Relaxed);
        RosTime::of_nanos(if is_simulated { simulated } else { time_of_day() })
    }
}
