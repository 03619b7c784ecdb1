//! Tests that an operator recovers from any disturbance, and that each timer fires at its own
//! instant, however far away that is.

use std::future::pending;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::support::{ClosureOperator, CloudScript, Script, SourceAction, play};
use fuseline_tokio::deadline::{Chosen, End, MetresPerSecond, Policy, Reason, Situation};
use fuseline_tokio::{Call, Config, Error, Local, Setup, spawn, stream};
use tokio::runtime::Handle;
use tokio::time::{Instant, sleep};

const MS: Duration = Duration::from_millis(1);
const HOUR: Duration = Duration::from_secs(3600);

/// Timers fire at their own instants after a day, a year, and beyond the range of the runtime's
/// timer wheel (P8, F5, D9).
#[tokio::test(start_paused = true)]
async fn each_timer_goes_off_at_its_own_instant_however_far() {
    let days = [1, 2, 40, 366, 900].map(|days: u32| days * 24 * HOUR + days * MS);
    let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
        let message_handler = move |message: &u64, _| {
            let index = usize::try_from(*message).unwrap();
            Some(((), days[index]))
        };
        let handle = |(), _: Call| pending::<Result<String, Error>>();
        setup.use_cloud(handle, message_handler, Ok, 1).calls = 8;
        Local::futures(8, |_, _| async { Ok("local".to_owned()) })
    });
    let config = Config { greatest_deadline: Duration::MAX, ..Config::default() };
    let (mut writer, input) = stream(8);
    let (running, mut output) = spawn(operator, config, input).unwrap();
    let start = Instant::now();
    for message in (0..5).rev() {
        writer.write(message).unwrap();
    }
    for due in days {
        let item = output.read().await.unwrap();
        let late = start.elapsed().checked_sub(due);
        assert!(late.is_some_and(|late| late < 2 * MS), "{due:?}: {late:?}, {item:?}");
        assert!(
            item.latency() >= due && item.latency() < due + 2 * MS,
            "{due:?}: {:?}",
            item.latency()
        );
    }
    drop((writer, output));
    assert_eq!(running.join().await.unwrap().missed, 0);
}

/// Returns a source's action, which goes wrong in every way in turn.
fn disturbed(t: u64) -> SourceAction {
    match t % 5 {
        0 => SourceAction::Fails(3),
        1 => SourceAction::Panics(7),
        2 => SourceAction::Never,
        3 => SourceAction::Answers(400),
        _ => SourceAction::Answers(10),
    }
}

/// After any disturbance of places, queues, gates and tasks, a message is answered as the first one
/// was (D6, D7, D8, D13).
#[tokio::test(start_paused = true)]
async fn after_any_disturbance_a_message_is_answered_as_the_first_was() {
    const LAST: u64 = 400;
    let tasks = || Handle::current().metrics().num_alive_tasks();
    let before = tasks();
    for (local_disturbed, cloud_disturbed) in [(true, false), (false, true), (true, true)] {
        let local: fn(u64) -> SourceAction = if local_disturbed {
            |t| match t {
                0 | LAST => SourceAction::Answers(20),
                // This one ends late instead of never, because a computation that never ends would
                // keep its place (F7).
                t if t % 5 == 2 => SourceAction::Answers(3000),
                t => disturbed(t),
            }
        } else {
            |_| SourceAction::Answers(20)
        };
        let act: fn(u64) -> SourceAction = if cloud_disturbed {
            |t| if t == 0 || t == LAST { SourceAction::Answers(40) } else { disturbed(t) }
        } else {
            |_| SourceAction::Answers(40)
        };
        let cloud = CloudScript { priority: 1, deadline_ms: 100, act, limit: 3, calls: 2 };
        let clouds = vec![cloud, CloudScript { priority: 2, act: disturbed, ..cloud }];
        let script = Script { local, deadline: Some(200 * MS), clouds };
        // The messages come too fast for the operator. After a minute one more comes.
        let mut at: Vec<u64> = (0..LAST).map(|t| if t == 0 { 0 } else { 1000 + t * 7 }).collect();
        at.push(60_000);
        let run = play(script, Config { window: 4, ..Config::default() }, &at).await;
        let first = run.items.lines().next().unwrap().to_owned();
        let last = run.items.lines().last().unwrap().to_owned();
        // Both outputs come equally long after their messages, from the same source and for the
        // same reason.
        assert_eq!(first, "40.000 ms: 0 cloud 1 by arrival from 40 ms");
        assert_eq!(last, "60040.000 ms: 400 cloud 1 by arrival from 60040 ms", "{}", run.items);
    }
    sleep(10 * HOUR).await;
    assert_eq!(tasks(), before, "tasks are left");
}

/// A policy that records the known speeds and chooses the cap.
struct NotingPolicy(Arc<Mutex<Vec<Option<f64>>>>);

impl Policy for NotingPolicy {
    fn decide(&mut self, situation: &Situation<'_>, cap: Duration) -> Chosen {
        let MetresPerSecond(speed) = situation.speed.greatest;
        self.0.lock().unwrap().push(speed.is_finite().then_some(speed));
        Chosen { deadline: cap, reason: Reason::Constant }
    }

    fn ended(&mut self, _: End) {}
}

/// After a situation handler has failed, no speed is known until it returns one. The vehicle may be
/// faster than at the last known speed (D7).
#[tokio::test(start_paused = true)]
async fn after_a_handler_of_situations_failed_no_speed_is_known_until_it_says_one() {
    let speeds = Arc::new(Mutex::new(Vec::new()));
    let noted = Arc::clone(&speeds);
    let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
        let handle = |(), _: Call| async { Ok::<_, Error>("cloud".to_owned()) };
        let cloud = setup.use_cloud(handle, |_, _| Some(((), 90 * MS)), Ok, 1);
        cloud.policy = Some(Box::new(NotingPolicy(noted)));
        setup.use_situation(|message, _| {
            assert!(message % 2 == 0, "on purpose");
            Situation::at(MetresPerSecond(f64::from(u32::try_from(*message).unwrap()) + 5.0))
        });
        Local::futures(8, |_, _| async { Ok("local".to_owned()) })
    });
    play(operator, Config::default(), &[0, 100, 200, 300]).await;
    assert_eq!(*speeds.lock().unwrap(), [Some(5.0), None, Some(7.0), None]);
}
