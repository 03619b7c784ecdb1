//! The probe's clock: slots, calls that overlap, and their ends.

use std::future;
use std::io::Write;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use tokio::task::JoinSet;
use tokio::time::{Instant, interval, sleep_until, timeout};

use crate::probe::log::ProbeLog;

/// Calls that are under way are awaited for this long once the user ends the probe.
const GRACE: Duration = Duration::from_secs(1);
/// The rows so far are written this often, so that little is lost if the probe is killed.
const WRITES: Duration = Duration::from_millis(500);

/// The instants at which the probe sends.
pub(crate) struct Schedule {
    /// Slots a second.
    pub(crate) rate: f64,
    /// The number of slots, or `None` to send until the user ends it.
    pub(crate) slots: Option<u64>,
    /// A call that takes longer counts as failed.
    pub(crate) give_up: Duration,
}

/// Sends by the schedule until it is done, or until `end` and a second more for what is under way.
/// Every `look` the log is shown.
///
/// `send_request` makes the call of a slot; false is a failure.
///
/// # Errors
/// If the recording cannot be written; the probe ends then.
pub(crate) async fn drive<W: Write, Fut>(
    log: &mut ProbeLog<W>,
    schedule: &Schedule,
    send_request: impl Fn(u64) -> Fut,
    end: impl Future<Output = ()>,
    (look, mut show): (Duration, impl FnMut(&ProbeLog<W>, Duration)),
) -> Result<(), csv::Error>
where
    Fut: Future<Output = bool> + Send + 'static,
{
    let start = Instant::now();
    let mut calls = JoinSet::new();
    let [mut looks, mut writes] = [look, WRITES].map(interval);
    // Their first ticks come at once.
    looks.tick().await;
    writes.tick().await;
    let (mut slot, mut ended) = (0, None);
    tokio::pin!(end);
    loop {
        let is_done = ended.is_some() || schedule.slots.is_some_and(|slots| slot >= slots);
        if is_done && calls.is_empty() {
            break;
        }
        let due = schedule.due(slot);
        let last = ended.map(|ended: Instant| ended + GRACE);
        tokio::select! {
            // Before a slot: what ended frees it.
            biased;
            Some(ended) = calls.join_next() => {
                // No call panics.
                if let Ok((number, round_trip)) = ended {
                    log.ended(number, round_trip, start.elapsed());
                }
            }
            () = &mut end, if ended.is_none() => ended = Some(Instant::now()),
            () = until(last) => break,
            () = sleep_until(start + due), if !is_done => {
                slot += overslept(log, schedule, slot, start.elapsed());
                let (due, now) = (schedule.due(slot), Instant::now());
                if let Some(number) = log.slot(due, now - start, utc_ms()) {
                    let call = timeout(schedule.give_up, send_request(slot));
                    calls.spawn(async move {
                        let is_answered = call.await.is_ok_and(|is_answered| is_answered);
                        (number, is_answered.then(|| now.elapsed()))
                    });
                }
                slot += 1;
            }
            _ = writes.tick() => log.write()?,
            _ = looks.tick() => show(log, start.elapsed()),
        }
    }
    log.finish(start.elapsed())
}

impl Schedule {
    #[expect(clippy::cast_precision_loss, reason = "exact for as long as a clock is")]
    fn due(&self, slot: u64) -> Duration {
        Duration::from_secs_f64(slot as f64 / self.rate)
    }
}

/// Skips the slots before the one that is due now: they are not made up. Says how many.
fn overslept<W: Write>(
    log: &mut ProbeLog<W>,
    schedule: &Schedule,
    slot: u64,
    now: Duration,
) -> u64 {
    let last = schedule.slots.map_or(u64::MAX, |slots| slots.saturating_sub(1));
    let mut passed = 0;
    while slot + passed < last && schedule.due(slot + passed + 1) <= now {
        passed += 1;
    }
    log.overslept(u32::try_from(passed).unwrap_or(u32::MAX));
    passed
}

async fn until(instant: Option<Instant>) {
    match instant {
        Some(instant) => sleep_until(instant).await,
        None => future::pending().await,
    }
}

fn utc_ms() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_millis()).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests;
