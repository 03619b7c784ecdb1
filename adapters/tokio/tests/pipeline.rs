//! Tests graphs of operators under one end-to-end deadline: budgets, joins, order and substitutes
//! (E1 to E9).

use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::support::ClosureOperator;
use fuseline_tokio::{
    CarriedState, Config, Ending, Item, Items, Join, JoinCause, JoinConfig, JoinDropReason, Joined,
    Latency, Lineage, Local, Operator, Origin, OutOfOrder, Overflow, Setup, spawn, stream,
};
use tokio::time::{Instant, advance, sleep, timeout};

const MS: Duration = Duration::from_millis(1);

/// An operator that works on another operator's items. It sends substitutes for missed messages if
/// it is told to.
struct Next {
    takes: Duration,
    substitute: bool,
}

impl Operator for Next {
    type Input = Item<String>;
    type Output = String;

    fn setup(self, setup: &mut Setup<Item<String>, String>) -> Local<Item<String>, String> {
        let takes = self.takes;
        if self.substitute {
            setup.use_substitute(|item| Some(format!("instead of {}", item.timestamp)));
        }
        Local::futures(9, move |item: Arc<Item<String>>, _| async move {
            sleep(takes).await;
            let value = item.value().ok_or("nothing to work on")?;
            Ok(format!("next of {value}"))
        })
    }
}

/// Returns an operator whose local takes as many milliseconds as the message says, and never ends
/// for 0.
fn takes_ms(
    setup: impl FnOnce(&mut Setup<u64, String>),
) -> impl Operator<Input = u64, Output = String> {
    ClosureOperator(|registered: &mut Setup<u64, String>| {
        setup(registered);
        Local::futures(99, |ms: Arc<u64>, _| async move {
            if *ms == 0 {
                std::future::pending::<()>().await;
            }
            sleep(Duration::from_millis(*ms)).await;
            Ok(format!("{ms}"))
        })
    })
}

fn config(reserve: impl IntoIterator<Item = Latency>) -> Config {
    Config { reserve: reserve.into_iter().collect(), ..Config::default() }
}

async fn all<T: Clone>(mut items: fuseline_tokio::Reader<T>) -> Vec<T> {
    let mut all = Vec::new();
    while let Some(item) = items.read().await {
        all.push(T::clone(&item));
    }
    all
}

/// Whatever hangs, each message leads to one item of the last operator by the end-to-end deadline
/// (E1, E2, E4).
#[tokio::test(start_paused = true)]
async fn of_a_chain_whose_first_operator_hangs_each_message_has_its_item_by_the_deadline() {
    let (mut camera, frames) = stream(8);
    let first = takes_ms(|setup| {
        setup.use_substitute(|_| Some("old boxes".into()));
    });
    let (_first, boxes) = spawn(first, config([Latency::stated(60 * MS)]), frames).unwrap();
    let next = Next { takes: 40 * MS, substitute: true };
    let (_next, plans) = spawn(next, config([]), boxes).unwrap();
    let start = Instant::now();
    // The second message hangs, and the third comes when its deadline is already over.
    for (ms, age) in [(50, 0), (0, 0), (50, 200), (0, 170)] {
        let captured = (start - age * MS).into_std();
        camera.write_with(ms, Lineage::new("camera", ms, captured).within(200 * MS)).unwrap();
    }
    drop(camera);
    let (mut ends, mut plans) = (Vec::new(), plans);
    while let Some(item) = plans.read().await {
        let age = item.lineage.as_ref().and_then(|lineage| lineage.age(Instant::now())).unwrap();
        // The item's age is the lineage's, and a substitute has none (E7).
        assert_eq!(item.age, item.substitute.is_none().then_some(age));
        ends.push((age.as_millis(), item.value().cloned().unwrap()));
    }
    ends.sort();
    let expected = [
        (90, "next of 50"),
        (180, "next of old boxes"),
        // Two timers are involved, and each may be 1 ms late.
        (202, "instead of 0"),
        (202, "instead of 1"),
    ];
    assert_eq!(ends.len(), 4);
    for ((age, value), (by, expected)) in ends.iter().zip(expected) {
        assert!(*age <= by, "{ends:?}");
        assert_eq!(value.split(' ').next(), expected.split(' ').next(), "{ends:?}");
    }
}

/// A substitute is marked as such, and its message still counts as missed (E4).
#[tokio::test(start_paused = true)]
async fn a_substitute_is_marked_and_the_message_stays_missed() {
    let (mut camera, frames) = stream(8);
    let operator = ClosureOperator(|setup: &mut Setup<u64, String>| {
        setup.use_substitute(|item| match item.timestamp {
            0 => Some("safe stop".into()),
            1 => None,
            _ => panic!("no substitute"),
        });
        Local::future(|_, _| async { Err("broken".into()) })
    });
    let (running, items) = spawn(operator, Config::default(), frames).unwrap();
    for t in 0..3 {
        camera.write(t).unwrap();
    }
    drop(camera);
    let items = all(items).await;
    let substitutes: Vec<_> = items.iter().map(|item| item.substitute.as_deref()).collect();
    assert_eq!(substitutes, [Some("safe stop"), None, None]);
    assert!(items.iter().all(|item| item.ending == Ending::Missed));
    assert_eq!(items[0].value().map(|it| &**it), Some("safe stop"));
    assert_eq!(running.join().await.unwrap().missed, 3);
}

/// A measured reserve follows the time that the operator downstream takes (E3).
#[tokio::test(start_paused = true)]
async fn a_measured_reserve_leaves_what_the_next_operator_takes() {
    let latency = Latency::measured(100, Duration::ZERO);
    let (mut camera, frames) = stream(99);
    let cloudy = takes_ms(|setup| {
        let handle = |(), call: fuseline_tokio::Call| async move {
            Ok(format!("left {}", call.deadline.as_millis()))
        };
        setup.use_cloud(handle, |_, _| Some(((), 1000 * MS)), Ok, 1);
    });
    let (_first, boxes) = spawn(cloudy, config([latency.clone()]), frames).unwrap();
    let next = Next { takes: 40 * MS, substitute: false };
    let next_config = Config { latency: Some(latency), ..Config::default() };
    let (_next, mut plans) = spawn(next, next_config, boxes).unwrap();
    let mut left = Vec::new();
    for seq in 0..20 {
        let lineage = Lineage::new("camera", seq, Instant::now()).within(200 * MS);
        camera.write_with(9, lineage).unwrap();
        left.push(plans.read().await.unwrap().value().unwrap().clone());
    }
    assert_eq!((&*left[0], &*left[19]), ("next of left 200", "next of left 160"));
}

/// Joins the items of two operators that read the same camera (E5, E7).
#[tokio::test(start_paused = true)]
async fn the_two_branches_of_a_diamond_meet_by_their_frame() {
    let (mut camera, frames) = stream(9);
    let other_frames = frames.new_reader();
    let (_fast, fast) = spawn(takes_ms(|_| {}), Config::default(), frames).unwrap();
    let slow = ClosureOperator(|_: &mut _| {
        Local::futures(9, |ms: Arc<u64>, _| async move {
            // Messages above 20 are missed.
            sleep(30 * MS).await;
            if *ms > 20 { Err("broken".into()) } else { Ok(format!("slow {ms}")) }
        })
    });
    let (_slow, slow) = spawn(slow, Config::default(), other_frames).unwrap();
    let mut join = Join::<Vec<String>>::new(JoinConfig::default());
    let put = |set: &mut Vec<String>, item: Arc<Item<String>>| {
        set.push(item.value().map_or("none", |value| value).to_owned());
        set.sort();
    };
    join.items("fast", fast, put).items("slow", slow, put);
    let (running, sets) = join.spawn().unwrap();
    let start = Instant::now();
    for (seq, ms) in [(7, 20), (8, 10), (9, 40)] {
        camera.write_with(ms, Lineage::new("camera", seq, start)).unwrap();
    }
    drop(camera);
    let sets: Vec<_> = all(sets).await.into_iter().map(|it| (it.key, it.set.join(", "))).collect();
    let expected = [(7, "20, slow 20"), (8, "10, slow 10"), (9, "40, none")];
    assert_eq!(sets, expected.map(|(key, set)| (key, set.to_owned())));
    let tally = running.join().await;
    assert_eq!(tally.given.into_iter().collect::<Vec<_>>(), [(JoinCause::Complete, 3)]);
}

/// The joined inputs of two cameras and a localization.
#[derive(Clone, Default, Debug)]
struct Scene {
    left: Option<u64>,
    right: Option<u64>,
    place: Option<u64>,
}

/// A join does not wait for a sensor that died, and each set names its missing inputs. Sensors die,
/// end, are late, and send old values (E5, E6).
#[tokio::test(start_paused = true)]
async fn nothing_waits_for_a_sensor_that_died_and_what_is_missing_is_said() {
    let (mut left, left_frames) = stream(9);
    let (mut right, right_frames) = stream(9);
    let (mut place, places) = stream(9);
    let wait = 20 * MS;
    let mut join = Join::<Scene>::new(JoinConfig { wait, ..JoinConfig::default() });
    let dropped = Arc::new(Mutex::new(Vec::new()));
    let reported = Arc::clone(&dropped);
    join.aligned("left", left_frames, |scene: &mut Scene, frame, _| scene.left = Some(*frame))
        .aligned("right", right_frames, |scene, frame, _| scene.right = Some(*frame))
        .latest("place", places, 100 * MS, |scene, place, _| scene.place = Some(*place))
        .on_drop(move |it| reported.lock().unwrap().push((it.input.to_string(), it.key, it.why)));
    let (running, mut sets) = join.spawn().unwrap();
    let start = Instant::now();
    let of = |stream: &str, seq| Lineage::new(stream, seq, Instant::now());
    let reported = |set: &Joined<Scene>| {
        let missing: Vec<_> = set.missing.iter().map(ToString::to_string).collect();
        let Scene { left, right, place } = set.set;
        (start.elapsed().as_millis(), (left, right, place), missing.join(" "))
    };
    left.write_with(1, of("left", 1)).unwrap();
    right.write_with(1, of("right", 1)).unwrap();
    let set = sets.read().await.unwrap();
    assert_eq!(reported(&set), (0, (Some(1), Some(1), None), "place".into()));
    place.write_with(70, of("place", 0)).unwrap();
    // The right camera misses one frame, which then comes late.
    left.write_with(2, of("left", 2)).unwrap();
    let set = sets.read().await.unwrap();
    assert_eq!(reported(&set), (20, (Some(2), None, Some(70)), "right".into()));
    assert_eq!(set.lineage.as_ref().unwrap().missing, set.missing);
    right.write_with(2, of("right", 2)).unwrap();
    right.write(3).unwrap();
    advance(100 * MS).await;
    right.write_with(3, of("right", 3)).unwrap();
    left.write_with(3, of("left", 3)).unwrap();
    let set = sets.read().await.unwrap();
    assert_eq!(reported(&set), (120, (Some(3), Some(3), None), "place".into()));
    // The right camera ends.
    drop(right);
    left.write_with(4, of("left", 4)).unwrap();
    let set = sets.read().await.unwrap();
    assert_eq!(reported(&set), (120, (Some(4), None, None), "right place".into()));
    drop(left);
    assert!(sets.read().await.is_none());
    let late = ("right".to_owned(), Some(2), JoinDropReason::Late);
    let unnumbered = ("right".to_owned(), None, JoinDropReason::NoKey);
    assert_eq!(*dropped.lock().unwrap(), [late, unnumbered]);
    let tally = running.join().await;
    assert_eq!((tally.given[&JoinCause::Complete], tally.given[&JoinCause::Due]), (3, 1));
    assert_eq!(tally.missing.values().sum::<u64>(), 5);
}

/// A join continues after old values, panics, ended inputs and late messages, and it counts what it
/// drops (D7, D11, E5).
#[tokio::test(start_paused = true)]
async fn a_join_keeps_the_latest_of_an_input_that_ended_and_goes_on_after_a_handler_that_panics() {
    let (mut left, frames) = stream(9);
    let (mut place, places) = stream(9);
    let mut join = Join::<Scene>::new(JoinConfig::default());
    join.aligned("left", frames, |scene: &mut Scene, frame, _| scene.left = Some(*frame));
    join.latest("place", places, 100 * MS, |scene, place, _| {
        assert!(*place != 13, "on purpose");
        scene.place = Some(*place);
    });
    let (running, mut sets) = join.spawn().unwrap();
    let captured = |seq, age: u32| Lineage::new("left", seq, Instant::now() - age * MS);
    // Ages count from the capture, not from the arrival.
    for (key, (value, age, expected)) in
        (0..).zip([(1, 0, Some(1)), (2, 101, None), (13, 0, None), (3, 100, Some(3))])
    {
        place.write_with(value, captured(key, age)).unwrap();
        left.write_with(key, captured(key, 0)).unwrap();
        let set = sets.read().await.unwrap().set.clone();
        assert_eq!((set.left, set.place), (Some(key), expected));
    }
    drop(place);
    for key in [0, 4] {
        left.write_with(key, captured(key, 0)).unwrap();
    }
    left.write(5).unwrap();
    assert_eq!(sets.read().await.unwrap().set.place, Some(3));
    drop(left);
    assert!(sets.read().await.is_none());
    let dropped: Vec<_> = running.join().await.dropped.into_values().collect();
    assert_eq!(dropped, [1, 1]);
}

/// A join reads two inputs with many messages in turn (E5).
#[tokio::test(start_paused = true)]
async fn the_inputs_of_a_join_take_turns() {
    let (mut left, left_frames) = stream(300);
    let (mut right, right_frames) = stream(300);
    let mut join = Join::<Scene>::new(JoinConfig { window: 4, ..JoinConfig::default() });
    join.aligned("left", left_frames, |scene: &mut Scene, frame, _| scene.left = Some(*frame))
        .aligned("right", right_frames, |scene, frame, _| scene.right = Some(*frame));
    for seq in 0..300 {
        for writer in [&mut left, &mut right] {
            writer.write_with(seq, Lineage::new("camera", seq, Instant::now())).unwrap();
        }
    }
    drop((left, right));
    let (running, sets) = join.spawn().unwrap();
    assert!(all(sets).await.iter().all(|it| it.set.left == it.set.right));
    let given = running.join().await.given;
    assert_eq!(given.into_iter().collect::<Vec<_>>(), [(JoinCause::Complete, 300)]);
}

/// A controller's set at each tick belongs to the newest plan and is as old as the frame behind
/// that plan. Without a fresh plan it belongs to the tick (E7).
#[tokio::test(start_paused = true)]
async fn sets_may_be_of_the_latest_message_and_are_due_by_the_aligned_ones() {
    let (mut tick, ticks) = stream(9);
    let (mut plan, plans) = stream(9);
    let mut join = Join::<Scene>::new(JoinConfig::default());
    join.aligned("tick", ticks, |_: &mut Scene, _, _: Option<&Lineage>| {})
        .latest("plan", plans, 100 * MS, |scene, plan, _| scene.place = Some(*plan))
        .origin_of("plan");
    let (_running, mut sets) = join.spawn().unwrap();
    let start = Instant::now();
    plan.write_with(7, Lineage::new("camera", 7, start).within(500 * MS)).unwrap();
    let mut lineages = Vec::new();
    for seq in 0..3 {
        advance(50 * MS).await;
        let lineage = Lineage::new("control", seq, Instant::now()).within(40 * MS);
        tick.write_with(seq, lineage).unwrap();
        let set = sets.read().await.unwrap();
        let lineage = set.lineage.clone().unwrap();
        let Origin { stream, seq } = lineage.origin.clone().unwrap();
        let due = lineage.due(Instant::now()).unwrap() - start.into_std();
        let age = lineage.age(Instant::now()).unwrap().as_millis();
        lineages.push((stream.to_string(), seq, age, due.as_millis(), lineage.missing.join(" ")));
    }
    let of_plan = |age, due| ("camera".to_owned(), Some(7), age, due, String::new());
    let of_tick = ("control".to_owned(), Some(2), 0, 190, "plan".to_owned());
    assert_eq!(lineages, [of_plan(50, 90), of_plan(100, 140), of_tick]);
    let mut join = Join::<Scene>::new(JoinConfig::default());
    join.aligned("tick", stream::<u8>(1).1, |_, _, _| {}).origin_of("tick");
    let error = join.spawn().unwrap_err().to_string();
    assert_eq!(error, "\"tick\" is not a latest-value input of this join; name one that is");
}

/// A reader that lags delays a join, which loses none of the messages that it accepted (E8).
#[tokio::test(start_paused = true)]
async fn a_join_whose_reader_lags_takes_nothing_in() {
    let (mut left, frames) = stream(4);
    let config = JoinConfig { output_len: 1, ..JoinConfig::default() };
    let mut join = Join::<Scene>::new(config.clone());
    join.aligned("left", frames, |scene, frame, _| scene.left = Some(*frame));
    let (_running, mut sets) = join.spawn().unwrap();
    let mut written = 0;
    for _ in 0..20 {
        sleep(MS).await;
        written +=
            u64::from(left.write_with(1, Lineage::new("left", written, Instant::now())).is_ok());
    }
    // One set is ready to be read, one waits for room, and four messages are still in the input
    // stream.
    assert_eq!(written, 6);
    drop(left);
    for key in 0..6 {
        assert_eq!(sets.read().await.unwrap().key, key);
    }
    assert!(sets.read().await.is_none());
    assert!(Join::<Scene>::new(JoinConfig { output_len: 0, ..config }).spawn().is_err());
}

/// The sets that a join sends at its end wait for a reader that lags (E8).
#[tokio::test(start_paused = true)]
async fn the_sets_that_a_join_gives_at_its_end_reach_a_reader_that_lags() {
    let (mut left, frames) = stream(4);
    let (right, others) = stream(4);
    let config = JoinConfig { output_len: 1, wait: 3_600_000 * MS, ..JoinConfig::default() };
    let mut join = Join::<Scene>::new(config);
    join.aligned("left", frames, |scene, frame, _| scene.left = Some(*frame)).aligned(
        "right",
        others,
        |scene, frame, _| scene.right = Some(*frame),
    );
    let (running, sets) = join.spawn().unwrap();
    for seq in 0..4 {
        left.write_with(seq, Lineage::new("camera", seq, Instant::now())).unwrap();
    }
    drop((left, right));
    sleep(MS).await;
    let read: Vec<u64> = all(sets).await.iter().map(|set| set.key).collect();
    assert_eq!(read, [0, 1, 2, 3]);
    assert_eq!(running.join().await.given.into_values().sum::<u64>(), 4);
}

/// A full join sends its oldest set to make room for another (E8).
#[tokio::test(start_paused = true)]
async fn full_join_gives_its_oldest_set() {
    let (mut left, frames) = stream(9);
    let (_right, others) = stream(9);
    let config = JoinConfig { window: 3, wait: 3_600_000 * MS, ..JoinConfig::default() };
    let mut join = Join::<Scene>::new(config);
    join.aligned("left", frames, |scene: &mut Scene, frame, _| scene.left = Some(*frame)).aligned(
        "right",
        others,
        |scene, frame, _| scene.right = Some(*frame),
    );
    let (_running, mut sets) = join.spawn().unwrap();
    for seq in 0..4 {
        left.write_with(seq, Lineage::new("camera", seq, Instant::now())).unwrap();
    }
    let set = timeout(MS, sets.read()).await.expect("four sets wait").unwrap();
    assert_eq!((set.key, set.cause), (0, JoinCause::Full));
}

/// Items wait for earlier ones until they are due, and timestamps that are passed over are reported
/// (E9).
#[tokio::test(start_paused = true)]
async fn items_wait_for_earlier_ones_until_they_are_due_and_what_was_passed_over_is_reported() {
    let (mut camera, frames) = stream(9);
    let (_running, items) = spawn(takes_ms(|_| {}), Config::default(), frames).unwrap();
    let reported = Arc::new(Mutex::new(Vec::new()));
    let report = Arc::clone(&reported);
    let report = move |it| report.lock().unwrap().push(it);
    let items: Items<String> = items.in_order(50 * MS, 10 * MS, report);
    for ms in [30, 10, 90, 35] {
        camera.write_with(ms, Lineage::new("camera", ms, Instant::now()).within(70 * MS)).unwrap();
    }
    drop(camera);
    let start = Instant::now();
    let mut items = items;
    let mut seen = Vec::new();
    while let Some(item) = items.read().await {
        seen.push((item.timestamp, start.elapsed().as_millis()));
    }
    // The third message is missed at its end-to-end deadline, and the fourth item cannot wait for
    // that long.
    assert_eq!(seen, [(0, 30), (1, 30), (3, 60)]);
    assert_eq!(*reported.lock().unwrap(), [OutOfOrder::PassedOver(2..3), OutOfOrder::Late(2)]);
}

/// Writing waits for the slowest reader, whichever reader that is (D8).
#[tokio::test(start_paused = true)]
async fn all_are_written_as_the_slowest_reader_makes_room() {
    let (writer, reader) = stream(1);
    let slow = reader.new_reader();
    let read = async |mut reader: fuseline_tokio::Reader<u64>, pause: Duration| {
        let mut count = 0;
        while reader.read().await.is_some() {
            sleep(pause).await;
            count += 1;
        }
        count
    };
    let messages = futures_util::stream::iter(0..20);
    let ends = tokio::join!(writer.write_all(messages), read(reader, MS), read(slow, 7 * MS));
    assert_eq!(ends, (Ok(20), 20, 20));
}

/// Items that wait for their turn are given when their operator is stopped (E9).
#[tokio::test(start_paused = true)]
async fn what_waits_for_its_turn_is_given_when_its_operator_is_stopped() {
    let (mut camera, frames) = stream(9);
    let (running, items) = spawn(takes_ms(|_| {}), Config::default(), frames).unwrap();
    let reported = Arc::new(Mutex::new(Vec::new()));
    let report = Arc::clone(&reported);
    let mut items = items.in_order(500 * MS, MS, move |it| report.lock().unwrap().push(it));
    for ms in [90, 10] {
        camera.write(ms).unwrap();
    }
    sleep(20 * MS).await;
    running.stop();
    assert_eq!(items.read().await.map(|item| item.timestamp), Some(1));
    assert!(items.read().await.is_none());
    assert_eq!(*reported.lock().unwrap(), [OutOfOrder::PassedOver(0..1)]);
}

/// A local that cannot keep up computes the freshest messages, or with `DropNewest` the oldest
/// (D17).
#[tokio::test(start_paused = true)]
async fn a_local_that_cannot_keep_up_computes_the_freshest() {
    for (overflow, computed) in [(Overflow::DropOldest, [0, 3]), (Overflow::DropNewest, [0, 1])] {
        let operator = ClosureOperator(move |_: &mut _| {
            let mut local = Local::future(|_, t| async move {
                sleep(50 * MS).await;
                Ok(format!("{t}"))
            });
            (local.waiting, local.overflow) = (Some(1), overflow);
            local
        });
        let (mut camera, frames) = stream(9);
        let (_running, items) = spawn(operator, Config::default(), frames).unwrap();
        for t in 0..4 {
            camera.write(t).unwrap();
            sleep(MS).await;
        }
        drop(camera);
        let items = all(items).await;
        let forwarded = items.iter().filter(|item| item.forwarded().is_some());
        assert_eq!(forwarded.map(|item| item.timestamp).collect::<Vec<_>>(), computed);
    }
}

/// Messages that begin after a cloud's result was sent use the state of that result (E10, A55).
#[tokio::test(start_paused = true)]
async fn what_begins_after_a_clouds_result_was_sent_is_computed_from_its_state() {
    let operator = ClosureOperator(|setup: &mut Setup<u64, String>| {
        let state = CarriedState::new("0".to_owned());
        let sent_along = state.clone();
        let handle = |state: String, _| async move {
            sleep(30 * MS).await;
            Ok(format!("{state}c"))
        };
        let message_handler =
            move |_: &u64, t: u64| (t == 1 || t == 4).then(|| (sent_along.current(), 100 * MS));
        setup.use_cloud(handle, message_handler, Ok, 1);
        setup.use_state(&state, String::clone);
        Local::future(move |_, t| {
            let state = state.clone();
            async move {
                let next = format!("{}l", state.current());
                // Local still computes message 1 when the cloud's result is sent, so local's state
                // is not carried on.
                sleep(if t == 1 { 35 * MS } else { MS }).await;
                state.computed(t, next.clone());
                Ok(next)
            }
        })
    });
    let (mut camera, frames) = stream(9);
    let (_running, items) = spawn(operator, Config::default(), frames).unwrap();
    for t in 0..7 {
        camera.write(t).unwrap();
        // The cloud's result for 1 comes before 2, and its result for 4 comes after 5 was computed
        // and before 6.
        sleep(if t == 1 || t == 5 { 40 * MS } else { 10 * MS }).await;
    }
    drop(camera);
    let mut items = all(items).await;
    items.sort_by_key(|item| item.timestamp);
    let values: Vec<_> = items.iter().map(|item| item.value().unwrap().as_str()).collect();
    let expected = ["0l", "0lc", "0lcl", "0lcll", "0lcllc", "0lcllll", "0lclllll"];
    assert_eq!(values, expected);
}
