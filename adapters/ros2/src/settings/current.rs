//! The settings of a node that runs.

use std::sync::{Arc, Mutex, MutexGuard};

use fuseline_engine::lock;

use crate::settings::Settings;

/// The settings with what was set since the start.
#[derive(Clone)]
pub(crate) struct Current(Arc<Mutex<Settings>>);

impl Current {
    pub(crate) fn new(settings: Settings) -> Self {
        Self(Arc::new(Mutex::new(settings)))
    }

    pub(crate) fn now(&self) -> Settings {
        self.locked().clone()
    }

    /// Locks the settings. A change is made whole, so even a poisoned lock holds sound settings.
    pub(crate) fn locked(&self) -> MutexGuard<'_, Settings> {
        lock(&self.0)
    }
}
