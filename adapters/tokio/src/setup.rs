//! [`Setup`] holds what [`Operator::setup`](crate::Operator::setup) registers, such as clouds with
//! their handlers and bounds.
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

/// Registers an operator's clouds, up to 15, and its other handlers.
pub struct Setup<I, O> {
    pub(crate) clouds: Vec<Cloud>,
    /// The message handlers of the clouds, in the clouds' order.
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
/// Returns the value to send for a message without a result.
pub(crate) type SubstituteHandler<O> = Box<dyn FnMut(&Item<O>) -> Option<O> + Send>;
/// Takes over the state of a result that was sent for a message.
pub(crate) type StateHandler<O> = Box<dyn FnMut(u64, &O) + Send>;
/// Gives policies the vehicle's situation.
pub(crate) type SituationSource<I> = Box<dyn FnMut(&I, u64) -> Situation<'static> + Send>;
/// Returns the request to send, if any, and how long the cloud may take.
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

    /// Registers a cloud, and returns its [`Cloud`], in which you set its name and bounds.
    ///
    /// - `message_handler` gets each accepted message and its timestamp, in the operator's task. It
    ///   returns the request and its deadline, or `None` to send no request for this message. A
    ///   panic sends none either.
    /// - `handle` makes the call, in a task of its own. Dropping its future must abort the call,
    ///   because the operator drops it when the request is due or another result is forwarded (F5,
    ///   F7). An error or a panic is a failure (F4).
    /// - `response_handler` turns the response into the output, in the call's task. The result
    ///   counts as arrived when the handler returns. An error or a panic is a failure (F4).
    /// - `priority` is from 1 to 65535 and different for each cloud. The greater priority wins.
    ///
    /// No handler may block: it would delay the calls that share its thread, and on a runtime of
    /// one thread the operator. [`EncodeOnce`](crate::EncodeOnce) encodes requests in a thread.
    /// Section 3 of `SPEC.md` defines the rules F1 to F9.
    ///
    /// ```
    /// # use std::time::Duration;
    /// # use fuseline_tokio::{Call, Error, Setup};
    /// # struct Frame { pixels: Vec<u8> }
    /// # async fn detect(_pixels: Vec<u8>, _time_left: Duration) -> Result<Vec<String>, Error> { Ok(Vec::new()) }
    /// # fn setup(setup: &mut Setup<Frame, Vec<String>>) {
    /// // The call: it gets the request, and knows how much time is left.
    /// let handle = |pixels: Vec<u8>, call: Call| async move { detect(pixels, call.deadline).await };
    /// // The request for a message, and its deadline.
    /// let message_handler = |frame: &Frame, _timestamp| {
    ///     let is_dark = frame.pixels.iter().all(|pixel| *pixel < 8);
    ///     (!is_dark).then(|| (frame.pixels.clone(), Duration::from_millis(500)))
    /// };
    /// // The output from a response.
    /// let response_handler = |objects: Vec<String>| Ok(objects);
    /// let cloud = setup.use_cloud(handle, message_handler, response_handler, 1);
    /// cloud.name = "west".to_owned();
    /// # }
    /// ```
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

    /// Registers a cloud whose responses name the message that their value was computed from.
    /// Otherwise it works as [`use_cloud`](Self::use_cloud) does.
    ///
    /// `response_handler` reads the timestamp of that message from the response and returns it in
    /// the field `of`. It must not use the timestamp of the call, which says nothing about a
    /// mixed-up response. The oldest message counts for a blend of values. A value of an older
    /// message than [`Cloud::max_age`] allows is a failure (F4).
    ///
    /// The field `meant_for` may say which message the value is meant for. A value that is meant
    /// for another message is a failure, too (D18).
    ///
    /// ```
    /// # use std::time::Duration;
    /// # use fuseline_tokio::{Call, Error, Setup, StampedValue};
    /// # struct Plan { made_from: u64, speed: f32 }
    /// # async fn plan(timestamp: u64, _: Call) -> Result<Plan, Error> { Ok(Plan { made_from: timestamp, speed: 1.0 }) }
    /// # fn setup(setup: &mut Setup<(), f32>) {
    /// let message_handler = |_: &(), timestamp| Some((timestamp, Duration::from_millis(500)));
    /// let response_handler = |plan: Plan| {
    ///     Ok(StampedValue { of: Some(plan.made_from), ..StampedValue::from(plan.speed) })
    /// };
    /// let cloud = setup.use_stamped_cloud(plan, message_handler, response_handler, 1);
    /// // A plan may be of one of the last five messages.
    /// cloud.max_age = 5;
    /// # }
    /// ```
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

    /// Sets the function that gives the clouds' policies the vehicle's situation, above all its
    /// speed, for each accepted message. Without it nothing is known, and the guard takes no risk.
    ///
    /// It is called in the operator's task and must not block. After a panic the situation is
    /// unknown.
    pub fn use_situation(
        &mut self,
        situation: impl FnMut(&I, u64) -> Situation<'static> + Send + 'static,
    ) -> &mut Self {
        self.situation = Some(Box::new(situation));
        self
    }

    /// Registers side requests, whose answers help local with later messages and never become an
    /// output.
    ///
    /// The machine does not know of side requests, so no output waits for an answer. A request by
    /// [`use_cloud`](Self::use_cloud) holds local's result back until it is answered, fails or is
    /// due (F3).
    ///
    /// - `handle` makes the call, as for a cloud. Its future is dropped when the deadline or the
    ///   operator ends.
    /// - `message_handler` gets each accepted message after the clouds' handlers, and must not
    ///   block. `None` makes no call.
    /// - `response_handler` gets each answer that comes in time, in the call's task, and changes
    ///   [shared](crate::SharedState) state. `Ok` counts as answered, and an error as failed.
    ///
    /// Requests are gated and bounded like a cloud's.
    ///
    /// ```
    /// # use std::time::Duration;
    /// # use fuseline_tokio::{Call, Error, Local, Setup, SharedState};
    /// # async fn route(_position: u32, _: Call) -> Result<Vec<u32>, Error> { Ok(Vec::new()) }
    /// # fn setup(setup: &mut Setup<u32, u32>) -> Local<u32, u32> {
    /// let waypoints = SharedState::new(Vec::<u32>::new());
    /// let message_handler = |position: &u32, _timestamp| Some((*position, Duration::from_secs(2)));
    /// let store = waypoints.clone();
    /// let response_handler = move |route: Vec<u32>| {
    ///     store.with(|waypoints| *waypoints = route);
    ///     Ok(())
    /// };
    /// setup.use_side_request(route, message_handler, response_handler);
    /// Local::blocking(move |position, _timestamp| {
    ///     Ok(waypoints.with(|waypoints| waypoints.first().copied()).unwrap_or(*position))
    /// })
    /// # }
    /// ```
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

    /// Sets the function that gets each result that came too late for its message, with the
    /// result's age. Such a late result is called a *hint*: local can use it for later messages,
    /// but it never becomes an output.
    ///
    /// The function gets results that were dropped as `late` or `superseded`, local's too, if their
    /// message is one of the last 1024. An aborted call has no result, so set how long a cloud's
    /// calls [linger](Cloud::linger). `take_hint` is called in the operator's task and must not
    /// block.
    ///
    /// ```
    /// # use fuseline_tokio::{Hint, Setup, SharedState};
    /// # fn setup(setup: &mut Setup<u32, String>) {
    /// let latest = SharedState::new(None);
    /// let store = latest.clone();
    /// setup.on_late_result(move |hint: Hint<String>| store.with(|latest| *latest = Some(hint)));
    /// # }
    /// ```
    pub fn on_late_result(&mut self, take_hint: impl FnMut(Hint<O>) + Send + 'static) -> &mut Self {
        self.hints = Some(Box::new(take_hint));
        self
    }

    /// Updates `state` with each result that is sent, local's or a cloud's (E10). `state_of` reads
    /// the new state from the output.
    ///
    /// `state_of` is called in the operator's task and must not block. After a panic the state
    /// stays as it was.
    pub fn use_state<S: Clone + Send + 'static>(
        &mut self,
        state: &CarriedState<S>,
        mut state_of: impl FnMut(&O) -> S + Send + 'static,
    ) -> &mut Self {
        let state = state.clone();
        self.states.push(Box::new(move |t, output| state.sent(t, state_of(output))));
        self
    }

    /// Sets the function that returns the value to send for a message that is missed or refused
    /// (E4). Examples are the last plan, or a safe stop. The item is [marked](Item::substitute);
    /// its ending and the trace stay as they are.
    ///
    /// A message with an [end-to-end deadline](crate::Lineage::within) is then missed early enough
    /// to leave the [reserve](crate::Config::reserve) to the operators downstream. `substitute`
    /// gets the item, is called in the operator's task and must not block. `None` or a panic sends
    /// the item without a value.
    ///
    /// ```
    /// # use fuseline_tokio::Setup;
    /// # fn setup(setup: &mut Setup<u32, &'static str>) {
    /// setup.use_substitute(|_item| Some("stop"));
    /// # }
    /// ```
    pub fn use_substitute(
        &mut self,
        substitute: impl FnMut(&Item<O>) -> Option<O> + Send + 'static,
    ) -> &mut Self {
        self.substitutes = Some(Box::new(substitute));
        self
    }
}

impl<I, O> CloudHandler<I, O> {
    /// Returns the request of the message handler; `None` if the handler panics. `ended` is when
    /// the handler before it ended, if nothing of the user's has run since, and afterwards when
    /// this one ended.
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
