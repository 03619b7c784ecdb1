//! The operators of a vehicle on one emulated link, in virtual time.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::support::ClosureOperator;
use fuseline_tokio::deadline::LinkRate;
use fuseline_tokio::{
    Call, Config, EmulatedLink, EmulatedNetwork, Error, Items, LinkDirection, Local, Running,
    SourceTally, Writer, spawn, stream,
};
use tokio::time::{Instant, sleep};

const MS: Duration = Duration::from_millis(1);
const PERIOD: Duration = Duration::from_millis(100);
const DEADLINE: Duration = Duration::from_millis(90);

/// What each call was given.
type TimesLeft = Arc<Mutex<Vec<Duration>>>;

/// 8 Mbit/s, which is a byte in a microsecond, and 400 KB of room.
fn link() -> EmulatedLink {
    EmulatedLink::new(400_000, |_, _| Some(LinkRate::constant(8_000_000)))
}

/// An operator whose cloud takes 10 ms behind a link, with its camera.
fn operator(
    link: &EmulatedLink,
    request_bytes: usize,
) -> (Writer<u64>, Running, Items<String>, TimesLeft) {
    let times_left = TimesLeft::default();
    let seen = Arc::clone(&times_left);
    let reply = move |(), call: Call| {
        seen.lock().unwrap().push(call.deadline);
        async {
            sleep(10 * MS).await;
            Ok::<_, Error>(())
        }
    };
    let handle = link.handle([request_bytes, 1_000], reply);
    let detector = ClosureOperator(move |setup: &mut fuseline_tokio::Setup<u64, String>| {
        setup.use_cloud(handle, |_, _| Some(((), DEADLINE)), |()| Ok("cloud".into()), 1);
        Local::futures(4, |_, _| async { Ok("local".into()) })
    });
    let (writer, frames) = stream(8);
    let (running, items) = spawn(detector, Config::default(), frames).unwrap();
    (writer, running, items, times_left)
}

#[tokio::test(start_paused = true)]
async fn a_call_takes_the_round_trip_of_its_moment_and_waits_where_there_is_no_network() {
    let network = EmulatedNetwork::new(|moment| (moment < 250 * MS).then_some(40 * MS));
    let times_left = TimesLeft::default();
    let seen = Arc::clone(&times_left);
    let handle = network.handle(move |(), call: Call| {
        seen.lock().unwrap().push(call.deadline);
        async {
            sleep(10 * MS).await;
            Ok::<_, Error>(())
        }
    });
    let detector = ClosureOperator(move |setup: &mut fuseline_tokio::Setup<u64, String>| {
        setup.use_cloud(handle, |_, _| Some(((), DEADLINE)), |()| Ok("cloud".into()), 1);
        Local::futures(4, |_, _| async { Ok("local".into()) })
    });
    let (camera, frames) = stream(8);
    let (_running, mut items) = spawn(detector, Config::default(), frames).unwrap();
    tokio::spawn(film(camera));
    for serial in 0..10 {
        let item = items.read().await.unwrap();
        let (whose, took) = if serial < 3 { ("cloud", 50 * MS) } else { ("local", DEADLINE) };
        assert_eq!(item.value().map(String::as_str), Some(whose));
        // Timers are served by the millisecond.
        assert!((took..took + 4 * MS).contains(&item.took()), "{serial}: {:?}", item.took());
    }
    assert_eq!(*times_left.lock().unwrap(), [70 * MS; 3]);
}

async fn film(mut camera: Writer<u64>) {
    for serial in 0..10 {
        camera.write(serial).unwrap();
        sleep(PERIOD).await;
    }
}

/// How the cloud's requests of two operators end, with 30 KB and, a millisecond later, `other` bytes each.
async fn both(one: &EmulatedLink, two: &EmulatedLink, other: usize) -> [SourceTally; 2] {
    let (camera, first, _items, _) = operator(one, 30_000);
    let (second_camera, second, _more, _) = operator(two, other);
    let later = async {
        sleep(MS).await;
        film(second_camera).await;
    };
    tokio::join!(film(camera), later);
    let [first, second] = [first.join().await.unwrap(), second.join().await.unwrap()];
    [first.sources[1].clone(), second.sources[1].clone()]
}

#[tokio::test(start_paused = true)]
async fn two_operators_wait_for_each_other_on_a_link_that_each_alone_would_fit() {
    let of_their_own = both(&link(), &link(), 60_000).await;
    assert_eq!(of_their_own.map(|it| (it.forwarded(), it.timers)), [(10, 0), (10, 0)]);
    // 30 ms and 60 ms of each 100 ms: the second is through when its deadline is over.
    let link = link();
    let shared = both(&link, &link.clone(), 60_000).await;
    assert_eq!(shared.map(|it| (it.forwarded(), it.timers)), [(10, 0), (0, 10)]);
}

#[tokio::test(start_paused = true)]
async fn an_operator_that_sends_more_than_the_link_carries_delays_all_others() {
    let link = link();
    // 125 KB in each 100 ms, which carry 100: each time another 25 ms wait.
    let ends = both(&link, &link.clone(), 95_000).await;
    assert_eq!(ends.map(|it| (it.forwarded(), it.timers)), [(2, 8), (0, 10)]);
}

#[tokio::test(start_paused = true)]
async fn the_time_in_the_uplink_is_taken_from_the_deadline() {
    let (mut camera, _running, mut items, times_left) = operator(&link(), 30_000);
    camera.write(0).unwrap();
    let item = items.read().await.unwrap();
    assert_eq!(item.value().map(String::as_str), Some("cloud"));
    assert_eq!(*times_left.lock().unwrap(), [60 * MS]);
}

#[tokio::test(start_paused = true)]
async fn a_direction_without_a_rate_does_not_wait_and_a_full_queue_refuses() {
    let up =
        |direction, _| (direction == LinkDirection::Uplink).then(|| LinkRate::constant(8_000_000));
    let link = EmulatedLink::new(10_000, up);
    let start = Instant::now();
    assert!(link.pass(LinkDirection::Downlink, usize::MAX).await);
    assert_eq!(start.elapsed(), Duration::ZERO);
    let (one, other) = tokio::join!(
        link.pass(LinkDirection::Uplink, 5_000),
        link.pass(LinkDirection::Uplink, 5_000)
    );
    assert!(one && other && start.elapsed() == 10 * MS, "{:?}", start.elapsed());
    let (one, other) = tokio::join!(
        link.pass(LinkDirection::Uplink, 5_000),
        link.pass(LinkDirection::Uplink, 6_000)
    );
    assert!(one && !other, "10 KB may wait");
}

#[tokio::test(start_paused = true)]
async fn what_a_queue_has_taken_is_sent_though_its_call_is_given_up() {
    let link = link();
    let given_up = tokio::time::timeout(MS, link.pass(LinkDirection::Uplink, 50_000)).await;
    assert!(given_up.is_err());
    let start = Instant::now();
    assert!(link.pass(LinkDirection::Uplink, 1_000).await);
    assert_eq!(start.elapsed(), 50 * MS);
}

#[tokio::test(start_paused = true)]
async fn a_reply_that_finds_no_room_does_not_come() {
    let link = EmulatedLink::new(50_000, |_, _| Some(LinkRate::constant(8_000_000)));
    let (mut camera, _running, mut items, _) = operator(&link, 1_000);
    for value in ["local", "cloud"] {
        let full = tokio::spawn({
            let (link, bytes) = (link.clone(), if value == "local" { 100_000 } else { 1_000 });
            async move { link.pass(LinkDirection::Downlink, bytes).await }
        });
        camera.write(0).unwrap();
        let item = items.read().await.unwrap();
        assert_eq!(item.value().map(String::as_str), Some(value));
        assert_eq!(item.took(), if value == "local" { DEADLINE } else { 12 * MS });
        assert!(full.await.unwrap());
    }
}
