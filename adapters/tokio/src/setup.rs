//! [`Setup`]: what [`Operator::setup`](crate::Operator::setup) registers, such as clouds with their handlers and bounds.
//!
//! Registering starts nothing; [`spawn`](crate::spawn) does.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Duration;

use fuseline_deadline::Situation;
use fuseline_engine::{CloudConfig as Cloud, Counting, Hint, Item, StampedValue};
use tokio::time::Instant;
use tracing::error;

use crate::Error;
use crate::call::Call;
use crate::carried_state::CarriedState;
use crate::panics::reason;
use crate::pending_call::{self, BoxedRequest};
use crate::side::{SideCall, SideRegistration, SideRequest, SideResponse};

/// Registers an operator's clouds, up to 15, and what goes with them.
pub struct Setup<I, O> {
    pub(crate) clouds: Vec<Cloud>,
    /// Of the clouds, in their order.
    pub(crate) message_handlers: Vec<MessageHandler<I, O>>,
    pub(crate) situation: Option<SituationSource<I>>,
    pub(crate) sides: Vec<SideRegistration<I>>,
    pub(crate) hints: Option<HintHandler<O>>,
    pub(crate) substitutes: Option<SubstituteHandler<O>>,
    pub(crate) states: Vec<StateHandler<O>>,
}

/// A registered cloud's message handler.
pub(crate) struct CloudHandler<I, O> {
    pub(crate) priority: u16,
    pub(crate) name: String,
    pub(crate) message_handler: MessageHandler<I, O>,
}

/// Takes late results.
pub(crate) type HintHandler<O> = Box<dyn FnMut(Hint<O>) + Send>;
/// What is sent for a message without a result.
pub(crate) type SubstituteHandler<O> = Box<dyn FnMut(&Item<O>) -> Option<O> + Send>;
/// Takes over the state of a result that was sent for a message.
pub(crate) type StateHandler<O> = Box<dyn FnMut(u64, &O) + Send>;
/// Gives policies the vehicle's situation.
pub(crate) type SituationSource<I> = Box<dyn FnMut(&I, u64) -> Situation<'static> + Send>;
/// What to send, if anything, and how long the cloud may take.
pub(crate) type MessageHandler<I, O> =
    Box<dyn FnMut(&I, u64) -> Option<(BoxedRequest<O>, Duration)> + Send>;

impl<I, O: Send + 'static> Setup<I, O> {
    pub(crate) const fn new() -> Self {
        Self {
            clouds: Vec::new(),
            message_handlers: Vec::new(),
            situation: None,
            sides: Vec::new(),
            hints: None,
            substitutes: None,
            states: Vec::new(),
        }
    }

    /// Registers a cloud; set its name and bounds in the [`Cloud`] returned.
    ///
    /// - `handle` makes the call, in a task of its own, and must not block: it would hold up calls that share its thread, on a
    ///   runtime of one thread the operator. [`EncodeOnce`](crate::EncodeOnce) encodes in a thread first. Dropping its future must abort the call:
    ///   that happens when its timer fires or another result is forwarded (F5, F7). An error or a
    ///   panic is a failure (F4).
    /// - `message_handler` looks at each message that was taken on, in the operator's task, and may
    ///   keep state. It must not block either. `None` or a
    ///   panic makes no request to this cloud; the handler is called again with the next message.
    /// - `response_handler` turns the response into the output, in the call's task, when it
    ///   arrives, and must not block either. An error or a panic is a failure (F4). The result counts as arrived when the
    ///   handler is done.
    /// - `priority` is from 1 to 65535, different for each cloud; the greater wins.
    pub fn use_cloud<Req, Res, Fut>(
        &mut self,
        handle: impl Fn(Req, Call) -> Fut + Send + Sync + 'static,
        message_handler: impl FnMut(&I, u64) -> Option<(Req, Duration)> + Send + 'static,
        response_handler: impl Fn(Res) -> Result<O, Error> + Send + Sync + 'static,
        priority: u16,
    ) -> &mut Cloud
    where
        Req: Send + 'static,
        Res: Send + 'static,
        Fut: Future<Output = Result<Res, Error>> + Send + 'static,
    {
        let response_handler = move |response| response_handler(response).map(StampedValue::from);
        self.use_stamped_cloud(handle, message_handler, response_handler, priority)
    }

    /// The same for a cloud whose replies say of which message they are.
    ///
    /// `response_handler` reads that from the reply, as the field `of` of the output: never the timestamp of the call, which a
    /// mixed up reply does not know. A value of another message than [`Cloud::max_age`] allows is a failure (F4). Of a blend
    /// of values it is the oldest's. A reply may also say for which message it is meant, in the field `meant_for`: a value
    /// that is meant for another message is a failure too (D18).
    pub fn use_stamped_cloud<Req, Res, Fut>(
        &mut self,
        handle: impl Fn(Req, Call) -> Fut + Send + Sync + 'static,
        mut message_handler: impl FnMut(&I, u64) -> Option<(Req, Duration)> + Send + 'static,
        response_handler: impl Fn(Res) -> Result<StampedValue<O>, Error> + Send + Sync + 'static,
        priority: u16,
    ) -> &mut Cloud
    where
        Req: Send + 'static,
        Res: Send + 'static,
        Fut: Future<Output = Result<Res, Error>> + Send + 'static,
    {
        let handlers = Arc::new((handle, response_handler));
        let message_handler = move |message: &I, timestamp| {
            let (request, deadline) = message_handler(message, timestamp)?;
            let handlers = Arc::clone(&handlers);
            let make = move |call| async move { (handlers.1)((handlers.0)(request, call).await?) };
            Some((pending_call::request(make), deadline))
        };
        self.message_handlers.push(Box::new(message_handler));
        self.clouds.push(Cloud::new(priority));
        let last = self.clouds.len() - 1;
        &mut self.clouds[last]
    }

    /// Sets where the clouds' policies get the vehicle's situation from with each message taken in, above
    /// all its speed. Without it nothing is known, and the guard risks nothing.
    ///
    /// It is called in the operator's task and must not block. After a panic the situation is unknown.
    pub fn use_situation(
        &mut self,
        situation: impl FnMut(&I, u64) -> Situation<'static> + Send + 'static,
    ) -> &mut Self {
        self.situation = Some(Box::new(situation));
        self
    }

    /// Registers side requests: for what helps local with later messages and is no result of
    /// this one, such as a plan for what may happen.
    ///
    /// The machine does not know of them: no output waits for an answer, and no answer becomes
    /// an output. A request by [`use_cloud`](Self::use_cloud) holds local's result back until it
    /// is answered, fails or times out (F3).
    ///
    /// - `handle` makes the call as for a cloud, within the time left. When that is over, or
    ///   the operator ends, its future is dropped.
    /// - `message_handler` looks at each message that was taken on, after the clouds' handlers, and must
    ///   not block. `None` makes no call.
    /// - `response_handler` gets each answer that comes in time, in the call's task, and changes
    ///   [shared](crate::SharedState) state. `Ok` counts as answered, an error as failed.
    ///
    /// Requests are gated and bounded like a cloud's.
    pub fn use_side_request<Req, Res, Fut>(
        &mut self,
        handle: impl Fn(Req, Call) -> Fut + Send + Sync + 'static,
        mut message_handler: impl FnMut(&I, u64) -> Option<(Req, Duration)> + Send + 'static,
        response_handler: impl Fn(Res) -> Result<(), Error> + Send + Sync + 'static,
    ) -> &mut SideRequest
    where
        Req: Send + 'static,
        Res: Send + 'static,
        Fut: Future<Output = Result<Res, Error>> + Send + 'static,
    {
        let handlers = Arc::new((handle, response_handler));
        let message_handler = move |message: &I, timestamp| {
            let (request, deadline) = message_handler(message, timestamp)?;
            let handlers = Arc::clone(&handlers);
            let request: SideCall = Box::new(move |call| {
                Box::pin(async move {
                    let response = (handlers.0)(request, call).await?;
                    let answered: SideResponse = Box::new(move || (handlers.1)(response));
                    Ok(answered)
                })
            });
            Some((request, deadline))
        };
        let name = format!("side-{}", self.sides.len() + 1);
        let side = SideRequest { name, limit: 8, resume: 0, calls: 8 };
        let message_handler = Box::new(message_handler);
        self.sides.push(SideRegistration { side, message_handler });
        let last = self.sides.len() - 1;
        &mut self.sides[last].side
    }

    /// Hands on results that came too late for their messages, with their age, so that local can use
    /// them for later ones. A hint never becomes an output.
    ///
    /// These are results dropped as `late` or `superseded`, local's too, if their message is one of the
    /// last 1024. Aborted calls have no result: let clouds [linger](Cloud::linger).
    /// `take_hint` is called in the operator's task and must not block.
    pub fn on_late_result(&mut self, take_hint: impl FnMut(Hint<O>) + Send + 'static) -> &mut Self {
        self.hints = Some(Box::new(take_hint));
        self
    }

    /// Takes over the state of each result that is sent, local's or a cloud's, as `state_of` reads it from the output (E10).
    ///
    /// It is called in the operator's task and must not block. After a panic the state stays as it was.
    pub fn use_state<S: Clone + Send + 'static>(
        &mut self,
        state: &CarriedState<S>,
        mut state_of: impl FnMut(&O) -> S + Send + 'static,
    ) -> &mut Self {
        let state = state.clone();
        self.states.push(Box::new(move |t, output| state.sent(t, state_of(output))));
        self
    }

    /// Gives what is sent for a message that is missed or refused, such as the last plan or a safe stop (E4). The item is
    /// [marked](Item::substitute); its ending and the trace stay as they are.
    ///
    /// A message with an [end-to-end deadline](crate::Lineage::within) is then missed early enough to leave the
    /// [reserve](crate::Config::reserve) to the operators downstream. `substitute` gets the item, is called in the operator's
    /// task and must not block. `None` or a panic sends the item without a value.
    pub fn use_substitute(
        &mut self,
        substitute: impl FnMut(&Item<O>) -> Option<O> + Send + 'static,
    ) -> &mut Self {
        self.substitutes = Some(Box::new(substitute));
        self
    }
}

impl<I, O> CloudHandler<I, O> {
    /// What the message handler wants to send; nothing if it panics. `ended` is when the handler before it did, if nothing of the
    /// user's has run since, and then when this one does.
    pub(crate) fn request(
        &mut self,
        message: &I,
        timestamp: u64,
        counting: &Counting,
        ended: &mut Option<Instant>,
    ) -> Option<(BoxedRequest<O>, Duration)> {
        let begin = ended.unwrap_or_else(Instant::now);
        let wanted = catch_unwind(AssertUnwindSafe(|| (self.message_handler)(message, timestamp)));
        let end = *ended.insert(Instant::now());
        counting.check_handler_time(Some(self.priority), end.saturating_duration_since(begin));
        wanted.unwrap_or_else(|panic| {
            let why = reason(&*panic);
            error!(timestamp, cloud = %self.name, why, "the message handler panicked");
            counting.handler_failed(Some(self.priority));
            None
        })
    }
}
