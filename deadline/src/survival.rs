//! [`Survival`]: estimates how long a cloud's results take, even if some of the observed calls were
//! given up.
//!
//! The book's chapter *Deadlines that are safe* has the formula of the estimate and its source
//! (T5).

use core::iter::Peekable;
use core::time::Duration;

/// Counts the calls that were observed until the same age.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct Observation {
    /// The age, counted from the capture of the message.
    pub response: Duration,
    /// `true` if the results came at that age. Otherwise they had not come by then, and nothing
    /// more is known.
    pub is_answered: bool,
    /// The number of calls.
    pub count: u64,
}

/// Estimates the share of calls whose results have not come by an age, after Kaplan and Meier.
/// Yields a step for each distinct response, in ascending order.
///
/// A call that was given up counts as neither fast nor lost: it counts for as long as it was seen.
/// If a call was given up at an age at which other calls had their results, it counts as not
/// answered by that age.
#[derive(Clone, Debug)]
pub struct Survival<'a, I: Iterator<Item = Observation>> {
    sorted: Peekable<I>,
    /// The oldest call comes first.
    under_way: &'a [Duration],
    at_risk: u64,
    unanswered: f64,
}

/// A response that was observed.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Step {
    /// The response: the age at which results came.
    pub response: Duration,
    /// The share of calls whose results came at exactly this response.
    pub mass: f64,
    /// The share of calls whose results had not come by this response.
    pub survival: f64,
}

impl Observation {
    /// Returns the key of the order that [`Survival`] needs: by response, calls with results before
    /// those given up.
    #[must_use]
    pub const fn key(&self) -> (Duration, bool) {
        (self.response, !self.is_answered)
    }
}

impl<'a, I: Iterator<Item = Observation> + Clone> Survival<'a, I> {
    /// Creates an estimate from observations in the order of their [`key`](Observation::key), and
    /// from the ages of the calls under way, the oldest first.
    ///
    /// Any other order makes the estimate wrong, and is not detected.
    pub fn new(sorted: I, under_way: &'a [Duration]) -> Self {
        let counts = sorted.clone().map(|observation| observation.count);
        let at_risk = counts.fold(under_way.len() as u64, u64::saturating_add);
        Self { sorted: sorted.peekable(), under_way, at_risk, unanswered: 1.0 }
    }
}

impl<I: Iterator<Item = Observation>> Iterator for Survival<'_, I> {
    type Item = Step;

    fn next(&mut self) -> Option<Step> {
        loop {
            let Observation { response, is_answered, mut count } = self.sorted.next()?;
            if is_answered && count > 0 {
                while let [older @ .., youngest] = self.under_way
                    && *youngest < response
                {
                    self.under_way = older;
                    self.at_risk = self.at_risk.saturating_sub(1);
                }
                while let Some(more) =
                    self.sorted.next_if(|next| next.is_answered && next.response == response)
                {
                    count = count.saturating_add(more.count);
                }
                let remain = self.at_risk.saturating_sub(count);
                let before = self.unanswered;
                self.unanswered *= share(remain, self.at_risk);
                self.at_risk = remain;
                let mass = before - self.unanswered;
                return Some(Step { response, mass, survival: self.unanswered });
            }
            self.at_risk = self.at_risk.saturating_sub(count);
        }
    }
}

#[expect(clippy::cast_precision_loss, reason = "a share needs no more than 53 bits")]
fn share(part: u64, whole: u64) -> f64 {
    part as f64 / whole as f64
}
