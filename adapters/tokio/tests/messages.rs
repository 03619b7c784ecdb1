//! Tests that several clouds share one encoding of a message, and that items carry their messages.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use crate::support::ClosureOperator;
use fuseline_tokio::{
    Call, Commit, Config, EncodeOnce, Ending, Error, Items, Local, Setup, spawn, stream,
};
use tokio::time::sleep;

const MS: Duration = Duration::from_millis(1);

async fn read_all(mut items: Items<String>) -> Vec<(u64, String)> {
    let mut read = Vec::new();
    while let Some(item) = items.read().await {
        let value = item.value().cloned().unwrap_or_default();
        read.push((item.timestamp, format!("{value} {}", item.failures.len())));
    }
    read
}

#[tokio::test]
async fn a_message_of_two_clouds_is_encoded_once_also_if_that_fails() {
    let encodings = Arc::new(AtomicUsize::new(0));
    let counted = Arc::clone(&encodings);
    let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
        let once = EncodeOnce::new(move |message: u64| {
            counted.fetch_add(1, Ordering::Relaxed);
            if message == 2 { Err("no JPEG of 2".into()) } else { Ok(format!("{message}")) }
        });
        let send = |message: &u64, _| Some((*message, 2000 * MS));
        for (priority, name) in [(1, "west"), (2, "east")] {
            let handle = move |jpeg: String, _: Call| async move {
                if name == "east" && jpeg == "1" {
                    return Err("east is gone".into());
                }
                Ok::<_, Error>(format!("{name}'s of {jpeg}"))
            };
            setup.use_cloud(once.handle(handle), once.message_handler(send), Ok, priority);
        }
        Local::futures(3, |_, _| async {
            sleep(300 * MS).await;
            Ok("local's".to_owned())
        })
    });
    let (mut camera, frames) = stream(8);
    let config = Config { commit: Commit::Patient, ..Config::default() };
    let (_running, items) = spawn(operator, config, frames).unwrap();
    for t in 0..3 {
        camera.write(t).unwrap();
    }
    drop(camera);
    let mut read = read_all(items).await;
    read.sort();
    assert_eq!(read[0], (0, "east's of 0 0".to_owned()));
    assert_eq!(read[1], (1, "west's of 1 1".to_owned()));
    assert_eq!(read[2], (2, "local's 2".to_owned()), "both failed");
    assert_eq!(encodings.load(Ordering::Relaxed), 3);
}

#[tokio::test(start_paused = true)]
async fn items_carry_their_messages_if_that_is_wanted_and_the_operator_lets_go_of_them() {
    for carry_messages in [true, false] {
        let operator = ClosureOperator(|setup: &mut Setup<u64, String>| {
            setup.use_cloud(
                |message: u64, _: Call| async move {
                    sleep(50 * MS).await;
                    Ok::<_, Error>(format!("cloud's of {message}"))
                },
                |message: &u64, t| (t == 0).then_some((*message, 200 * MS)),
                Ok,
                1,
            );
            let mut local = Local::futures(2, |message: Arc<u64>, t| async move {
                sleep(10 * MS).await;
                if t == 1 { Err("broken".into()) } else { Ok(format!("local's of {message}")) }
            });
            local.deadline = Some(100 * MS);
            local
        });
        let commit = Commit::Progressive;
        let config = Config { commit, carry_messages, window: 2, ..Config::default() };
        let (mut camera, frames) = stream(8);
        let (running, mut items) = spawn(operator, config, frames).unwrap();
        for message in 10..13 {
            camera.write(message).unwrap();
        }
        drop(camera);
        let (mut read, mut last) = (Vec::new(), Vec::new());
        while let Some(item) = items.read().await {
            assert_eq!(item.message::<u8>(), None, "it is of another type");
            let message = item.message::<u64>();
            let kind = match &item.ending {
                Ending::Preliminary(_) => "preliminary",
                Ending::Forwarded(_) => "forwarded",
                Ending::Final(_) => "final",
                Ending::Missed => "missed",
                Ending::Refused(_) => "refused",
            };
            read.push(format!(
                "{kind} {}",
                message.as_deref().map_or("-".to_owned(), u64::to_string)
            ));
            last = message.map(|message| Arc::downgrade(&message)).into_iter().collect();
            drop(item);
        }
        drop(running.join().await);
        read.sort();
        let expected = ["forwarded 10", "missed 11", "preliminary 10", "refused 12"];
        if carry_messages {
            assert_eq!(read, expected);
            assert!(last.iter().all(|message| message.upgrade().is_none()));
        } else {
            assert!(read.iter().all(|item| item.ends_with(" -")), "{read:?}");
        }
    }
}
