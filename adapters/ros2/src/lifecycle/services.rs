//! The five services of a managed node, and the topic on which it tells of its transitions.

use std::time::SystemTime;

use futures_util::StreamExt;
use ros2_client::qos::WhenFull;
use ros2_client::service::{RmwRequestId, Server};
use ros2_client::{
    Message, MessageTypeName, Name, Node, Publisher, QosProfile, ReadError, ServiceMapping,
    ServiceTypeName,
};
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinSet;
use tracing::{debug, info, warn};

use super::messages::{
    AvailableStates, AvailableTransitions, ChangeState, Changed, CurrentState, Nothing,
    TransitionEvent,
};
use super::{Done, Order, Orders, STATES, State, TRANSITIONS, Transition};
use crate::error::NodeError;
use crate::names::NodeName;

/// Serves the node's lifecycle in `tasks`: it begins unconfigured. What the node is told comes by the orders.
///
/// # Errors
/// ROS refuses a service or the topic.
pub(crate) fn serve(
    ros: &mut Node,
    name: &NodeName,
    tasks: &mut JoinSet<()>,
) -> Result<Orders, NodeError> {
    // One at a time is under way.
    let (teller, told) = mpsc::channel(1);
    let services = Services {
        change: server(ros, name, "change_state", "ChangeState")?,
        state: server(ros, name, "get_state", "GetState")?,
        states: server(ros, name, "get_available_states", "GetAvailableStates")?,
        ways: server(ros, name, "get_available_transitions", "GetAvailableTransitions")?,
        graph: server(ros, name, "get_transition_graph", "GetAvailableTransitions")?,
        events: events(ros, name)?,
    };
    tasks.spawn(services.run(teller));
    Ok(Orders { told, is_active: false, last: None })
}

struct Services {
    change: Server<ChangeState, Changed>,
    state: Server<Nothing, CurrentState>,
    states: Server<Nothing, AvailableStates>,
    ways: Server<Nothing, AvailableTransitions>,
    graph: Server<Nothing, AvailableTransitions>,
    events: Publisher<TransitionEvent>,
}

/// A change of state that the node works on.
struct UnderWay {
    request: RmwRequestId,
    done: oneshot::Receiver<Done>,
}

impl Services {
    async fn run(self, teller: mpsc::Sender<Order>) {
        let mut state = State::Unconfigured;
        let mut under_way: Option<UnderWay> = None;
        let mut changes = self.change.receive_request_stream();
        let mut states = self.state.receive_request_stream();
        let mut all_states = self.states.receive_request_stream();
        let mut ways = self.ways.receive_request_stream();
        let mut graph = self.graph.receive_request_stream();
        let described = |ways: Vec<Transition>| AvailableTransitions {
            available_transitions: ways.into_iter().map(Into::into).collect(),
        };
        loop {
            tokio::select! {
                how = done(&mut under_way) => {
                    if let Some(UnderWay { request, .. }) = under_way.take() {
                        state = self.end(state, how);
                        let success = how == Done::Success;
                        reply(&self.change, Ok((request, ())), |()| Changed { success });
                    }
                }
                Some(asked) = changes.next() => {
                    let begun = self.begin(&mut state, asked, &teller);
                    under_way = begun.or(under_way);
                }
                Some(asked) = states.next() => {
                    reply(&self.state, asked, |_| CurrentState { current_state: state.into() });
                }
                Some(asked) = all_states.next() => {
                    let available_states = STATES.map(Into::into).to_vec();
                    reply(&self.states, asked, |_| AvailableStates { available_states });
                }
                Some(asked) = ways.next() => {
                    reply(&self.ways, asked, |_| described(state.ways().collect()));
                }
                Some(asked) = graph.next() => {
                    reply(&self.graph, asked, |_| described(TRANSITIONS.to_vec()));
                }
            }
        }
    }

    /// Begins a change of state, unless there is no such way from here.
    fn begin(
        &self,
        state: &mut State,
        asked: Result<(RmwRequestId, ChangeState), ReadError>,
        teller: &mpsc::Sender<Order>,
    ) -> Option<UnderWay> {
        let (request, ChangeState { transition }) = known(asked)?;
        let begun = state.asked(transition.id, &transition.label).and_then(|(way, task)| {
            let (order, done) = Order::new(task);
            teller.try_send(order).ok().map(|()| (way, done))
        });
        let Some((way, done)) = begun else {
            let (id, label) = (transition.id, transition.label);
            warn!(id, label, state = state.label(), "there is no such transition from here");
            reply(&self.change, Ok((request, ())), |()| Changed { success: false });
            return None;
        };
        self.goes(way);
        *state = way.to;
        Some(UnderWay { request, done })
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
        if let Err(error) =
            self.events.publish(TransitionEvent { timestamp, transition: way.into() })
        {
            debug!(?error, "transition not told");
        }
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

fn known<T>(asked: Result<T, ReadError>) -> Option<T> {
    asked.inspect_err(|error| debug!(%error, "a request of the lifecycle that cannot be read")).ok()
}

fn reply<Q, T, R>(
    server: &Server<Q, R>,
    asked: Result<(RmwRequestId, T), ReadError>,
    answer: impl FnOnce(T) -> R,
) where
    Q: Message + Clone + 'static,
    R: Message + 'static,
{
    let Some((request, asked)) = known(asked) else { return };
    if let Err(error) = server.send_response(request, answer(asked)) {
        debug!(?error, "answer of the lifecycle not sent");
    }
}

fn server<Q, R>(
    ros: &mut Node,
    node: &NodeName,
    service: &str,
    ty: &str,
) -> Result<Server<Q, R>, NodeError>
where
    Q: Message + Clone + 'static,
    R: Message + 'static,
{
    let wrong = |error: &dyn std::fmt::Display| NodeError::Ros(format!("{service}: {error}"));
    let name = Name::new(&node.full(), service).map_err(|error| wrong(&error))?;
    let ty = ServiceTypeName::new("lifecycle_msgs", ty);
    let qos = QosProfile::publisher_default().reliability_reliable(WhenFull::Fail);
    // The mapping of the node's other services.
    ros.create_server(ServiceMapping::Enhanced, &name, &ty, qos.clone(), qos)
        .map_err(|error| wrong(&error))
}

fn events(ros: &mut Node, node: &NodeName) -> Result<Publisher<TransitionEvent>, NodeError> {
    let wrong =
        |error: &dyn std::fmt::Display| NodeError::Ros(format!("transition_event: {error}"));
    let name = Name::new(&node.full(), "transition_event").map_err(|error| wrong(&error))?;
    let qos = QosProfile::publisher_default().reliability_reliable(WhenFull::Fail);
    let ty = MessageTypeName::new("lifecycle_msgs", "TransitionEvent");
    let topic = ros.create_topic(&name, ty, &qos).map_err(|error| wrong(&error))?;
    ros.create_publisher(&topic, Some(qos)).map_err(|error| wrong(&error))
}
