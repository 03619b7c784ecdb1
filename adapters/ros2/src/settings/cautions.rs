//! Finds settings that are allowed but probably mistaken. The node logs them at its start, and
//! `--check` prints them.

use std::path::Path;
use std::time::Duration;

use fuseline_engine::Commit;

use crate::key::{IntegerKind, MessageKey};
use crate::settings::{Cloud, Middleware, PolicyKind, Settings};

impl Settings {
    /// Returns the cautions, each in a sentence.
    #[must_use]
    pub fn cautions(&self) -> Vec<String> {
        let cautions = [
            self.given_away(),
            self.idle_within(),
            self.keys(),
            self.policies(),
            self.accuracies(),
            self.rate(),
            self.diagnostics(),
            self.recording(),
            self.ports(),
        ];
        self.unheeded.iter().cloned().chain(cautions.into_iter().flatten()).collect()
    }

    fn idle_within(&self) -> Option<String> {
        let within = self.end_to_end.within.filter(|within| *within > self.greatest_deadline)?;
        Some(format!(
            "within is {} s, but no message takes longer than greatest_deadline ({} s); within is \
             in seconds",
            within.as_secs_f64(),
            self.greatest_deadline.as_secs_f64()
        ))
    }

    fn keys(&self) -> Option<String> {
        let is_short = |key| {
            matches!(key, MessageKey::Integer { kind: IntegerKind::U32 | IntegerKind::I32, .. })
        };
        let (input, output) = (self.input.key, self.output.key);
        let is_header = |key| key == MessageKey::Header;
        ((is_header(input) && is_short(output)) || (is_short(input) && is_header(output))).then(
            || {
                format!(
                    "the key of input is {input} and the key of output is {output}: a stamp in \
                     nanoseconds does not fit into 32 bits, so no result matches a message"
                )
            },
        )
    }

    fn policies(&self) -> Option<String> {
        let is_set = self.deadlines.kind == PolicyKind::Set;
        if let Some(speed) = self.deadlines.speed.as_ref().filter(|_| is_set) {
            let topic = &speed.topic;
            return Some(format!(
                "policy.speed_topic is {topic}, but no policy chooses deadlines; give policy: \
                 guard or guarded"
            ));
        }
        let is_idle = !is_set && self.clouds.is_empty();
        is_idle.then(|| "policy has no cloud to choose deadlines for; add it to clouds".to_owned())
    }

    fn accuracies(&self) -> Option<String> {
        let accuracy = &self.deadlines.accuracy;
        let are_parts = accuracy.local <= 1.0 && accuracy.cloud <= 1.0;
        let is_above = accuracy.local > 100.0 || accuracy.cloud > 100.0;
        let is_swapped = accuracy.local >= accuracy.cloud;
        if self.deadlines.kind != PolicyKind::Expected {
            None
        } else if are_parts {
            Some(
                "policy.accuracy_local and .accuracy_cloud are at most 1, but they are in percent, \
                 as policy.price_per_ms is; multiply them by 100"
                    .to_owned(),
            )
        } else if is_above {
            Some(
                "policy.accuracy_local or .accuracy_cloud is above 100, but they are in percent"
                    .to_owned(),
            )
        } else if is_swapped {
            Some("policy.accuracy_local is not below .accuracy_cloud, so no message waits for a cloud; swap them".to_owned())
        } else {
            None
        }
    }

    fn rate(&self) -> Option<String> {
        let rate = self.deadlines.rate.filter(|rate| *rate < 0.1)?;
        Some(format!(
            "policy.rate is {rate}, but it is in messages a second; give a rate and not a period"
        ))
    }

    fn diagnostics(&self) -> Option<String> {
        let period = Some(self.diagnostics_period).filter(|it| *it > Duration::from_secs(60))?;
        Some(format!("diagnostics.period is {} s; give it in seconds", period.as_secs_f64()))
    }

    /// DDS begins at port 7400 and has 250 ports a domain; Linux gives 32768 to 60999 to any
    /// program, unless it is set otherwise.
    fn ports(&self) -> Option<String> {
        let domain = Some(self.domain).filter(|it| (102..=214).contains(it))?;
        let first = 7400 + 250 * u32::from(domain);
        self.needs(Middleware::Dds).then(|| {
            format!(
                "domain_id is {domain}, but Linux also gives its ports, from {first} on, to other \
                 programs, so a start may fail now and then; give 0 to 101"
            )
        })
    }

    fn recording(&self) -> Option<String> {
        let ends = |path: &Path, ends: &[&str]| {
            path.extension().is_some_and(|it| ends.iter().any(|end| it == *end))
        };
        if let Some(trace) =
            self.trace.as_ref().filter(|it| ends(it, &["gz", "zst", "packed", "mcap"]))
        {
            return Some(format!(
                "trace.file is {}, but it is written as plain lines; give it a name that ends in \
                 .jsonl",
                trace.display()
            ));
        }
        let mcap =
            self.mcap.as_ref().filter(|it| ends(it, &["jsonl", "json", "gz", "zst", "db3"]))?;
        Some(format!(
            "trace.mcap is {}, but it is written as MCAP; give it a name that ends in .mcap",
            mcap.display()
        ))
    }

    /// A4: a lower cloud's timer sends what is available, though a better cloud has time left; with
    /// its remedy.
    fn given_away(&self) -> Option<String> {
        if self.commit != Commit::Eager || self.deadlines.kind != PolicyKind::Set {
            return None;
        }
        let clouds = || self.clouds.iter().filter(|cloud| cloud.enabled);
        let deadline = |cloud: &Cloud| cloud.deadline.unwrap_or(self.deadline);
        clouds().find_map(|low| {
            let is_given_away =
                |high: &&Cloud| low.priority < high.priority && deadline(low) < deadline(high);
            let better = clouds().find(is_given_away)?;
            Some(format!(
                "under commit: eager the earlier deadline of {low} ends the wait for {better}, \
                 which is better (A4); give {low} the same or a later deadline, or give commit: \
                 patient",
                low = low.name,
                better = better.name
            ))
        })
    }
}
