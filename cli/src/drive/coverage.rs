//! What the runs came to: a suite that reaches little says little.

use std::collections::BTreeMap;

use fuseline_traces::{Decision, DropReason, Input, OfferRefusal, OpenRefusal, Rule};
use serde_json::{Map, Value};

use super::case::Run;
use super::edge::Edge;
use super::scene::{Reasons, Scene, Step};

/// Something that a run can come to.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum Mark {
    Rule(Rule),
    Open(OpenRefusal),
    Offer(OfferRefusal),
    Result(DropReason),
    Fail(DropReason),
    /// The first decides although the second holds as well.
    Opens(OpenRefusal, OpenRefusal),
    Offers(OfferRefusal, OfferRefusal),
    Results(DropReason, DropReason),
    Fails(DropReason, DropReason),
    Edge(Edge),
}

/// The marks that were reached, each with how often.
#[derive(Default)]
pub(super) struct Coverage(BTreeMap<Mark, u64>);

/// One kind of marks: how many were reached, of how many, and which were not.
pub(super) struct Share {
    pub(super) kind: &'static str,
    pub(super) reached: usize,
    pub(super) all: usize,
    pub(super) missing: Vec<String>,
}

impl Coverage {
    /// Notes what a run comes to.
    pub(super) fn watch(&mut self, run: &Run) {
        self.edges(Edge::of_run(run));
        let mut scene = Scene::new(&run.header);
        for input in &run.inputs {
            self.edges(Edge::of_input(&scene, input));
            let gate: Vec<_> = Edge::of_gate(&scene, input).collect();
            let step = scene.apply(input);
            self.edges(Edge::of_step(&scene, input, &step));
            let own = step.own.first().map(|(decision, _)| *decision);
            if let Some(
                Decision::Request { .. } | Decision::RefuseOffer { why: OfferRefusal::Queue, .. },
            ) = own
            {
                self.edges(gate.into_iter());
            }
            self.rules(input, &step);
            self.reasons(&step.reasons);
        }
    }

    /// How much of each kind was reached.
    pub(super) fn shares(&self) -> Vec<Share> {
        let share = |(kind, marks): (&'static str, Vec<Mark>)| {
            let missed = marks.iter().filter(|mark| !self.0.contains_key(mark));
            let missing: Vec<_> = missed.map(|mark| mark.name()).collect();
            Share { kind, reached: marks.len() - missing.len(), all: marks.len(), missing }
        };
        kinds().into_iter().map(share).collect()
    }

    /// Every mark with how often it was reached.
    pub(super) fn counts(&self) -> Map<String, Value> {
        let all = kinds().into_iter().flat_map(|(_, marks)| marks);
        all.map(|mark| (mark.name(), self.0.get(&mark).copied().unwrap_or(0).into())).collect()
    }

    fn mark(&mut self, mark: Mark) {
        *self.0.entry(mark).or_default() += 1;
    }

    fn edges(&mut self, edges: impl Iterator<Item = Edge>) {
        for edge in edges {
            self.mark(Mark::Edge(edge));
        }
    }

    /// Notes the rules that an input shows.
    fn rules(&mut self, input: &Input, step: &Step) {
        if matches!(input, Input::Fail { .. }) {
            self.mark(Mark::Rule(Rule::F4));
        }
        for (decision, rule) in step.fired.iter().chain(&step.own) {
            self.mark(Mark::Rule(*rule));
            if decision.at() != input.at() {
                self.mark(Mark::Rule(Rule::F0));
            }
            // P1 shows where something comes for what was forwarded or missed.
            if let Decision::Drop { why: DropReason::Superseded, .. } = decision {
                self.mark(Mark::Rule(Rule::P1));
            }
        }
    }

    /// Notes the reason that decides, and each that holds as well.
    fn reasons(&mut self, reasons: &Reasons) {
        match reasons {
            Reasons::None => {}
            Reasons::Open(all) => self.first(all, Mark::Open, Mark::Opens),
            Reasons::Offer(all) => self.first(all, Mark::Offer, Mark::Offers),
            Reasons::Result(all) => self.first(all, Mark::Result, Mark::Results),
            Reasons::Fail(all) => self.first(all, Mark::Fail, Mark::Fails),
        }
    }

    fn first<T: Copy>(&mut self, all: &[T], one: fn(T) -> Mark, two: fn(T, T) -> Mark) {
        let Some((first, more)) = all.split_first() else { return };
        self.mark(one(*first));
        for second in more {
            self.mark(two(*first, *second));
        }
    }
}

impl Mark {
    fn name(self) -> String {
        match self {
            Self::Rule(rule) => rule.to_string(),
            Self::Open(why) => format!("open refused {why}"),
            Self::Offer(why) => format!("offer refused {why}"),
            Self::Result(why) => format!("result dropped {why}"),
            Self::Fail(why) => format!("failure dropped {why}"),
            Self::Opens(why, though) => format!("open refused {why} though {though}"),
            Self::Offers(why, though) => format!("offer refused {why} though {though}"),
            Self::Results(why, though) => format!("result dropped {why} though {though}"),
            Self::Fails(why, though) => format!("failure dropped {why} though {though}"),
            Self::Edge(edge) => {
                let named = Edge::ALL.iter().find(|(one, _)| *one == edge);
                named.map_or_else(String::new, |(_, name)| (*name).to_owned())
            }
        }
    }
}

/// All that can be reached, by kind.
fn kinds() -> [(&'static str, Vec<Mark>); 4] {
    use DropReason as Drop;
    let opens = OpenRefusal::ALL;
    let offers = OfferRefusal::ALL;
    // Who was not asked, or cannot be, has no result in hand.
    let drops = Drop::ALL;
    let can_be = |(first, second): &(Drop, Drop)| {
        !matches!(first, Drop::Unknown | Drop::Unsolicited) || *second != Drop::Duplicate
    };
    let mut reasons: Vec<_> = opens.map(Mark::Open).into();
    reasons.extend(offers.map(Mark::Offer));
    reasons.extend(drops.map(Mark::Result));
    reasons.extend(drops.map(Mark::Fail));
    let mut pairs: Vec<_> = ordered(&opens).map(|(a, b)| Mark::Opens(a, b)).collect();
    pairs.extend(ordered(&offers).map(|(a, b)| Mark::Offers(a, b)));
    pairs.extend(ordered(&drops).filter(can_be).map(|(a, b)| Mark::Results(a, b)));
    pairs.extend(ordered(&drops).filter(can_be).map(|(a, b)| Mark::Fails(a, b)));
    [
        ("rules", Rule::ALL.map(Mark::Rule).into()),
        ("reasons", reasons),
        ("pairs of reasons", pairs),
        ("edges", Edge::ALL.map(|(edge, _)| Mark::Edge(edge)).into()),
    ]
}

/// Each pair of these, the earlier one first.
fn ordered<T: Copy>(of: &[T]) -> impl Iterator<Item = (T, T)> {
    let after = |i: usize| of.iter().skip(i + 1);
    of.iter().enumerate().flat_map(move |(i, first)| after(i).map(|second| (*first, *second)))
}
