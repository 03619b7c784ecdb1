//! Makes a run smaller while it still shows the same fault.

use std::ops::Range;
use std::time::Duration;

use fuseline_testkit::{Simplification, Steps};
use fuseline_tokio::Commit;

use crate::simulate::scenario::{
    CallResult, Disk, Finish, OfferAction, ReaderPlan, Scenario, SourceAction,
};

/// The steps are the messages; those that stay keep their times.
impl Steps for Scenario {
    fn count(&self) -> usize {
        self.frames.len()
    }

    fn remove(&mut self, steps: Range<usize>) {
        let from = steps.start;
        let gap: Duration = self.frames.drain(steps).map(|frame| frame.gap).sum();
        if let Some(next) = self.frames.get_mut(from) {
            next.gap += gap;
        }
    }
}

/// Returns changes that each remove one thing.
pub(crate) fn simplifications(scenario: &Scenario) -> Vec<Simplification<Scenario>> {
    let mut all: Vec<Simplification<Scenario>> = Vec::new();
    for index in (0..scenario.clouds.len()).rev() {
        all.push(Box::new(move |it| {
            it.clouds.remove(index);
            it.frames.iter_mut().for_each(|frame| {
                frame.offers.remove(index);
            });
        }));
    }
    all.push(Box::new(|it| it.clouds.iter_mut().for_each(|cloud| cloud.policy = None)));
    all.push(Box::new(|it| it.clouds.iter_mut().for_each(|cloud| cloud.linger = Duration::ZERO)));
    for index in (0..scenario.stalls.len()).rev() {
        all.push(Box::new(move |it| {
            it.stalls.remove(index);
        }));
    }
    let plain = ReaderPlan { joins_after: 0, pace: Duration::ZERO, lag: None, leaves_after: None };
    all.push(Box::new(|it| it.readers.truncate(1)));
    all.push(Box::new(move |it| it.readers.iter_mut().for_each(|reader| *reader = plain)));
    all.push(Box::new(|it| it.disk = Disk::Whole(None)));
    all.push(Box::new(|it| it.hints = None));
    all.push(Box::new(|it| it.side = None));
    all.push(Box::new(|it| it.link = None));
    all.push(Box::new(|it| it.end = Finish::Input));
    all.push(Box::new(|it| it.commit = Commit::Eager));
    all.push(Box::new(|it| it.input_len = 1024));
    all.push(Box::new(|it| it.output_len = 1024));
    all.push(Box::new(|it| it.window = 16));
    all.push(Box::new(|it| (it.local.waiting, it.local.skip_answered) = (None, false)));
    all.push(Box::new(|it| it.local.at_once = 64));
    if scenario.frames.len() <= 40 {
        (0..scenario.frames.len()).for_each(|index| simplify_frame(index, scenario, &mut all));
    }
    // Without it, a message whose local computation hangs stays open without end, which shows
    // nothing else.
    all.push(Box::new(|it| {
        let hangs = |act: SourceAction| {
            matches!(act.result, CallResult::Hangs | CallResult::HangsAndPanics)
        };
        if !it.frames.iter().any(|frame| hangs(frame.local)) {
            it.local.deadline = None;
        }
    }));
    all
}

fn simplify_frame(index: usize, scenario: &Scenario, all: &mut Vec<Simplification<Scenario>>) {
    all.push(Box::new(move |it| it.frames[index].yields = 0));
    all.push(Box::new(move |it| it.frames[index].side = OfferAction::Nothing));
    all.push(Box::new(move |it| it.frames[index].local = SourceAction::answers(Duration::ZERO)));
    all.push(Box::new(move |it| it.frames[index].local.yields = 0));
    for cloud in 0..scenario.clouds.len() {
        all.push(Box::new(move |it| {
            if let Some(offer) = it.frames[index].offers.get_mut(cloud) {
                *offer = OfferAction::Nothing;
            }
        }));
        all.push(Box::new(move |it| {
            if let Some(OfferAction::Offers(_, act)) = it.frames[index].offers.get_mut(cloud) {
                *act = SourceAction { result: CallResult::Answers, yields: 0, ..*act };
            }
        }));
    }
}
