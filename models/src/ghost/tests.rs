//! Each promise goes red when a machine breaks it: what the machine said is made up here.

use super::*;
use crate::machine::{End, Fired, machine};

/// The accounts of an operator under a machine that says what it is told to.
struct Liar {
    config: &'static Config,
    ghost: Ghost,
    /// Opens and requests are given to it, so that its timers are those that are owed.
    machine: Machine,
}

impl Liar {
    fn new(config: &str) -> Self {
        let config = Config::named(config).expect("a configuration");
        let machine = machine(&config.header()).expect("a sound one");
        Self { config, ghost: Ghost::default(), machine }
    }

    /// Opens 0 without a deadline at 0 and asks 5 for it by 3.
    fn with_request(config: &str) -> Self {
        let mut liar = Self::new(config);
        liar.honest(&Input::Open { at: 0, t: 0, deadline: None });
        liar.honest(&Input::Offer { at: 0, t: 0, p: 5, deadline: 3, backlog: 0 });
        liar
    }

    /// Enters an input with the machine's true answer, which breaks nothing.
    fn honest(&mut self, input: &Input) {
        let answer = crate::machine::answer(&mut self.machine, input, 9);
        let broken = self.ghost.enter(self.config, input, &answer, &self.machine);
        assert!(broken.is_empty(), "{broken:?}");
    }

    /// Enters an input with this for an answer, which the machine does not hear of.
    fn lie(&mut self, input: &Input, own: &[Decision]) -> Claims {
        let answer = Answer { fired: Vec::new(), own: own.to_vec(), end: End::Whole };
        self.ghost.enter(self.config, input, &answer, &self.machine)
    }

    /// Enters a tick after which these decisions are made by timers.
    fn fire(&mut self, at: u64, due: u64, decisions: &[Decision]) -> Claims {
        let fired = vec![Fired { t: 0, due, decisions: decisions.to_vec() }];
        let answer = Answer { fired, own: Vec::new(), end: End::Whole };
        self.ghost.enter(self.config, &Input::Tick { at }, &answer, &self.machine)
    }
}

#[test]
fn a_second_output_breaks_p1() {
    let mut liar = Liar::new("2x1-eager");
    liar.honest(&Input::Open { at: 0, t: 0, deadline: None });
    liar.honest(&Input::Result { at: 1, t: 0, p: 0 });
    let again = Input::Result { at: 1, t: 0, p: 0 };
    assert!(liar.lie(&again, &[Decision::Emit { at: 1, t: 0, p: 0 }]).contains(Claim::P1));
    let mut liar = Liar::new("2x1-eager");
    liar.honest(&Input::Open { at: 0, t: 0, deadline: None });
    liar.honest(&Input::Result { at: 1, t: 0, p: 0 });
    assert!(liar.fire(2, 2, &[Decision::Miss { at: 2, t: 0 }]).contains(Claim::P1));
}

#[test]
fn forwarding_at_the_due_instant_breaks_p2_and_before_it_does_not() {
    for (at, breaks) in [(2, false), (3, true)] {
        let mut liar = Liar::with_request("2x1-eager");
        let emit = [Decision::Emit { at, t: 0, p: 5 }];
        let broken = liar.lie(&Input::Result { at, t: 0, p: 5 }, &emit);
        assert_eq!(broken.contains(Claim::P2), breaks, "at {at}");
    }
}

#[test]
fn forwarding_less_than_the_best_breaks_p3() {
    let mut liar = Liar::with_request("2x1-eager");
    liar.honest(&Input::Offer { at: 0, t: 0, p: 2, deadline: 3, backlog: 0 });
    liar.honest(&Input::Result { at: 1, t: 0, p: 0 });
    liar.honest(&Input::Result { at: 1, t: 0, p: 2 });
    let fail = Input::Fail { at: 2, t: 0, p: 5 };
    assert!(liar.lie(&fail, &[Decision::Emit { at: 2, t: 0, p: 0 }]).contains(Claim::P3));
}

#[test]
fn forwarding_what_never_came_breaks_p3() {
    let mut liar = Liar::with_request("2x1-eager");
    let emit = [Decision::Emit { at: 1, t: 0, p: 2 }];
    assert!(liar.lie(&Input::Result { at: 1, t: 0, p: 0 }, &emit).contains(Claim::P3));
}

#[test]
fn holding_the_best_breaks_p4() {
    let mut liar = Liar::with_request("2x1-eager");
    let hold = [Decision::Hold { at: 1, t: 0, p: 5 }];
    assert!(liar.lie(&Input::Result { at: 1, t: 0, p: 5 }, &hold).contains(Claim::P4));
}

#[test]
fn missing_or_keeping_local_beyond_the_latest_due_instant_breaks_p5() {
    let mut liar = Liar::with_request("2x1-eager");
    liar.honest(&Input::Result { at: 1, t: 0, p: 0 });
    let timer = Decision::Timer { at: 3, t: 0, p: 5 };
    assert!(liar.fire(3, 3, &[timer, Decision::Miss { at: 3, t: 0 }]).contains(Claim::P5));
    let mut liar = Liar::with_request("2x1-eager");
    liar.honest(&Input::Result { at: 1, t: 0, p: 0 });
    assert!(!liar.fire(2, 3, &[]).contains(Claim::P5));
    assert!(liar.fire(3, 3, &[timer]).contains(Claim::P5));
}

#[test]
fn a_failed_request_binds_p5_until_its_due_instant() {
    let mut liar = Liar::with_request("2x1-eager");
    liar.honest(&Input::Result { at: 1, t: 0, p: 0 });
    assert!(!liar.lie(&Input::Fail { at: 1, t: 0, p: 5 }, &[]).contains(Claim::P5));
    assert!(!liar.fire(2, 2, &[]).contains(Claim::P5));
    assert!(liar.fire(3, 3, &[]).contains(Claim::P5));
}

#[test]
fn holding_local_without_a_request_breaks_p6() {
    let mut liar = Liar::new("2x1-eager");
    liar.honest(&Input::Open { at: 0, t: 0, deadline: None });
    let hold = [Decision::Hold { at: 1, t: 0, p: 0 }];
    assert!(liar.lie(&Input::Result { at: 1, t: 0, p: 0 }, &hold).contains(Claim::P6));
}

#[test]
fn waiting_for_nothing_breaks_p7() {
    let mut liar = Liar::new("2x1-eager");
    liar.honest(&Input::Open { at: 0, t: 0, deadline: None });
    assert!(liar.lie(&Input::Fail { at: 1, t: 0, p: 0 }, &[]).contains(Claim::P7));
}

#[test]
fn outliving_the_limit_breaks_p7() {
    let mut liar = Liar::new("2x1-eager");
    liar.honest(&Input::Open { at: 0, t: 0, deadline: Some(2) });
    assert!(!liar.fire(1, 2, &[]).contains(Claim::P7));
    assert!(liar.fire(2, 2, &[Decision::Timer { at: 2, t: 0, p: 0 }]).contains(Claim::P7));
}

#[test]
fn a_timer_that_is_not_owed_or_not_kept_breaks_p8() {
    let mut liar = Liar::with_request("2x1-patient");
    liar.honest(&Input::Offer { at: 0, t: 0, p: 2, deadline: 2, backlog: 0 });
    // Patient: a held result owes no timer, and the machine keeps it.
    let hold = [Decision::Hold { at: 1, t: 0, p: 2 }];
    assert!(liar.lie(&Input::Result { at: 1, t: 0, p: 2 }, &hold).contains(Claim::P8));
    // Early.
    let mut liar = Liar::with_request("2x1-eager");
    assert!(liar.fire(2, 2, &[Decision::Timer { at: 2, t: 0, p: 5 }]).contains(Claim::P8));
    // Overdue.
    let mut liar = Liar::with_request("2x1-eager");
    assert!(liar.fire(3, 3, &[]).contains(Claim::P8));
}

#[test]
fn an_open_beyond_the_window_breaks_p9() {
    let mut liar = Liar::new("1x2w1-eager");
    liar.honest(&Input::Open { at: 0, t: 0, deadline: None });
    assert!(liar.lie(&Input::Open { at: 0, t: 1, deadline: None }, &[]).contains(Claim::P9));
}

#[test]
fn no_outcome_two_outcomes_and_a_false_reason_break_p11() {
    let result = Input::Result { at: 1, t: 0, p: 5 };
    let hold = Decision::Hold { at: 1, t: 0, p: 5 };
    let drop = |why| Decision::Drop { at: 1, t: 0, p: 5, why };
    for own in [vec![], vec![hold, drop(DropReason::Late)]] {
        let mut liar = Liar::with_request("2x1-eager");
        assert!(liar.lie(&result, &own).contains(Claim::P11), "{own:?}");
    }
    for why in DropReason::ALL {
        let mut liar = Liar::with_request("2x1-eager");
        assert!(liar.lie(&result, &[drop(why)]).contains(Claim::P11), "{why}");
    }
    for why in OfferRefusal::ALL {
        let mut liar = Liar::with_request("2x1-eager");
        let offer = Input::Offer { at: 0, t: 0, p: 2, deadline: 1, backlog: 0 };
        let refuse = [Decision::RefuseOffer { at: 0, t: 0, p: 2, why }];
        assert!(liar.lie(&offer, &refuse).contains(Claim::P11), "{why}");
    }
    for why in OpenRefusal::ALL {
        let mut liar = Liar::new("1x2w1-eager");
        let refuse = [Decision::RefuseOpen { at: 0, t: 0, why }];
        let open = Input::Open { at: 0, t: 0, deadline: None };
        assert!(liar.lie(&open, &refuse).contains(Claim::P11), "{why}");
    }
}
