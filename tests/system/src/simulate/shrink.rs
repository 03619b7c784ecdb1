//! Makes a run smaller while it still shows what it shows.

use std::io;
use std::time::Duration;

use crate::simulate::scenario::{
    CallResult, Disk, Finish, OfferAction, ReaderPlan, Scenario, SourceAction,
};

/// The most runs that are tried.
const TRIES: usize = 3000;

/// The smallest run that was found of which `shows` is true; the run itself shows it.
pub(crate) fn smallest(
    scenario: &Scenario,
    mut shows: impl FnMut(&Scenario) -> io::Result<bool>,
) -> io::Result<Scenario> {
    let mut best = scenario.clone();
    let mut tries = 0;
    loop {
        let before = best.clone();
        let mut chunk = (best.frames.len() / 2).max(1);
        while chunk > 0 {
            let mut from = 0;
            while from < best.frames.len() && tries < TRIES {
                tries += 1;
                let smaller = without(&best, from, chunk);
                if !smaller.frames.is_empty() && shows(&smaller)? {
                    best = smaller;
                } else {
                    from += chunk;
                }
            }
            chunk /= 2;
        }
        for smaller in plainer(&best) {
            tries += 1;
            // Each is made from the run that it was proposed for, so only one at a time counts.
            if tries < TRIES && smaller != best && shows(&smaller)? {
                best = smaller;
                break;
            }
        }
        if best == before || tries >= TRIES {
            return Ok(best);
        }
    }
}

/// Without these messages; the others keep their times.
fn without(scenario: &Scenario, from: usize, count: usize) -> Scenario {
    let mut smaller = scenario.clone();
    let to = (from + count).min(smaller.frames.len());
    let gap: Duration = smaller.frames.drain(from..to).map(|frame| frame.gap).sum();
    if let Some(next) = smaller.frames.get_mut(from) {
        next.gap += gap;
    }
    smaller
}

/// The same with one thing less each.
fn plainer(scenario: &Scenario) -> Vec<Scenario> {
    let mut all = Vec::new();
    let mut propose = |change: &dyn Fn(&mut Scenario)| {
        let mut smaller = scenario.clone();
        change(&mut smaller);
        if smaller != *scenario {
            all.push(smaller);
        }
    };
    for place in 0..scenario.clouds.len() {
        propose(&|it| {
            it.clouds.remove(place);
            it.frames.iter_mut().for_each(|frame| {
                frame.asks.remove(place);
            });
        });
        propose(&|it| it.clouds[place].policy = None);
        propose(&|it| it.clouds[place].linger = Duration::ZERO);
    }
    for place in 0..scenario.stalls.len() {
        propose(&|it| it.stalls = [&it.stalls[..place], &it.stalls[place + 1..]].concat());
    }
    let plain = ReaderPlan { joins_after: 0, pace: Duration::ZERO, lag: None, leaves_after: None };
    propose(&|it| it.readers.truncate(1));
    propose(&|it| it.readers.iter_mut().for_each(|reader| *reader = plain));
    propose(&|it| it.disk = Disk::Whole(None));
    propose(&|it| it.hints = None);
    propose(&|it| it.side = None);
    propose(&|it| it.end = Finish::Input);
    propose(&|it| it.input_len = 1024);
    propose(&|it| it.output_len = 1024);
    propose(&|it| it.window = 16);
    propose(&|it| (it.local.waiting, it.local.skip_answered) = (None, false));
    propose(&|it| it.local.at_once = 64);
    propose(&|it| it.local.deadline = None);
    if scenario.frames.len() > 40 {
        return all;
    }
    for place in 0..scenario.frames.len() {
        propose(&|it| it.frames[place].yields = 0);
        propose(&|it| it.frames[place].side = OfferAction::Nothing);
        propose(&|it| it.frames[place].local = SourceAction::answers(Duration::ZERO));
        propose(&|it| it.frames[place].local.yields = 0);
        for cloud in 0..scenario.clouds.len() {
            propose(&|it| it.frames[place].asks[cloud] = OfferAction::Nothing);
            propose(&|it| {
                if let OfferAction::Offers(_, act) = &mut it.frames[place].asks[cloud] {
                    *act = SourceAction { how: CallResult::Answers, yields: 0, ..*act };
                }
            });
        }
    }
    // Removing local's deadline may leave a message open for ever, which shows nothing but that.
    all.retain(|it| {
        let hangs =
            |act: SourceAction| matches!(act.how, CallResult::Hangs | CallResult::HangsAndPanics);
        it.local.deadline.is_some() || !it.frames.iter().any(|frame| hangs(frame.local))
    });
    all
}
