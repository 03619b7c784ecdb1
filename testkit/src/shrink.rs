//! Makes what fails smaller while it still fails.

use std::ops::Range;

use crate::run::Run;

/// Something with steps, some of which can be left out.
pub trait Steps: Clone {
    /// How many there are.
    fn count(&self) -> usize;

    /// Leaves these out.
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

/// Makes one thing simpler. What it wants to change may be gone by then, which must do no harm.
pub type Simplification<T> = Box<dyn Fn(&mut T)>;

/// The smallest subject that was found of which `fails` is true; of `subject` it is.
///
/// Delta debugging: stretches of steps are left out, half of them first, then shorter ones down to single steps. After that
/// each of the `simplifications` of what is left is tried. All of this goes on until no single step can be left out any more
/// and no simplification is possible. No simplification may undo another, or there is no end.
///
/// `fails` may give up at some time: it answers false from then on.
///
/// # Errors
/// The first error of `fails`.
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

/// Leaves out stretches of steps; whether it could.
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

/// Tries each simplification on what the ones before it left; whether any was possible.
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
