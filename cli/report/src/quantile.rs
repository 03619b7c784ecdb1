//! Response times by nearest ranks, even if some of them are not known.

use std::time::Duration;

use serde::{Serialize, Serializer};

/// The time from a message to the result of a source, known or bounded.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum ArrivalTime {
    /// At this time.
    At(Duration),
    /// Unknown, but later than this, if ever. The call was ended at this time before its result
    /// came. Events of the trace at the same instant came first.
    After(Duration),
    /// No result will come, which was known at this time. The time is 0 if nothing was requested of
    /// the source.
    Failed(Duration),
    /// Its network never came back.
    Never,
}

/// A response time, as far as it is known.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Response {
    /// It is at least this.
    pub least: Duration,
    /// It is at most this, or [`NEVER`] if it may not end.
    pub most: Duration,
}

/// The response time of a message without output.
pub const NEVER: Duration = Duration::MAX;

/// A quantile of response times. The response time of a message without output never ends.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Quantile {
    /// Exactly this.
    Exactly(Duration),
    /// At least this, because some response times are not known.
    AtLeast(Duration),
    /// Never, because too many messages have no output.
    Never,
}

/// The quantiles that are shown, in percent.
pub const PERCENT: [usize; 3] = [50, 90, 99];

impl Serialize for Quantile {
    /// Writes milliseconds, `{"at_least":…}` if some response times are not known, or null if it
    /// never ends.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let ms = |at: Duration| at.as_secs_f64() * 1000.0;
        let written = match *self {
            Self::Exactly(at) => WrittenQuantile::Exactly(ms(at)),
            Self::AtLeast(at) => WrittenQuantile::Bound { at_least: ms(at) },
            Self::Never => WrittenQuantile::Never,
        };
        written.serialize(serializer)
    }
}

/// The form in which a quantile is written, in milliseconds.
#[derive(Serialize)]
#[serde(untagged)]
enum WrittenQuantile {
    Exactly(f64),
    Bound { at_least: f64 },
    Never,
}

impl Response {
    /// Returns a response time that is known. `None` never ends.
    #[must_use]
    pub fn exactly(at: Option<Duration>) -> Self {
        let at = at.unwrap_or(NEVER);
        Self { least: at, most: at }
    }
}

impl From<ArrivalTime> for Response {
    fn from(arrival: ArrivalTime) -> Self {
        match arrival {
            ArrivalTime::At(at) => Self::exactly(Some(at)),
            ArrivalTime::After(bound) => Self { least: bound, most: NEVER },
            // There is no output, however long one waits.
            ArrivalTime::Failed(_) | ArrivalTime::Never => Self::exactly(None),
        }
    }
}

/// Returns the quantiles at [`PERCENT`], by nearest ranks, or `None` if there are no responses.
#[must_use]
pub fn quantiles(responses: &[Response]) -> [Option<Quantile>; 3] {
    quantiles_among(responses, &[])
}

/// Does the same if it is not known which of the `possible` responses count. The bounds hold
/// whichever of them count. They are `None` if no response is sure and none is possible.
#[must_use]
pub fn quantiles_among(sure: &[Response], possible: &[Response]) -> [Option<Quantile>; 3] {
    let sorted = |responses: &[Response], time: fn(&Response) -> Duration| {
        let mut times: Vec<Duration> = responses.iter().map(time).collect();
        times.sort_unstable();
        times
    };
    let least = [sure, possible].map(|responses| sorted(responses, |response| response.least));
    let most = [sure, possible].map(|responses| sorted(responses, |response| response.most));
    PERCENT.map(|percent| {
        let (least, most) = (lowest(&least, percent)?, greatest(&most, percent)?);
        Some(match least {
            NEVER => Quantile::Never,
            least if least == most && !sure.is_empty() => Quantile::Exactly(least),
            least => Quantile::AtLeast(least),
        })
    })
}

/// Returns the lowest value of a quantile. The possible responses that are no greater count,
/// because they lower it.
fn lowest([sure, possible]: &[Vec<Duration>; 2], percent: usize) -> Option<Duration> {
    let reaches = |time: &Duration| {
        let [sure_below, possible_below] =
            [sure, possible].map(|times| times.partition_point(|other| other <= time));
        let below = sure_below + possible_below;
        below * 100 >= percent * (sure.len() + possible_below) && below > 0
    };
    let first =
        |times: &[Duration]| times.get(times.partition_point(|time| !reaches(time))).copied();
    [first(sure), first(possible)].into_iter().flatten().min()
}

/// Returns the greatest value of a quantile. The possible responses that are no less count, because
/// they raise it.
fn greatest([sure, possible]: &[Vec<Duration>; 2], percent: usize) -> Option<Duration> {
    let is_reached = |time: &Duration| {
        let [sure_below, possible_below] =
            [sure, possible].map(|times| times.partition_point(|other| other < time));
        sure_below * 100 < percent * (sure.len() + possible.len() - possible_below)
    };
    let last = |times: &[Duration]| {
        times.partition_point(is_reached).checked_sub(1).and_then(|index| times.get(index)).copied()
    };
    [last(sure), last(possible)].into_iter().flatten().max()
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(millis: u64) -> Duration {
        Duration::from_millis(millis)
    }

    fn at(millis: u64) -> Response {
        ArrivalTime::At(ms(millis)).into()
    }

    fn after(millis: u64) -> Response {
        ArrivalTime::After(ms(millis)).into()
    }

    #[expect(clippy::unnecessary_wraps, reason = "as quantiles are given")]
    fn exactly(millis: u64) -> Option<Quantile> {
        Some(Quantile::Exactly(ms(millis)))
    }

    #[expect(clippy::unnecessary_wraps, reason = "as quantiles are given")]
    fn at_least(millis: u64) -> Option<Quantile> {
        Some(Quantile::AtLeast(ms(millis)))
    }

    #[test]
    fn an_unknown_response_makes_all_quantiles_above_it_lower_bounds() {
        let quantiles = quantiles(&[at(100), after(200), at(300)]);
        assert_eq!([quantiles[0], quantiles[2]], [at_least(200), at_least(300)]);
    }

    #[test]
    fn a_response_between_known_times_leaves_what_is_beyond_them_exact() {
        let between = Response { least: ms(50), most: ms(80) };
        let responses: Vec<Response> = (100..198).map(at).chain([between, after(900)]).collect();
        assert_eq!(quantiles(&responses), [exactly(148), exactly(188), exactly(197)]);
    }

    #[test]
    fn responses_that_may_belong_leave_bounds_that_hold_with_and_without_them() {
        let among = |sure: &[Response], possible: &[Response]| quantiles_among(sure, possible)[0];
        assert_eq!(among(&[at(100), at(200)], &[at(50)]), exactly(100));
        assert_eq!(among(&[at(100), at(200)], &[at(50), at(60)]), at_least(60));
        assert_eq!(among(&[at(100); 9], &[at(50), at(700)]), exactly(100));
        assert_eq!(among(&[], &[at(50), at(700)]), at_least(50));
        assert_eq!(among(&[], &[]), None);
    }

    #[test]
    fn quantiles_are_nearest_ranks() {
        let responses: Vec<Response> = (1..=200).rev().map(at).collect();
        assert_eq!(quantiles(&responses), [exactly(100), exactly(180), exactly(198)]);
        assert_eq!(quantiles(&responses[199..]), [exactly(1); 3]);
        assert_eq!(quantiles(&[]), [None; 3]);
    }
}
