//! Several events that may happen, each with a probability, and which of their plans are cached in
//! time.

use std::str::FromStr;

use serde::Serialize;

use crate::jaywalking::Args;
use crate::jaywalking::planning::{PlanCallOutcome, Planning};

/// An event that may happen.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct UnlikelyEvent {
    name: String,
    probability: f64,
}

/// The plan for an event.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub(crate) struct HypothesisRow {
    pub(crate) name: String,
    pub(crate) probability: f64,
    /// `true` if the plan is in the cache when the event happens.
    pub(crate) cached: bool,
    /// The time from the event to the plan for it, in s.
    pub(crate) response: f64,
}

impl FromStr for UnlikelyEvent {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (name, probability) = text.split_once('=').ok_or("write NAME=P")?;
        let name = name.trim();
        let is_name = !name.is_empty() && !name.contains(char::is_control);
        let probability = probability.trim().parse().ok().filter(|p| *p > 0.0 && *p <= 1.0);
        match probability {
            Some(probability) if is_name => Ok(Self { name: name.to_owned(), probability }),
            Some(_) => Err("write a name before ="),
            None => Err("write a probability above 0 and up to 1 behind ="),
        }
    }
}

/// Lets each event happen in turn, the likeliest first.
pub(crate) fn rows(args: &Args) -> Vec<HypothesisRow> {
    let mut events = args.hypothesis.clone();
    events.sort_by(|one, other| other.probability.total_cmp(&one.probability));
    let ends = args.response.first().copied().zip(args.response.last().copied());
    let Some((planner, cached)) = ends else { return Vec::new() };
    let planning = Planning { cloud: PlanCallOutcome::InTime, planner, cached };
    let row = |(index, event): (usize, &UnlikelyEvent)| {
        let at_once = usize::from(args.plans_at_once);
        let (response, cached) = planning.with_hypotheses(events.len(), at_once, index);
        let UnlikelyEvent { name, probability } = event.clone();
        HypothesisRow { name, probability, cached, response }
    };
    events.iter().enumerate().map(row).collect()
}

/// Returns the mean response weighted by probability, or `None` if no event has a probability.
pub(crate) fn mean_response(rows: &[HypothesisRow]) -> Option<f64> {
    let all: f64 = rows.iter().map(|row| row.probability).sum();
    let sum: f64 = rows.iter().map(|row| row.probability * row.response).sum();
    (all > 0.0).then(|| sum / all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hypothesis_has_a_name_and_a_probability() {
        let event: UnlikelyEvent = "door-opens=0.04".parse().unwrap();
        assert_eq!(event, UnlikelyEvent { name: "door-opens".to_owned(), probability: 0.04 });
        for text in ["door", "=0.1", "door=0", "door=1.1", "door=nan", "door="] {
            assert!(text.parse::<UnlikelyEvent>().is_err(), "{text}");
        }
    }

    #[test]
    fn the_mean_weighs_by_probability() {
        let row = |probability, response| HypothesisRow {
            name: String::new(),
            probability,
            cached: true,
            response,
        };
        let mean = mean_response(&[row(0.3, 0.4), row(0.1, 0.5)]).unwrap();
        assert!((mean - 0.425).abs() < 1e-12, "{mean}");
        assert_eq!(mean_response(&[]), None);
    }
}
