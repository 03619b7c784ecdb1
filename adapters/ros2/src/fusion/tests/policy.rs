//! Deadlines that a policy chooses, and results that come too late for them.

use super::*;

/// Returns a cloud's values in the last diagnostics.
fn values_of(node: &Node, part: &str) -> Vec<(String, String)> {
    let reported_lines = node.reported_lines();
    let statuses = reported_lines.diagnostics.last().unwrap();
    let status = statuses.iter().find(|status| status.name.ends_with(part)).unwrap();
    status.values.iter().map(|it| (it.key.clone(), it.value.clone())).collect()
}

#[tokio::test(start_paused = true)]
async fn d16_the_guard_decides_by_the_speed_of_a_topic_and_diagnostics_report_the_deadline_and_why()
{
    let speed_type = "policy.speed_type:=std_msgs/msg/Float64";
    let more = ["policy:=guard", "policy.speed_topic:=speed", speed_type];
    let node = Node::start_with(|_| Answers(300), &[(2000, |_| Loses)], &more);
    let publish_report = async |speed: f64| {
        let body = Bytes::copy_from_slice(&speed.to_le_bytes());
        let speed = Payload { big_endian: false, body };
        assert!(node.peers.senders.send(ReceivedTopic::Speed, Some(speed)).await);
    };
    node.until(1).await;
    publish_report(18.0).await;
    node.feed(0, [10]).await;
    node.until(1000).await;
    publish_report(20.0).await;
    node.feed(1, [1010]).await;
    node.until(2600).await;
    // No speed was received for longer than half a second, so it is unknown, and nothing is risked.
    node.feed(2, [2610]).await;
    node.until(4500).await;
    let expected = [
        "661 ms: 0 local's of 0, asked at 10 ms by F5",
        "1322 ms: 1 local's of 1, asked at 1010 ms by F5",
        "2912 ms: 2 local's of 2, asked at 2610 ms by F5",
    ];
    assert_eq!(node.lines(), expected);
    let values = values_of(&node, "cloud1");
    let value = |key: &str| values.iter().find(|(name, _)| name == key).unwrap().1.clone();
    assert_eq!((value("deadline_s"), value("deadline_why")), ("0.301700".into(), "unsure".into()));
    let reported_lines = node.reported_lines();
    let fusion = &reported_lines.diagnostics.last().unwrap()[0];
    assert_eq!((fusion.level, &*fusion.message), (1, "no speed on /speed for 3.0 s"));
}

#[tokio::test(start_paused = true)]
async fn d16_an_expecting_node_waits_no_longer_for_a_cloud_that_is_gone_until_it_returns() {
    let more = ["policy:=expected", "policy.local_response:=0.02", "policy.probe_every:=8"];
    // The cloud is gone from message 80 to message 179, at ten messages a second.
    let act = |t| if (80..180).contains(&t) { Loses } else { Answers(60) };
    let node = Node::start_with(|_| Answers(20), &[(90, act)], &more);
    node.feed(0, (0..300).map(|t| 100 * t)).await;
    node.until(32_000).await;
    let lines = node.lines();
    assert_eq!(lines.len(), 300);
    let ends = |t: u64, who: &str, ms: u64| {
        let line = format!("{} ms: {t} {who}'s of {t}, asked at {} ms", 100 * t + ms, 100 * t);
        lines[usize::try_from(t).unwrap()].starts_with(&line)
    };
    assert!((64..80).all(|t| ends(t, "cloud1", 60)), "{lines:#?}");
    // After 64 ends without an answer, one message in eight waits for the 90 ms that it may take.
    assert!((144..180).all(|t| ends(t, "local", 20) || ends(t, "local", 90)), "{lines:#?}");
    assert!((3..=5).contains(&(144..180).filter(|t| ends(*t, "local", 90)).count()), "{lines:#?}");
    assert!((252..300).all(|t| ends(t, "cloud1", 60)), "{lines:#?}");
}

#[tokio::test(start_paused = true)]
async fn late_results_are_hints_on_a_topic_of_their_own_byte_for_byte_and_no_outputs() {
    // The third result lingers for too long.
    let lower =
        |t| [Answers(140), Answers(90), Answers(250), Answers(10)][usize::try_from(t).unwrap()];
    let best = |t| [Loses, Answers(80), Loses, Answers(5)][usize::try_from(t).unwrap()];
    let clouds: [(u64, Plan); 3] = [(100, lower), (100, |_| Answers(60)), (100, best)];
    let more = ["cloud1.linger:=0.1", "cloud1.hints:=late"];
    let node = Node::start_with(|_| Answers(20), &clouds, &more);
    node.feed(0, [0, 500, 1000, 1500]).await;
    node.until(3000).await;
    let sources = ["cloud2", "cloud3", "cloud2", "cloud3"];
    let lines = node.lines();
    assert_eq!(lines.len(), 4);
    for ((t, line), source) in lines.iter().enumerate().zip(sources) {
        assert!(line.contains(&format!(": {t} {source}'s of {t}, asked at")), "{line}");
    }
    let expected = [(140, 0, 0), (590, 1, 500), (1510, 3, 1500)];
    let expected = expected.map(|(at, t, requested)| {
        (at, payload(t, &value("cloud1", t, Duration::from_millis(requested))))
    });
    assert_eq!(*node.peers.hints.lock().unwrap(), expected);
}
