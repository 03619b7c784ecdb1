//! Tests that a wrong setting is reported: what is wrong, where, and what to do about it.

use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;
use std::process::Command;
use std::time::Duration;

use crate::{TYPES, settings, with};

/// Returns what is wrong with a file, below the node's name.
fn error_in(parameters: &str) -> String {
    let text =
        format!("fuseline:\n  ros__parameters:\n    {}\n", parameters.replace('\n', "\n    "));
    settings(&[&text], TYPES).unwrap_err()
}

fn error_with(args: &str) -> String {
    with(args).unwrap_err()
}

#[test]
fn what_is_wrong_in_a_file_is_reported_with_its_place() {
    let cases = [
        ("window: 0", "0.yaml:3:5: window is 0; give an integer from 1 to 1024"),
        (
            "input: {window: 1}",
            "0.yaml:3:13: there is no parameter input.window; the nearest is input.type",
        ),
        ("deadlin: 1.0", "0.yaml:3:5: there is no parameter deadlin; the nearest is deadline"),
        ("a: &b 1", "0.yaml:3:8: anchors and aliases are not supported; write the value out"),
        (
            "a: [1, 2.0]",
            "0.yaml:3:8: a must be a list of only booleans, only integers, only numbers or only strings",
        ),
        ("a: {b: }", "0.yaml:3:10: a.b has no value; give one, '' for an empty string"),
        ("a.b: 1\na: {b: 2}", "0.yaml:4:9: a.b is given twice; leave one out"),
    ];
    for (parameters, expected) in cases {
        let error = error_in(parameters);
        assert_eq!(error, expected);
    }
    let files = [
        ("- a", "0.yaml:1:1: expected a node's name with ros__parameters below it"),
        ("window: 1", "0.yaml:1:9: expected a node's name with ros__parameters below it"),
        ("ros__parameters: {}", "0.yaml:1:1: expected a node's name with ros__parameters below it"),
        ("a:\n  ros__parameters: 3", "0.yaml:2:20: expected parameters, each as name: value"),
        (
            "/a*:\n  ros__parameters: {}",
            "0.yaml:1:1: \"/a*\" is not a node's name: '*' is not a letter, digit or underscore",
        ),
    ];
    for (file, error) in files {
        assert_eq!(settings(&[file], TYPES).unwrap_err(), error);
    }
}

#[test]
fn a_deadline_above_the_greatest_is_refused_with_its_remedy() {
    let cases = [
        ("deadline:=0", "deadline is 0.0"),
        ("deadline:=.nan", "deadline is .nan"),
        ("deadline:=500", "deadline is 500.0"),
        ("local.deadline:=1e-12", "local.deadline is 1e-12"),
        ("local.deadline:=60.001", "local.deadline is 60.001"),
    ];
    for (parameter, wrong) in cases {
        let error = error_with(&format!("-p {parameter}"));
        let expected = "give seconds, more than 0 and at most greatest_deadline (60)";
        assert_eq!(error, format!("-p {parameter}: {wrong}; {expected}"));
    }
    let cloud = error_with("-p clouds:=[west] -p west.deadline:=61 -p greatest_deadline:=60.5");
    let expected =
        "give seconds, more than 0 and at most greatest_deadline (60.5), or 0 for deadline";
    assert_eq!(cloud, format!("-p west.deadline:=61: west.deadline is 61.0; {expected}"));
    let longer = with("-p deadline:=500 -p local.deadline:=500 -p greatest_deadline:=500").unwrap();
    assert_eq!(longer.deadline, Duration::from_secs(500));
    assert_eq!(longer.local.deadline, longer.greatest_deadline);
    let own = with("-p greatest_deadline:=0.2").unwrap_err();
    assert_eq!(
        own,
        "default: deadline is 0.5; give seconds, more than 0 and at most greatest_deadline (0.2)"
    );
}

#[test]
fn files_are_bounded_and_must_be_there() {
    let large = format!("# {}\n", "a".repeat(1 << 20));
    assert_eq!(
        settings(&[&large], TYPES).unwrap_err(),
        "0.yaml: the file has more than 1 MiB; give a parameter file"
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.yaml");
    std::fs::write(&path, b"a: \xff").unwrap();
    let path = path.display();
    let error = error_with(&format!("--params-file {path}"));
    assert_eq!(error, format!("{path}: not UTF-8; give a parameter file that can be read"));
    let missing = error_with("--params-file no-such.yaml");
    assert!(missing.starts_with("no-such.yaml: "), "{missing}");
    assert!(missing.ends_with("; give a parameter file that can be read"), "{missing}");
}

#[test]
fn what_is_wrong_with_a_stream_is_reported() {
    let error = settings(&[], "-p input.type:=a/msg/B").unwrap_err();
    assert_eq!(
        error,
        "-p input.type:=a/msg/B: it is unknown whether a/msg/B begins with a \
         std_msgs/Header; give input.key: header if it does, or else the type of its integer"
    );
    let error = settings(&[], "").unwrap_err();
    assert_eq!(
        error,
        "input.type is not given; give it, for example with -p \
         input.type:=sensor_msgs/msg/Image or in a parameter file"
    );
    let error = settings(&[], "-p input.type:=Image").unwrap_err();
    assert_eq!(
        error,
        "-p input.type:=Image: input.type is \"Image\"; give a type such as sensor_msgs/msg/Image"
    );
    let cases = [
        ("input.key:=int16", "input.key is \"int16\"; give header, uint32, int32, uint64 or int64"),
        (
            "input.key_offset:=0",
            "input.key_offset is for integer keys, but the key is a header; leave it out",
        ),
        (
            "input.topic:=a//b",
            "input.topic is \"a//b\", which is not a topic name: a part between slashes is \
             empty; rename it",
        ),
        ("input.topic:=", "input.topic has no value; give one, '' for an empty string"),
        (
            "input.topic:=''",
            "input.topic is \"\", which is not a topic name: it is empty; rename it",
        ),
        (
            "output.topic:=input",
            "output.topic is /input, and so is input.topic; give each a topic of its own",
        ),
        ("commit:=lazy", "commit is \"lazy\"; give eager, patient or progressive"),
        (
            "output.revisions_topic:=better",
            "output.revisions_topic is given without commit: progressive; give both or none",
        ),
        ("realtime:=100", "realtime is 100; give an integer from 0 to 99"),
        ("timers:=mine", "timers is \"mine\"; give kernel or tokio"),
        (
            "greatest_deadline:=0",
            "greatest_deadline is 0.0; give seconds, more than 0 and at most 1e9",
        ),
        ("use_sim_time:=1", "use_sim_time is 1; give true or false"),
        (
            "trace.file:=1",
            "trace.file is 1; give a string, in quotes if it looks like something else",
        ),
        ("clouds:=west", "clouds is \"west\"; give a list of names such as [west, east]"),
        ("windw:=1", "there is no parameter windw; the nearest is window"),
        (
            "qos_overrides./input.subscription.dept:=1",
            "there is no parameter qos_overrides./input.subscription.dept; the nearest is \
             qos_overrides./input.subscription.depth",
        ),
        (
            "qos_overrides./input.publisher.depth:=1",
            "there is no parameter qos_overrides./input.publisher.depth; the nearest is \
             qos_overrides./output.publisher.depth",
        ),
        (
            "qos_overrides./input.subscription.depth:=0",
            "qos_overrides./input.subscription.depth is 0; give an integer from 1 to 1024",
        ),
        (
            "qos_overrides./input.subscription.history:=keep_all",
            "qos_overrides./input.subscription.history is \"keep_all\"; give keep_last",
        ),
        (
            "qos_overrides./input.subscription.durability:=no",
            "qos_overrides./input.subscription.durability is false; give volatile or \
             transient_local",
        ),
    ];
    for (parameter, error) in cases {
        let argument = format!("-p {parameter}");
        assert_eq!(error_with(&argument), format!("{argument}: {error}"));
    }
    let error = "-p realtime:=20: realtime is 20; give 0 to a managed node, whose next configuration \
                 would start its threads with that priority";
    assert_eq!(error_with("-p lifecycle:=true -p realtime:=20"), error);
}

#[test]
fn what_is_wrong_with_a_cloud_is_reported() {
    let cases = [
        (
            "clouds:=[a__b]",
            "the cloud \"a__b\": give a name of letters, digits and single underscores",
        ),
        ("clouds:=[a,a]", "the cloud \"a\": it is given twice; leave one out"),
        (
            "clouds:=[a,b,c,d,e,f,g,h,i,j,k,l,m,x,o,p]",
            "clouds is refused: 16 clouds; there can be at most 15",
        ),
        ("west.limit:=1", "west.limit is given, but there is no cloud west; add it to clouds"),
    ];
    for (parameter, error) in cases {
        let argument = format!("-p {parameter}");
        assert_eq!(error_with(&argument), format!("{argument}: {error}"));
    }
    let cases = [
        ("a.priority:=2", "-p clouds:=[a,b]", "b has priority 2, and so has a; give each its own"),
        ("b.priority:=1", "", "b has priority 1, and so has a; give each its own"),
        ("b.priority:=0", "", "b.priority is 0; give an integer from 1 to 65535"),
        ("b.limit:=0", "", "b.limit is 0; give an integer of at least 1"),
        ("b.resume:=31", "", "b.resume is 31; give an integer from 0 to 7"),
        (
            "b.deadline:=-1",
            "",
            "b.deadline is -1.0; give seconds, more than 0 and at most greatest_deadline (60), or 0 \
             for deadline",
        ),
        ("a.grpc.ca:=f", "", "a.grpc.ca is given without a.grpc.url; give both or none"),
        (
            "a.grpc.url:=a:1",
            "",
            "a.grpc.url is \"a:1\"; give http://host:port or https://host:port",
        ),
        (
            "a.grpc.url:=https://a:1",
            "",
            "a.grpc.url is https; give the CA's certificate with a.grpc.ca",
        ),
        (
            "a.input_topic:=c -p a.grpc.url:=http://a:1",
            "-p a.input_topic:=c",
            "a.input_topic is given, but a is a gRPC server without topics; leave it out",
        ),
        (
            "a.grpc.ca:=f -p a.grpc.url:=http://a:1",
            "-p a.grpc.ca:=f",
            "a.grpc.ca is given, but a.grpc.url is http; leave it out, or use https",
        ),
        (
            "a.grpc.token_file:=f -p a.grpc.url:=http://a:1",
            "-p a.grpc.token_file:=f",
            "a.grpc.token_file is given, but a.grpc.url is http to another computer, so that anybody on the way could read \
             the token; use https, or leave it out",
        ),
        (
            "a.grpc.key:=f -p a.grpc.ca:=f -p a.grpc.url:=https://a:1",
            "-p a.grpc.key:=f",
            "a.grpc.key is given without a.grpc.certificate; give both or none",
        ),
    ];
    for (parameters, origin, error) in cases {
        let arguments = format!("-p {parameters}");
        let origin = if origin.is_empty() { &arguments } else { origin };
        assert_eq!(
            error_with(&format!("-p clouds:=[a,b] {arguments}")),
            format!("{origin}: {error}")
        );
    }
}

#[test]
fn token_stays_on_this_computer_without_tls() {
    let with_token =
        |url: &str| with(&format!("-p clouds:=[a] -p a.grpc.token_file:=f -p a.grpc.url:={url}"));
    for url in ["http://localhost:1", "http://127.0.0.1:1/", "http://[::1]:1", "http://127.9.9.9"] {
        assert!(with_token(url).is_ok(), "{url}");
    }
    for url in ["http://10.0.0.1:1", "http://localhost.example:1", "http://[::2]:1"] {
        assert!(with_token(url).is_err(), "{url}");
    }
}

#[test]
fn misspelt_name_under_a_wildcard_is_refused() {
    let shared = |parameters: &str| {
        let file = format!("/**: {{ros__parameters: {{{parameters}}}}}");
        settings(&[&file], &format!("{TYPES} -p clouds:=[west]")).map(|all| all.unheeded)
    };
    for (parameter, nearest) in [
        ("deadlin: 1.0", "deadline"),
        ("deadline_topc: a", "deadline_topic"),
        ("west.deadlines: 1.0", "west.deadline"),
        ("local.wait: 3", "local.waiting"),
        (
            "qos_overrides./west/input.publisher.dept: 1",
            "qos_overrides./west/input.publisher.depth",
        ),
    ] {
        let error = shared(parameter).unwrap_err();
        assert!(error.ends_with(&format!("; the nearest is {nearest}")), "{error}");
    }
    for parameter in ["rate: 1.0", "reverse: true", "camera.fps: 3"] {
        let idle = shared(parameter).unwrap().join("\n");
        assert!(
            idle.ends_with(" is not a parameter of this node, and counts as another node's"),
            "{idle}"
        );
    }
    let cloud = shared("north.deadline: 0.1").unwrap().join("\n");
    assert!(
        cloud.ends_with("add it to clouds, unless it is a parameter of another node"),
        "{cloud}"
    );
    let other = "qos_overrides./camera/image.subscription.depth: 1";
    assert_eq!(shared(other).unwrap().len(), 1);
}

#[test]
fn names_that_cannot_be_remapped_are_refused() {
    for (rule, why) in [
        ("~/set_parameters:=/set", "/fuseline/set_parameters cannot be renamed"),
        ("/rosout:=/log", "/rosout cannot be renamed"),
        ("fuseline:inputs:=/camera", "this node has no topic /inputs"),
    ] {
        let error = error_with(&format!("-r {rule}"));
        assert!(error.contains(why) && error.contains("; give one of /input, /output"), "{error}");
    }
    let idle = |rule: &str| with(&format!("-r {rule}")).unwrap().unheeded.len();
    assert_eq!(
        (idle("inputs:=/camera"), idle("/tf:=tf"), idle("other:inputs:=/camera")),
        (1, 0, 0)
    );
}

#[test]
fn domain_among_ports_of_other_programs_warns() {
    let cautions = |domain: u16| with(&format!("-p domain_id:={domain}")).unwrap().cautions();
    for domain in [102, 214] {
        assert!(cautions(domain)[0].contains("give 0 to 101"));
    }
    for domain in [101, 215, 232] {
        assert_eq!(cautions(domain), [""; 0]);
    }
}

#[test]
fn each_topic_has_one_use_after_remapping() {
    let shared = |args: &str| error_with(args);
    assert_eq!(
        shared("-r local/output:=/output"),
        "--remap: local.output_topic is /output, and so is output.topic; give each a topic of its \
         own"
    );
    assert_eq!(
        shared("-p input.topic:=local/input"),
        "-p input.topic:=local/input: local.input_topic is /local/input, and so is input.topic; \
         give each a topic of its own"
    );
}

/// D12.
#[test]
fn a_variable_that_is_no_text_is_wrong_and_not_missing() {
    let checked = Command::new(env!("CARGO_BIN_EXE_fuseline-ros2"))
        .args(["--check", "--ros-args"])
        .args(TYPES.split(' '))
        .env("ROS_DOMAIN_ID", OsStr::from_bytes(b"4\xff"))
        .output()
        .unwrap();
    let reported = String::from_utf8(checked.stderr).unwrap();
    assert_eq!(checked.status.code(), Some(2), "{reported}");
    assert!(reported.contains("ROS_DOMAIN_ID: domain_id is "), "{reported}");
}
