use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use tokio::time::{advance, sleep};

use super::*;
use crate::probe::figures::RequestCounts;
use crate::probe::row::SlotRows;
use fuseline_report::Quantile;

const fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

/// A file that others read while it is written.
#[derive(Clone, Default)]
struct Shared(Arc<Mutex<Vec<u8>>>);

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

struct ProbeRun {
    log: ProbeLog<Shared>,
    rows: Vec<[f64; 3]>,
}

/// Probes at 30 Hz; `send_request` gets each slot. A runtime of 118 ms must be done within 500 ms.
async fn probe<Fut>(
    slots: Option<u64>,
    send_request: impl Fn(u64) -> Fut,
    end: impl Future<Output = ()>,
) -> ProbeRun
where
    Fut: Future<Output = bool> + Send + 'static,
{
    let file = Shared::default();
    let rows = SlotRows::new(file.clone()).unwrap();
    let mut log = ProbeLog::new(rows, Duration::from_secs(1) / 30, (ms(118), ms(500)));
    let schedule = Schedule { rate: 30.0, slots, give_up: ms(20_000) };
    drive(&mut log, &schedule, send_request, end, (ms(1000), |_, _| {})).await.unwrap();
    let text = String::from_utf8(file.0.lock().unwrap().clone()).unwrap();
    let row = |line: &str| {
        let cells: Vec<f64> =
            line.split(',').map(|cell| cell.parse().unwrap_or(f64::NAN)).collect();
        [cells[0], cells[1], cells[2]]
    };
    ProbeRun { rows: text.lines().skip(1).map(row).collect(), log }
}

fn quantile(found: Option<Quantile>) -> f64 {
    match found {
        Some(Quantile::Exactly(at)) => at.as_secs_f64() * 1e3,
        other => panic!("{other:?}"),
    }
}

#[tokio::test(start_paused = true)]
async fn calls_overlap_and_quantiles_are_those_of_the_delays() {
    let send_request = |slot| async move {
        sleep(ms(1 + slot % 200)).await;
        true
    };
    let ProbeRun { log, rows } = probe(Some(600), send_request, future::pending()).await;
    let counts = RequestCounts {
        slots: 600,
        sent: 600,
        answered: 600,
        in_time: 600,
        ..RequestCounts::default()
    };
    assert_eq!(log.figures.counts, counts);
    for (percent, expected) in [(50, 100.0), (90, 180.0), (99, 198.0), (100, 200.0)] {
        for spread in [&log.figures.answers, &log.figures.slots] {
            // A timer fires by the millisecond.
            assert!((quantile(spread.quantile(percent)) - expected).abs() <= 1.1, "{percent}");
        }
    }
    assert_eq!(rows.len(), 600);
    for (slot, row) in (0_u32..).zip(&rows) {
        assert!((row[0] - f64::from(slot) * 1000.0 / 30.0).abs() <= 1.0, "{slot}: {row:?}");
    }
    assert!(rows.iter().any(|row| row[2] > 2.0));
}

#[tokio::test(start_paused = true)]
async fn killed_probe_loses_the_rows_of_half_a_second() {
    let file = Shared::default();
    let rows = SlotRows::new(file.clone()).unwrap();
    let mut log = ProbeLog::new(rows, Duration::from_secs(1) / 30, (ms(118), ms(500)));
    let schedule = Schedule { rate: 30.0, slots: None, give_up: ms(20_000) };
    let answered = |_| async { true };
    let look = (ms(5000), |_: &ProbeLog<Shared>, _| {});
    let probing = drive(&mut log, &schedule, answered, future::pending(), look);
    assert!(timeout(ms(4600), probing).await.is_err());
    let text = String::from_utf8(file.0.lock().unwrap().clone()).unwrap();
    let last = text.lines().next_back().and_then(|row| row.split(',').next()?.parse().ok());
    assert!(last.is_some_and(|sent: f64| sent > 4000.0), "{last:?}");
}

#[tokio::test(start_paused = true)]
async fn a_stall_leaves_31_unanswered_and_nothing_is_sent_until_all_are_answered() {
    let under_way = Arc::new(AtomicUsize::new(0));
    let requests = Arc::new(Mutex::new(Vec::new()));
    let start = Instant::now();
    let send_request = |slot| {
        let (under_way, requests) = (Arc::clone(&under_way), Arc::clone(&requests));
        async move {
            requests.lock().unwrap().push((slot, under_way.fetch_add(1, Ordering::Relaxed)));
            sleep(ms(20)).await;
            let stalled = start.elapsed();
            // From 1 s until 4 s nothing comes.
            if (ms(1000)..ms(4000)).contains(&stalled) {
                sleep(ms(4000).saturating_sub(stalled)).await;
            }
            under_way.fetch_sub(1, Ordering::Relaxed);
            true
        }
    };
    let ProbeRun { log, rows } = probe(Some(180), send_request, future::pending()).await;
    let requests = requests.lock().unwrap();
    assert_eq!(requests.iter().map(|(_, queued)| queued + 1).max(), Some(31));
    // The last of the 31, then the first after the pause: with nothing under way.
    let last = requests.iter().position(|(_, queued)| *queued == 30).unwrap();
    let (slot, queued) = requests[last + 1];
    assert_eq!(queued, 0);
    assert!(slot >= 120, "{slot}");
    let skipped = slot - requests[last].0 - 1;
    let counts = log.figures.counts;
    assert_eq!((counts.pauses, counts.skipped, counts.missed), (1, skipped, 0));
    assert_eq!((counts.slots, counts.sent + counts.skipped), (180, 180));
    // The pause has one row, at its first slot, with 31 requests queued.
    let pauses: Vec<&[f64; 3]> = rows.iter().filter(|row| row[1] < 0.0).collect();
    let [row] = pauses[..] else { panic!("{pauses:?}") };
    assert!((row[2] - 31.0).abs() < 1e-9);
    assert_eq!(rows.len() as u64, counts.sent + 1);
    // The longest are the first of the stall; a skipped slot took until the pause's end.
    assert!((quantile(log.figures.answers.quantile(100)) - 3020.0).abs() <= 40.0);
    let skipped_ms = quantile(log.figures.slots.quantile(70));
    assert!((500.0..2000.0).contains(&skipped_ms), "{skipped_ms}");
}

#[tokio::test(start_paused = true)]
async fn what_fails_is_lost_and_never_ends() {
    let send_request = |slot| future::ready(slot % 4 != 0);
    let ProbeRun { log, rows } = probe(Some(100), send_request, future::pending()).await;
    assert_eq!((log.figures.counts.answered, log.figures.counts.failed), (75, 25));
    assert_eq!(rows.iter().filter(|row| row[1] < 0.0).count(), 25);
    assert_eq!(log.figures.slots.quantile(76), Some(Quantile::Never));
    assert!(quantile(log.figures.slots.quantile(75)) < 0.1);
}

#[tokio::test(start_paused = true)]
async fn a_call_is_given_up_so_that_rows_do_not_wait_for_ever() {
    let send_request = |slot| async move {
        if slot == 0 {
            future::pending::<()>().await;
        }
        true
    };
    let ProbeRun { log, rows } = probe(Some(3000), send_request, future::pending()).await;
    assert_eq!((log.figures.counts.failed, rows.len()), (1, 3000));
    assert!(rows[0][1] < 0.0 && rows[1..].iter().all(|row| row[1] >= 0.0));
}

#[tokio::test(start_paused = true)]
async fn ended_by_the_user_the_recording_is_whole() {
    let send_request = |slot| async move {
        sleep(if slot < 20 { ms(200) } else { ms(5000) }).await;
        true
    };
    let ProbeRun { log, rows } = probe(None, send_request, sleep(ms(990))).await;
    let RequestCounts { slots, sent, answered, unanswered, .. } = log.figures.counts;
    assert_eq!((slots, sent, answered, unanswered), (30, 30, 20, 10));
    assert_eq!((rows.len(), rows.iter().filter(|row| row[1] < 0.0).count()), (30, 10));
}

#[tokio::test(start_paused = true)]
async fn slots_that_were_overslept_are_reported_and_not_made_up() {
    let send_request = |slot| async move {
        if slot == 9 {
            // The host seems to stand still.
            advance(ms(1000)).await;
        }
        true
    };
    let ProbeRun { log, rows } = probe(Some(90), send_request, future::pending()).await;
    let RequestCounts { slots, sent, missed, skipped, .. } = log.figures.counts;
    assert_eq!((slots, sent + missed, skipped), (90, 90, 0));
    assert!((28..=30).contains(&missed), "{missed}");
    assert_eq!(rows.len() as u64, sent);
}
