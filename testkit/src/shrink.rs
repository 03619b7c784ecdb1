//! Makes a failing case smaller while it still fails.

use std::ops::Range;

use crate::run::Run;

/// A case with steps, some of which can be left out.
pub trait Steps: Clone {
    /// Returns the number of steps.
    fn count(&self) -> usize;

    /// Removes these steps.
    fn remove(&mut self, steps: Range<usize>);
}

impl<T: Clone> Steps for Vec<T> {
    fn count(&self) -> usize {
        self.len()
    }

    fn remove(&mut self, steps: Range<usize>) {
        self.drain(steps);
    }
}

impl Steps for Run {
    fn count(&self) -> usize {
        self.inputs.len()
    }

    fn remove(&mut self, steps: Range<usize>) {
        self.inputs.drain(steps);
    }
}

/// Makes one part of a case simpler. If that part is gone by then, it must change nothing.
pub type Simplification<T> = Box<dyn Fn(&mut T)>;

/// Returns the smallest case that was found for which `fails` returns `true`; it must return `true`
/// for `subject`.
///
/// This is delta debugging. It removes stretches of steps, first half of them, then shorter
/// stretches down to single steps. Then it tries each of the `simplifications` of what is left. It
/// repeats both until no single step can be removed and no simplification is possible. No
/// simplification may undo another one, or the search never ends.
///
/// `fails` may give up at some point, and must then return `false` from there on.
///
/// ```
/// let fails = |steps: &Vec<u8>| Ok::<_, ()>(steps.contains(&7));
/// assert_eq!(fuseline_testkit::shrink(vec![1, 7, 3], |_| Vec::new(), fails), Ok(vec![7]));
/// ```
///
/// # Errors
/// Returns the first error of `fails`.
pub fn shrink<T: Steps + PartialEq, E>(
    mut subject: T,
    simplifications: impl Fn(&T) -> Vec<Simplification<T>>,
    mut fails: impl FnMut(&T) -> Result<bool, E>,
) -> Result<T, E> {
    loop {
        let is_shorter = remove(&mut subject, &mut fails)?;
        let is_simpler = simplify(&mut subject, &simplifications, &mut fails)?;
        if !is_shorter && !is_simpler {
            return Ok(subject);
        }
    }
}

/// Removes stretches of steps. Returns `true` if it removed any.
fn remove<T: Steps, E>(
    subject: &mut T,
    mut fails: impl FnMut(&T) -> Result<bool, E>,
) -> Result<bool, E> {
    let before = subject.count();
    let mut stretch = before.div_ceil(2);
    while stretch > 0 {
        let mut from = 0;
        while from < subject.count() {
            let mut shorter = subject.clone();
            shorter.remove(from..(from + stretch).min(subject.count()));
            if fails(&shorter)? {
                *subject = shorter;
            } else {
                from += stretch;
            }
        }
        stretch /= 2;
    }
    Ok(subject.count() < before)
}

/// Tries each simplification on what the earlier ones left. Returns `true` if any was possible.
fn simplify<T: Steps + PartialEq, E>(
    subject: &mut T,
    simplifications: impl Fn(&T) -> Vec<Simplification<T>>,
    mut fails: impl FnMut(&T) -> Result<bool, E>,
) -> Result<bool, E> {
    let mut is_simpler = false;
    for simplification in simplifications(subject) {
        let mut simpler = subject.clone();
        simplification(&mut simpler);
        if simpler != *subject && fails(&simpler)? {
            *subject = simpler;
            is_simpler = true;
        }
    }
    Ok(is_simpler)
}
