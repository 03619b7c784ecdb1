//! A state of the model, and the step to the next state.

use std::fmt;
use std::hash::{Hash, Hasher};
use std::sync::OnceLock;

use fuseline_core::{Instant, Priority, Timestamp};
use fuseline_testkit::{History, Ledger, admissions_and_ends};
use fuseline_traces::{Commit, Decision, ExpectedDecisions, Input, Reference, Rule};

use crate::claim::{Claim, Claims};
use crate::machine::{InputResponse, ModelMachine, WholeAnswer, answer, machine};
use crate::sighting::Sightings;
use crate::world::World;

/// The shipped machine, with companions that show whether it is right.
///
/// Everything except the twin identifies a state. If the twin differed from the machine, P10 would
/// be broken and the state would be a last one. The reference machine is part of the identity,
/// because a faulty machine may confuse two histories, and the search would then see only the first
/// of them.
#[derive(Clone)]
pub struct State {
    pub(crate) machine: ModelMachine,
    /// A machine with its clouds in reverse order, which is ticked at every instant in between
    /// (P10).
    twin: ModelMachine,
    /// Under progressive, a machine with the patient rule that takes the same inputs (P13).
    patient: Option<ModelMachine>,
    /// The reference machine, until the two disagree.
    reference: Option<Reference>,
    pub(crate) ledger: Ledger,
    violated: Claims,
    /// The sightings of the steps from here, once they are computed.
    ahead: OnceLock<Sightings>,
}

impl State {
    /// Returns the state of a new operator, or `None` if the machine refuses the configuration.
    #[must_use]
    pub fn new(config: &World) -> Option<Self> {
        let mut header = config.header();
        let reference = Some(Reference::new(&header));
        let first = machine(&header)?;
        header.clouds.reverse();
        let twin = machine(&header)?;
        header.commit = Commit::Patient;
        let patient = (config.commit == Commit::Progressive).then(|| machine(&header)).flatten();
        let (ledger, violated, ahead) = Default::default();
        Some(Self { machine: first, twin, patient, reference, ledger, violated, ahead })
    }

    /// Returns the claims that the step to this state, or an earlier one, broke.
    #[must_use]
    pub const fn violated(&self) -> Claims {
        self.violated
    }

    /// Returns `true` if further steps mean something. They do if nothing is broken except
    /// agreement with the reference machine, which the promises do not need.
    #[must_use]
    pub fn goes_on(&self) -> bool {
        self.violated.iter().all(Claim::is_of_reference)
    }

    /// Returns the state after an input, and the machine's response to it.
    #[must_use]
    pub fn step(&self, config: &World, input: &Input) -> (Self, InputResponse) {
        let mut next = Self { ahead: OnceLock::new(), ..self.clone() };
        let most = self.ledger.timer_count();
        let answer = answer(&mut next.machine, input, most);
        next.violated.insert_if(Claim::F8, answer.end == WholeAnswer::Panicked);
        next.violated.insert_if(Claim::P9, answer.end == WholeAnswer::Endless);
        if answer.end == WholeAnswer::Whole {
            next.enter(config, input, &answer);
            next.compare(config, input, &answer);
            let same = next.mirror(config, input, &answer, self.ledger.now(), most);
            next.violated.insert_if(Claim::P10, !same);
            let same = next.is_as_patient(input, &answer);
            next.violated.insert_if(Claim::P13, !same);
        }
        (next, answer)
    }

    pub(crate) fn ahead(&self, look: impl FnOnce() -> Sightings) -> Sightings {
        *self.ahead.get_or_init(look)
    }

    /// Enters the input into the ledger of promises, and compares the machine with the ledger.
    fn enter(&mut self, config: &World, input: &Input, answer: &InputResponse) {
        let fired = answer.fired.iter().flat_map(|fired| &fired.decisions);
        let next_due = self.machine.next_due();
        let violations = self.ledger.enter(config.terms(), input, fired, &answer.own, next_due);
        self.violated.extend(violations.into_iter().map(|violation| violation.promise.into()));
        self.violated
            .insert_if(Claim::P9, self.machine.fusion().len() > usize::from(config.window));
        let open = self.ledger.open();
        let has_timers = open.iter().all(|(t, history)| self.has_timers_of(config, *t, history));
        self.violated.insert_if(Claim::P8, !has_timers);
    }

    /// Returns `true` if the machine has exactly the timers for an open timestamp that it owes
    /// (P8).
    fn has_timers_of(&self, config: &World, t: u64, history: &History) -> bool {
        let mut sources = config.clouds.iter().map(|cloud| cloud.p).chain([0]);
        sources.all(|p| {
            let due = self.machine.fusion().due(Timestamp::new(t), Priority::new(p));
            due.map(Instant::as_nanos) == history.due(p.into())
        })
    }

    /// Gives the input to the reference machine, and drops it if the two disagree.
    fn compare(&mut self, config: &World, input: &Input, answer: &InputResponse) {
        let Some(reference) = &mut self.reference else { return };
        let mut demands = ExpectedDecisions::new();
        reference.apply(input, &mut demands);
        let now = reference.now() == self.machine.now();
        let alike = reference.next_due() == self.machine.next_due()
            && config.timestamps.iter().all(|t| {
                let slot = self.machine.fusion().slot(Timestamp::new(*t));
                reference.is_open(*t) == slot.is_some()
            });
        let claim = difference(input, answer, &demands)
            .or_else(|| (!now).then_some(Claim::F0))
            .or_else(|| (!alike).then(|| of_input(input)));
        if let Some(claim) = claim {
            self.violated.insert(claim);
            self.reference = None;
        }
    }

    /// Gives the input to the twin, after ticks at every instant in between. Returns `true` if the
    /// twin does the same as the machine.
    fn mirror(
        &mut self,
        config: &World,
        input: &Input,
        answer_of_machine: &InputResponse,
        from: u64,
        most: usize,
    ) -> bool {
        let mut decisions = Vec::new();
        let between = config.clock.iter().filter(|at| from < **at && **at <= input.at());
        // At every second tick, the clock goes back.
        let ticks = between.flat_map(|at| [Input::Tick { at: *at }, Input::Tick { at: 0 }]);
        for input in ticks.chain([*input]) {
            let answer = answer(&mut self.twin, &input, most);
            if answer.end != WholeAnswer::Whole {
                return false;
            }
            decisions.extend(answer.decisions().map(|decision| decision.redated(0)));
        }
        let of_machine = answer_of_machine.decisions().map(|decision| decision.redated(0));
        of_machine.eq(decisions) && self.twin == self.machine
    }

    /// Gives the input to the patient machine. Returns `true` if it admits, refuses and ends as the
    /// machine does (P13).
    fn is_as_patient(&mut self, input: &Input, answer_of_machine: &InputResponse) -> bool {
        let Some(patient) = &mut self.patient else { return true };
        let answer = answer(patient, input, usize::MAX);
        let open =
            |machine: &ModelMachine| machine.fusion().open().map(|(t, _)| t).collect::<Vec<_>>();
        admissions_and_ends(Commit::Patient, answer.decisions())
            == admissions_and_ends(Commit::Progressive, answer_of_machine.decisions())
            && open(patient) == open(&self.machine)
    }
}

/// Returns the rule of the first decision that differs, if one does.
fn difference(input: &Input, answer: &InputResponse, demands: &ExpectedDecisions) -> Option<Claim> {
    let decisions: Vec<&Decision> = answer.decisions().collect();
    let of_firings = decisions.len() - answer.own.len();
    let demanded = |index: usize| demands.get(index).map(|(decision, _)| decision);
    let places = 0..decisions.len().max(demands.len());
    let index =
        places.into_iter().find(|index| decisions.get(*index).copied() != demanded(*index))?;
    Some(match (decisions.get(index), demands.get(index)) {
        (Some(found), Some((decision, _))) if found.redated(0) == decision.redated(0) => Claim::F0,
        // A firing's decision that nothing demands stands where the input's own decision should.
        (Some(found), Some((_, rule)))
            if index < of_firings && !matches!(rule, Rule::F5 | Rule::F6 | Rule::F7 | Rule::F9) =>
        {
            of_decision(found, input)
        }
        (_, Some((_, rule))) => Claim::from(*rule),
        (Some(found), None) => of_decision(found, input),
        (None, None) => of_input(input),
    })
}

/// Returns the rule of a decision that no rule demands.
fn of_decision(decision: &Decision, input: &Input) -> Claim {
    match decision {
        Decision::Timer { .. } => Claim::F5,
        Decision::Emit { .. } | Decision::Miss { .. } => Claim::F6,
        Decision::Cancel { .. } => Claim::F7,
        Decision::Final { .. } => Claim::F9,
        Decision::RefuseOpen { .. }
        | Decision::RefuseOffer { .. }
        | Decision::Request { .. }
        | Decision::Hold { .. }
        | Decision::Drop { .. } => of_input(input),
    }
}

/// Returns the rule about inputs of this kind.
fn of_input(input: &Input) -> Claim {
    match input {
        Input::Open { .. } => Claim::F1,
        Input::Offer { .. } => Claim::F2,
        Input::Result { .. } => Claim::F3,
        Input::Fail { .. } => Claim::F4,
        Input::Tick { .. } => Claim::F5,
    }
}

impl PartialEq for State {
    fn eq(&self, other: &Self) -> bool {
        self.machine == other.machine
            && self.patient == other.patient
            && self.reference == other.reference
            && self.ledger == other.ledger
            && self.violated == other.violated
    }
}

impl Eq for State {}

impl Hash for State {
    fn hash<H: Hasher>(&self, hasher: &mut H) {
        (&self.machine, &self.patient, &self.reference, &self.ledger, self.violated).hash(hasher);
    }
}

impl fmt::Debug for State {
    /// Writes the machine's state, one line for each open timestamp, and the claims that are
    /// broken.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "now {}", self.machine.now())?;
        match self.machine.fusion().newest() {
            Some(newest) => write!(f, ", newest {}", newest.as_u64())?,
            None => f.write_str(", nothing opened")?,
        }
        for source in self.machine.fusion().clouds().iter() {
            let p = self.machine.fusion().priority(source);
            if self.machine.fusion().gate(p).is_some_and(|gate| gate.is_shut()) {
                write!(f, ", gate {} shut", p.as_u16())?;
            }
        }
        for (t, slot) in self.machine.fusion().open() {
            write!(f, "\nt {}:", t.as_u64())?;
            let sets = [
                ("pending", slot.pending()),
                ("held", slot.cached()),
                ("closed", slot.requested().difference(slot.pending().union(slot.cached()))),
            ];
            for (name, set) in sets.into_iter().filter(|(_, set)| !set.is_empty()) {
                write!(f, " {name}")?;
                for source in set.iter() {
                    let p = self.machine.fusion().priority(source);
                    write!(f, " {}", p.as_u16())?;
                    if let Some(due) = self.machine.fusion().due(t, p) {
                        write!(f, " (due {})", due.as_nanos())?;
                    }
                }
            }
        }
        for claim in self.violated.iter() {
            write!(f, "\nviolated: {}", claim.name())?;
        }
        Ok(())
    }
}
