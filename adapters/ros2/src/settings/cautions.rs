//! What settings allow and is probably a mistake: the node says so at its start, and `--check` too.

use fuseline_engine::Commit;

use crate::settings::{Cloud, PolicyKind, Settings};

impl Settings {
    /// Each in a sentence.
    #[must_use]
    pub fn cautions(&self) -> Vec<String> {
        self.unheeded.iter().cloned().chain(self.given_away()).collect()
    }

    /// A4: a lower cloud's timer sends what is available, though a better cloud has time left; with its remedy.
    fn given_away(&self) -> Option<String> {
        if self.commit != Commit::Eager || self.deadlines.kind != PolicyKind::Set {
            return None;
        }
        let clouds = || self.clouds.iter().filter(|cloud| cloud.enabled);
        let deadline = |cloud: &Cloud| cloud.deadline.unwrap_or(self.deadline);
        clouds().find_map(|low| {
            let is_given_away = |high: &&Cloud| {
                low.priority < high.priority && deadline(low) < deadline(high)
            };
            let better = clouds().find(is_given_away)?;
            Some(format!(
                "under commit: eager the earlier deadline of {} ends the wait for {}, which is better (A4); give it the same \
                 or a later one, or commit: patient",
                low.name, better.name
            ))
        })
    }
}
