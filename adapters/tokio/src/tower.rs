//! A tower [`Layer`] for a service that has fallbacks of rising quality. It calls all of them at
//! once, and answers with the best answer by the deadline, not with the first one.
//!
//! ```
//! # use std::time::Duration;
//! # use fuseline_tokio::tower::FallbackLayer;
//! # use tower_layer::Layer;
//! # #[derive(Clone)]
//! # struct Model(&'static str);
//! # impl tower_service::Service<u64> for Model {
//! #     type Response = String;
//! #     type Error = std::convert::Infallible;
//! #     type Future = std::future::Ready<Result<String, Self::Error>>;
//! #     fn poll_ready(&mut self, _: &mut std::task::Context<'_>) -> std::task::Poll<Result<(), Self::Error>> { Ok(()).into() }
//! #     fn call(&mut self, frame: u64) -> Self::Future { std::future::ready(Ok(format!("{} of {frame}", self.0))) }
//! # }
//! # #[tokio::main(flavor = "current_thread")]
//! # async fn main() -> Result<(), fuseline_tokio::Error> {
//! # use tower_service::Service;
//! let layer = FallbackLayer::new(Model("on board")).fallback(Model("nearby"), Duration::from_millis(200));
//! let mut detect = layer.deadline(Duration::from_millis(500)).layer(Model("in the cloud"));
//! assert_eq!(detect.call(7).await?, "in the cloud of 7");
//! # Ok(())
//! # }
//! ```

use std::collections::BTreeMap;
use std::future::poll_fn;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use fuseline_engine::{Commit, Ending, Failure, Item};
use futures_util::future::BoxFuture;
use tokio::sync::{oneshot, watch};
use tower_layer::Layer;
use tower_service::Service;

use crate::{
    Call, Config, Error, Items, Local, Operator, Setup, SharedState, Writer, spawn, stream,
};

/// Adds fallbacks of rising quality to a service that is better than all of them.
pub struct FallbackLayer<Req, Res> {
    local: FallbackCall<Req, Res>,
    fallbacks: Vec<(FallbackCall<Req, Res>, Duration)>,
    deadline: Duration,
    config: Config,
}

/// A service with its fallbacks. Clones share the requests under way.
///
/// Any number of services may be called at once, for as many requests as [`Config::window`] has
/// room for. A further request is an error. A request whose future is dropped is given up, and its
/// calls are dropped too.
pub struct FallbackService<Req, Res> {
    started: Result<Arc<RunningService<Req, Res>>, Arc<str>>,
}

/// A started operator. It ends when all clones of the service are dropped and all requests are
/// answered.
struct RunningService<Req, Res> {
    requests: SharedState<Writer<Arc<FallbackRequest<Req>>>>,
    callers: WaitingCallers<Res>,
}

/// The callers that wait for an answer, by the timestamp of their request.
type WaitingCallers<Res> = SharedState<BTreeMap<u64, oneshot::Sender<Result<Res, Error>>>>;

/// Makes a request to one service. The deadline covers both the wait until the service is ready and
/// the call.
type FallbackCall<Req, Res> =
    Arc<dyn Fn(Arc<FallbackRequest<Req>>) -> BoxFuture<'static, Result<Res, Error>> + Send + Sync>;

/// A request, and a channel that shows whether its caller still waits.
struct FallbackRequest<Req> {
    request: Req,
    caller: watch::Receiver<()>,
}

/// The operator behind a service.
struct FallbackOperator<Req, Res> {
    local: FallbackCall<Req, Res>,
    clouds: Vec<(FallbackCall<Req, Res>, Duration)>,
    at_once: usize,
}

impl<Req, Res> FallbackLayer<Req, Res>
where
    Req: Clone + Send + Sync + 'static,
    Res: Send + Sync + Clone + 'static,
{
    /// Creates a layer with a service on board. Its answer is sent if no better one comes by the
    /// deadlines. Its call is dropped once the request is answered, or its caller no longer waits.
    pub fn new<S>(local: S) -> Self
    where
        S: Service<Req, Response = Res> + Clone + Send + 'static,
        S::Future: Send,
        S::Error: Into<Error>,
    {
        // Under eager, the earlier deadline of a fallback would end the wait for a better answer
        // (A4).
        let config = Config { commit: Commit::Patient, ..Config::default() };
        let local = boxed(local);
        Self { local, fallbacks: Vec::new(), deadline: Duration::from_secs(1), config }
    }

    /// Adds a fallback that is better than the fallbacks before it. It has `deadline` to become
    /// ready and answer. There may be at most 14 fallbacks.
    #[must_use]
    pub fn fallback<S>(mut self, service: S, deadline: Duration) -> Self
    where
        S: Service<Req, Response = Res> + Clone + Send + 'static,
        S::Future: Send,
        S::Error: Into<Error>,
    {
        self.fallbacks.push((boxed(service), deadline));
        self
    }

    /// Sets how long the wrapped service may take to become ready and answer; 1 s by default.
    #[must_use]
    pub const fn deadline(mut self, deadline: Duration) -> Self {
        self.deadline = deadline;
        self
    }

    /// Sets the operator's configuration, such as its window, trace and commit rule, which is
    /// patient by default.
    #[must_use]
    pub fn config(mut self, config: Config) -> Self {
        self.config = config;
        self
    }
}

impl<S, Req, Res> Layer<S> for FallbackLayer<Req, Res>
where
    S: Service<Req, Response = Res> + Clone + Send + 'static,
    S::Future: Send,
    S::Error: Into<Error>,
    Req: Clone + Send + Sync + 'static,
    Res: Send + Sync + Clone + 'static,
{
    type Service = FallbackService<Req, Res>;

    /// Starts the operator on the current runtime. If it cannot start, each call fails with the
    /// reason.
    fn layer(&self, best: S) -> Self::Service {
        let mut clouds = self.fallbacks.clone();
        clouds.push((boxed(best), self.deadline));
        let at_once = usize::from(self.config.window);
        let (writer, input) = stream(at_once.max(1));
        let operator = FallbackOperator { local: Arc::clone(&self.local), clouds, at_once };
        let started = spawn(operator, self.config.clone(), input).map(|(_running, items)| {
            let callers = WaitingCallers::default();
            tokio::spawn(answer(items, callers.clone()));
            Arc::new(RunningService { requests: SharedState::new(writer), callers })
        });
        FallbackService { started: started.map_err(|error| error.to_string().into()) }
    }
}

impl<Req, Res> Clone for FallbackService<Req, Res> {
    fn clone(&self) -> Self {
        Self { started: self.started.clone() }
    }
}

impl<Req, Res> Service<Req> for FallbackService<Req, Res>
where
    Req: Send + Sync + 'static,
    Res: Send + 'static,
{
    type Response = Res;
    type Error = Error;
    type Future = BoxFuture<'static, Result<Res, Error>>;

    fn poll_ready(&mut self, _: &mut Context<'_>) -> Poll<Result<(), Error>> {
        Poll::Ready(Ok(()))
    }

    fn call(&mut self, request: Req) -> Self::Future {
        let (waiting, caller) = watch::channel(());
        let request = Arc::new(FallbackRequest { request, caller });
        let answer = match &self.started {
            Ok(running) => running.send(request),
            Err(why) => Err(Error::from(&**why)),
        };
        Box::pin(async move {
            let answer = answer?.await;
            drop(waiting);
            answer.unwrap_or_else(|_| Err("the operator has ended".into()))
        })
    }
}

impl<Req: Send + Sync + 'static, Res> RunningService<Req, Res> {
    fn send(
        &self,
        request: Arc<FallbackRequest<Req>>,
    ) -> Result<oneshot::Receiver<Result<Res, Error>>, Error> {
        // The lock is held until the caller is registered, so that no answer comes earlier.
        self.callers.with(|callers| {
            let written = self.requests.with(|requests| requests.write(request));
            let timestamp = written.map_err(|_| "too many requests are under way")?;
            let (caller, answer) = oneshot::channel();
            callers.insert(timestamp, caller);
            Ok(answer)
        })
    }
}

impl<Req, Res> Operator for FallbackOperator<Req, Res>
where
    Req: Clone + Send + Sync + 'static,
    Res: Send + Sync + Clone + 'static,
{
    type Input = Arc<FallbackRequest<Req>>;
    type Output = Res;

    fn setup(self, setup: &mut Setup<Self::Input, Res>) -> Local<Self::Input, Res> {
        let Self { local, clouds, at_once } = self;
        let longest = clouds.iter().map(|(_, deadline)| *deadline).max().unwrap_or_default();
        for (priority, (service, deadline)) in (1..).zip(clouds) {
            let message_handler =
                move |request: &Self::Input, _| Some((Arc::clone(request), deadline));
            let handle = move |request, _: Call| service(request);
            setup.use_cloud(handle, message_handler, Ok, priority).calls = at_once;
        }
        let mut local = Local::futures(at_once, move |request: Arc<Self::Input>, _| {
            local(Arc::clone(&request))
        });
        local.deadline = local.deadline.map(|deadline| deadline.max(longest));
        local
    }
}

/// Hands each request's result to its caller.
async fn answer<Res: Clone + Send + Sync + 'static>(
    items: Items<Res>,
    callers: WaitingCallers<Res>,
) {
    let mut items = items.last_only();
    while let Some(item) = items.read().await {
        let caller = callers.with(|callers| callers.remove(&item.timestamp));
        let Some(caller) = caller else { continue };
        // A caller that no longer waits has dropped the other half.
        let _ = caller.send(result_of(Arc::unwrap_or_clone(item)));
    }
}

fn result_of<Res>(item: Item<Res>) -> Result<Res, Error> {
    match item.ending {
        Ending::Preliminary(forwarded) | Ending::Forwarded(forwarded) => Ok(forwarded.value),
        Ending::Refused(why) => Err(format!("the request was refused: {why}").into()),
        Ending::Missed | Ending::Final(_) => {
            let why = |failure: &Failure| format!("{}: {}", failure.source, failure.why);
            let failures: Vec<String> = item.failures.iter().map(why).collect();
            Err(format!("no service answered: {}", failures.join("; ")).into())
        }
    }
}

/// Turns a service into a function that waits until it is ready, calls it, and gives up when nobody
/// waits for it.
fn boxed<S, Req>(service: S) -> FallbackCall<Req, S::Response>
where
    S: Service<Req> + Clone + Send + 'static,
    S::Future: Send,
    S::Error: Into<Error>,
    S::Response: Send,
    Req: Clone + Send + Sync + 'static,
{
    let service = SharedState::new(service);
    Arc::new(move |request: Arc<FallbackRequest<Req>>| {
        let mut service = service.with(|service| service.clone());
        Box::pin(async move {
            let mut caller = request.caller.clone();
            let answer = async {
                poll_fn(|context| service.poll_ready(context)).await.map_err(Into::into)?;
                service.call(request.request.clone()).await.map_err(Into::into)
            };
            tokio::select! {
                biased;
                result = answer => result,
                _ = caller.changed() => Err("its caller no longer waits".into()),
            }
        })
    })
}
