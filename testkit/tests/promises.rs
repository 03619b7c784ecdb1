//! Checks that each promise is violated when a machine breaks it. The wrong decisions are invented
//! here.

use fuseline_testkit::{Ledger, OperatorConfig, Promise, split};
use fuseline_traces::{
    Cloud, Commit, Decision, DropReason, Header, Input, OfferRefusal, OpenRefusal, Reference,
};

/// The ledger of an operator whose decisions are invented.
struct FaultyOperator {
    header: Header,
    ledger: Ledger,
    /// Gives the true answers. It never sees the wrong ones.
    reference: Reference,
}

impl FaultyOperator {
    /// Creates an operator with the clouds 2 and 5.
    fn new(commit: Commit) -> Self {
        let cloud = |p| Cloud { p, name: None, limit: 1, resume: 0 };
        let clouds = vec![cloud(2), cloud(5)];
        let header = Header { operator: None, window: 1, commit, clouds };
        let reference = Reference::new(&header);
        Self { header, ledger: Ledger::default(), reference }
    }

    /// Opens timestamp 0 at 0 without a deadline, and requests it of cloud 5, due at 3.
    fn with_request(commit: Commit) -> Self {
        let mut liar = Self::new(commit);
        liar.honest(&Input::Open { at: 0, t: 0, deadline: None });
        liar.honest(&Input::Offer { at: 0, t: 0, p: 5, deadline: 3, backlog: 0 });
        liar
    }

    /// Records an input with the true answer, which violates nothing.
    fn honest(&mut self, input: &Input) {
        let mut demands = Vec::new();
        self.reference.apply(input, &mut demands);
        let decisions: Vec<_> = demands.into_iter().map(|(decision, _)| decision).collect();
        let (fired, own) = split(input, &decisions);
        let violations = self.enter(input, fired, own);
        assert!(violations.is_empty(), "{violations:?}");
    }

    /// Records an input with this answer.
    fn lie(&mut self, input: &Input, own: &[Decision]) -> Vec<Promise> {
        self.enter(input, &[], own)
    }

    /// Records a tick after which timers make these decisions.
    fn fire(&mut self, at: u64, decisions: &[Decision]) -> Vec<Promise> {
        self.enter(&Input::Tick { at }, decisions, &[])
    }

    fn enter(&mut self, input: &Input, fired: &[Decision], own: &[Decision]) -> Vec<Promise> {
        let next_due = self.reference.next_due();
        let violations =
            self.ledger.enter(OperatorConfig::from(&self.header), input, fired, own, next_due);
        violations.into_iter().map(|violation| violation.promise).collect()
    }
}

#[test]
fn a_second_output_breaks_p1() {
    let mut liar = FaultyOperator::new(Commit::Eager);
    liar.honest(&Input::Open { at: 0, t: 0, deadline: None });
    liar.honest(&Input::Result { at: 1, t: 0, p: 0 });
    let again = Input::Result { at: 1, t: 0, p: 0 };
    assert!(liar.lie(&again, &[Decision::Emit { at: 1, t: 0, p: 0 }]).contains(&Promise::P1));
    let mut liar = FaultyOperator::new(Commit::Eager);
    liar.honest(&Input::Open { at: 0, t: 0, deadline: None });
    liar.honest(&Input::Result { at: 1, t: 0, p: 0 });
    assert!(liar.fire(2, &[Decision::Miss { at: 2, t: 0 }]).contains(&Promise::P1));
}

#[test]
fn forwarding_at_due_breaks_p2_and_before_does_not() {
    for (at, breaks) in [(2, false), (3, true)] {
        let mut liar = FaultyOperator::with_request(Commit::Eager);
        let emit = [Decision::Emit { at, t: 0, p: 5 }];
        let broken = liar.lie(&Input::Result { at, t: 0, p: 5 }, &emit);
        assert_eq!(broken.contains(&Promise::P2), breaks, "at {at}");
    }
}

#[test]
fn forwarding_less_than_the_best_breaks_p3() {
    let mut liar = FaultyOperator::with_request(Commit::Eager);
    liar.honest(&Input::Offer { at: 0, t: 0, p: 2, deadline: 3, backlog: 0 });
    liar.honest(&Input::Result { at: 1, t: 0, p: 0 });
    liar.honest(&Input::Result { at: 1, t: 0, p: 2 });
    let fail = Input::Fail { at: 2, t: 0, p: 5 };
    assert!(liar.lie(&fail, &[Decision::Emit { at: 2, t: 0, p: 0 }]).contains(&Promise::P3));
}

#[test]
fn forwarding_what_never_came_breaks_p3() {
    let mut liar = FaultyOperator::with_request(Commit::Eager);
    let emit = [Decision::Emit { at: 1, t: 0, p: 2 }];
    assert!(liar.lie(&Input::Result { at: 1, t: 0, p: 0 }, &emit).contains(&Promise::P3));
}

#[test]
fn holding_the_best_breaks_p4() {
    let mut liar = FaultyOperator::with_request(Commit::Eager);
    let hold = [Decision::Hold { at: 1, t: 0, p: 5 }];
    assert!(liar.lie(&Input::Result { at: 1, t: 0, p: 5 }, &hold).contains(&Promise::P4));
}

#[test]
fn missing_or_delaying_local_breaks_p5() {
    let mut liar = FaultyOperator::with_request(Commit::Eager);
    liar.honest(&Input::Result { at: 1, t: 0, p: 0 });
    let timer = Decision::Timer { at: 3, t: 0, p: 5 };
    assert!(liar.fire(3, &[timer, Decision::Miss { at: 3, t: 0 }]).contains(&Promise::P5));
    let mut liar = FaultyOperator::with_request(Commit::Eager);
    liar.honest(&Input::Result { at: 1, t: 0, p: 0 });
    assert!(!liar.fire(2, &[]).contains(&Promise::P5));
    assert!(liar.fire(3, &[timer]).contains(&Promise::P5));
}

#[test]
fn a_failed_request_binds_p5_until_its_due_instant() {
    let mut liar = FaultyOperator::with_request(Commit::Eager);
    liar.honest(&Input::Result { at: 1, t: 0, p: 0 });
    assert!(!liar.lie(&Input::Fail { at: 1, t: 0, p: 5 }, &[]).contains(&Promise::P5));
    assert!(!liar.fire(2, &[]).contains(&Promise::P5));
    assert!(liar.fire(3, &[]).contains(&Promise::P5));
}

#[test]
fn holding_local_without_a_request_breaks_p6() {
    let mut liar = FaultyOperator::new(Commit::Eager);
    liar.honest(&Input::Open { at: 0, t: 0, deadline: None });
    let hold = [Decision::Hold { at: 1, t: 0, p: 0 }];
    assert!(liar.lie(&Input::Result { at: 1, t: 0, p: 0 }, &hold).contains(&Promise::P6));
}

#[test]
fn waiting_for_nothing_breaks_p7() {
    let mut liar = FaultyOperator::new(Commit::Eager);
    liar.honest(&Input::Open { at: 0, t: 0, deadline: None });
    assert!(liar.lie(&Input::Fail { at: 1, t: 0, p: 0 }, &[]).contains(&Promise::P7));
}

#[test]
fn outliving_the_limit_breaks_p7() {
    let mut liar = FaultyOperator::new(Commit::Eager);
    liar.honest(&Input::Open { at: 0, t: 0, deadline: Some(2) });
    assert!(!liar.fire(1, &[]).contains(&Promise::P7));
    assert!(liar.fire(2, &[Decision::Timer { at: 2, t: 0, p: 0 }]).contains(&Promise::P7));
}

#[test]
fn a_timer_that_is_not_owed_or_not_kept_breaks_p8() {
    let mut liar = FaultyOperator::with_request(Commit::Patient);
    liar.honest(&Input::Offer { at: 0, t: 0, p: 2, deadline: 2, backlog: 0 });
    // Under patient a held result must have no timer, and this machine keeps it.
    let hold = [Decision::Hold { at: 1, t: 0, p: 2 }];
    assert!(liar.lie(&Input::Result { at: 1, t: 0, p: 2 }, &hold).contains(&Promise::P8));
    // This timer fires too early.
    let mut liar = FaultyOperator::with_request(Commit::Eager);
    assert!(liar.fire(2, &[Decision::Timer { at: 2, t: 0, p: 5 }]).contains(&Promise::P8));
    // This timer is overdue.
    let mut liar = FaultyOperator::with_request(Commit::Eager);
    assert!(liar.fire(3, &[]).contains(&Promise::P8));
}

#[test]
fn an_open_beyond_the_window_breaks_p9() {
    let mut liar = FaultyOperator::new(Commit::Eager);
    liar.honest(&Input::Open { at: 0, t: 0, deadline: None });
    assert!(liar.lie(&Input::Open { at: 0, t: 1, deadline: None }, &[]).contains(&Promise::P9));
}

#[test]
fn wrong_count_or_reason_of_outcomes_breaks_p11() {
    let result = Input::Result { at: 1, t: 0, p: 5 };
    let hold = Decision::Hold { at: 1, t: 0, p: 5 };
    let drop = |why| Decision::Drop { at: 1, t: 0, p: 5, why };
    for own in [vec![], vec![hold, drop(DropReason::Late)]] {
        let mut liar = FaultyOperator::with_request(Commit::Eager);
        assert!(liar.lie(&result, &own).contains(&Promise::P11), "{own:?}");
    }
    for why in DropReason::ALL {
        let mut liar = FaultyOperator::with_request(Commit::Eager);
        assert!(liar.lie(&result, &[drop(why)]).contains(&Promise::P11), "{why}");
    }
    for why in OfferRefusal::ALL {
        let mut liar = FaultyOperator::with_request(Commit::Eager);
        let offer = Input::Offer { at: 0, t: 0, p: 2, deadline: 1, backlog: 0 };
        let refuse = [Decision::RefuseOffer { at: 0, t: 0, p: 2, why }];
        assert!(liar.lie(&offer, &refuse).contains(&Promise::P11), "{why}");
    }
    for why in OpenRefusal::ALL {
        let mut liar = FaultyOperator::new(Commit::Eager);
        let refuse = [Decision::RefuseOpen { at: 0, t: 0, why }];
        let open = Input::Open { at: 0, t: 0, deadline: None };
        assert!(liar.lie(&open, &refuse).contains(&Promise::P11), "{why}");
    }
}

#[test]
fn outliving_local_and_the_requests_breaks_p12() {
    let timer = |at, p| Decision::Timer { at, t: 0, p };
    // Local's result came, and the last request is due.
    let mut liar = FaultyOperator::with_request(Commit::Eager);
    liar.honest(&Input::Result { at: 1, t: 0, p: 0 });
    assert!(!liar.fire(2, &[]).contains(&Promise::P12));
    assert!(liar.fire(3, &[timer(3, 5)]).contains(&Promise::P12));
    // The last request was due before, and local fails.
    let mut liar = FaultyOperator::with_request(Commit::Eager);
    assert!(!liar.fire(3, &[timer(3, 5)]).contains(&Promise::P12));
    assert!(liar.lie(&Input::Fail { at: 4, t: 0, p: 0 }, &[]).contains(&Promise::P12));
    // Local's result came, and the timestamp is missed.
    let mut liar = FaultyOperator::with_request(Commit::Eager);
    liar.honest(&Input::Result { at: 1, t: 0, p: 0 });
    let missed = [timer(3, 5), Decision::Miss { at: 3, t: 0 }];
    assert!(liar.fire(3, &missed).contains(&Promise::P12));
}

#[test]
fn failed_request_binds_p12_but_local_deadline_not() {
    let mut liar = FaultyOperator::new(Commit::Eager);
    liar.honest(&Input::Open { at: 0, t: 0, deadline: Some(9) });
    liar.honest(&Input::Offer { at: 0, t: 0, p: 5, deadline: 3, backlog: 0 });
    assert!(!liar.lie(&Input::Fail { at: 1, t: 0, p: 5 }, &[]).contains(&Promise::P12));
    assert!(!liar.lie(&Input::Fail { at: 1, t: 0, p: 0 }, &[]).contains(&Promise::P12));
    assert!(!liar.fire(2, &[]).contains(&Promise::P12));
    assert!(liar.fire(3, &[]).contains(&Promise::P12));
}

#[test]
fn a_timer_that_was_never_armed_breaks_p8() {
    let mut liar = FaultyOperator::with_request(Commit::Eager);
    assert_eq!(liar.fire(1, &[Decision::Timer { at: 1, t: 0, p: 2 }]), [Promise::P8]);
}

#[test]
fn a_request_with_another_due_instant_breaks_p8() {
    let mut liar = FaultyOperator::with_request(Commit::Eager);
    let offer = Input::Offer { at: 0, t: 0, p: 2, deadline: 3, backlog: 0 };
    assert_eq!(liar.lie(&offer, &[Decision::Request { at: 0, t: 0, p: 2, due: 4 }]), [Promise::P8]);
}

#[test]
fn a_miss_while_a_result_may_still_come_breaks_p7() {
    let mut liar = FaultyOperator::with_request(Commit::Eager);
    liar.honest(&Input::Fail { at: 1, t: 0, p: 0 });
    assert!(liar.fire(2, &[Decision::Miss { at: 2, t: 0 }]).contains(&Promise::P7));
}

#[test]
fn outliving_the_latest_due_instant_breaks_p7() {
    let mut liar = FaultyOperator::new(Commit::Eager);
    liar.honest(&Input::Open { at: 0, t: 0, deadline: Some(2) });
    liar.honest(&Input::Offer { at: 0, t: 0, p: 5, deadline: 3, backlog: 0 });
    assert!(liar.fire(3, &[]).contains(&Promise::P7));
}
