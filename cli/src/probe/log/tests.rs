use std::cell::RefCell;
use std::io;
use std::rc::Rc;

use fuseline_report::Quantile;
use fuseline_testkit::Rng;

use super::*;
use crate::percentile::Spread;
use crate::probe::figures::RequestCounts;

const fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

#[test]
fn slots_of_a_pause_are_skipped_and_each_takes_until_its_end_also_if_it_was_overslept() {
    let rows = SlotRows::new(Vec::new()).unwrap();
    let mut log = ProbeLog::new(rows, ms(10), (Duration::ZERO, ms(100)));
    let numbers: Vec<u64> =
        (0..32).filter_map(|slot| log.slot(ms(10 * slot), ms(10 * slot), 0)).collect();
    log.overslept(5);
    for number in numbers {
        log.ended(number, Some(ms(1)), ms(1000));
    }
    log.overslept(2);
    let Figures { counts, slots, paused, .. } = log.figures;
    let counted = (counts.slots, counts.sent, counts.skipped, counts.missed, counts.pauses);
    assert_eq!((counted, paused), ((39, 31, 6, 2, 1), ms(690)));
    let quantiles = [83, 86, 100].map(|percent| match slots.quantile(percent) {
        Some(Quantile::Exactly(time)) => Some((time + Duration::from_micros(500)).as_millis()),
        _ => None,
    });
    assert_eq!(quantiles, [1, 640, 690].map(Some));
}

/// A recording that is read while it is written.
#[derive(Clone, Default)]
struct WrittenRows(Rc<RefCell<Vec<u8>>>);

impl Write for WrittenRows {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A row of a recording, and what became of its request.
struct RecountedRow {
    sent: Duration,
    queued: usize,
    has_ended: bool,
    /// None of a failure, and while it is under way.
    round_trip: Option<Duration>,
}

/// The events, in plain lists.
#[derive(Default)]
struct RecountedProbe {
    counts: RequestCounts,
    rows: Vec<RecountedRow>,
    /// The rows of the requests under way.
    under_way: Vec<usize>,
    /// The instants at which the skipped slots of the current pause were due.
    pause: Vec<Duration>,
    paused: Duration,
    answers: Vec<Duration>,
    /// None of what never ended.
    slots: Vec<Option<Duration>>,
}

const PERIOD: Duration = ms(10);
const RUNTIME: Duration = ms(100);
const DEADLINE: Duration = ms(500);

impl RecountedProbe {
    /// Returns `true` if a request is sent.
    fn slot(&mut self, due: Duration, sent: Duration) -> bool {
        self.counts.slots += 1;
        let (queued, is_paused) = (self.under_way.len(), !self.pause.is_empty());
        if is_paused || queued == 31 {
            self.counts.skipped += 1;
            self.counts.pauses += u64::from(!is_paused);
            self.pause.push(due);
            if !is_paused {
                self.rows.push(RecountedRow { sent, queued, has_ended: true, round_trip: None });
            }
            return false;
        }
        self.counts.sent += 1;
        self.under_way.push(self.rows.len());
        self.rows.push(RecountedRow { sent, queued, has_ended: false, round_trip: None });
        true
    }

    fn ended(&mut self, row: usize, round_trip: Option<Duration>, now: Duration) {
        self.under_way.retain(|other| *other != row);
        self.rows[row].has_ended = true;
        self.rows[row].round_trip = round_trip;
        self.slots.push(round_trip);
        match round_trip {
            Some(time) => {
                self.counts.answered += 1;
                self.counts.in_time += u64::from(time < DEADLINE.checked_sub(RUNTIME).unwrap());
                self.answers.push(time);
            }
            None => self.counts.failed += 1,
        }
        if self.under_way.is_empty() {
            self.paused +=
                self.pause.first().map_or(Duration::ZERO, |first| now.saturating_sub(*first));
            self.slots.extend(self.pause.drain(..).map(|due| Some(now.saturating_sub(due))));
        }
    }

    fn finish(&mut self, now: Duration) {
        self.counts.unanswered = self.under_way.len() as u64;
        self.paused +=
            self.pause.first().map_or(Duration::ZERO, |first| now.saturating_sub(*first));
        self.slots.extend(self.under_way.drain(..).map(|_| None));
        self.slots.extend(self.pause.drain(..).map(|_| None));
    }

    /// The rows that are known, in the order of sending; all of them at the end.
    fn known(&self, at_end: bool) -> String {
        let is_known = |row: &&RecountedRow| at_end || row.has_ended;
        let (mut text, mut last) = (String::new(), None);
        let millis = |micros: u128| format!("{}.{:03}", micros / 1000, micros % 1000);
        for row in self.rows.iter().take_while(is_known) {
            let sent = last.map_or(0, |last| last + 1).max(row.sent.as_micros());
            last = Some(sent);
            let end = row.round_trip.map_or("-1".to_owned(), |time| millis(time.as_micros()));
            text.extend([format!("{},{end},{},7\n", millis(sent), row.queued)]);
        }
        text
    }
}

fn same_quantiles(spread: &Spread, mut times: Vec<Option<Duration>>) {
    times.sort_by_key(|time| time.unwrap_or(Duration::MAX));
    for percent in [1, 50, 90, 99, 100] {
        let rank = (times.len() * usize::try_from(percent).unwrap()).div_ceil(100);
        let expected = rank.checked_sub(1).map(|index| times[index]);
        match (spread.quantile(percent), expected) {
            (Some(Quantile::Exactly(found)), Some(Some(time))) => {
                let beyond = (found.as_secs_f64() - time.as_secs_f64()).abs();
                assert!(beyond <= time.as_secs_f64() * 1e-4, "{percent}: {found:?} for {time:?}");
            }
            (Some(Quantile::Never), Some(None)) | (None, None) => {}
            (found, expected) => panic!("{percent}: {found:?} for {expected:?}"),
        }
    }
}

/// Answers that come slowly, so that pauses begin and end; some fail, and now and then slots are
/// overslept.
#[test]
fn each_row_count_and_quantile_is_that_of_a_recount() {
    for seed in 0..40 {
        let (mut rng, written) = (Rng::with_seed(seed), WrittenRows::default());
        let rows = SlotRows::new(written.clone()).unwrap();
        let mut log = ProbeLog::new(rows, PERIOD, (RUNTIME, DEADLINE));
        let mut expected = RecountedProbe::default();
        let header = String::from_utf8(written.0.borrow().clone()).unwrap();
        let text = || String::from_utf8(written.0.borrow()[header.len()..].to_vec()).unwrap();
        let (mut due, end_of) = (Duration::ZERO, 1 + seed % 4);
        for _ in 0..rng.u64(1..400) {
            if rng.u64(0..20) == 0 {
                let slots = rng.u32(1..5);
                log.overslept(slots);
                expected.counts.slots += u64::from(slots);
                if expected.pause.is_empty() {
                    expected.counts.missed += u64::from(slots);
                } else {
                    expected.counts.skipped += u64::from(slots);
                    expected.pause.extend((0..slots).map(|slot| due + PERIOD * slot));
                }
                due += PERIOD * slots;
            }
            let now = due + Duration::from_micros(rng.u64(0..2) * rng.u64(0..10_000));
            let number = log.slot(due, now, 7);
            assert_eq!(number.is_some(), expected.slot(due, now));
            assert!(number.is_none_or(|number| number == expected.rows.len() as u64 - 1));
            while !expected.under_way.is_empty() && rng.u64(0..end_of + 1) == 0 {
                let row = expected.under_way[rng.index(expected.under_way.len())];
                let round_trip = (rng.u64(0..9) > 0).then(|| ms(50 * rng.u64(1..12)));
                log.ended(row as u64, round_trip, now);
                expected.ended(row, round_trip, now);
                assert_eq!(log.latest, expected.answers.last().copied());
            }
            log.write().unwrap();
            if rng.u64(0..8) == 0 {
                assert_eq!(text(), expected.known(false), "{seed}");
            }
            due += PERIOD;
        }
        log.finish(due).unwrap();
        expected.finish(due);
        assert_eq!(text(), expected.known(true));
        let Figures { counts, paused, answers, slots } = &log.figures;
        assert_eq!((*counts, *paused), (expected.counts, expected.paused));
        same_quantiles(answers, expected.answers.into_iter().map(Some).collect());
        same_quantiles(slots, expected.slots);
    }
}
