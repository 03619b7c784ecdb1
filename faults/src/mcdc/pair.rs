//! Evaluations of a decision, and the pairs of evaluations which show that a condition changes it
//! alone.

use std::collections::BTreeSet;
use std::fmt;

/// One evaluation of a decision by a test.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub struct Evaluation {
    outcome: bool,
    /// The values of the conditions. A condition that was not evaluated is `None`.
    conditions: Vec<Option<bool>>,
    test: String,
}

/// Two evaluations that differ in a condition and in the outcome, and in no other condition that
/// both evaluated.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct IndependencePair<'a> {
    /// The evaluation with the condition true.
    pub holds: &'a Evaluation,
    /// The evaluation with the condition false.
    pub fails: &'a Evaluation,
}

impl Evaluation {
    /// Parses a line of the record: the decision's number, its conditions, the outcome, the test.
    /// Returns `None` if the line is not of this form.
    pub(crate) fn parse(line: &str) -> Option<(usize, Self)> {
        let mut words = line.splitn(4, ' ');
        let decision = words.next()?.parse().ok()?;
        let conditions = words.next()?.chars().map(|value| match value {
            '1' => Some(Some(true)),
            '0' => Some(Some(false)),
            '-' => Some(None),
            _ => None,
        });
        let conditions = conditions.collect::<Option<_>>()?;
        let outcome = words.next()? == "1";
        Some((decision, Self { outcome, conditions, test: words.next()?.to_owned() }))
    }
}

impl<'a> IndependencePair<'a> {
    /// Returns the tests that made the two evaluations.
    pub(crate) fn tests(self) -> [&'a str; 2] {
        [&self.holds.test, &self.fails.test]
    }

    /// Returns the first pair that shows a condition, if there is one.
    pub(crate) fn find(evaluations: &'a BTreeSet<Evaluation>, condition: usize) -> Option<Self> {
        let with = |wanted: bool| {
            evaluations.iter().filter(move |it| it.conditions.get(condition) == Some(&Some(wanted)))
        };
        let is_alone = |a: &Evaluation, b: &Evaluation| {
            let both = a.conditions.iter().zip(&b.conditions).enumerate();
            both.filter(|(i, _)| *i != condition)
                .all(|(_, (a, b))| a.is_none() || b.is_none() || a == b)
        };
        with(true).find_map(|holds| {
            let fails =
                with(false).find(|it| it.outcome != holds.outcome && is_alone(holds, it))?;
            Some(Self { holds, fails })
        })
    }
}

impl fmt::Display for Evaluation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for value in &self.conditions {
            f.write_str(match value {
                Some(true) => "T",
                Some(false) => "F",
                None => "-",
            })?;
        }
        write!(f, " is {} in {}", self.outcome, self.test)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn evaluations(lines: &[&str]) -> BTreeSet<Evaluation> {
        lines.iter().map(|line| Evaluation::parse(line).expect("a line of a record").1).collect()
    }

    #[test]
    fn a_condition_is_shown_by_two_evaluations_that_differ_in_it_alone() {
        let both = evaluations(&["0 11 1 a", "0 0- 0 b", "0 10 0 c"]);
        assert!(IndependencePair::find(&both, 0).is_some());
        assert!(IndependencePair::find(&both, 1).is_some());
        let (first, second) =
            (evaluations(&["0 11 1 a", "0 0- 0 b"]), evaluations(&["0 11 1 a", "0 10 0 c"]));
        assert_eq!(IndependencePair::find(&first, 1), None, "without its test it is not shown");
        assert_eq!(IndependencePair::find(&second, 0), None);
    }

    #[test]
    fn another_condition_that_differs_too_shows_nothing() {
        assert_eq!(IndependencePair::find(&evaluations(&["0 110 1 a", "0 001 0 b"]), 0), None);
        assert_eq!(IndependencePair::find(&evaluations(&["0 11 1 a", "0 01 1 b"]), 0), None);
    }
}
