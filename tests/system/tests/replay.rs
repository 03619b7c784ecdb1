//! A seed determines its run: played again, it is the same to the byte. A failing run becomes
//! small.

use std::time::Duration;

use fuseline_system_tests::simulate::{
    CallResult, Disk, Drawn, Finish, OfferAction, Scenario, Simulator, SourceAction,
};
use fuseline_tokio::Commit;

#[test]
fn a_seed_played_twice_is_the_same_to_the_byte() {
    let mut simulator = Simulator::new().unwrap();
    let mut bytes = 0;
    for seed in 0..60 {
        assert_eq!(Scenario::draw(seed), Scenario::draw(seed));
        let first = simulator.simulate(&Scenario::draw(seed)).unwrap();
        assert!(first.findings.is_empty(), "seed {seed}: {:?}", first.findings);
        let second = simulator.simulate(&Scenario::draw(seed)).unwrap();
        assert!(first.trace == second.trace, "the traces of seed {seed} differ");
        assert!(
            first.external_log() == second.external_log(),
            "what is seen of seed {seed} differs"
        );
        bytes += first.trace.len();
    }
    assert!(bytes > 1_000_000, "{bytes} bytes are nothing to compare");
}

/// Every kind of trouble occurs within a few hundred seeds. Otherwise the drawing has dried up.
#[test]
fn every_kind_of_trouble_is_drawn() {
    let all: Vec<Scenario> = (0..400).map(Scenario::draw).collect();
    let frames = || all.iter().flat_map(|it| &it.frames);
    let acts = || {
        frames().flat_map(|frame| &frame.offers).filter_map(|offer| match offer {
            OfferAction::Offers(_, act) => Some(act),
            OfferAction::Nothing | OfferAction::Panics => None,
        })
    };
    let drawn = |feature: &str, count: usize| assert!(count > 0, "no scenario has {feature}");
    for result in [
        CallResult::Answers,
        CallResult::Fails,
        CallResult::Panics,
        CallResult::PanicsAtOnce,
        CallResult::BadResponse,
        CallResult::PanickingResponse,
        CallResult::Hangs,
        CallResult::HangsAndPanics,
    ] {
        drawn(
            &format!("a call that {result:?}"),
            acts().filter(|act| act.result == result).count(),
        );
        drawn(
            &format!("a local that {result:?}"),
            frames().filter(|it| it.local.result == result).count(),
        );
    }
    drawn("yields", acts().filter(|act| act.yields > 0).count());
    let handlers = frames().flat_map(|frame| &frame.offers);
    drawn("a handler that panics", handlers.filter(|offer| **offer == OfferAction::Panics).count());
    drawn("a stall", all.iter().filter(|it| !it.stalls.is_empty()).count());
    drawn(
        "a policy",
        all.iter().flat_map(|it| &it.clouds).filter(|it| it.policy.is_some()).count(),
    );
    drawn(
        "a linger",
        all.iter().flat_map(|it| &it.clouds).filter(|it| !it.linger.is_zero()).count(),
    );
    drawn("an aside", all.iter().filter(|it| it.side.is_some()).count());
    drawn(
        "each commit rule",
        usize::from(Commit::ALL.iter().all(|rule| all.iter().any(|it| it.commit == *rule))),
    );
    drawn("hints", all.iter().filter(|it| it.hints.is_some()).count());
    drawn("metrics", all.iter().filter(|it| it.metered).count());
    drawn("a full disk", all.iter().filter(|it| matches!(it.disk, Disk::FullAfter(..))).count());
    let readers = || all.iter().flat_map(|it| &it.readers);
    drawn("a reader that lags", readers().filter(|it| it.lag.is_some()).count());
    drawn("a reader that leaves", readers().filter(|it| it.leaves_after.is_some()).count());
    for (feature, is) in [
        ("a stop", (|end| matches!(end, Finish::Stop(_))) as fn(Finish) -> bool),
        ("a crash", |end| matches!(end, Finish::Crash(_))),
        ("nobody who holds it", |end| end == Finish::Alone),
        ("an end of its input", |end| end == Finish::Input),
    ] {
        drawn(feature, all.iter().filter(|it| is(it.end)).count());
    }
}

/// A local computation that never ends and has no deadline keeps the operator running without end
/// (A9). No seed draws this scenario, and the simulator must find it. So this test shows that
/// findings are found and become small.
#[test]
fn what_never_ends_is_found_and_becomes_one_message() {
    let mut simulator = Simulator::new().unwrap();
    let seed = (0..1000).find(|seed| {
        let it = Scenario::draw(*seed);
        it.frames.len() > 50 && it.end == Finish::Input && it.disk == Disk::Whole(None)
    });
    let mut scenario = Scenario::draw(seed.unwrap());
    scenario.clouds.clear();
    (scenario.window, scenario.input_len, scenario.local.at_once) = (1024, 1024, 64);
    scenario.local.deadline = None;
    for frame in &mut scenario.frames {
        frame.offers.clear();
        frame.local = SourceAction::answers(Duration::from_millis(1));
    }
    scenario.frames[40].local =
        SourceAction { after: Duration::ZERO, yields: 0, result: CallResult::Hangs };
    let findings = simulator.simulate(&scenario).unwrap().findings;
    assert!(findings.iter().any(|finding| finding.check == "d8_everything_ends"), "{findings:?}");
    let smallest = simulator.smallest(&scenario, "d8_everything_ends").unwrap();
    assert_eq!(smallest.frames.len(), 1, "{smallest}");
    assert_eq!(smallest.frames[0].local.result, CallResult::Hangs, "{smallest}");
}
