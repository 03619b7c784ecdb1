//! The configuration of an engine, its checks, and the header of its trace.

use std::fmt;
use std::time::Duration;

use fuseline_core::ConfigError;
use fuseline_deadline::Policy;
use fuseline_traces::{Cloud, Commit, Header, HeaderAnnotations};

use crate::effect::Local;
use crate::latency::Latency;
use crate::sized_arbiter::SizedArbiter;
use crate::workload::{CapacityErrors, Workload};

/// Configures an operator. Change the fields that differ from their defaults, then pass it to
/// [`Engine::new`](crate::Engine::new).
#[derive(Debug)]
pub struct EngineConfig {
    /// The operator's name in logs, metrics and traces; `operator` by default.
    pub operator: String,
    /// The greatest number of messages that may be open at once, 1 to 1024; 16 by default (F1).
    pub window: u16,
    /// The commit rule (F6, F9); eager by default.
    pub commit: Commit,
    /// The clouds, up to 15; none by default.
    pub clouds: Vec<CloudConfig>,
    /// The computations that local takes.
    pub local: Local,
    /// A timer that is served later than this, or a handler that runs longer without a pause, is
    /// counted and logged as a warning; 20 ms by default.
    pub lag_warning: Duration,
    /// The longest deadline of an offer; unbounded by default. An offer with a longer deadline is
    /// refused as `deadline`. If a policy chooses the deadline, this is the greatest that it may
    /// choose.
    pub greatest_deadline: Duration,
    /// `true` if the adapter has a [substitute](crate::Item::substitute) for messages that are
    /// missed (E4). Such messages are missed early enough for the operators downstream.
    pub has_substitutes: bool,
    /// `true` to return results that came too late as [hints](crate::Effect::Hint), if their
    /// message is among the last 1024.
    pub takes_hints: bool,
    /// `true` if messages' ages come from a clock that may step (D13). They are then recorded, but
    /// end-to-end deadlines count from when a message is accepted.
    pub has_doubtful_ages: bool,
    /// Records how long local's computations and messages take, for the reserve of the operators
    /// upstream. By default nothing is recorded. Refused messages never are.
    pub latency: Option<Latency>,
    /// The rate of messages that the operator must keep up with. By default it is not checked.
    pub workload: Option<Workload>,
}

/// Configures a cloud's queue, bounds and deadlines.
pub struct CloudConfig {
    /// The cloud's rank, from 1 to 65535, different for each cloud. The greater number wins.
    pub priority: u16,
    /// The name for people, traces and metrics; `cloud-` and the priority by default.
    pub name: String,
    /// The number of requests waiting to be sent at which the gate shuts (F2g); at least 1. The
    /// default is [`calls`](Self::calls), so that no more requests wait than calls may be under way
    /// (A15).
    pub limit: Option<u64>,
    /// The number of waiting requests at or below which the shut gate opens; less than `limit`, 0
    /// by default.
    pub resume: u64,
    /// The greatest number of calls under way; at least 1, 8 by default. Further requests wait.
    pub calls: usize,
    /// Chooses how long each request may take, at most what the message handler says, and learns
    /// how each ended. By default there is none, and the message handler alone decides.
    ///
    /// An abandoned request is reported as censored, even if it never left the queue. Ages count
    /// from when the message was accepted. If it has an end-to-end deadline, they count from the
    /// capture and include the reserve. The policy is called in the operator's task and must not
    /// block. If it panics, no request is made.
    pub policy: Option<Box<dyn Policy + Send>>,
    /// The time that a call may run on after its due instant, so that `policy` learns how long it
    /// really takes; 0 by default. A result that comes then is still dropped (F3).
    ///
    /// Such calls do not count among those under way. Up to `calls` of them may linger; one more
    /// ends the oldest.
    pub linger: Duration,
    /// The number of messages by which a value may be older than its message; 0 by default. An
    /// older value, or a value of a later message, is a failure (D2, F4). The reply states which
    /// message its value was computed from.
    pub max_age: u64,
}

/// The reason why a configuration was refused.
#[derive(Clone, PartialEq, Debug)]
pub enum EngineConfigError {
    /// No machine has this window and these clouds.
    Machine(ConfigError),
    /// A policy's promise assumes one output for each message, but under progressive there may be
    /// more.
    OneOutput {
        /// The cloud's name.
        cloud: String,
    },
    /// A policy learns of longer deadlines only from calls that linger, but this cloud's calls do
    /// not linger. The policy would never again wait for a cloud that was gone.
    Linger {
        /// The cloud's name.
        cloud: String,
    },
    /// The operator could not keep up with its [workload](EngineConfig::workload).
    Workload(CapacityErrors),
}

impl EngineConfig {
    /// Returns the trace's header, and the header's keys that the machine does not need.
    #[must_use]
    pub fn header(&self) -> (Header, HeaderAnnotations) {
        let max_ages = self.clouds.iter().map(|cloud| (u64::from(cloud.priority), cloud.max_age));
        let max_ages = max_ages.filter(|(_, max_age)| *max_age > 0).collect();
        let clouds = self.clouds.iter().map(|cloud| Cloud {
            p: cloud.priority,
            name: Some(cloud.name.clone()),
            // A request should not wait behind more calls than are under way (A15).
            limit: cloud.limit.unwrap_or(cloud.calls as u64),
            resume: cloud.resume,
        });
        let header = Header {
            operator: Some(self.operator.clone()),
            window: self.window,
            commit: self.commit,
            clouds: clouds.collect(),
        };
        (header, HeaderAnnotations { max_ages, ..HeaderAnnotations::default() })
    }

    /// Checks the configuration, as [`Engine::new`](crate::Engine::new) does.
    ///
    /// # Errors
    /// Returns an [`EngineConfigError`] if no machine has this configuration, a policy's promise
    /// would not hold, or the operator could not keep up.
    pub fn check(&self) -> Result<(), EngineConfigError> {
        self.machine().map(drop)
    }

    /// Checks this configuration and creates its machine.
    pub(crate) fn machine(&self) -> Result<SizedArbiter, EngineConfigError> {
        let machine = SizedArbiter::new(&self.header().0).map_err(EngineConfigError::Machine)?;
        if let Some(workload) = &self.workload {
            let calls = self.clouds.iter().map(|cloud| (&*cloud.name, cloud.calls));
            let kept_up = workload.check(self.window.into(), self.local.at_once, calls);
            kept_up.map_err(EngineConfigError::Workload)?;
        }
        for CloudConfig { name, policy, linger, .. } in &self.clouds {
            let Some(policy) = policy else { continue };
            if self.commit == Commit::Progressive && policy.assumes_one_output() {
                return Err(EngineConfigError::OneOutput { cloud: name.clone() });
            }
            if linger.is_zero() && policy.needs_linger() {
                return Err(EngineConfigError::Linger { cloud: name.clone() });
            }
        }
        Ok(machine)
    }
}

impl Default for EngineConfig {
    fn default() -> Self {
        Self {
            operator: "operator".into(),
            window: 16,
            commit: Commit::Eager,
            clouds: Vec::new(),
            local: Local::default(),
            lag_warning: Duration::from_millis(20),
            greatest_deadline: Duration::MAX,
            has_substitutes: false,
            takes_hints: false,
            has_doubtful_ages: false,
            latency: None,
            workload: None,
        }
    }
}

/// Takes the name, the window, the commit rule and the clouds of a header. Clouds without a name
/// get the default one.
impl From<&Header> for EngineConfig {
    fn from(header: &Header) -> Self {
        let default = Self::default();
        let clouds = header.clouds.iter().map(|cloud| {
            let default = CloudConfig::new(cloud.p);
            CloudConfig {
                name: cloud.name.clone().unwrap_or(default.name),
                limit: Some(cloud.limit),
                resume: cloud.resume,
                ..default
            }
        });
        Self {
            operator: header.operator.clone().unwrap_or(default.operator),
            window: header.window,
            commit: header.commit,
            clouds: clouds.collect(),
            ..default
        }
    }
}

impl CloudConfig {
    /// Returns a cloud with this priority and the defaults.
    #[must_use]
    pub fn new(priority: u16) -> Self {
        Self {
            priority,
            name: format!("cloud-{priority}"),
            limit: None,
            resume: 0,
            calls: 8,
            policy: None,
            linger: Duration::ZERO,
            max_age: 0,
        }
    }
}

impl fmt::Debug for CloudConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { priority, name, limit, resume, calls, policy, linger, max_age } = self;
        f.debug_struct("CloudConfig")
            .field("priority", priority)
            .field("name", name)
            .field("limit", limit)
            .field("resume", resume)
            .field("calls", calls)
            .field("policy", &policy.as_ref().map(|_| "…"))
            .field("linger", linger)
            .field("max_age", max_age)
            .finish()
    }
}

impl fmt::Display for EngineConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Machine(error) => error.fmt(f),
            Self::OneOutput { cloud } => write!(
                f,
                "the policy of {cloud} assumes one output for each message, but commit progressive \
                 may send more; give another policy, or commit patient"
            ),
            Self::Linger { cloud } => write!(
                f,
                "the policy of {cloud} neither probes nor sees lingering calls, so it would never \
                 notice that the cloud is back; give the policy probe_every, or the cloud a linger"
            ),
            Self::Workload(errors) => write!(f, "the operator could not keep up: {errors}"),
        }
    }
}

impl std::error::Error for EngineConfigError {}
