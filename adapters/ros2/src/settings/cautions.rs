//! What settings allow and is probably a mistake: the node says so at its start, and `--check` too.

use std::time::Duration;

use fuseline_engine::Commit;

use crate::settings::{Cloud, PolicyKind, Settings};

/// A deadline beyond it was probably meant in milliseconds.
const PLAUSIBLE: Duration = Duration::from_secs(60);

impl Settings {
    /// Each in a sentence with its remedy.
    #[must_use]
    pub fn cautions(&self) -> Vec<String> {
        let mut cautions = Vec::new();
        let own = |cloud: &Cloud| {
            let deadline = cloud.deadline?;
            Some((format!("{}.deadline", cloud.name), deadline))
        };
        let node = [("deadline", self.deadline), ("local.deadline", self.local.deadline)];
        let all = node.map(|(name, deadline)| (name.to_owned(), deadline));
        for (name, deadline) in all.into_iter().chain(self.clouds.iter().filter_map(own)) {
            if deadline > PLAUSIBLE {
                cautions.push(format!(
                    "{name} is {} s, and an output may wait as long; it is in seconds",
                    deadline.as_secs_f64()
                ));
            }
        }
        cautions.extend(self.eager_caution());
        cautions
    }

    /// A4: a lower cloud's timer sends what is available, though a better cloud has time left.
    fn eager_caution(&self) -> Option<String> {
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
