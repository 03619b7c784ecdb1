//! The level and the words of each state.

use std::sync::Arc;
use std::time::Duration;

use fuseline_engine::{
    self as shared, CloudConfig, DropReason, Ending, Engine, EngineConfig, Forwarded, OfferRefusal,
    OpenRefusal,
};
use tokio::time::Instant;

use super::*;
use crate::source::Route;

/// An event at the node, with the level and the message that it leads to.
type NodeCase = (fn(&mut Tally, &mut NodeCounts), u8, &'static str);
/// An event at a source, with the level and the message that it leads to.
type SourceCase = (fn(&mut SourceTally, &mut NodeSource), u8, &'static str);

const UNREADABLE: &str =
    "1 inputs not accepted: too short for their key, an invalid stamp, or not plain CDR";

/// The counts of a node with one cloud, at its start.
fn none() -> Tally {
    let west = CloudConfig { name: "west".into(), ..CloudConfig::new(1) };
    let config = EngineConfig { clouds: vec![west], ..EngineConfig::default() };
    Engine::<Payload, Payload>::new(config).unwrap().counts().tally()
}

/// A source that needs no topics.
fn source(priority: u16, name: &str) -> NodeSource {
    let route = Route::Grpc(Arc::new(|_, _| Box::pin(std::future::pending())));
    let (deadline, unmatched) = (None, UnmatchedResults::default());
    NodeSource {
        priority,
        name: name.into(),
        route,
        enabled: true,
        deadline,
        hints: None,
        unmatched,
    }
}

fn sources() -> [NodeSource; 2] {
    [source(0, "local"), source(1, "west")]
}

/// Both ends of the node, each with a peer.
fn ends() -> [Endpoint; 2] {
    let ends = ["/input", "/output"].map(|topic| Endpoint::new(topic, "a_msgs/msg/A"));
    for end in &ends {
        end.change([7; 16], 1, None);
    }
    ends
}

/// The report of a part of the node after a period in which this happened.
fn reported_lines(
    part: usize,
    happened: impl FnOnce(&mut Tally, &mut NodeCounts, &mut [NodeSource; 2], &[Endpoint; 2]),
) -> (u8, String) {
    let (mut tally, mut intake, mut sources, ends) =
        (none(), NodeCounts::default(), sources(), ends());
    let mut reporter = Reporter::new("/fuseline", none());
    happened(&mut tally, &mut intake, &mut sources, &ends);
    let ends = ends.each_ref();
    let mut first = reporter.period(tally.clone(), intake, &sources, &ends, None);
    // An event that happened once is reported once.
    let mut next = reporter.period(tally, intake, &sources, &ends, None);
    let (status, next) = (first.swap_remove(part), next.swap_remove(part));
    assert_eq!(status.name, format!("/fuseline: {}", ["fusion", "local", "west"][part]));
    assert_eq!(status.values, next.values, "counts are since the start");
    let lasts = ["not enabled", "no node on", "a peer on", "incompatible", "others also publish"];
    if !lasts.iter().any(|state| status.message.starts_with(state)) {
        assert_eq!(next.level, OK, "{}", next.message);
    }
    (status.level, status.message)
}

/// D15.
#[test]
fn the_node_is_ok_warns_and_errs_by_what_became_of_messages() {
    let fusion = |happened: fn(&mut Tally, &mut NodeCounts)| {
        reported_lines(0, |tally, intake, _, _| happened(tally, intake))
    };
    let cases: [NodeCase; 11] = [
        (|tally, _| tally.messages = 5, OK, "each message has its output"),
        (|tally, _| tally.missed = 2, ERROR, "2 messages missed"),
        (
            |_, intake| intake.unsent = 3,
            ERROR,
            "3 outputs not published: a subscriber is too far behind",
        ),
        (|tally, _| tally.refused = [(OpenRefusal::Full, 4)].into(), WARN, "4 messages refused"),
        (|_, intake| intake.short = 1, WARN, UNREADABLE),
        (|_, intake| intake.nanosec = 1, WARN, UNREADABLE),
        (|_, intake| intake.encoding = 1, WARN, UNREADABLE),
        (
            |_, intake| intake.duplicate_stamp = 3,
            WARN,
            "3 inputs not accepted: one of the last 1024 messages has the same stamp, as when a bag is played in a \
             loop or two publishers send the same",
        ),
        (
            |_, intake| (intake.duplicate_stamp, intake.stamp_zero) = (3, 3),
            WARN,
            "3 inputs not accepted: header.stamp is 0, as in an earlier message; let the publisher set it, or give \
             input.key",
        ),
        (
            |_, intake| (intake.duplicate_stamp, intake.stamp_zero) = (3, 2),
            WARN,
            "2 inputs not accepted: header.stamp is 0, as in an earlier message; let the publisher set it, or give \
             input.key; 1 inputs not accepted: one of the last 1024 messages has the same stamp, as when a bag is \
             played in a loop or two publishers send the same",
        ),
        (|_, intake| intake.stamp_backwards = 1, OK, "each message has its output"),
    ];
    for (happened, level, message) in cases {
        assert_eq!(fusion(happened), (level, message.to_owned()));
    }
}

#[test]
fn the_node_warns_of_topics_that_do_not_fit_and_names_those_without_peers() {
    let ends = |happened: fn(&[Endpoint; 2])| reported_lines(0, |_, _, _, ends| happened(ends));
    let unsubscribed = ends(|ends| ends[1].change([7; 16], -1, None));
    assert_eq!(unsubscribed, (OK, "no node on /output".to_owned()));
    let rivals = "others also publish on /output (2), so a message may have two results; does a second \
                  node have this name, or is a node not remapped?";
    let others = ends(|ends| ends[1].set_rivals([[1; 16], [2; 16]].into()));
    assert_eq!(others, (WARN, rivals.to_owned()));
    let other = ends(|ends| {
        ends[0].change([7; 16], -1, None);
        ends[0].change([7; 16], 1, Some(&"other".to_owned()));
    });
    assert_eq!(other, (WARN, "a peer on /input has another type: other".to_owned()));
}

/// D15.
#[test]
fn the_node_warns_of_a_speed_that_is_not_known_after_what_is_worse() {
    let reported_lines = |missed| {
        let blind = Some("no speed on /odom for 0.7 s".to_owned());
        let (tally, ends) = (Tally { missed, ..none() }, ends());
        let mut reporter = Reporter::new("/fuseline", none());
        let mut reported_lines =
            reporter.period(tally, NodeCounts::default(), &sources(), &ends.each_ref(), blind);
        let status = reported_lines.swap_remove(0);
        (status.level, status.message)
    };
    assert_eq!(reported_lines(0), (WARN, "no speed on /odom for 0.7 s".to_owned()));
    assert_eq!(reported_lines(1), (ERROR, "1 messages missed".to_owned()));
}

/// D15.
#[test]
fn the_node_warns_of_inputs_that_come_no_longer() {
    let [input, output] = ends();
    let hour = Duration::from_secs(3600);
    let now = Instant::now();
    input.patience(Some(hour));
    let reported_lines = || {
        let mut reported_lines = Reporter::new("/fuseline", none());
        let reported_lines = reported_lines.period(
            none(),
            NodeCounts::default(),
            &sources(),
            &[&input, &output],
            None,
        );
        (reported_lines[0].level, reported_lines[0].message.clone())
    };
    let well = (OK, "each message has its output".to_owned());
    assert_eq!(reported_lines(), well, "none came yet");
    input.received(now);
    assert_eq!(reported_lines(), well);
    input.patience(Some(hour));
    input.received(now.checked_sub(2 * hour).unwrap());
    let (level, message) = reported_lines();
    assert_eq!(level, WARN, "{message}");
    assert!(message.starts_with("nothing came on /input for 72"), "{message}");
    assert!(message.ends_with(" s; matched publishers: 1"), "{message}");
    input.change([7; 16], -1, None);
    let (level, message) = reported_lines();
    assert_eq!(level, WARN, "{message}");
    assert!(message.ends_with(" s; matched publishers: 0"), "{message}");
    input.change([7; 16], 1, None);
    assert_eq!(reported_lines(), well, "its publisher has as long to begin");
}

/// D15.
#[tokio::test(start_paused = true)]
async fn warns_of_inputs_that_never_came() {
    let [input, output] = ends();
    input.change([7; 16], -1, None);
    input.expect(None);
    let status = || {
        let mut reporter = Reporter::new("/fuseline", none());
        let ends = [&input, &output];
        let period = reporter.period(none(), NodeCounts::default(), &sources(), &ends, None);
        (period[0].level, period[0].message.clone())
    };
    tokio::time::advance(Duration::from_secs(10)).await;
    assert_eq!(status(), (OK, "no node on /input".to_owned()));
    tokio::time::advance(Duration::from_millis(100)).await;
    let words = "no message yet on /input for 10.1 s; matched publishers: 0";
    assert_eq!(status(), (WARN, words.to_owned()));
}

/// D15.
#[test]
fn a_source_is_ok_in_time_warns_when_others_stand_in_and_errs_without_a_result() {
    let west = |happened: fn(&mut SourceTally, &mut NodeSource)| {
        reported_lines(2, |tally, _, sources, _| happened(&mut tally.sources[1], &mut sources[1]))
    };
    let cases: [SourceCase; 13] = [
        (|_, _| {}, OK, "in time"),
        (|_, west| west.enabled = false, OK, "not enabled"),
        (
            |tally, _| (tally.admitted, tally.timers) = (3, 3),
            ERROR,
            "missing: no result to 3 requests",
        ),
        (
            |tally, _| (tally.admitted, tally.failed) = (3, 3),
            ERROR,
            "missing: no result to 3 requests",
        ),
        (
            |tally, _| (tally.admitted, tally.timers, tally.preliminary) = (3, 2, 1),
            WARN,
            "falling back: 2 requests without a result in time",
        ),
        (
            |tally, _| (tally.admitted, tally.timers, tally.preliminary) = (3, 3, 1),
            WARN,
            "falling back: 3 requests without a result in time",
        ),
        (
            |tally, _| (tally.admitted, tally.timers, tally.held) = (3, 3, 1),
            WARN,
            "falling back: 3 requests without a result in time",
        ),
        (
            |tally, _| {
                (tally.admitted, tally.timers) = (3, 3);
                tally.dropped.insert(DropReason::Late, 1);
            },
            WARN,
            "falling back: 3 requests without a result in time",
        ),
        (
            |tally, _| (tally.admitted, tally.failed) = (3, 1),
            WARN,
            "falling back: 1 requests without a result in time",
        ),
        (
            |tally, _| tally.refused = [(OfferRefusal::Queue, 2)].into(),
            WARN,
            "falling back: 2 requests refused",
        ),
        (|_, west| west.unmatched.unknown_stamp = 2, WARN, "2 results that match no message"),
        (
            |tally, west| {
                (tally.admitted, tally.timers) = (3, 3);
                (west.unmatched.unknown_stamp, west.unmatched.stamp_zero) = (3, 3);
            },
            ERROR,
            "missing: no result to 3 requests; 3 results that match no message: header.stamp is 0; copy the input's \
             header",
        ),
        (
            |_, west| west.unmatched.malformed = 1,
            WARN,
            "1 results that match no message: too short for their key, an invalid stamp, or not plain CDR",
        ),
    ];
    for (happened, level, message) in cases {
        assert_eq!(west(happened), (level, message.to_owned()));
    }
}

/// D15.
#[test]
fn the_status_of_a_message_names_its_source_and_warns_without_one() {
    let ms = Duration::from_millis;
    let of = |ending| {
        let (opened, decided, failures) = (ms(10), ms(40), Vec::new());
        let (lineage, age) = (None, None);
        let (timestamp, revision, substitute) = (3, 2, None);
        let item = Item {
            timestamp,
            opened,
            decided,
            revision,
            ending,
            failures,
            lineage,
            age,
            substitute,
            carried: None,
        };
        of_item("/fuseline", None, &item)
    };
    let source = shared::Source { priority: 1, name: "west".into() };
    let value = Payload { big_endian: false, body: bytes::Bytes::new() };
    let arrived = ms(30);
    let forwarded =
        Forwarded { value, source, arrived, trigger: Trigger::Arrival, of: None, meant_for: None };
    let preliminary = of(Ending::Preliminary(forwarded.clone()));
    assert_eq!((preliminary.level, &*preliminary.message), (OK, "west, preliminary"));
    let last = of(Ending::Final(forwarded.source.clone()));
    assert_eq!((last.level, &*last.message), (OK, "west, final"));
    for status in [preliminary, last] {
        let reported = |key| status.values.iter().find(|pair| pair.key == key).unwrap();
        let values = ["source", "rule", "revision"].map(|key| reported(key).value.as_str());
        assert_eq!(values, ["west", "F9", "2"]);
    }
    let status = of(Ending::Forwarded(forwarded));
    let reported = |key| status.values.iter().find(|pair| pair.key == key).unwrap().value.as_str();
    assert_eq!((status.level, reported("source"), reported("rule")), (OK, "west", "F3"));
    assert_eq!(
        ["timestamp", "arrived_s", "decided_s"].map(reported),
        ["3", "0.020000", "0.030000"]
    );
    assert_eq!((of(Ending::Missed).level, &*of(Ending::Missed).message), (WARN, "missed"));
    let refused = of(Ending::Refused(OpenRefusal::Full));
    assert_eq!((refused.level, &*refused.message), (WARN, "refused: full"));
}
