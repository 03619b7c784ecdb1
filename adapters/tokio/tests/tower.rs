//! Tests fallbacks of rising quality as a tower layer, in virtual time.

use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;

use fuseline_tokio::tower::{FallbackLayer, FallbackService};
use fuseline_tokio::{Config, Error};
use tokio::time::{Instant, advance, sleep, timeout};
use tower_layer::Layer;
use tower_service::Service;

const MS: Duration = Duration::from_millis(1);

/// A model that answers or fails after a while.
#[derive(Clone)]
struct Model {
    name: &'static str,
    after: Duration,
    fails: bool,
    is_ready: bool,
    under_way: Arc<AtomicUsize>,
}

/// Counts a call until it is dropped.
struct CountedCall(Arc<AtomicUsize>);

impl Drop for CountedCall {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

fn model(name: &'static str, after_ms: u32) -> Model {
    let under_way = Arc::default();
    Model { name, after: after_ms * MS, fails: false, is_ready: true, under_way }
}

impl Service<u64> for Model {
    type Response = String;
    type Error = Error;
    type Future = Pin<Box<dyn Future<Output = Result<String, Error>> + Send>>;

    fn poll_ready(&mut self, _: &mut Context<'_>) -> Poll<Result<(), Error>> {
        if self.is_ready { Poll::Ready(Ok(())) } else { Poll::Pending }
    }

    fn call(&mut self, frame: u64) -> Self::Future {
        let Self { name, after, fails, under_way, .. } = self.clone();
        under_way.fetch_add(1, Ordering::Relaxed);
        let counted = CountedCall(under_way);
        Box::pin(async move {
            let _counted = counted;
            sleep(after).await;
            if fails {
                Err(format!("{name} is out of order").into())
            } else {
                Ok(format!("{name} of {frame}"))
            }
        })
    }
}

/// Returns a service that answers on board after 5 ms, with a nearby model within 30 ms and the
/// best one within 50 ms.
fn service(nearby: Model, best: Model) -> FallbackService<u64, String> {
    let layer = FallbackLayer::new(model("on board", 5)).fallback(nearby, 30 * MS);
    layer.deadline(50 * MS).layer(best)
}

async fn answered(mut service: FallbackService<u64, String>) -> (Result<String, String>, u128) {
    let start = Instant::now();
    let answer = service.call(7).await.map_err(|error| error.to_string());
    (answer, start.elapsed().as_millis())
}

#[tokio::test(start_paused = true)]
async fn the_best_answer_by_the_deadline_is_the_answer_not_the_first_one() {
    let best = answered(service(model("nearby", 20), model("cloud", 25))).await;
    assert_eq!(best, (Ok("cloud of 7".into()), 25));
    let late = answered(service(model("nearby", 20), model("cloud", 60))).await;
    assert_eq!(late, (Ok("nearby of 7".into()), 50));
}

#[tokio::test(start_paused = true)]
async fn what_fails_or_never_is_ready_costs_no_answer() {
    let broken = Model { fails: true, ..model("cloud", 10) };
    let answer =
        answered(service(Model { fails: true, ..model("nearby", 8) }, broken.clone())).await;
    assert_eq!(answer, (Ok("on board of 7".into()), 10));
    let busy = Model { is_ready: false, ..model("cloud", 1) };
    let answer = answered(service(model("nearby", 20), busy)).await;
    assert_eq!(answer, (Ok("nearby of 7".into()), 50));
    let layer = FallbackLayer::new(Model { fails: true, ..model("on board", 5) });
    let (answer, _) = answered(layer.deadline(50 * MS).layer(broken)).await;
    let why = answer.unwrap_err();
    assert!(
        why.contains("on board is out of order") && why.contains("cloud is out of order"),
        "{why}"
    );
}

#[tokio::test(start_paused = true)]
async fn a_request_that_is_given_up_ends_its_calls() {
    let (nearby, best) = (model("nearby", 20), model("cloud", 40));
    let calls = [Arc::clone(&nearby.under_way), Arc::clone(&best.under_way)];
    let under_way = || calls.each_ref().map(|count| count.load(Ordering::Relaxed));
    let mut service = service(nearby, best);
    let answer = service.call(7);
    sleep(10 * MS).await;
    assert_eq!(under_way(), [1, 1]);
    drop(answer);
    sleep(MS).await;
    assert_eq!(under_way(), [0, 0]);
    // Outranked calls end with the answer.
    assert!(timeout(21 * MS, service.call(8)).await.is_err());
    sleep(MS).await;
    assert_eq!(under_way(), [0, 0]);
}

#[tokio::test(start_paused = true)]
async fn what_ends_while_the_executor_is_blocked_is_late() {
    let mut service = service(model("nearby", 25), model("cloud", 60));
    let computing = async {
        sleep(10 * MS).await;
        advance(100 * MS).await; // nothing else runs meanwhile
    };
    let (answer, ()) = tokio::join!(service.call(7), computing);
    assert_eq!(answer.unwrap(), "on board of 7");
}

#[tokio::test(start_paused = true)]
async fn the_service_on_board_ends_once_its_request_is_answered() {
    let on_board = model("on board", 500);
    let under_way = Arc::clone(&on_board.under_way);
    let mut service = FallbackLayer::new(on_board).deadline(50 * MS).layer(model("cloud", 20));
    assert_eq!(service.call(1).await.unwrap(), "cloud of 1");
    sleep(MS).await;
    assert_eq!(under_way.load(Ordering::Relaxed), 0);
}

#[tokio::test(start_paused = true)]
async fn requests_are_answered_one_by_one_and_one_too_many_is_an_error() {
    let layer = FallbackLayer::new(model("on board", 5)).deadline(50 * MS);
    let config = Config { window: 2, ..Config::default() };
    let mut service = layer.config(config).layer(model("cloud", 20));
    let answers = [service.call(1), service.call(2), service.call(3)];
    let mut reported = Vec::new();
    for answer in answers {
        reported.push(answer.await.map_err(|error| error.to_string()));
    }
    assert_eq!(reported[..2], [Ok("cloud of 1".into()), Ok("cloud of 2".into())]);
    assert!(reported[2].as_ref().is_err_and(|why| why.contains("too many")), "{reported:?}");
}

#[tokio::test(start_paused = true)]
async fn what_cannot_be_started_is_each_calls_error() {
    let config = Config { window: 0, ..Config::default() };
    let layer = FallbackLayer::new(model("on board", 5)).config(config);
    let (answer, _) = answered(layer.layer(model("cloud", 20))).await;
    assert!(answer.unwrap_err().contains("window"));
}
