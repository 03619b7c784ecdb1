//! A managed node: its states and transitions as ROS 2 defines them, with the numbers and labels of
//! `lifecycle_msgs`.

mod messages;
mod services;

use tokio::sync::{mpsc, oneshot};

pub(crate) use services::serve;

/// The state of a managed node: at rest, or from 10 on in transition.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum LifecycleState {
    /// No node is; ROS lists it.
    Unknown = 0,
    Unconfigured = 1,
    Inactive = 2,
    Active = 3,
    Finalized = 4,
    Configuring = 10,
    CleaningUp = 11,
    ShuttingDown = 12,
    Activating = 13,
    Deactivating = 14,
    ErrorProcessing = 15,
}

use LifecycleState::{
    Activating, Active, CleaningUp, Configuring, Deactivating, ErrorProcessing, Finalized,
    Inactive, ShuttingDown, Unconfigured, Unknown,
};

/// A way from one state to another.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Transition {
    pub(crate) id: u8,
    pub(crate) label: &'static str,
    pub(crate) from: LifecycleState,
    pub(crate) to: LifecycleState,
}

/// All states with their labels, in the order of their numbers.
pub(crate) const STATES: [(LifecycleState, &str); 11] = [
    (Unknown, "unknown"),
    (Unconfigured, "unconfigured"),
    (Inactive, "inactive"),
    (Active, "active"),
    (Finalized, "finalized"),
    (Configuring, "configuring"),
    (CleaningUp, "cleaningup"),
    (ShuttingDown, "shuttingdown"),
    (Activating, "activating"),
    (Deactivating, "deactivating"),
    (ErrorProcessing, "errorprocessing"),
];

const SUCCESS: &str = "transition_success";
const FAILURE: &str = "transition_failure";
const ERROR: &str = "transition_error";

/// All transitions: those that may be requested, then those by which they end.
pub(crate) const TRANSITIONS: [Transition; 25] = [
    transition(1, "configure", Unconfigured, Configuring),
    transition(2, "cleanup", Inactive, CleaningUp),
    transition(3, "activate", Inactive, Activating),
    transition(4, "deactivate", Active, Deactivating),
    transition(5, "shutdown", Unconfigured, ShuttingDown),
    transition(6, "shutdown", Inactive, ShuttingDown),
    transition(7, "shutdown", Active, ShuttingDown),
    transition(10, SUCCESS, Configuring, Inactive),
    transition(11, FAILURE, Configuring, Unconfigured),
    transition(12, ERROR, Configuring, ErrorProcessing),
    transition(20, SUCCESS, CleaningUp, Unconfigured),
    transition(21, FAILURE, CleaningUp, Inactive),
    transition(22, ERROR, CleaningUp, ErrorProcessing),
    transition(30, SUCCESS, Activating, Active),
    transition(31, FAILURE, Activating, Inactive),
    transition(32, ERROR, Activating, ErrorProcessing),
    transition(40, SUCCESS, Deactivating, Inactive),
    transition(41, FAILURE, Deactivating, Active),
    transition(42, ERROR, Deactivating, ErrorProcessing),
    transition(50, SUCCESS, ShuttingDown, Finalized),
    transition(51, FAILURE, ShuttingDown, Finalized),
    transition(52, ERROR, ShuttingDown, ErrorProcessing),
    transition(60, SUCCESS, ErrorProcessing, Unconfigured),
    transition(61, FAILURE, ErrorProcessing, Finalized),
    transition(62, ERROR, ErrorProcessing, Finalized),
];

/// The next task of a managed node.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum LifecycleTask {
    Configure,
    CleanUp,
    Activate,
    Deactivate,
    ShutDown,
}

/// The outcome of the task.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum TransitionResult {
    /// It succeeded.
    Success,
    /// It is as it was before.
    Failure,
    /// Something was lost on the way.
    Error,
}

/// A task, and where to say that it is done.
pub(crate) struct LifecycleRequest {
    pub(crate) task: LifecycleTask,
    done: oneshot::Sender<TransitionResult>,
}

/// The requests to a managed node's lifecycle.
pub(crate) struct LifecycleRequests {
    pub(crate) reported: mpsc::Receiver<LifecycleRequest>,
    /// `true` if messages are taken in.
    pub(crate) is_active: bool,
    /// The order to close what is open, once it came.
    pub(crate) last: Option<LifecycleRequest>,
}

impl LifecycleRequest {
    /// An order, and where it is said how it went.
    pub(crate) fn new(task: LifecycleTask) -> (Self, oneshot::Receiver<TransitionResult>) {
        let (done, received) = oneshot::channel();
        (Self { task, done }, received)
    }

    pub(crate) fn done(self, result: TransitionResult) {
        // Nobody waits for it if the node ends.
        let _ = self.done.send(result);
    }
}

impl LifecycleRequests {
    /// Does what needs nothing but this; whether the node is to close what is open.
    pub(crate) fn obey(&mut self, order: LifecycleRequest) -> bool {
        match order.task {
            LifecycleTask::Activate | LifecycleTask::Deactivate => {
                self.is_active = order.task == LifecycleTask::Activate;
                order.done(TransitionResult::Success);
                false
            }
            LifecycleTask::CleanUp | LifecycleTask::ShutDown => {
                self.is_active = false;
                self.last = Some(order);
                true
            }
            // It is not requested twice of a managed node: `LifecycleState::requested`.
            LifecycleTask::Configure => {
                order.done(TransitionResult::Failure);
                false
            }
        }
    }
}

impl LifecycleState {
    pub(crate) fn label(self) -> &'static str {
        STATES.into_iter().find(|(state, _)| *state == self).map_or("", |(_, label)| label)
    }

    /// Returns the transitions from here.
    pub(crate) fn transitions(self) -> impl Iterator<Item = Transition> {
        TRANSITIONS.into_iter().filter(move |transition| transition.from == self)
    }

    /// Returns the requested transition and its task. The transition is found by its label if there
    /// is one, else by its number; `None` if it does not begin here.
    pub(crate) fn requested(self, id: u8, label: &str) -> Option<(Transition, LifecycleTask)> {
        let transition = self.transitions().find(|transition| {
            if label.is_empty() { transition.id == id } else { transition.label == label }
        })?;
        let task = match transition.to {
            Configuring => LifecycleTask::Configure,
            CleaningUp => LifecycleTask::CleanUp,
            Activating => LifecycleTask::Activate,
            Deactivating => LifecycleTask::Deactivate,
            ShuttingDown => LifecycleTask::ShutDown,
            Unknown | Unconfigured | Inactive | Active | Finalized | ErrorProcessing => {
                return None;
            }
        };
        Some((transition, task))
    }

    /// Returns the transition by which what is under way ends, if anything is.
    pub(crate) fn ended(self, result: TransitionResult) -> Option<Transition> {
        let label = match result {
            TransitionResult::Success => SUCCESS,
            TransitionResult::Failure => FAILURE,
            TransitionResult::Error => ERROR,
        };
        self.transitions().find(|transition| transition.label == label)
    }
}

const fn transition(
    id: u8,
    label: &'static str,
    from: LifecycleState,
    to: LifecycleState,
) -> Transition {
    Transition { id, label, from, to }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_state_that_rests_has_the_transitions_of_ros() {
        let transitions = |state: LifecycleState| {
            state.transitions().map(|transition| transition.label).collect::<Vec<_>>()
        };
        assert_eq!(transitions(Unconfigured), ["configure", "shutdown"]);
        assert_eq!(transitions(Inactive), ["cleanup", "activate", "shutdown"]);
        assert_eq!(transitions(Active), ["deactivate", "shutdown"]);
        assert_eq!(transitions(Finalized), [""; 0]);
    }

    #[test]
    fn a_task_leads_to_where_it_is_meant_to_lead() {
        let run_transition = |state: LifecycleState, id, label, result| {
            let (transition, task) = state.requested(id, label)?;
            assert_eq!(transition.from, state);
            Some((task, transition.to.ended(result)?.to))
        };
        assert_eq!(
            run_transition(Unconfigured, 1, "", TransitionResult::Success),
            Some((LifecycleTask::Configure, Inactive))
        );
        assert_eq!(
            run_transition(Unconfigured, 1, "", TransitionResult::Failure),
            Some((LifecycleTask::Configure, Unconfigured))
        );
        assert_eq!(
            run_transition(Inactive, 3, "", TransitionResult::Success),
            Some((LifecycleTask::Activate, Active))
        );
        assert_eq!(
            run_transition(Active, 4, "", TransitionResult::Success),
            Some((LifecycleTask::Deactivate, Inactive))
        );
        assert_eq!(
            run_transition(Inactive, 2, "", TransitionResult::Success),
            Some((LifecycleTask::CleanUp, Unconfigured))
        );
        assert_eq!(
            run_transition(Inactive, 2, "", TransitionResult::Error),
            Some((LifecycleTask::CleanUp, ErrorProcessing))
        );
        for (state, id) in [(Unconfigured, 5), (Inactive, 6), (Active, 7)] {
            assert_eq!(
                run_transition(state, id, "", TransitionResult::Success),
                Some((LifecycleTask::ShutDown, Finalized))
            );
            assert_eq!(
                run_transition(state, 0, "shutdown", TransitionResult::Success),
                Some((LifecycleTask::ShutDown, Finalized))
            );
        }
        assert_eq!(
            ErrorProcessing.ended(TransitionResult::Success).map(|transition| transition.to),
            Some(Unconfigured)
        );
    }

    #[test]
    fn what_does_not_begin_here_is_refused_and_so_is_the_end_of_something_under_way() {
        assert_eq!(Unconfigured.requested(3, ""), None);
        assert_eq!(Active.requested(1, "configure"), None);
        assert_eq!(Configuring.requested(10, ""), None);
        assert_eq!(Configuring.requested(0, SUCCESS), None);
        assert_eq!(
            Inactive.requested(3, "cleanup").map(|(_, task)| task),
            Some(LifecycleTask::CleanUp)
        );
        assert_eq!(Inactive.ended(TransitionResult::Success), None);
    }

    #[test]
    fn messages_are_taken_in_from_activation_until_deactivation_or_the_end() {
        let (_sender, reported) = mpsc::channel(1);
        let mut requests = LifecycleRequests { reported, is_active: false, last: None };
        for (task, is_active, closes, result) in [
            (LifecycleTask::Activate, true, false, Some(TransitionResult::Success)),
            (LifecycleTask::Configure, true, false, Some(TransitionResult::Failure)),
            (LifecycleTask::Deactivate, false, false, Some(TransitionResult::Success)),
            (LifecycleTask::Activate, true, false, Some(TransitionResult::Success)),
            // The task that closes the node reports the outcome.
            (LifecycleTask::CleanUp, false, true, None),
            (LifecycleTask::Activate, true, false, Some(TransitionResult::Success)),
            (LifecycleTask::ShutDown, false, true, None),
        ] {
            let (order, mut done) = LifecycleRequest::new(task);
            assert_eq!((requests.obey(order), requests.is_active), (closes, is_active), "{task:?}");
            assert_eq!(done.try_recv().ok(), result, "{task:?}");
            assert_eq!(requests.last.take().map(|order| order.task), closes.then_some(task));
        }
    }
}
