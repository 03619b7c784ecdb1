//! Searches random drives for an obstacle that fusion hits and local alone does not.

mod vehicle;

use std::sync::LazyLock;
use std::time::Duration;

use fuseline_deadline::{
    Classes, Guard, Hazard, Metres, MetresPerSecond, MetresPerSecondSquared, Parameters, Situation,
    Span,
};
use fuseline_testkit::Rng;
use vehicle::{Drive, Frame};

/// The number of drives in a search.
const DRIVES: u64 = 240_000;

/// A drive, and what a guard knows about it: spans that contain the truth.
struct Setting {
    drive: Drive,
    parameters: Parameters,
    speed: Span<MetresPerSecond>,
}

/// Returns a span around the truth, which is exact in half of the cases.
fn around(random: &mut Rng, truth: f64) -> Span<f64> {
    if random.f64() < 0.5 {
        return Span::exactly(truth);
    }
    let (below, above) = (random.f64_between(0.9, 1.0), random.f64_between(1.0, 1.1));
    Span::new(truth * below, truth * above)
}

/// The frames on which the obstacle can be seen.
#[derive(Clone, Copy, PartialEq, Eq)]
enum View {
    /// From the greatest range on.
    Free,
    /// From somewhere on, which may be near.
    Late,
    /// Like [`Late`](Self::Late) or [`Free`](Self::Free), except for frames on which something
    /// passes in front of it.
    Broken,
}

/// Returns a time with a nanosecond of tolerance at each end, because it is rounded.
fn time(seconds: Span<f64>) -> Span<Duration> {
    const ROUNDING: Duration = Duration::from_nanos(1);
    let Span { least, greatest } = seconds.map(Duration::from_secs_f64);
    Span::new(least.saturating_sub(ROUNDING), greatest + ROUNDING)
}

/// The behaviour of a cloud during one drive.
#[derive(Clone, Copy)]
enum Network {
    Silent,
    Steady,
    Mixed,
    Outage,
}

fn setting(number: u64, view: View) -> Setting {
    let random = &mut Rng::with_seed(number);
    let period = 1.0 / random.one_of(&[10.0, 20.0, 30.0]);
    let speed = random.f64_between(8.0, 32.0);
    let deceleration = random.f64_between(4.0, 10.0);
    let brake_delay = random.f64_between(0.0, 0.3);
    let (least, span) = (random.f64_between(0.05, 0.5), random.one_of(&[0.0, 0.01, 0.1]));
    let local_response = Span::new(least, least + span);
    let range_local = random.f64_between(20.0, 65.0);
    let range_cloud = range_local * random.f64_between(1.0, 1.8);
    let is_late = view == View::Late || (view == View::Broken && random.f64() < 0.5);
    let hidden_beyond = if is_late { random.f64_between(3.0, range_cloud) } else { f64::INFINITY };
    let covered = if view == View::Broken { random.f64_between(0.0, 0.5) } else { 0.0 };
    let reports = random.one_of(&[1, 2, 3, 4_u32]);
    let lateness = random.one_of(&[0.0, 0.005, 0.02]);
    let is_serial = random.f64() < 0.3;
    let network =
        random.one_of(&[Network::Silent, Network::Steady, Network::Mixed, Network::Outage]);

    let start = range_cloud + speed * period * random.f64();
    let (steady, outage) = (random.f64_between(0.05, 2.5), random.f64_between(0.0, start / speed));
    let mut free = 0.0;
    let mut frames = Vec::new();
    for frame in 0.. {
        let captured = f64::from(frame) * period;
        let gap = start - speed * captured;
        // From here on braking is too late, whatever a source sees.
        if frame > 0 && gap <= speed * speed / (2.0 * deceleration) {
            break;
        }
        let takes = random.f64_between(local_response.least, local_response.greatest);
        let is_taken = !is_serial || captured >= free;
        if is_taken {
            free = captured + takes;
        }
        let cloud = match network {
            Network::Steady => steady,
            Network::Mixed => {
                random.one_of(&[0.1, 0.3, 0.6, 1.2, f64::INFINITY]) * random.f64_between(0.5, 1.5)
            }
            Network::Outage if captured < outage => steady,
            Network::Silent | Network::Outage => f64::INFINITY,
        };
        let lateness = random.f64_between(0.0, lateness);
        let is_covered = covered > 0.0 && random.f64() < covered;
        let local = is_taken.then_some(takes);
        frames.push(Frame { captured, gap, local, cloud, lateness, is_covered });
    }

    let rounded_up = |response: f64| (response / period - 1e-9).ceil() * period;
    let period_local = if is_serial {
        Span::new(rounded_up(local_response.least), rounded_up(local_response.greatest))
    } else {
        Span::exactly(period)
    };
    let hazard = Hazard {
        weight: 1.0,
        range_local: around(random, range_local).map(Metres),
        range_cloud: Metres(range_cloud).into(),
    };
    let margin = random.one_of(&[0.0, 2.0]);
    let widest = range_cloud.max(hazard.range_local.greatest.0);
    let range = Span::new(range_cloud.min(widest), widest).map(Metres);
    let hazard = Hazard { range_cloud: range, ..hazard };
    let other = Hazard {
        weight: 2.0,
        range_local: Metres(random.f64_between(10.0, 70.0)).into(),
        range_cloud: Metres(random.f64_between(70.0, 90.0)).into(),
    };
    let classes =
        if random.f64() < 0.3 { Classes::new(&[other, hazard]).unwrap() } else { hazard.into() };
    Setting {
        parameters: Parameters {
            deceleration: around(random, deceleration).map(MetresPerSecondSquared),
            brake_delay: time(around(random, brake_delay)),
            frames: reports,
            period_local: time(period_local),
            period_cloud: time(Span::exactly(period)),
            local_response: time(local_response),
            lateness: time(Span::exactly(lateness)).greatest,
            margin: Metres(margin),
            classes,
        },
        speed: around(random, speed).map(MetresPerSecond),
        drive: Drive {
            speed,
            deceleration,
            brake_delay,
            reports,
            range_local,
            range_cloud,
            hidden_beyond,
            frames,
        },
    }
}

/// Counts the drives under one policy.
#[derive(Clone, Default, Debug)]
struct SearchResult {
    /// The number of drives in which fusion collides and local alone does not.
    worse: u64,
    /// The seed of the first of them.
    seed: Option<u64>,
    /// The number of drives in which local alone collides and fusion does not.
    better: u64,
}

/// Counts the drives towards one kind of obstacle.
#[derive(Default, Debug)]
struct Search {
    /// The counts for each of [`DEADLINES`].
    results: [SearchResult; 4],
    /// The number of drives in which local alone stops.
    local_stops: u64,
    /// The counts for each case of the guard, with the obstacle in sight.
    cases: [u64; 3],
    /// The number of drives in which fusion with local's deadline collides and local alone does
    /// not, if any output without a report breaks a row.
    worse_where_any_output_counts: u64,
}

/// Returns the deadline of a frame in seconds.
type Deadline = fn(&Setting, &Guard, &Frame) -> f64;

const DEADLINES: [Deadline; 4] = [
    |_, guard, _| guard.local_response().0.as_secs_f64(),
    |setting, guard, _| guard.judge(&Situation::at(setting.speed)).deadline.as_secs_f64(),
    |setting, guard, frame| {
        let situation =
            Situation { reveal: Some(Metres(frame.gap)), ..Situation::at(setting.speed) };
        guard.judge(&situation).deadline.as_secs_f64()
    },
    |_, _, _| 0.5,
];
const T1: usize = 0;
const GUARD: usize = 1;
const GUARD_THAT_KNOWS: usize = 2;
const HALF_A_SECOND: usize = 3;

static IN_SIGHT: LazyLock<Search> = LazyLock::new(|| search(View::Free));
static HIDDEN: LazyLock<Search> = LazyLock::new(|| search(View::Late));
static COVERED: LazyLock<Search> = LazyLock::new(|| search(View::Broken));

fn search(view: View) -> Search {
    let mut search = Search::default();
    for seed in 0..DRIVES {
        let setting = setting(seed, view);
        let guard = Guard::new(setting.parameters).unwrap();
        let drive = &setting.drive;
        let local_stops = !drive.collides(&drive.local_alone());
        search.local_stops += u64::from(local_stops);
        let case = guard.judge(&Situation::at(setting.speed)).case;
        search.cases[usize::from(case.number()) - 1] += 1;
        if local_stops && view == View::Broken {
            let outputs = drive.fused(|frame| DEADLINES[T1](&setting, &guard, frame));
            let is_worse = drive.collides_where_any_output_counts(&outputs);
            search.worse_where_any_output_counts += u64::from(is_worse);
        }
        for (results, deadline) in search.results.iter_mut().zip(DEADLINES) {
            let stops = !drive.collides(&drive.fused(|frame| deadline(&setting, &guard, frame)));
            results.better += u64::from(stops && !local_stops);
            if local_stops && !stops {
                results.worse += 1;
                results.seed.get_or_insert(seed);
            }
        }
    }
    search
}

#[test]
fn the_search_sees_every_case_and_every_outcome() {
    for search in [&IN_SIGHT, &HIDDEN, &COVERED] {
        assert!(search.cases.iter().all(|seen| *seen > 10_000), "{search:?}");
        assert!(search.results.iter().all(|results| results.better > 1000), "{search:?}");
        assert!(search.local_stops > 10_000 && search.local_stops < DRIVES - 10_000, "{search:?}");
    }
}

#[test]
fn t1_locals_least_response_is_never_worse() {
    for search in [&IN_SIGHT, &HIDDEN, &COVERED] {
        assert_eq!(search.results[T1].worse, 0, "{search:?}");
    }
}

/// An obstacle may be covered on a frame that local skips. An output that truly shows nothing there
/// must break no row of local's (T4).
#[test]
fn t4_counting_any_output_is_worse_in_dozens() {
    let search = &COVERED;
    assert!(search.worse_where_any_output_counts > 20, "{search:?}");
}

/// If neither case is sure, the guard allows only local's response (T1).
#[test]
fn t2_guard_is_never_worse_in_plain_sight() {
    assert_eq!(IN_SIGHT.results[GUARD].worse, 0, "{IN_SIGHT:?}");
}

#[test]
fn t2_guard_is_never_worse_at_a_known_reveal() {
    assert_eq!(HIDDEN.results[GUARD_THAT_KNOWS].worse, 0, "{HIDDEN:?}");
    assert_eq!(IN_SIGHT.results[GUARD_THAT_KNOWS].worse, 0, "{IN_SIGHT:?}");
}

#[test]
fn t4_unannounced_nearer_reveal_may_be_hit() {
    assert!(HIDDEN.results[GUARD].worse > 2000, "{HIDDEN:?}");
}

#[test]
fn half_a_second_always_is_worse_in_thousands() {
    assert!(IN_SIGHT.results[HALF_A_SECOND].worse > 2000, "{IN_SIGHT:?}");
    assert!(HIDDEN.results[HALF_A_SECOND].worse > 2000, "{HIDDEN:?}");
}

/// The guarantee assumes that the cloud reports everything that local would report (T4).
#[test]
fn t4_blind_cloud_hides_what_local_sees() {
    let mut worse = 0;
    for seed in 0..2000 {
        let Setting { mut drive, parameters, .. } = setting(seed, View::Free);
        let local_stops = !drive.collides(&drive.local_alone());
        drive.range_cloud = 0.0;
        drive.frames.iter_mut().for_each(|frame| frame.cloud = 0.01);
        worse += u32::from(
            local_stops
                && drive.collides(&drive.fused(|_| parameters.local_response.least.as_secs_f64())),
        );
    }
    assert!(worse > 500, "{worse}");
}
