//! Policies: the same arrivals under fusion, fusion with one deadline, local only, cloud only and
//! first response wins.

mod constant;

use std::time::Duration;

use fuseline_report::{Arrival, Forwarded, Message, Quantile, quantiles};

pub(crate) use constant::Constant;

/// A way to choose one result for each message.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) enum Policy {
    /// What the operator did.
    Fusion,
    /// What the operator would have done with one deadline for all requests.
    Constant(Constant),
    /// Local's result, whenever it is there.
    LocalOnly,
    /// This source's result, however long that takes.
    CloudOnly(usize),
    /// Whichever result is there first.
    FirstWins,
}

/// What a policy gives: means over all messages.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct PolicyScore {
    /// Mean COCO AP, where an output that is missing or whose result came too late counts 0. None
    /// if it is not known: some model has no figure, or some call was ended before its deadline.
    pub(crate) ap: Option<f64>,
    /// Outputs whose result was there before the deadline.
    pub(crate) in_time: u64,
    /// Response times that half, 90 % and 99 % of the messages do not exceed. None without
    /// messages.
    pub(crate) quantiles: [Option<Quantile>; 3],
    /// The response time that half of the messages in outages do not exceed. None without such.
    pub(crate) outage: Option<Quantile>,
}

/// What a policy does with one message.
struct Choice {
    response: Arrival,
    /// Whose result it is and when that was there; none if there is no output or it is unknown.
    result: Option<(usize, Duration)>,
}

impl Policy {
    /// How much the policy needs of what all requests admitted need, by source; none for fusion,
    /// which cancels some before they are sent, whatever its deadlines.
    pub(crate) fn needs(&self, all: &[u64]) -> Option<u64> {
        match *self {
            Self::Fusion | Self::Constant(_) => None,
            Self::LocalOnly => Some(0),
            Self::CloudOnly(source) => all.get(source).copied(),
            Self::FirstWins => Some(all.iter().skip(1).sum()),
        }
    }

    /// The policy's score; `aps` is each source's COCO AP and `deadline` what its result has to
    /// beat.
    ///
    /// A result at its deadline is late (A1).
    pub(crate) fn score(
        &self,
        messages: &[Message],
        aps: &[Option<f64>],
        deadline: Duration,
    ) -> PolicyScore {
        let mut responses = Vec::with_capacity(messages.len());
        let mut in_outages = Vec::new();
        let (mut sum, mut in_time) = (Some(0.0), 0);
        for message in messages {
            let choice = self.choose(message);
            responses.push(choice.response);
            if message.is_in_outage(deadline) {
                in_outages.push(choice.response);
            }
            match (choice.result, choice.response) {
                (Some((source, arrival)), _) if arrival < deadline => {
                    in_time += 1;
                    sum = sum.zip(aps[source]).map(|(sum, ap)| sum + ap);
                }
                (None, Arrival::After(bound)) if bound < deadline => sum = None,
                _ => {}
            }
        }
        #[expect(clippy::cast_precision_loss, reason = "at most a million messages")]
        let ap = sum.filter(|_| !messages.is_empty()).map(|sum| sum / messages.len() as f64);
        let [outage, ..] = quantiles(&mut in_outages);
        PolicyScore { ap, in_time, quantiles: quantiles(&mut responses), outage }
    }

    fn choose(&self, message: &Message) -> Choice {
        let alone = |source: usize| {
            let response = message.arrivals[source];
            let result = match response {
                Arrival::At(arrival) => Some((source, arrival)),
                Arrival::After(_) | Arrival::Failed(_) | Arrival::Never => None,
            };
            Choice { response, result }
        };
        let put_out = |forwarded: Option<Forwarded>| match forwarded {
            Some(Forwarded { source, response }) => {
                Choice { response: Arrival::At(response), ..alone(source) }
            }
            None => Choice { response: Arrival::Never, result: None },
        };
        match *self {
            Self::LocalOnly => alone(0),
            Self::CloudOnly(source) => alone(source),
            Self::FirstWins => {
                let first = (0..message.arrivals.len()).min_by_key(|i| message.arrivals[*i].key());
                first.map_or(Choice { response: Arrival::Never, result: None }, alone)
            }
            Self::Fusion => put_out(message.forwarded),
            Self::Constant(ref constant) => {
                let forwarded = constant.forwarded(&message.arrivals);
                // An unknown arrival may have changed everything from then on.
                let unknown = message.arrivals.iter().filter_map(|arrival| match arrival {
                    Arrival::After(bound) => Some(*bound),
                    Arrival::At(_) | Arrival::Failed(_) | Arrival::Never => None,
                });
                match (unknown.min(), forwarded) {
                    (Some(bound), Some(Forwarded { response, .. })) if response <= bound => {
                        put_out(forwarded)
                    }
                    (Some(bound), _) => Choice { response: Arrival::After(bound), result: None },
                    (None, _) => put_out(forwarded),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const APS: [Option<f64>; 3] = [Some(40.0), Some(44.0), Some(52.0)];
    const DEADLINE: Duration = ms(500);

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn message(arrivals: [Arrival; 3], forwarded: Option<(usize, u64)>) -> Message {
        let forwarded =
            forwarded.map(|(source, response)| Forwarded { source, response: ms(response) });
        Message { arrivals: arrivals.to_vec(), forwarded }
    }

    fn at(millis: u64) -> Arrival {
        Arrival::At(ms(millis))
    }

    fn constant() -> Policy {
        let (deadline, priorities) = (DEADLINE, vec![1, 2]);
        Policy::Constant(Constant { deadline, priorities })
    }

    fn score(policy: &Policy, messages: &[Message]) -> PolicyScore {
        policy.score(messages, &APS, DEADLINE)
    }

    /// One message that the best cloud wins, and one where both networks fail.
    fn two() -> [Message; 2] {
        [
            message([at(300), at(150), at(170)], Some((2, 170))),
            message([at(310), at(9_000), Arrival::Never], Some((0, 500))),
        ]
    }

    fn close(found: Option<f64>, expected: f64) -> bool {
        found.is_some_and(|found| (found - expected).abs() < 1e-9)
    }

    #[test]
    fn each_policy_takes_its_own_result() {
        for (policy, ap, in_time) in [
            (Policy::Fusion, 46.0, 2),
            (constant(), 46.0, 2),
            (Policy::LocalOnly, 40.0, 2),
            (Policy::CloudOnly(1), 22.0, 1),
            (Policy::CloudOnly(2), 26.0, 1),
            (Policy::FirstWins, 42.0, 2),
        ] {
            let score = score(&policy, &two());
            assert!(close(score.ap, ap), "{policy:?}: {score:?}");
            assert_eq!(score.in_time, in_time, "{policy:?}");
        }
    }

    /// It has in hand whatever comes first, so that nothing is in time without it.
    #[test]
    fn one_deadline_is_in_time_wherever_the_first_response_is() {
        let failed = |millis| Arrival::Failed(ms(millis));
        let all = [
            at(100),
            at(300),
            at(499),
            at(500),
            at(9_000),
            failed(0),
            failed(300),
            failed(600),
            Arrival::Never,
        ];
        for (local, west, east) in (0..all.len().pow(3)).map(|i| (i / 81, i / 9 % 9, i % 9)) {
            let one = [message([all[local], all[west], all[east]], None)];
            let (constant, first) = (score(&constant(), &one), score(&Policy::FirstWins, &one));
            assert!(constant.in_time >= first.in_time, "{one:?}");
            assert!(constant.ap >= first.ap && constant.ap.is_some(), "{one:?}");
        }
    }

    #[test]
    fn a_result_at_the_deadline_counts_as_late() {
        let late = [message([at(500), at(499), at(501)], Some((0, 500)))];
        assert_eq!(score(&Policy::LocalOnly, &late).in_time, 0);
        assert_eq!(score(&Policy::CloudOnly(1), &late).in_time, 1);
        assert_eq!(score(&Policy::Fusion, &late).in_time, 0);
    }

    #[test]
    fn fusion_is_in_time_by_its_results_arrival_though_it_leaves_at_the_deadline() {
        let held = [message([at(300), at(9_000), at(9_000)], Some((0, 501)))];
        let score = score(&Policy::Fusion, &held);
        assert_eq!((score.in_time, score.quantiles[0]), (1, Some(Quantile::Exactly(ms(501)))));
    }

    #[test]
    fn a_missed_message_counts_zero_and_never_responds() {
        let missed = [message([Arrival::Never; 3], None), message([at(1); 3], Some((2, 1)))];
        let score = score(&Policy::Fusion, &missed);
        assert!(close(score.ap, 26.0), "{score:?}");
        assert_eq!(score.quantiles[1], Some(Quantile::Never));
    }

    #[test]
    fn an_ended_call_leaves_the_ap_open_only_before_the_deadline() {
        let ended =
            |bound| [message([at(300), at(150), Arrival::After(ms(bound))], Some((0, 500)))];
        assert!(close(score(&Policy::CloudOnly(2), &ended(500)).ap, 0.0));
        assert_eq!(score(&Policy::CloudOnly(2), &ended(499)).ap, None);
        // Who is first is known while the unknown one is later.
        assert!(close(score(&Policy::FirstWins, &ended(499)).ap, 44.0));
        assert_eq!(score(&Policy::FirstWins, &ended(150)).ap, None);
    }

    #[test]
    fn with_a_constant_what_is_unknown_leaves_open_what_may_depend_on_it() {
        let unknown = |bound| {
            let arrivals = [at(300), at(150), Arrival::After(ms(bound))];
            score(&constant(), &[message(arrivals, Some((1, 287)))])
        };
        assert_eq!((unknown(287).ap, unknown(500).ap), (None, Some(44.0)));
        assert_eq!(unknown(287).quantiles[0], Some(Quantile::AtLeast(ms(287))));
        assert_eq!(unknown(500).quantiles[0], Some(Quantile::Exactly(ms(500))));
    }

    #[test]
    fn the_median_of_outages_is_that_of_messages_without_a_result_in_time() {
        let refused = Arrival::Failed(Duration::ZERO);
        let messages = [
            message([at(300), at(150), at(170)], Some((2, 170))),
            message([at(310), at(9_000), at(100)], Some((2, 100))),
            message([at(320), at(150), Arrival::Never], Some((1, 290))),
            message([at(330), at(500), refused], Some((0, 330))),
            message([at(340), Arrival::Failed(ms(9)), refused], Some((0, 340))),
        ];
        let outage = |policy: Policy| score(&policy, &messages).outage;
        assert_eq!(outage(Policy::Fusion), Some(Quantile::Exactly(ms(290))));
        assert_eq!(outage(constant()), Some(Quantile::Exactly(ms(500))));
        assert_eq!(score(&Policy::Fusion, &messages[..1]).outage, None);
    }

    #[test]
    fn a_model_without_figure_leaves_the_ap_open() {
        let score = Policy::Fusion.score(&two(), &[Some(40.0), None, None], DEADLINE);
        assert_eq!(score.ap, None);
    }

    #[test]
    fn requests_are_what_each_policy_needs_of_those_admitted() {
        let requests = |policy: Policy| policy.needs(&[300, 250, 200]);
        assert_eq!(requests(Policy::Fusion), None);
        assert_eq!(requests(Policy::LocalOnly), Some(0));
        assert_eq!(requests(Policy::CloudOnly(1)), Some(250));
        assert_eq!(requests(Policy::FirstWins), Some(450));
    }
}
