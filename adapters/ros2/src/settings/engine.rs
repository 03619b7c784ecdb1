//! The configuration of the engine that the settings describe.

use fuseline_engine::{CloudConfig, EngineConfig, EngineConfigError, Local, Workload};

use crate::settings::{Cloud, PolicyKind, Settings, SettingsError, SettingsFlaw};

impl Settings {
    /// Returns the engine's configuration.
    ///
    /// # Errors
    /// Returns an error if the figures make no policy.
    pub(crate) fn engine_config(&self) -> Result<EngineConfig, SettingsError> {
        let refused = |why| SettingsError::Policy { origin: self.origin("policy"), why };
        let policy = || self.deadlines.policy().map_err(refused);
        // The figures are also checked if there is no cloud.
        policy()?;
        let cloud = |cloud: &Cloud| -> Result<_, SettingsError> {
            Ok(CloudConfig {
                name: cloud.name.clone(),
                limit: Some(cloud.limit),
                resume: cloud.resume,
                calls: cloud.in_flight.into(),
                policy: policy()?,
                linger: cloud.linger,
                ..CloudConfig::new(cloud.priority)
            })
        };
        Ok(EngineConfig {
            operator: self.node.full(),
            window: self.window,
            commit: self.commit,
            clouds: self.clouds.iter().map(cloud).collect::<Result<_, _>>()?,
            local: Local {
                at_once: self.local.in_flight.into(),
                waiting: Some(self.local.waiting.into()),
                may_lose_results: true,
                ..Local::default()
            },
            greatest_deadline: self.greatest_deadline,
            takes_hints: self.clouds.iter().any(|cloud| cloud.hints.is_some()),
            has_doubtful_ages: true,
            workload: self.workload(),
            ..EngineConfig::default()
        })
    }

    /// Returns the messages that the node must keep up with, if the rate is known and there is a
    /// policy.
    fn workload(&self) -> Option<Workload> {
        let rate = self.deadlines.rate.filter(|_| self.deadlines.kind != PolicyKind::Set)?;
        let deadlines = self.clouds.iter().map(|cloud| cloud.deadline.unwrap_or(self.deadline));
        let longest_deadline = deadlines.max().unwrap_or_default();
        let local_response = self.deadlines.parameters.local_response.greatest;
        Some(Workload { rate, longest_deadline, local_response })
    }

    /// Checks the parameters as the engine does.
    pub(super) fn check(&self) -> Result<(), SettingsError> {
        self.engine_config()?.check().map_err(|why| self.refused(why))
    }

    /// Returns the engine's refusal as an error about the parameter that caused it.
    pub(crate) fn refused(&self, why: EngineConfigError) -> SettingsError {
        let (name, flaw) = match why {
            EngineConfigError::Workload(why) => ("policy.rate", SettingsFlaw::Workload(why)),
            EngineConfigError::Machine(_) => ("clouds", SettingsFlaw::Refused(why)),
            EngineConfigError::OneOutput { .. } => ("policy", SettingsFlaw::Refused(why)),
            EngineConfigError::Linger { .. } => ("policy.probe_every", SettingsFlaw::Refused(why)),
        };
        SettingsError::Flaw { origin: self.origin(name), name: name.to_owned(), flaw }
    }
}
