//! Response times by nearest ranks, also where some of them are not known.

use std::collections::BTreeMap;
use std::time::Duration;

use serde::{Serialize, Serializer};

/// When a source's result was there, or would have been, since its message came.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Arrival {
    /// At this time.
    At(Duration),
    /// Unknown, but not before: the call was ended then.
    After(Duration),
    /// No result will come, as was known then; at once if the source was not asked.
    Failed(Duration),
    /// Its network never came back.
    Never,
}

/// A response time among all messages; one without output never ends.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Quantile {
    /// Exactly this.
    Exactly(Duration),
    /// No less than this: some response times are not known.
    AtLeast(Duration),
    /// Never: too many messages have no output.
    Never,
}

/// The quantiles told, in percent.
pub const PERCENT: [usize; 3] = [50, 90, 99];

impl Serialize for Quantile {
    /// Milliseconds; `{"at_least":…}` where some are not known, null where it never ends.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let ms = |at: Duration| at.as_secs_f64() * 1000.0;
        match *self {
            Self::Exactly(at) => serializer.serialize_f64(ms(at)),
            Self::AtLeast(at) => {
                [("at_least", ms(at))].into_iter().collect::<BTreeMap<_, _>>().serialize(serializer)
            }
            Self::Never => serializer.serialize_none(),
        }
    }
}

impl Arrival {
    /// By when it was there, to sort by; at the same instant an unknown one comes first, since it may be the later one.
    #[must_use]
    pub const fn key(self) -> (Duration, u8) {
        match self {
            Self::After(bound) => (bound, 0),
            Self::At(at) => (at, 1),
            // No output however long one waits.
            Self::Failed(_) | Self::Never => (Duration::MAX, 2),
        }
    }
}

/// Those of [`PERCENT`], by nearest ranks; none without responses. Sorts them.
///
/// An unknown response that may exceed its place makes all later ones lower bounds.
pub fn quantiles(responses: &mut [Arrival]) -> [Option<Quantile>; 3] {
    responses.sort_unstable_by_key(|arrival| arrival.key());
    let unknown = responses
        .iter()
        .position(|arrival| matches!(arrival, Arrival::After(_)))
        .unwrap_or(responses.len());
    PERCENT.map(|percent| {
        let place = (responses.len() * percent).div_ceil(100).checked_sub(1)?;
        Some(match *responses.get(place)? {
            Arrival::At(at) if place < unknown => Quantile::Exactly(at),
            Arrival::At(bound) | Arrival::After(bound) => Quantile::AtLeast(bound),
            Arrival::Failed(_) | Arrival::Never => Quantile::Never,
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(millis: u64) -> Duration {
        Duration::from_millis(millis)
    }

    const fn at(millis: u64) -> Arrival {
        Arrival::At(ms(millis))
    }

    #[test]
    fn an_unknown_response_makes_all_quantiles_above_it_lower_bounds() {
        let mut responses = [at(100), Arrival::After(ms(200)), at(300)];
        let quantiles = quantiles(&mut responses).map(Option::unwrap);
        assert_eq!(quantiles[0], Quantile::AtLeast(ms(200)));
        assert_eq!(quantiles[2], Quantile::AtLeast(ms(300)));
    }

    #[test]
    fn quantiles_are_nearest_ranks() {
        let mut responses: Vec<Arrival> = (1..=200).rev().map(at).collect();
        let exactly = |millis| Some(Quantile::Exactly(ms(millis)));
        assert_eq!(quantiles(&mut responses), [exactly(100), exactly(180), exactly(198)]);
        assert_eq!(quantiles(&mut responses[..1]), [exactly(1); 3]);
        assert_eq!(quantiles(&mut []), [None; 3]);
    }
}
