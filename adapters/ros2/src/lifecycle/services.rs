//! The five services of a managed node, and the topic on which it reports its transitions.

use std::time::SystemTime;

use fuseline_engine::nanos;
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinSet;
use tracing::{info, warn};

use super::messages::{
    AvailableStates, AvailableTransitions, ChangeStateRequest, ChangeStateResponse, CurrentState,
    EmptyRequest, TransitionEvent,
};
use super::{
    LifecycleRequest, LifecycleRequests, LifecycleState, STATES, TRANSITIONS, Transition,
    TransitionResult,
};
use crate::error::NodeError;
use crate::middleware::{Graph, MessagePublisher, REPORTS, TypeName};
use crate::names::NodeName;
use crate::service::{PendingRequest, Requests, ServiceReply};

/// Serves the node's lifecycle in `tasks`: it begins unconfigured. Requests to the node come by the
/// orders.
///
/// # Errors
/// ROS refuses a service or the topic.
pub(crate) fn serve(
    graph: &mut Graph,
    node: &NodeName,
    tasks: &mut JoinSet<()>,
) -> Result<LifecycleRequests, NodeError> {
    // Only one transition is under way at a time.
    let (message_publisher, reported) = mpsc::channel(1);
    let ty = |name| TypeName { package: "lifecycle_msgs", name };
    let services = LifecycleServices {
        change: graph.serve("change_state", ty("ChangeState"), tasks)?,
        state: graph.serve("get_state", ty("GetState"), tasks)?,
        states: graph.serve("get_available_states", ty("GetAvailableStates"), tasks)?,
        transitions: graph.serve(
            "get_available_transitions",
            ty("GetAvailableTransitions"),
            tasks,
        )?,
        graph: graph.serve("get_transition_graph", ty("GetAvailableTransitions"), tasks)?,
        events: graph.message_publisher(
            &format!("{}/transition_event", node.full()),
            ty("TransitionEvent"),
            REPORTS,
        )?,
    };
    tasks.spawn(services.run(message_publisher));
    Ok(LifecycleRequests { reported, is_active: false, last: None })
}

struct LifecycleServices {
    change: Requests<ChangeStateRequest, ChangeStateResponse>,
    state: Requests<EmptyRequest, CurrentState>,
    states: Requests<EmptyRequest, AvailableStates>,
    transitions: Requests<EmptyRequest, AvailableTransitions>,
    graph: Requests<EmptyRequest, AvailableTransitions>,
    events: MessagePublisher<TransitionEvent>,
}

/// A change of state that the node works on.
struct PendingTransition {
    reply: ServiceReply<ChangeStateResponse>,
    done: oneshot::Receiver<TransitionResult>,
}

impl LifecycleServices {
    async fn run(mut self, message_publisher: mpsc::Sender<LifecycleRequest>) {
        let mut state = LifecycleState::Unconfigured;
        let mut under_way: Option<PendingTransition> = None;
        let described = |transitions: Vec<Transition>| AvailableTransitions {
            available_transitions: transitions.into_iter().map(Into::into).collect(),
        };
        loop {
            tokio::select! {
                result = done(&mut under_way) => {
                    if let Some(PendingTransition { reply, .. }) = under_way.take() {
                        state = self.end(state, result);
                        reply.send(ChangeStateResponse { success: result == TransitionResult::Success });
                    }
                }
                Some(requested) = self.change.recv() => {
                    let begun = self.begin(&mut state, requested, &message_publisher);
                    under_way = begun.or(under_way);
                }
                Some(requested) = self.state.recv() => {
                    requested.answer(|_| CurrentState { current_state: state.into() });
                }
                Some(requested) = self.states.recv() => requested.answer(|_| AvailableStates {
                    available_states: STATES.map(|(state, _)| state.into()).to_vec(),
                }),
                Some(requested) = self.transitions.recv() => requested.answer(|_| described(state.transitions().collect())),
                Some(requested) = self.graph.recv() => requested.answer(|_| described(TRANSITIONS.to_vec())),
                else => break,
            }
        }
    }

    /// Begins a change of state, unless there is no such way from here.
    fn begin(
        &self,
        state: &mut LifecycleState,
        requested: PendingRequest<ChangeStateRequest, ChangeStateResponse>,
        message_publisher: &mpsc::Sender<LifecycleRequest>,
    ) -> Option<PendingTransition> {
        let PendingRequest { request: ChangeStateRequest { transition }, reply } = requested;
        let begun =
            state.requested(transition.id, &transition.label).and_then(|(transition, task)| {
                let (order, done) = LifecycleRequest::new(task);
                message_publisher.try_send(order).ok().map(|()| (transition, done))
            });
        let Some((transition, done)) = begun else {
            let (id, label) = (transition.id, transition.label);
            warn!(
                id,
                label,
                state = state.label(),
                "the node's state does not allow this transition"
            );
            reply.send(ChangeStateResponse { success: false });
            return None;
        };
        self.announce(transition);
        *state = transition.to;
        Some(PendingTransition { reply, done })
    }

    /// Ends the current transition, and returns the state in which it ends. After an error
    /// everything is closed, and the node starts again.
    fn end(&self, mut state: LifecycleState, result: TransitionResult) -> LifecycleState {
        let mut next = result;
        while let Some(transition) = state.ended(next) {
            self.announce(transition);
            state = transition.to;
            next = TransitionResult::Success;
        }
        state
    }

    fn announce(&self, transition: Transition) {
        info!(from = transition.from.label(), to = transition.to.label(), "{}", transition.label);
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        (self.events)(TransitionEvent { timestamp: nanos(now), transition: transition.into() });
    }
}

/// Waits for the outcome of the current transition; never ends if there is none.
async fn done(under_way: &mut Option<PendingTransition>) -> TransitionResult {
    match under_way {
        // The node ended without an answer.
        Some(under_way) => (&mut under_way.done).await.unwrap_or(TransitionResult::Error),
        None => std::future::pending().await,
    }
}
