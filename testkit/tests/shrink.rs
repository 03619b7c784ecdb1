use std::convert::Infallible;

use fuseline_testkit::{Simplification, Steps, shrink};

fn none<T>(_: &T) -> Vec<Simplification<T>> {
    Vec::new()
}

fn shrunk<T: Steps + PartialEq>(
    subject: T,
    simplifications: impl Fn(&T) -> Vec<Simplification<T>>,
    fails: impl Fn(&T) -> bool,
) -> T {
    assert!(fails(&subject));
    let Ok(smallest) =
        shrink(subject, simplifications, |subject| Ok::<_, Infallible>(fails(subject)));
    smallest
}

#[test]
fn keeps_needed_steps_wherever_they_are() {
    for needed in [vec![0], vec![99], vec![3, 4], vec![0, 50, 99], (20..40).collect(), vec![]] {
        let fails = |steps: &Vec<u8>| needed.iter().all(|step| steps.contains(step));
        assert_eq!(shrunk((0..100).collect(), none, fails), needed);
    }
}

#[test]
fn removes_steps_that_removals_make_needless() {
    // While there is a `b`, there must be an `a`, which is tried before it.
    let fails = |steps: &Vec<char>| {
        let has = |step| steps.contains(&step);
        has('x') && has('y') && (has('a') || !has('b'))
    };
    assert_eq!(shrunk("axyb".chars().collect(), none, fails), ['x', 'y']);
}

#[test]
fn each_step_is_as_simple_as_it_can_be() {
    let halved = |steps: &Vec<u32>| {
        let halve =
            |index: usize| -> Simplification<Vec<u32>> { Box::new(move |steps| steps[index] /= 2) };
        (0..steps.len()).map(halve).collect()
    };
    let fails = |steps: &Vec<u32>| steps.iter().any(|step| *step > 10);
    assert_eq!(shrunk(vec![3, 999, 5, 800], halved, fails), [12]);
}

#[test]
fn removes_steps_that_simplifications_make_needless() {
    let simplified = |_: &Vec<u8>| -> Vec<Simplification<Vec<u8>>> {
        vec![Box::new(|steps| steps.iter_mut().for_each(|step| *step = 0))]
    };
    // While there is a 9, all three must be present.
    let fails = |steps: &Vec<u8>| {
        if steps.contains(&9) { steps.len() == 3 } else { !steps.is_empty() }
    };
    assert_eq!(shrunk(vec![9, 9, 9], simplified, fails), [0]);
}

#[test]
fn what_gives_up_or_errs_ends_the_search() {
    let mut tries = 0;
    let last = shrink((0..100).collect(), none, |steps: &Vec<u8>| {
        tries += 1;
        Ok::<_, Infallible>(tries <= 2 && steps.contains(&99))
    });
    // Half of them is removed, then half of what is left.
    assert_eq!(last, Ok((50..100).collect()));
    let mut tries = 0;
    let stopped = shrink(vec![1, 2, 3], none, |_: &Vec<u8>| {
        tries += 1;
        if tries < 2 { Ok(false) } else { Err("gone") }
    });
    assert_eq!((stopped, tries), (Err("gone"), 2));
}
