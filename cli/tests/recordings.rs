//! `fuseline convert` of recordings of ROS 2 and others: an event is a message of a topic.

use std::collections::BTreeMap;
use std::fs;
use std::io::Cursor;
use std::path::Path;

use crate::common::{err, out, run};
use byteorder::LittleEndian;
use mcap::records::MessageHeader;
use serde_json::{Value, json};
use tempfile::tempdir;

const HEADER: &str = r#"{"fuseline":1,"window":16,"clouds":[{"p":1,"name":"west","limit":31}]}"#;
const STAMPED: &str = "std_msgs/Header header\nstring source\n===============\n\
                       MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n";
const TOPICS: &str =
    "open=/camera,west.request=/west/request,west.result=/west/objects,emit=/objects";

/// A message: its topic, when it was recorded, and its bytes.
struct RecordedMessage(&'static str, u64, Vec<u8>);

/// A message with the stamp of its frame and a source, in CDR.
fn stamped(topic: &'static str, log_time: u64, frame: u32, source: &str) -> RecordedMessage {
    let message = ((7_i32, frame, "front"), source);
    let body = cdr_encoding::to_vec::<_, LittleEndian>(&message).unwrap();
    RecordedMessage(topic, log_time, [&[0, 1, 0, 0][..], &body].concat())
}

fn frames() -> Vec<RecordedMessage> {
    vec![
        stamped("/camera", 10, 1, ""),
        stamped("/west/request", 20, 1, ""),
        stamped("/west/objects", 30, 1, ""),
        stamped("/objects", 40, 1, "west"),
    ]
}

/// Returns the events that a recording becomes in a trace, without the header.
fn expected() -> Vec<Value> {
    let t = 7_000_000_001_u64;
    vec![
        json!({"ev": "open", "at": 10, "t": t}),
        json!({"ev": "request", "at": 20, "t": t, "p": 1, "due": 40}),
        json!({"ev": "result", "at": 30, "t": t, "p": 1}),
        json!({"ev": "emit", "at": 40, "t": t, "p": 1}),
    ]
}

fn mcap(
    encoding: &str,
    schema: Option<(&str, &str, &[u8])>,
    messages: &[RecordedMessage],
) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = mcap::Writer::new(&mut bytes).unwrap();
    let add = |(name, encoding, data)| writer.add_schema(name, encoding, data).unwrap();
    let schema = schema.map_or(0, add);
    for RecordedMessage(topic, log_time, data) in messages {
        let channel_id = writer.add_channel(schema, topic, encoding, &BTreeMap::new()).unwrap();
        let (log_time, publish_time) = (*log_time, *log_time);
        let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time };
        writer.write_to_known_channel(&header, data).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

fn convert(path: &Path, more: &[&str]) -> std::process::Output {
    let header = path.with_file_name("header.jsonl");
    fs::write(&header, format!("{HEADER}\n")).unwrap();
    let start = ["convert", "--header", header.to_str().unwrap(), path.to_str().unwrap()];
    run(&[&start[..], more].concat(), "")
}

fn convert_mcap(bytes: &[u8], more: &[&str]) -> std::process::Output {
    let dir = tempdir().unwrap();
    let path = dir.path().join("drive.mcap");
    fs::write(&path, bytes).unwrap();
    convert(&path, more)
}

fn events(done: &std::process::Output) -> Vec<Value> {
    assert_eq!(done.status.code(), Some(0), "{}", err(done));
    out(done).lines().skip(1).map(|line| serde_json::from_str(line).unwrap()).collect()
}

const BY_STAMP: [&str; 4] =
    ["--topic", TOPICS, "--column", "t=header.stamp,p=source,deadline=20ns"];

#[test]
fn topics_of_ros_2_become_events() {
    let schema = Some(("robot_msgs/msg/Stamped", "ros2msg", STAMPED.as_bytes()));
    let bytes = mcap("cdr", schema, &frames());
    let done = convert_mcap(&bytes, &BY_STAMP);
    assert_eq!((events(&done), err(&done)), (expected(), ""));
}

#[test]
fn a_mistyped_topic_is_refused() {
    let schema = Some(("robot_msgs/msg/Stamped", "ros2msg", STAMPED.as_bytes()));
    let bytes = mcap("cdr", schema, &frames());
    let more = [&BY_STAMP[..], &["--topic", "west.fail=/west/reqests"]].concat();
    let done = convert_mcap(&bytes, &more);
    let message = "--topic west.fail=/west/reqests: the file has no topic \"/west/reqests\"; it \
                   has /west/request, ";
    assert_eq!(done.status.code(), Some(2), "{}", out(&done));
    assert!(err(&done).contains(message), "{}", err(&done));
    let shown = convert_mcap(&bytes, &["--explain"]);
    assert!(out(&shown).contains("; it has /"), "{}", out(&shown));
}

#[test]
fn times_of_ros_in_json_are_times() {
    let line = |topic, at, ev: &str| {
        let stamp = json!({"sec": 7, "nanosec": 1});
        let line = json!({"header": {"stamp": stamp}, "source": "west", "kind": ev});
        RecordedMessage(topic, at, line.to_string().into_bytes())
    };
    let lines = [line("/log", 10, "open"), line("/log", 40, "emit")];
    let names = ["--topic", "/log", "--column", "t=header.stamp,p=source,ev=kind"];
    let done = convert_mcap(&mcap("json", None, &lines), &names);
    let all = expected();
    assert_eq!(events(&done), [all[0].clone(), all[3].clone()]);
}

#[test]
fn a_recording_that_is_not_understood_is_refused_in_one_line() {
    let schema = |text| Some(("robot_msgs/msg/Stamped", "ros2msg", text));
    let good = schema(STAMPED.as_bytes());
    let other = Some(("robot_msgs/msg/Stamped", "ros2idl", &b"module x {}"[..]));
    let short = [RecordedMessage("/camera", 10, vec![0, 1, 0, 0, 7])];
    for (bytes, args, expected) in [
        (mcap("cdr", None, &frames()), &BY_STAMP[..], "the file has no schema for it"),
        (
            mcap("ros1", good, &frames()),
            &BY_STAMP,
            "its encoding is ros1 with a schema in ros2msg; convert reads json,",
        ),
        (
            mcap("cdr", other, &frames()),
            &BY_STAMP,
            "its encoding is cdr with a schema in ros2idl; convert reads json,",
        ),
        (mcap("cdr", schema(b"Thing x\n"), &frames()), &BY_STAMP, "has a field of type \"Thing\""),
        (mcap("cdr", good, &short), &BY_STAMP, "/camera, message 1: it ends within"),
        (mcap("cdr", good, &frames()), &["--topic", "/camera"], "name their fields with --column"),
        (
            mcap("cdr", good, &[]),
            &BY_STAMP,
            "--topic open=/camera: the file has no topic \"/camera\"",
        ),
        (mcap("cdr", good, &frames()), &["--topic", "/a,/b"], "--topic was given several times"),
        (mcap("cdr", good, &frames()), &["--topic", "came=/a"], "a trace has no event \"came\""),
    ] {
        let refused = convert_mcap(&bytes, args);
        assert_eq!(refused.status.code(), Some(2), "{expected}: {}", out(&refused));
        assert!(err(&refused).contains(expected), "{expected}: {}", err(&refused));
    }
    let dir = tempdir().unwrap();
    let refused = run(&["convert", dir.path().to_str().unwrap()], "");
    assert!(err(&refused).contains("the folder has no metadata.yaml"), "{}", err(&refused));
}

/// A recorder that was killed leaves no footer.
#[test]
fn cut_recording_is_read_up_to_its_last_message() {
    let options = mcap::WriteOptions::new().use_chunks(false);
    let mut whole = Cursor::new(Vec::new());
    let mut writer = options.create(&mut whole).unwrap();
    let (name, text) = ("robot_msgs/msg/Stamped", STAMPED.as_bytes());
    let schema = writer.add_schema(name, "ros2msg", text).unwrap();
    for RecordedMessage(topic, log_time, data) in frames() {
        let channel_id = writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap();
        let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    writer.flush().unwrap();
    // Otherwise it writes the footer.
    std::mem::forget(writer);
    let cut = whole.into_inner();
    let refused = convert_mcap(&cut, &BY_STAMP);
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        err(&refused).contains("read everything before that with --truncated"),
        "{}",
        err(&refused)
    );
    let done = convert_mcap(&cut, &[&BY_STAMP[..], &["--truncated"]].concat());
    assert_eq!(events(&done), expected());
    assert!(
        err(&done).contains("the file is cut off; read up to its last whole row"),
        "{}",
        err(&done)
    );
}

#[test]
fn parts_of_a_bag_are_read_as_one() {
    let schema = Some(("robot_msgs/msg/Stamped", "ros2msg", STAMPED.as_bytes()));
    let dir = tempdir().unwrap();
    let all = frames();
    // The second part is packed, and its messages one by one.
    let packed = |message: &RecordedMessage| {
        RecordedMessage(message.0, message.1, zstd::encode_all(&message.2[..], 0).unwrap())
    };
    let parts = [mcap("cdr", schema, &all[..2]), {
        let packed: Vec<RecordedMessage> = all[2..].iter().map(packed).collect();
        zstd::encode_all(&mcap("cdr", schema, &packed)[..], 0).unwrap()
    }];
    for (name, part) in ["bag_0.mcap", "bag_1.mcap.zstd"].iter().zip(&parts) {
        fs::write(dir.path().join(name), part).unwrap();
    }
    let header = dir.path().join("header");
    fs::write(&header, format!("{HEADER}\n")).unwrap();
    let path = |name: &str| dir.path().join(name).display().to_string();
    let read = |files: &[&str]| {
        let header = header.to_str().unwrap();
        run(&[&["convert", "--header", header], files, &BY_STAMP[..]].concat(), "")
    };
    let folder = dir.path().display().to_string();
    assert_eq!(events(&read(&[&folder])), expected());
    assert_eq!(events(&read(&[&path("bag_0.mcap"), &path("bag_1.mcap.zstd")])), expected());
    let metadata = "rosbag2_bagfile_information:\n  relative_file_paths:\n    - bag_0.mcap\n    - bag_1.mcap\n  files: []\n";
    fs::write(dir.path().join("metadata.yaml"), metadata).unwrap();
    assert_eq!(events(&read(&[&folder])), expected());
    let one = read(&[&path("bag_0.mcap")]);
    assert!(err(&one).contains("it is one file of a bag: the bag has 2 files"), "{}", err(&one));
}

/// The events of a service, by the definition of the service that recordings have instead of that
/// of the events.
#[test]
fn events_of_a_service_are_requests_and_results() {
    let event = |at: u64, kind: u8, number: i64| {
        let info = ((kind, (7_i32, 1_u32), [9_u8; 16], number), 0_u32);
        let body = cdr_encoding::to_vec::<_, LittleEndian>(&info).unwrap();
        RecordedMessage("/west/_service_event", at, [&[0, 1, 0, 0][..], &body].concat())
    };
    let schema =
        Some(("robot/srv/Infer_Event", "ros2msg", &b"string image\n---\nstring objects\n"[..]));
    let topic = "west.request=/west/_service_event,west.result=/west/_service_event";
    let options = ["--topic", topic, "--column", "t=info.sequence_number,deadline=50ns"];
    let request = json!({"ev": "request", "at": 10, "t": 4, "p": 1, "due": 60});
    for (kinds, note) in [
        ([0, 1, 2, 3], "events of a service's server, skipped because the log has its client's: 2"),
        (
            [1, 1, 2, 2],
            "events of a service's server, read in place of its client's, which were not recorded: \
             2",
        ),
    ] {
        let ats = [10, 12, 20, 22];
        let mut all: Vec<RecordedMessage> =
            ats.iter().zip(kinds).map(|(at, kind)| event(*at, kind, 4)).collect();
        if kinds[0] == 1 {
            all.remove(1);
            all.pop();
        }
        let done = convert_mcap(&mcap("cdr", schema, &all), &options);
        let at = if kinds[0] == 1 { 20 } else { 22 };
        let expected = [request.clone(), json!({"ev": "result", "at": at, "t": 4, "p": 1})];
        assert_eq!(events(&done), expected, "{}", err(&done));
        assert!(err(&done).contains(note), "{}", err(&done));
    }
    let own = "open=/west/_service_event,local.emit=/west/_service_event";
    let all = [event(10, 1, 4), event(20, 2, 4)];
    let options = ["--topic", own, "--column", "t=info.sequence_number"];
    let done = convert_mcap(&mcap("cdr", schema, &all), &options);
    let expected =
        [json!({"ev": "open", "at": 10, "t": 4}), json!({"ev": "emit", "at": 20, "t": 4, "p": 0})];
    assert_eq!(events(&done), expected, "{}", err(&done));
}

mod bags {
    use prost::Message as _;
    use prost_reflect::prost_types::field_descriptor_proto::{Label, Type};
    use prost_reflect::prost_types::{
        DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet,
    };
    use rusqlite::{Connection, params};

    use super::*;

    /// A database as rosbag2 writes it, without its indices.
    fn database(path: &Path, messages: &[RecordedMessage], definition: Option<&str>) {
        let database = Connection::open(path).unwrap();
        database
            .execute_batch(
                "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
                   serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
                 CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
                   timestamp INTEGER NOT NULL, data BLOB NOT NULL);",
            )
            .unwrap();
        if let Some(definition) = definition {
            let text = "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT,
                          encoding TEXT, encoded_message_definition TEXT)";
            database.execute(text, []).unwrap();
            let text = "INSERT INTO message_definitions VALUES (1, 'robot_msgs/msg/Stamped', 'ros2msg', ?1)";
            database.execute(text, [definition]).unwrap();
        }
        for (number, RecordedMessage(topic, at, data)) in messages.iter().enumerate() {
            let number = i64::try_from(number).unwrap();
            let text = "INSERT INTO topics VALUES (?1, ?2, 'robot_msgs/msg/Stamped', 'cdr', '')";
            database.execute(text, params![number, topic]).unwrap();
            let text = "INSERT INTO messages VALUES (?1, ?1, ?2, ?3)";
            database.execute(text, params![number, at.cast_signed(), data]).unwrap();
        }
    }

    #[test]
    fn a_database_of_rosbag2_is_read() {
        let dir = tempdir().unwrap();
        let path = dir.path().join("bag.db3");
        database(&path, &frames(), Some(STAMPED));
        let done = convert(&path, &BY_STAMP);
        assert_eq!((events(&done), err(&done)), (expected(), ""));
    }

    #[test]
    fn many_and_long_messages_are_read_in_order() {
        const STEP: u64 = 10_000_000;
        let frame = |number: u32| {
            let source = "x".repeat(if number == 100 { 100_000 } else { 0 });
            stamped("/camera", STEP * u64::from(number), number, &source)
        };
        let dir = tempdir().unwrap();
        let path = dir.path().join("bag.db3");
        let frames: Vec<RecordedMessage> = (1..=300).map(frame).collect();
        database(&path, &frames, Some(STAMPED));
        let done = convert(&path, &["--topic", "open=/camera", "--column", "t=header.stamp"]);
        let opened: Vec<u64> =
            events(&done).iter().map(|event| event["at"].as_u64().unwrap()).collect();
        assert_eq!((opened, err(&done)), ((1..=300).map(|number| STEP * number).collect(), ""));
    }

    #[test]
    fn a_database_that_is_none_is_refused_in_one_line() {
        let dir = tempdir().unwrap();
        let path = |name: &str| dir.path().join(name);
        database(&path("old.db3"), &frames(), None);
        fs::write(path("junk.db3"), "no database at all, and long enough to be looked at").unwrap();
        Connection::open(path("empty.db3")).unwrap().execute("CREATE TABLE a(b)", []).unwrap();
        let view = "CREATE TABLE topics(a); CREATE VIEW messages AS SELECT a FROM topics;";
        Connection::open(path("view.db3")).unwrap().execute_batch(view).unwrap();
        let other = "CREATE TABLE topics(\"a\nb\"); CREATE TABLE messages(id);";
        Connection::open(path("other.db3")).unwrap().execute_batch(other).unwrap();
        for (name, expected) in [
            ("other.db3", "no such column"),
            ("old.db3", "the file has no schema for it"),
            ("junk.db3", "file is not a database"),
            ("empty.db3", "the database has no table topics"),
            ("view.db3", "the database has no table messages"),
        ] {
            let refused = convert(&path(name), &BY_STAMP);
            let lines = err(&refused).lines().count();
            assert_eq!((refused.status.code(), lines), (Some(2), 1), "{}", err(&refused));
            assert!(err(&refused).contains(expected), "{expected}: {}", err(&refused));
        }
        let refused = run(&["convert", "--from", "db3", "-"], "");
        assert!(err(&refused).contains("cannot come from standard input"), "{}", err(&refused));
    }

    /// `message Event { google.protobuf.Timestamp stamp = 1; uint64 frame = 2; string kind = 3; }`
    fn descriptors() -> Vec<u8> {
        let field = |name: &str, number, kind: Type, of: Option<&str>| FieldDescriptorProto {
            name: Some(name.to_owned()),
            number: Some(number),
            label: Some(Label::Optional.into()),
            r#type: Some(kind.into()),
            type_name: of.map(str::to_owned),
            ..Default::default()
        };
        let message = |name: &str, field| DescriptorProto {
            name: Some(name.to_owned()),
            field,
            ..Default::default()
        };
        let file = |name: &str, package: &str, needs: &[&str], of| FileDescriptorProto {
            name: Some(name.to_owned()),
            package: Some(package.to_owned()),
            dependency: needs.iter().map(|name| (*name).to_owned()).collect(),
            message_type: vec![of],
            syntax: Some("proto3".to_owned()),
            ..Default::default()
        };
        let time = message(
            "Timestamp",
            vec![field("seconds", 1, Type::Int64, None), field("nanos", 2, Type::Int32, None)],
        );
        let event = message(
            "Event",
            vec![
                field("stamp", 1, Type::Message, Some(".google.protobuf.Timestamp")),
                field("frame", 2, Type::Uint64, None),
                field("kind", 3, Type::String, None),
            ],
        );
        let time_file = "google/protobuf/timestamp.proto";
        let files = vec![
            file(time_file, "google.protobuf", &[], time),
            file("event.proto", "robot", &[time_file], event),
        ];
        FileDescriptorSet { file: files }.encode_to_vec()
    }

    #[test]
    fn protobuf_is_read_by_the_descriptors_inside() {
        // The stamp of 7.5 s, frame 3, "came": fields of their own lengths behind tags.
        let stamp = [0x0a, 8, 0x08, 7, 0x10, 0x80, 0xca, 0xb5, 0xee, 0x01];
        let event = [&stamp[..], &[0x10, 3, 0x1a, 4], b"came"].concat();
        let names = ["--topic", "/log", "--column", "at=stamp,t=frame,ev=kind"];
        let names = [&names[..], &["--event", "came=open"]].concat();
        let descriptors = descriptors();
        let schema = Some(("robot.Event", "protobuf", &descriptors[..]));
        let done =
            convert_mcap(&mcap("protobuf", schema, &[RecordedMessage("/log", 1, event)]), &names);
        assert_eq!(events(&done), [json!({"ev": "open", "at": 7_500_000_000_u64, "t": 3})]);

        let junk = [RecordedMessage("/log", 1, vec![0xff; 9])];
        for (name, descriptors, expected) in [
            ("robot.Event", &descriptors[..], "/log, message 1: "),
            ("robot.Other", &descriptors, "the file's descriptors do not define it"),
            ("robot.Event", b"\xff\xff", "schema robot.Event: "),
        ] {
            let schema = Some((name, "protobuf", descriptors));
            let refused = convert_mcap(&mcap("protobuf", schema, &junk), &names);
            let lines = err(&refused).lines().count();
            assert_eq!((refused.status.code(), lines), (Some(2), 1), "{}", err(&refused));
            assert!(err(&refused).contains(expected), "{expected}: {}", err(&refused));
        }
    }
}
