//! The five services of a managed node, and the topic on which it tells of its transitions.

use std::time::SystemTime;

use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinSet;
use tracing::{info, warn};

use super::messages::{
    AvailableStates, AvailableTransitions, ChangeState, Changed, CurrentState, Nothing,
    TransitionEvent,
};
use super::{Done, Order, Orders, STATES, State, TRANSITIONS, Transition};
use crate::error::NodeError;
use crate::home::{Home, TOLD, Teller, TypeName};
use crate::names::NodeName;
use crate::service::{Asked, Reply, Requests};

/// Serves the node's lifecycle in `tasks`: it begins unconfigured. What the node is told comes by the orders.
///
/// # Errors
/// ROS refuses a service or the topic.
pub(crate) fn serve(
    home: &mut Home,
    node: &NodeName,
    tasks: &mut JoinSet<()>,
) -> Result<Orders, NodeError> {
    // One at a time is under way.
    let (teller, told) = mpsc::channel(1);
    let ty = |name| TypeName { package: "lifecycle_msgs", name };
    let services = Services {
        change: home.serve("change_state", ty("ChangeState"), tasks)?,
        state: home.serve("get_state", ty("GetState"), tasks)?,
        states: home.serve("get_available_states", ty("GetAvailableStates"), tasks)?,
        ways: home.serve("get_available_transitions", ty("GetAvailableTransitions"), tasks)?,
        graph: home.serve("get_transition_graph", ty("GetAvailableTransitions"), tasks)?,
        events: home.teller(
            &format!("{}/transition_event", node.full()),
            ty("TransitionEvent"),
            TOLD,
        )?,
    };
    tasks.spawn(services.run(teller));
    Ok(Orders { told, is_active: false, last: None })
}

struct Services {
    change: Requests<ChangeState, Changed>,
    state: Requests<Nothing, CurrentState>,
    states: Requests<Nothing, AvailableStates>,
    ways: Requests<Nothing, AvailableTransitions>,
    graph: Requests<Nothing, AvailableTransitions>,
    events: Teller<TransitionEvent>,
}

/// A change of state that the node works on.
struct UnderWay {
    reply: Reply<Changed>,
    done: oneshot::Receiver<Done>,
}

impl Services {
    async fn run(mut self, teller: mpsc::Sender<Order>) {
        let mut state = State::Unconfigured;
        let mut under_way: Option<UnderWay> = None;
        let described = |ways: Vec<Transition>| AvailableTransitions {
            available_transitions: ways.into_iter().map(Into::into).collect(),
        };
        loop {
            tokio::select! {
                how = done(&mut under_way) => {
                    if let Some(UnderWay { reply, .. }) = under_way.take() {
                        state = self.end(state, how);
                        reply.send(Changed { success: how == Done::Success });
                    }
                }
                Some(asked) = self.change.recv() => {
                    let begun = self.begin(&mut state, asked, &teller);
                    under_way = begun.or(under_way);
                }
                Some(asked) = self.state.recv() => {
                    asked.answer(|_| CurrentState { current_state: state.into() });
                }
                Some(asked) = self.states.recv() => asked.answer(|_| AvailableStates {
                    available_states: STATES.map(Into::into).to_vec(),
                }),
                Some(asked) = self.ways.recv() => asked.answer(|_| described(state.ways().collect())),
                Some(asked) = self.graph.recv() => asked.answer(|_| described(TRANSITIONS.to_vec())),
                else => break,
            }
        }
    }

    /// Begins a change of state, unless there is no such way from here.
    fn begin(
        &self,
        state: &mut State,
        asked: Asked<ChangeState, Changed>,
        teller: &mpsc::Sender<Order>,
    ) -> Option<UnderWay> {
        let Asked { request: ChangeState { transition }, reply } = asked;
        let begun = state.asked(transition.id, &transition.label).and_then(|(way, task)| {
            let (order, done) = Order::new(task);
            teller.try_send(order).ok().map(|()| (way, done))
        });
        let Some((way, done)) = begun else {
            let (id, label) = (transition.id, transition.label);
            warn!(id, label, state = state.label(), "there is no such transition from here");
            reply.send(Changed { success: false });
            return None;
        };
        self.goes(way);
        *state = way.to;
        Some(UnderWay { reply, done })
    }

    /// Where what is under way ends. After an error everything is closed, and the node begins anew.
    fn end(&self, mut state: State, how: Done) -> State {
        let mut next = how;
        while let Some(way) = state.ended(next) {
            self.goes(way);
            state = way.to;
            next = Done::Success;
        }
        state
    }

    fn goes(&self, way: Transition) {
        info!(from = way.from.label(), to = way.to.label(), "{}", way.label);
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let timestamp = u64::try_from(now.as_nanos()).unwrap_or(u64::MAX);
        (self.events)(TransitionEvent { timestamp, transition: way.into() });
    }
}

/// How what is under way went; never, if nothing is.
async fn done(under_way: &mut Option<UnderWay>) -> Done {
    match under_way {
        // The node ended without a word.
        Some(under_way) => (&mut under_way.done).await.unwrap_or(Done::Error),
        None => std::future::pending().await,
    }
}
