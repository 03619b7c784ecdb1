//! Timers and misses that the ledger must not take, each for a reason of its own.

use fuseline_testkit::{Ledger, OperatorConfig, Promise, split};
use fuseline_traces::{Cloud, Commit, Decision, Header, Input, Reference};

/// An operator with the clouds 2 and 5 that says what the test gives it.
struct FaultyOperator {
    header: Header,
    ledger: Ledger,
    reference: Reference,
}

impl FaultyOperator {
    /// With 0 open, local limited to this, and a request of it to 5 due at 3.
    fn new(limit: Option<u64>) -> Self {
        let cloud = |p| Cloud { p, name: None, limit: 1, resume: 0 };
        let clouds = vec![cloud(2), cloud(5)];
        let header = Header { operator: None, window: 1, commit: Commit::Eager, clouds };
        let reference = Reference::new(&header);
        let mut liar = Self { header, ledger: Ledger::default(), reference };
        liar.honest(&Input::Open { at: 0, t: 0, deadline: limit });
        liar.honest(&Input::Offer { at: 0, t: 0, p: 5, deadline: 3, backlog: 0 });
        liar
    }

    /// An input with the true answer, which breaks nothing.
    fn honest(&mut self, input: &Input) {
        let mut demands = Vec::new();
        self.reference.apply(input, &mut demands);
        let decisions: Vec<_> = demands.into_iter().map(|(decision, _)| decision).collect();
        assert_eq!(self.violations_of(input, &decisions), []);
    }

    /// What breaks if it says this.
    fn violations_of(&mut self, input: &Input, decisions: &[Decision]) -> Vec<Promise> {
        let next_due = self.reference.next_due();
        let (fired, own) = split(input, decisions);
        let terms = OperatorConfig::from(&self.header);
        let broken = self.ledger.enter(terms, input, fired, own, next_due);
        broken.into_iter().map(|violation| violation.promise).collect()
    }
}

#[test]
fn a_timer_that_was_never_armed_breaks_p8() {
    let timer = Decision::Timer { at: 1, t: 0, p: 2 };
    assert_eq!(
        FaultyOperator::new(None).violations_of(&Input::Tick { at: 1 }, &[timer]),
        [Promise::P8]
    );
}

#[test]
fn a_request_with_another_due_instant_breaks_p8() {
    let offer = Input::Offer { at: 0, t: 0, p: 2, deadline: 3, backlog: 0 };
    let request = Decision::Request { at: 0, t: 0, p: 2, due: 4 };
    assert_eq!(FaultyOperator::new(None).violations_of(&offer, &[request]), [Promise::P8]);
}

#[test]
fn a_miss_while_a_result_may_still_come_breaks_p7() {
    let mut liar = FaultyOperator::new(None);
    liar.honest(&Input::Fail { at: 1, t: 0, p: 0 });
    let missed = Decision::Miss { at: 2, t: 0 };
    assert!(liar.violations_of(&Input::Tick { at: 2 }, &[missed]).contains(&Promise::P7));
}

#[test]
fn a_timestamp_that_outlives_its_latest_due_instant_breaks_p7() {
    assert!(
        FaultyOperator::new(Some(2))
            .violations_of(&Input::Tick { at: 3 }, &[])
            .contains(&Promise::P7)
    );
}
