//! Compares rival policies offline, on the same arrivals: fusion, fusion with one deadline, local
//! only, cloud only and first response wins. If a call was ended early, the trace does not show
//! when its result would have come, so the figures are bounds.
//!
//! [`TraceStatistics::messages`](crate::TraceStatistics::messages) returns the arrivals of a trace.
//! Others are made by hand:
//!
//! ```
//! use std::time::Duration;
//! use fuseline_report::policies::ComparedPolicy;
//! use fuseline_report::{ArrivalTime, MessageRecord};
//!
//! let at = |ms| ArrivalTime::At(Duration::from_millis(ms));
//! // Local after 300 ms, the cloud after 170 and 900 ms.
//! let arrivals = [vec![at(300), at(170)], vec![at(310), at(900)]];
//! let messages = arrivals.map(|arrivals| MessageRecord { arrivals, forwarded: None });
//! let (aps, deadline) = ([Some(43.5), Some(51.3)], Duration::from_millis(500));
//! let score = |policy: ComparedPolicy| policy.score(&messages, &aps, deadline);
//! assert_eq!(score(ComparedPolicy::LocalOnly).in_time.exact(), Some(2));
//! assert_eq!(score(ComparedPolicy::CloudOnly(1)).in_time.exact(), Some(1));
//! let first = score(ComparedPolicy::FirstWins).ap.and_then(|ap| ap.exact());
//! assert_eq!(first, Some((51.3 + 43.5) / 2.0));
//! ```

mod constant;
mod figure;
#[cfg(test)]
mod tests;

use std::time::Duration;

use crate::quantile::{ArrivalTime, NEVER, Quantile, Response, quantiles, quantiles_among};
use crate::statistics::{ForwardedOutput, MessageRecord};

pub use constant::ConstantPolicy;
pub use figure::BoundedFigure;

/// A way to choose one result for each message.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum ComparedPolicy {
    /// The policy that the operator followed.
    Fusion,
    /// One constant deadline for all requests.
    Constant(ConstantPolicy),
    /// Local's result, whenever it comes.
    LocalOnly,
    /// This source's result, however long that takes.
    CloudOnly(usize),
    /// The first result that comes.
    FirstWins,
    /// Each better result at once, until the deadline (F9). The clouds have these priorities, in
    /// the order of the sources.
    Progressive(Vec<u16>),
}

/// The score of a policy, as far as it is known.
///
/// If calls were ended before their results, each figure is a bound that holds whatever those
/// results would have been.
#[derive(Clone, PartialEq, Debug)]
pub struct PolicyScore {
    /// The mean COCO AP. An output that is missing or whose result came too late counts as 0.
    /// `None` if a model has no figure.
    pub ap: Option<BoundedFigure<f64>>,
    /// The outputs whose results came before the deadline.
    pub in_time: BoundedFigure<u64>,
    /// The response times that half, 90 % and 99 % of the messages do not exceed. `None` if there
    /// are no messages.
    pub quantiles: [Option<Quantile>; 3],
    /// The response time that half of the messages in outages do not exceed. `None` if there are no
    /// such messages, and a bound if there may be none.
    pub outage: Option<Quantile>,
}

/// The choice of a policy for one message, as far as it is known.
struct PolicyChoice {
    response: Response,
    /// The source whose result the policy has before the deadline, or `None` if it has no result in
    /// time. If that is not known, there are several elements.
    in_time: Vec<Option<usize>>,
}

impl ComparedPolicy {
    /// Returns how much the policy needs out of `all`, the amount that the admitted requests to
    /// each source need. It returns `None` for fusion, because fusion cancels some requests before
    /// they are sent, whatever its deadlines are.
    #[must_use]
    pub fn needs(&self, all: &[u64]) -> Option<u64> {
        match *self {
            Self::Fusion | Self::Constant(_) => None,
            Self::LocalOnly => Some(0),
            Self::CloudOnly(source) => all.get(source).copied(),
            Self::FirstWins | Self::Progressive(_) => Some(all.iter().skip(1).sum()),
        }
    }

    /// Returns the policy's score. `aps` has the COCO AP of each source. A result counts if it
    /// comes before `deadline`; a result at its deadline is late (A1).
    ///
    /// # Panics
    /// Panics if a message has more sources than `aps`, or the policy names a source that does not
    /// exist.
    #[must_use]
    pub fn score(
        &self,
        messages: &[MessageRecord],
        aps: &[Option<f64>],
        deadline: Duration,
    ) -> PolicyScore {
        let mut responses = Vec::with_capacity(messages.len());
        let (mut in_outages, mut perhaps_in_outages) = (Vec::new(), Vec::new());
        let (mut sum, mut in_time) = (Some(BoundedFigure::exactly(0.0)), BoundedFigure::exactly(0));
        for message in messages {
            let PolicyChoice { response, in_time: sources } = self.choose(message, deadline);
            responses.push(response);
            match message.is_in_outage(deadline) {
                Some(true) => in_outages.push(response),
                Some(false) => {}
                None => perhaps_in_outages.push(response),
            }
            let counts = sources.iter().map(|source| u64::from(source.is_some()));
            in_time = in_time.add(BoundedFigure::spanning(counts));
            let aps: Option<Vec<f64>> =
                sources.iter().map(|source| source.map_or(Some(0.0), |it| aps[it])).collect();
            sum = sum.zip(aps).map(|(sum, aps)| sum.add(BoundedFigure::spanning(aps)));
        }
        #[expect(clippy::cast_precision_loss, reason = "at most a million messages")]
        let count = messages.len() as f64;
        let ap = sum.filter(|_| !messages.is_empty()).map(|sum| sum.map(|sum| sum / count));
        let [outage, ..] = quantiles_among(&in_outages, &perhaps_in_outages);
        PolicyScore { ap, in_time, quantiles: quantiles(&responses), outage }
    }

    fn choose(&self, message: &MessageRecord, deadline: Duration) -> PolicyChoice {
        let arrivals = &*message.arrivals;
        match *self {
            Self::LocalOnly => alone(arrivals, 0, deadline),
            Self::CloudOnly(source) => alone(arrivals, source, deadline),
            Self::FirstWins => first(arrivals, deadline),
            Self::Progressive(ref priorities) => PolicyChoice {
                response: first(arrivals, deadline).response,
                in_time: best(arrivals, priorities, deadline),
            },
            Self::Fusion => put_out(arrivals, message.forwarded, deadline),
            Self::Constant(ref constant) => {
                if arrivals.iter().any(|arrival| matches!(arrival, ArrivalTime::After(_))) {
                    let (response, in_time) = constant.bounds(arrivals, deadline);
                    PolicyChoice { response, in_time }
                } else {
                    put_out(arrivals, constant.forwarded(arrivals), deadline)
                }
            }
        }
    }
}

/// Returns the choice of a policy whose output is known.
fn put_out(
    arrivals: &[ArrivalTime],
    forwarded: Option<ForwardedOutput>,
    deadline: Duration,
) -> PolicyChoice {
    let response = Response::exactly(forwarded.map(|forwarded| forwarded.response));
    let in_time = forwarded.and_then(|ForwardedOutput { source, .. }| match arrivals[source] {
        ArrivalTime::At(at) => Some(source).filter(|_| at < deadline),
        ArrivalTime::After(_) | ArrivalTime::Failed(_) | ArrivalTime::Never => None,
    });
    PolicyChoice { response, in_time: vec![in_time] }
}

/// Chooses one source's result, whenever it comes.
fn alone(arrivals: &[ArrivalTime], source: usize, deadline: Duration) -> PolicyChoice {
    let in_time = match arrivals[source] {
        ArrivalTime::At(at) if at < deadline => vec![Some(source)],
        ArrivalTime::After(bound) if bound < deadline => vec![Some(source), None],
        ArrivalTime::At(_)
        | ArrivalTime::After(_)
        | ArrivalTime::Failed(_)
        | ArrivalTime::Never => vec![None],
    };
    PolicyChoice { response: arrivals[source].into(), in_time }
}

/// Chooses the first result of all. A call that was ended early may have been first, but the output
/// is no later than the first known result.
fn first(arrivals: &[ArrivalTime], deadline: Duration) -> PolicyChoice {
    let known = arrivals.iter().enumerate().filter_map(|(source, arrival)| match *arrival {
        ArrivalTime::At(at) => Some((at, source)),
        ArrivalTime::After(_) | ArrivalTime::Failed(_) | ArrivalTime::Never => None,
    });
    let known = known.min();
    let most = known.map_or(NEVER, |(at, _)| at);
    let mut least = most;
    let mut in_time = vec![known.filter(|(at, _)| *at < deadline).map(|(_, source)| source)];
    for (source, arrival) in arrivals.iter().enumerate() {
        if let ArrivalTime::After(bound) = *arrival
            && bound < most
        {
            least = least.min(bound);
            in_time.extend((bound < deadline).then_some(Some(source)));
        }
    }
    PolicyChoice { response: Response { least, most }, in_time }
}

/// Returns the sources whose result may be the best result that arrives before the deadline.
fn best(arrivals: &[ArrivalTime], priorities: &[u16], deadline: Duration) -> Vec<Option<usize>> {
    let mut by_rank: Vec<usize> = (0..arrivals.len()).collect();
    by_rank.sort_by_key(|source| source.checked_sub(1).map_or(0, |cloud| priorities[cloud]));
    let mut candidates = Vec::new();
    while let Some(source) = by_rank.pop() {
        match arrivals[source] {
            ArrivalTime::At(at) if at < deadline => {
                candidates.push(Some(source));
                return candidates;
            }
            ArrivalTime::After(bound) if bound < deadline => candidates.push(Some(source)),
            ArrivalTime::At(_)
            | ArrivalTime::After(_)
            | ArrivalTime::Failed(_)
            | ArrivalTime::Never => {}
        }
    }
    candidates.push(None);
    candidates
}
