//! The messages of `lifecycle_msgs`, as they are serialized.

use ros2_client::Message;
use serde::{Deserialize, Serialize};

/// `msg/State`.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct StateMessage {
    pub(super) id: u8,
    pub(super) label: String,
}

/// `msg/Transition`.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct TransitionMessage {
    pub(super) id: u8,
    pub(super) label: String,
}

/// `msg/TransitionDescription`.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct TransitionDescription {
    transition: TransitionMessage,
    start_state: StateMessage,
    goal_state: StateMessage,
}

/// `msg/TransitionEvent`.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct TransitionEvent {
    /// Nanoseconds of the time of day.
    pub(super) timestamp: u64,
    pub(super) transition: TransitionDescription,
}

/// `srv/ChangeState_Request`.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct ChangeStateRequest {
    pub(super) transition: TransitionMessage,
}

/// `srv/ChangeState_Response`.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct ChangeStateResponse {
    pub(super) success: bool,
}

/// A request without content: ROS sends one byte.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct EmptyRequest {
    structure_needs_at_least_one_member: u8,
}

/// `srv/GetState_Response`.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct CurrentState {
    pub(super) current_state: StateMessage,
}

/// `srv/GetAvailableStates_Response`.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct AvailableStates {
    pub(super) available_states: Vec<StateMessage>,
}

/// `srv/GetAvailableTransitions_Response`.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct AvailableTransitions {
    pub(super) available_transitions: Vec<TransitionDescription>,
}

impl Message for ChangeStateRequest {}
impl Message for ChangeStateResponse {}
impl Message for EmptyRequest {}
impl Message for CurrentState {}
impl Message for AvailableStates {}
impl Message for AvailableTransitions {}

impl From<super::LifecycleState> for StateMessage {
    fn from(state: super::LifecycleState) -> Self {
        Self { id: state as u8, label: state.label().to_owned() }
    }
}

impl From<super::Transition> for TransitionDescription {
    fn from(transition: super::Transition) -> Self {
        Self {
            transition: TransitionMessage { id: transition.id, label: transition.label.to_owned() },
            start_state: transition.from.into(),
            goal_state: transition.to.into(),
        }
    }
}
