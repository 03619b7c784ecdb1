//! All interleavings of few threads at the machine, with at most three preemptions: each is some order of the pure
//! step. Run with `RUSTFLAGS="--cfg loom"`.
#![cfg(loom)]

use std::collections::HashSet;
use std::sync::{Arc, Mutex};

use fuseline_core::shared::Shared;
use fuseline_core::{Cloud, Commit, Gate, Priority};
use fuseline_loom::{
    Answer, History, Member, Sequential, Timed, fail, limited, next_due, offer, open, result, tick,
};
use loom::model::Builder;
use loom::thread;

/// What threads do: first the owner alone, then all at once, the owner first among them, then the owner alone.
struct Race {
    before: &'static [Timed],
    threads: &'static [&'static [Timed]],
    after: &'static [Timed],
}

impl Race {
    /// Explores it under a commit rule; answers how many different lists of answers there were.
    fn ends<const CLOUDS: usize, const WINDOW: usize>(&'static self, commit: Commit) -> usize {
        let ends: Arc<Mutex<HashSet<Vec<Answer>>>> = Arc::default();
        let seen = Arc::clone(&ends);
        explore(move || {
            seen.lock().unwrap().insert(self.run::<CLOUDS, WINDOW>(commit));
        });
        ends.lock().unwrap().len()
    }

    fn run<const CLOUDS: usize, const WINDOW: usize>(&self, commit: Commit) -> Vec<Answer> {
        let clouds: [u16; CLOUDS] = std::array::from_fn(|i| i as u16 + 1);
        let clouds = clouds.map(|p| Cloud::new(Priority::new(p), 1));
        let shared = Shared::<CLOUDS, WINDOW>::new(WINDOW, commit, &clouds).unwrap();
        // Loom's threads cannot borrow.
        let (shared, history) =
            (Box::leak(Box::new(shared)), &*Box::leak(Box::<History>::default()));
        let (intake, desk) = shared.split();
        let mut owner = Member::owner(history, desk, intake);
        owner.make(self.before);
        let others: Vec<_> = self.threads[1..]
            .iter()
            .map(|calls| {
                let mut member = owner.other();
                thread::spawn(move || member.make(calls))
            })
            .collect();
        owner.make(self.threads[0]);
        for other in others {
            other.join().unwrap();
        }
        owner.make(self.after);
        let gates = vec![Gate::new(1, 0).unwrap(); CLOUDS];
        let explained = history.is_explained_by(&Sequential::new(commit, WINDOW, gates));
        assert!(explained, "no order of the pure step explains {:#?}", history.calls());
        let mut calls = history.calls();
        calls.sort_by_key(|call| format!("{:?}", call.input));
        calls.iter().map(|call| call.answer).collect()
    }
}

fn explore(run: impl Fn() + Sync + Send + 'static) {
    let mut builder = Builder::new();
    builder.preemption_bound = Some(3);
    builder.check(run);
}

#[test]
fn two_clouds_race() {
    static RACE: Race = Race {
        before: &[open(0, 0), offer(0, 0, 1, 10), offer(0, 0, 2, 20)],
        threads: &[&[result(5, 0, 1)], &[result(5, 0, 2)]],
        after: &[tick(20, 0)],
    };
    for commit in [Commit::Eager, Commit::Patient] {
        assert_eq!(RACE.ends::<2, 1>(commit), 2);
    }
}
