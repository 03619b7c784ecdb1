//! Local's result at once, one cloud hedged: `hedge tower|tower-queue|seatbelt FOLDER SCENARIO`.
//! `tower-queue` has a limit of one call at a time in place of the hedge.

use std::sync::Arc;
use std::time::Duration;

use others::{AttemptDone, DrivenRun};
use tower::util::BoxCloneService;
use tower::{Layer, Service, ServiceExt};
use tower_resilience::{fallback::FallbackLayer, hedge::HedgeLayer, timelimiter::TimeLimiterLayer};

const HEDGE: Duration = Duration::from_millis(40);
type AttemptResult = Result<AttemptDone, String>;
type BoxedService = BoxCloneService<usize, AttemptDone, String>;

fn tower(harness: &Arc<DrivenRun>, port: u16) -> BoxedService {
    let own = harness.clone();
    let inner = tower::service_fn(move |t| own.clone().call(port, t));
    let hedged: BoxedService = if harness.has_queue() {
        BoxCloneService::new(tower::limit::ConcurrencyLimit::new(inner, 1))
    } else {
        let hedge = HedgeLayer::builder().delay(HEDGE).max_hedged_attempts(2).build();
        BoxCloneService::new(hedge.layer(inner).map_err(|error| format!("{error:?}")))
    };
    let limit = TimeLimiterLayer::builder().timeout_duration(harness.deadline()).build();
    let limited = limit.layer(hedged).map_err(|error| format!("{error:?}"));
    let fallback = FallbackLayer::<usize, AttemptDone, String>::builder();
    let fallback = fallback.from_request_error(|t: &usize, _: &String| (0, *t)).build();
    BoxCloneService::new(fallback.layer(limited).map_err(|error| format!("{error:?}")))
}

async fn seatbelt(harness: Arc<DrivenRun>, port: u16, t: usize) -> AttemptResult {
    use layered::{Execute, Service as _, Stack};
    use seatbelt::fallback::Fallback;
    use seatbelt::hedging::Hedging;
    use seatbelt::timeout::Timeout;
    use seatbelt::{RecoveryInfo, ResilienceContext};

    let clock = tick::Clock::new_tokio();
    let context: ResilienceContext<usize, AttemptResult> =
        ResilienceContext::new(&clock).name("operator");
    let stack = (
        Fallback::layer("fallback", &context)
            .should_fallback(|done: &AttemptResult| done.is_err())
            .fallback(move |_: AttemptResult, _| Ok((0, t))),
        Timeout::layer("timeout", &context)
            .timeout_output(|_| Err("timeout".to_owned()))
            .timeout(harness.deadline()),
        Hedging::layer("hedge", &context)
            .clone_input()
            .recovery_with(|done: &AttemptResult, _| match done {
                Ok(_) => RecoveryInfo::never(),
                Err(_) => RecoveryInfo::retry(),
            })
            .hedging_delay(HEDGE),
        Execute::new(move |t: usize| harness.clone().call(port, t)),
    );
    stack.into_service().execute(t).await
}

async fn message(harness: Arc<DrivenRun>, port: u16, mut service: BoxedService, t: usize) {
    harness.record("open", t, &format!(r#","within":{}"#, harness.deadline().as_nanos()));
    harness.record("result", t, r#","p":0"#);
    if harness.has_queue() {
        harness.record_request(t, 0); // as the caller sees it: it waits until the service is ready
    }
    let done = if harness.mode == "seatbelt" {
        seatbelt(harness.clone(), port, t).await
    } else {
        service.ready().await.expect("a service").call(t).await
    };
    match done {
        Ok((0, _)) => harness.record("emit", t, r#","p":0"#),
        Ok((p, of)) => harness.record("emit", t, &format!(r#","p":{p},"of":{of}"#)),
        Err(_) => harness.record("miss", t, ""),
    }
}

#[tokio::main(flavor = "current_thread")]
async fn main() {
    let harness = DrivenRun::new();
    let (port, mut server) = harness.serve();
    let service = tower(&harness, port);
    let mut messages = tokio::task::JoinSet::new();
    for t in 0..harness.delays().len() {
        if harness.is_at("kill_at", t) {
            server.kill().expect("the server");
        }
        messages.spawn(message(harness.clone(), port, service.clone(), t));
        let next = tokio::time::Instant::now() + harness.time("period", 60);
        if harness.is_at("block_at", t) {
            tokio::time::sleep(Duration::from_millis(30)).await;
            std::thread::sleep(harness.time("block", 0)); // something computes on the executor's thread
        }
        tokio::time::sleep_until(next).await;
    }
    let rest = async { while messages.join_next().await.is_some() {} };
    let _ = tokio::time::timeout(Duration::from_secs(1), rest).await;
    harness.end();
    server.kill().expect("the server");
    std::process::exit(0); // threads of the libraries may be left
}
