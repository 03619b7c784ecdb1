//! Clients that keep within the bounds, some of them barely.

use std::time::Duration;

use fuseline_testkit::Rng;
use futures_util::future::join_all;
use tokio::time::{Instant, sleep};

use super::memory::{CallPlan, VisitEnd, Visitor};
use super::visitors::{SECOND, VisitedServer};

/// An answer may come this much later than planned, because each timer rounds up to a millisecond.
const ROUNDING: Duration = Duration::from_millis(20);

/// The units of `grpc-timeout`, their nanoseconds, and the greatest count that is drawn for each.
const UNITS: [(&str, u64, u64); 6] = [
    ("H", 3_600_000_000_000, 2),
    ("M", 60_000_000_000, 5),
    ("S", 1_000_000_000, 90),
    ("m", 1_000_000, 90_000),
    ("u", 1_000, 90_000_000),
    ("n", 1, 99_999_999),
];

/// Headers that set no deadline: a missing one, the longest one, and some that cannot be read.
const NO_DEADLINES: [Option<&str>; 6] =
    [None, Some("99999999H"), Some("1"), Some("S"), Some("1x"), Some("123456789m")];

/// Makes calls and rests until all others are done too. Returns the first error, if there was one.
pub(crate) async fn stay(here: &VisitedServer, visitor: &Visitor, rng: Rng) -> Option<String> {
    let wrong = visit(here, visitor, rng).await;
    here.busy.set(here.busy.get() - 1);
    while wrong.is_none() {
        if !here.answers(visitor).await {
            return Some("not answered while the others go on".into());
        }
        if here.busy.get() == 0 {
            break;
        }
        sleep(here.bounds.idle / 4).await;
    }
    wrong
}

async fn visit(here: &VisitedServer, visitor: &Visitor, mut rng: Rng) -> Option<String> {
    let bounds = here.bounds;
    while Instant::now() < here.until {
        let mut before = 3 * SECOND;
        match rng.u8(0..8) {
            0 => take_back(here, visitor).await,
            1 => {
                if let Some(wrong) = hurry(here, visitor).await {
                    return Some(wrong);
                }
            }
            _ => {
                let (plan, expected) = draw(here, &mut rng);
                if plan.read_pause > Duration::ZERO {
                    // For the server the call ended when it sent the last bytes.
                    before = bounds.stall;
                }
                match visitor.call(&plan).await {
                    Ok(end) if is_as_expected(&plan, &end, &expected) => {}
                    end => return Some(format!("{plan:?}: {end:?}, expected {expected:?}")),
                }
            }
        }
        let rest = match rng.u8(0..3) {
            0 => Duration::ZERO,
            1 => Duration::from_millis(rng.u64(0..20_000)),
            _ => bounds.idle.saturating_sub(before),
        };
        sleep(rest).await;
        if !visitor.is_open() {
            return Some(format!("closed while it rests for {rest:?}"));
        }
    }
    None
}

fn is_as_expected(plan: &CallPlan, end: &VisitEnd, expected: &VisitEnd) -> bool {
    let least = expected.took;
    // There is no upper bound for a slow reader.
    let is_in_time = plan.read_pause > Duration::ZERO || end.took <= least + ROUNDING;
    (end.status, end.bytes) == (expected.status, expected.bytes) && end.took >= least && is_in_time
}

/// Cancels as many calls in a second as is allowed, each while it is computed.
async fn take_back(here: &VisitedServer, visitor: &Visitor) {
    sleep(SECOND).await;
    let plan = CallPlan { compute: 1000 * SECOND, ..here.plain() };
    for _ in 0..here.bounds.resets {
        let Ok(mut send) = visitor.send.clone().ready().await else { return };
        let Ok((answer, mut body)) = send.send_request(plan.head(), false) else { return };
        let _ = body.send_data(plan.body(), true);
        sleep(Duration::from_millis(10)).await;
        body.send_reset(h2::Reason::CANCEL);
        drop(answer);
    }
    sleep(SECOND).await;
}

/// Makes more calls than may be cancelled in a second. Each must be answered.
async fn hurry(here: &VisitedServer, visitor: &Visitor) -> Option<String> {
    for turn in 0..=here.bounds.resets / here.bounds.calls {
        let calls = (0..here.bounds.calls).map(|_| here.answers(visitor));
        if !join_all(calls).await.into_iter().all(|is_answered| is_answered) {
            return Some(format!("in turn {turn} a call among several is not answered"));
        }
    }
    None
}

/// Draws a call, and the way in which it must end.
fn draw(here: &VisitedServer, rng: &mut Rng) -> (CallPlan, VisitEnd) {
    let (bounds, mut plan) = (here.bounds, here.plain());
    plan.reply = rng.usize(1..60_000);
    plan.payload = rng.usize(0..60_000);
    plan.compute = Duration::from_millis(rng.u64(0..5_000));
    let (unit, nanos, most) = UNITS[rng.index(UNITS.len())];
    let count = rng.u64(1..most);
    let deadline = Duration::from_nanos(count * nanos);
    let mut end = VisitEnd { status: 0, bytes: plan.reply, took: plan.compute };
    match rng.u8(0..6) {
        0 => {}
        1 => {
            plan.compute = bounds.idle + Duration::from_secs(rng.u64(1..600));
            // A header that is no deadline, or a very long one, ends nothing.
            plan.timeout = NO_DEADLINES[rng.index(NO_DEADLINES.len())].map(str::to_owned);
            end.took = plan.compute;
        }
        // In this case the call ends in time, and in the next case late.
        2 => {
            plan.compute = millis(deadline.mul_f64(0.9));
            plan.timeout = Some(format!("{count}{unit}"));
            end.took = plan.compute;
        }
        3 => {
            plan.compute = millis(deadline * 2 + SECOND);
            plan.timeout = Some(format!("{count}{unit}"));
            end = VisitEnd { status: 4, bytes: 0, took: deadline };
        }
        // The reply is taken slowly.
        4 => {
            plan.reply = 64 * 1024 * rng.usize(2..4);
            plan.read_pause = bounds.stall / 16;
            end.bytes = plan.reply;
        }
        _ => {
            let gap = bounds.stall.saturating_sub(SECOND) / 10;
            plan.upload = (11, gap);
            end.took = plan.compute + gap * 10;
        }
    }
    (plan, end)
}

/// Rounds down to whole milliseconds.
fn millis(time: Duration) -> Duration {
    Duration::from_millis(u64::try_from(time.as_millis()).unwrap())
}
