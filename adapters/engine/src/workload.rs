//! Checks whether a configuration can keep up with its messages.

use std::fmt;
use std::time::Duration;

/// The messages that an operator must keep up with.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Workload {
    /// The rate in messages per second.
    pub rate: f64,
    /// The longest deadline that a cloud may get, which is the cap of its policy.
    pub longest_deadline: Duration,
    /// The longest time that a local computation takes.
    pub local_response: Duration,
}

/// A reason why a configuration cannot keep up. Its message says what to do about it.
#[derive(Clone, PartialEq, Debug)]
pub enum CapacityError {
    /// The rate is not a number above 0.
    Rate(f64),
    /// The window is too small for the messages that are open at once. Some would be refused, and
    /// for those no deadline is safe.
    Window {
        /// The workload.
        workload: Workload,
        /// The configured window.
        has: usize,
        /// The least window that suffices.
        needs: usize,
    },
    /// A cloud may have too few calls under way at once. Requests would wait, and the cloud would
    /// seem slow.
    Calls {
        /// The workload.
        workload: Workload,
        /// The cloud's name.
        cloud: String,
        /// The number of calls that it may have.
        has: usize,
        /// The number of calls that it needs.
        needs: usize,
    },
    /// Local can compute too few messages at once, so more and more would wait.
    Workers {
        /// The workload.
        workload: Workload,
        /// The number of messages that it can compute at once.
        has: usize,
        /// The number of messages that it must compute at once.
        needs: usize,
    },
}

/// All reasons why a configuration cannot keep up; at least one.
#[derive(Clone, PartialEq, Debug)]
pub struct CapacityErrors(pub Vec<CapacityError>);

/// The greatest delay of an output after its due instant, in seconds. Timers are up to 1 ms late,
/// and later on busy hosts.
const LATENESS: f64 = 0.005;

impl Workload {
    /// Checks that the window, local's computations at once, and each cloud's calls (by name)
    /// suffice.
    ///
    /// # Errors
    /// Returns everything that does not suffice.
    pub fn check<'a>(
        &self,
        window: usize,
        workers: usize,
        clouds: impl IntoIterator<Item = (&'a str, usize)>,
    ) -> Result<(), CapacityErrors> {
        let workload = *self;
        if !(workload.rate > 0.0 && workload.rate.is_finite()) {
            return Err(CapacityErrors(vec![CapacityError::Rate(workload.rate)]));
        }
        let mut all = Vec::new();
        let open = workload.longest_deadline.max(workload.local_response).as_secs_f64() + LATENESS;
        // Two more: the message that comes as the oldest one is due, and the message after it.
        let needs = whole((open * workload.rate).ceil()).saturating_add(2);
        if window < needs {
            all.push(CapacityError::Window { workload, has: window, needs });
        }
        let needs = at_once(workload.rate, workload.longest_deadline);
        for (cloud, has) in clouds {
            if has.max(1) < needs {
                let cloud = cloud.to_owned();
                all.push(CapacityError::Calls { workload, cloud, has: has.max(1), needs });
            }
        }
        let needs = at_once(workload.rate, workload.local_response);
        if workers.max(1) < needs {
            all.push(CapacityError::Workers { workload, has: workers.max(1), needs });
        }
        if all.is_empty() { Ok(()) } else { Err(CapacityErrors(all)) }
    }
}

impl fmt::Display for CapacityError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Rate(rate) => {
                write!(f, "{rate} messages a second is not a rate; give a number above 0")
            }
            Self::Window { workload, has, needs } => {
                let longest = workload.longest_deadline.max(workload.local_response).as_secs_f64();
                write!(
                    f,
                    "a window of {has} for {} messages a second that are open for up to {longest} s: \
                     give {needs}",
                    workload.rate
                )?;
                if *needs > 1024 {
                    f.write_str(" (but at most 1024 are possible)")?;
                }
                let cap = (number(has.saturating_sub(2)) / workload.rate - LATENESS).max(0.0);
                let local = workload.local_response.as_secs_f64();
                if cap >= local {
                    write!(f, ", or cap deadlines at {cap:.3} s")
                } else {
                    write!(f, "; no deadline is short enough, because local takes {local} s")
                }
            }
            Self::Calls { workload, cloud, has, needs } => {
                let longest = workload.longest_deadline.as_secs_f64();
                let cap = number(*has) / workload.rate - 0.001;
                write!(
                    f,
                    "{has} calls at once to {cloud} for {} a second that take up to {longest} s: \
                     give {needs}, or cap deadlines at {:.3} s",
                    workload.rate,
                    cap.max(0.0)
                )
            }
            Self::Workers { workload, has, needs } => {
                let local = workload.local_response.as_secs_f64();
                write!(
                    f,
                    "{has} local computations at once for {} a second that take {local} s: give \
                     {needs}, or send at most {:.1} messages a second",
                    workload.rate,
                    number(*has) / local
                )
            }
        }
    }
}

impl fmt::Display for CapacityErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, shortfall) in self.0.iter().enumerate() {
            let comma = if index > 0 { "; " } else { "" };
            write!(f, "{comma}{shortfall}")?;
        }
        Ok(())
    }
}

impl std::error::Error for CapacityErrors {}

/// Returns how many computations of this length are under way at once, and one more to spare.
fn at_once(rate: f64, takes: Duration) -> usize {
    whole((rate * takes.as_secs_f64()).floor()).saturating_add(1)
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the cast saturates, which is what is wanted of what is too great"
)]
const fn whole(number: f64) -> usize {
    number as usize
}

#[expect(clippy::cast_precision_loss, reason = "for words")]
const fn number(count: usize) -> f64 {
    count as f64
}
