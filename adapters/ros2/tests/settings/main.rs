//! Settings from arguments, parameter files and the environment.

mod faults;
mod policies;

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Duration;

use fuseline_engine::Commit;
use fuseline_ros2::arguments::{Arguments, Level};
use fuseline_ros2::key::{IntegerKind, MessageKey};
use fuseline_ros2::parameters::{Value, ValueOrigin};
use fuseline_ros2::settings::{
    Change, Cloud, CloudConnection, Grpc, Middleware, Qos, Role, Settings, SettingsError, TABLE,
};
use fuseline_tokio::Timers;

const TYPES: &str =
    "-p input.type:=sensor_msgs/msg/Image -p output.type:=vision_msgs/msg/Detection2DArray";

/// Settings of files and of arguments that are split at spaces; a file's number stands for it.
fn settings(files: &[&str], args: &str) -> Result<Settings, String> {
    settings_in(files, args, &[])
}

fn settings_in(
    files: &[&str],
    args: &str,
    environment: &[(&str, &str)],
) -> Result<Settings, String> {
    let folder = tempfile::tempdir().unwrap();
    let mut all = vec!["--ros-args".to_owned()];
    for (at, text) in files.iter().enumerate() {
        let path = folder.path().join(format!("{at}.yaml"));
        std::fs::write(&path, text).unwrap();
        all.extend(["--params-file".to_owned(), path.display().to_string()]);
    }
    all.extend(args.split(' ').filter(|arg| !arg.is_empty()).map(str::to_owned));
    let within = |text: String| text.replace(&format!("{}/", folder.path().display()), "");
    let arguments = Arguments::parse(all.into_iter().map(OsString::from))
        .map_err(|error| within(error.to_string()))?;
    let look_up = |variable: &str| {
        let found = environment.iter().find(|(name, _)| *name == variable);
        found.map(|(_, value)| (*value).to_owned())
    };
    Settings::from(&arguments, look_up).map_err(|error: SettingsError| within(error.to_string()))
}

/// Settings of the two types and more arguments.
fn with(args: &str) -> Result<Settings, String> {
    settings(&[], &format!("{TYPES} {args}"))
}

#[test]
fn two_types_are_enough() {
    let all = with("").unwrap();
    assert_eq!((all.node.full().as_str(), all.input.topic.as_str()), ("/fuseline", "/input"));
    assert_eq!((all.input.key, all.output.key), (MessageKey::Header, MessageKey::Header));
    assert_eq!((all.revisions.as_deref(), all.deadline_topic.as_deref()), (None, None));
    assert_eq!((all.silence, all.log_level, all.rosout), (None, None, true));
    let local = (all.local.input.as_str(), all.local.output.as_str(), all.local.waiting);
    assert_eq!(local, ("/local/input", "/local/output", all.window));
    assert_eq!(
        (all.status.as_str(), all.diagnostics.as_str()),
        ("/fuseline/status", "/diagnostics")
    );
    assert_eq!((all.trace.as_deref(), all.mcap.as_deref()), (None, None));
    assert!(all.clouds.is_empty() && all.cautions().is_empty());
    assert!(all.declared.iter().skip(2).all(|parameter| {
        parameter.origin == ValueOrigin::Default || parameter.name == "output.type"
    }));
}

const FULL: &str = "
/car/front:
  ros__parameters:
    input: {type: my_msgs/msg/Frame, topic: /camera/image, key: uint64, key_offset: 8, silence: 3}
    output: {type: vision_msgs/msg/Detection2DArray, topic: detections}
    window: 4
    commit: patient
    deadline: 1        # an integer will do
    deadline_topic: ~/deadline
    local.deadline: 0.25
    local: {in_flight: 2, waiting: 0, input_topic: ~/in}
    clouds: [west, east]
    west:
      deadline: 0.2
      limit: 7
      resume: 3
      in_flight: 5
      enabled: false
      output_topic: west/out
      hints: west/late
    east:
      priority: 9
      grpc:
        url: https://east:50051
        ca: ca.pem
        certificate: me.pem
        key: me.key
        token_file: token
        server_name: server
    trace: {file: a.jsonl, mcap: a.mcap}
    domain_id: 7
    localhost_only: true
    diagnostics.period: 0.5
    use_sim_time: true
    timers: tokio
    qos_overrides:
      /camera/image:
        subscription: {reliability: reliable, durability: transient_local, depth: 1}
      /car/detections.publisher: {reliability: best_effort, history: keep_last}
";
const RENAMED: &str = "-r __node:=front -r __ns:=/car";

/// D16.
#[test]
fn everything_can_be_set() {
    let all = settings(&[FULL], RENAMED).unwrap();
    assert_eq!((all.domain, all.localhost_only), (7, true));
    assert_eq!(all.input.key, MessageKey::Integer { offset: 8, kind: IntegerKind::U64 });
    assert_eq!(all.silence, Some(Duration::from_secs(3)));
    assert_eq!((all.window, all.commit), (4, Commit::Patient));
    assert_eq!(all.deadline, Duration::from_secs(1));
    assert_eq!(all.deadline_topic.as_deref(), Some("/car/front/deadline"));
    assert_eq!(all.local.input, "/car/front/in");
    assert_eq!(all.local.deadline, Duration::from_millis(250));
    assert_eq!((all.local.in_flight, all.local.waiting), (2, 0));
    let (input, output) = ("/car/west/input".into(), "/car/west/out".into());
    let way = CloudConnection::Topics { middleware: Middleware::Dds, input, output };
    let deadline = Some(Duration::from_millis(200));
    let (name, enabled, linger) = ("west".to_owned(), false, Duration::ZERO);
    let hints = Some("/car/west/late".to_owned());
    let west = Cloud {
        name,
        priority: 1,
        deadline,
        enabled,
        limit: 7,
        resume: 3,
        in_flight: 5,
        linger,
        hints,
        way,
    };
    let way = CloudConnection::Grpc(Grpc {
        url: "https://east:50051".into(),
        ca: Some("ca.pem".into()),
        certificate: Some("me.pem".into()),
        key: Some("me.key".into()),
        token_file: Some("token".into()),
        server_name: Some("server".into()),
    });
    let (name, deadline, enabled, hints) = ("east".to_owned(), None, true, None);
    let east = Cloud {
        name,
        priority: 9,
        deadline,
        enabled,
        limit: 8,
        resume: 0,
        in_flight: 8,
        linger,
        hints,
        way,
    };
    assert_eq!(all.clouds, [west, east]);
    assert_eq!(all.trace, Some(PathBuf::from("a.jsonl")));
    assert_eq!(all.mcap, Some(PathBuf::from("a.mcap")));
    assert_eq!(all.diagnostics_period, Duration::from_millis(500));
    assert!(all.use_sim_time);
    assert_eq!(all.timers, Timers::Tokio);
    let qos = |reliable, transient_local, depth| Qos { reliable, transient_local, depth };
    assert_eq!(all.topic("/camera/image").qos, qos(true, true, 1));
    assert_eq!(all.topic("/car/detections").qos, qos(false, false, 5));
    assert_eq!(all.topic("/car/west/input").qos, qos(true, false, 5));
    assert_eq!(all.topic("/car/west/out").qos, qos(false, false, 5));
    assert_eq!(all.topics.len(), 10);
    let deadline = all.declared.iter().find(|parameter| parameter.name == "deadline").unwrap();
    assert_eq!((&deadline.value, deadline.spec.at_run_time), (&Value::Double(1.0), true));
}

#[test]
fn the_middleware_is_what_ros_chose_unless_a_parameter_says_otherwise() {
    let with = |args: &str, rmw| {
        settings_in(
            &[],
            &format!("{TYPES} -p clouds:=[west] {args}"),
            &[("RMW_IMPLEMENTATION", rmw)],
        )
    };
    assert_eq!(with("", "rmw_fastrtps_cpp").unwrap().middleware, Middleware::Dds);
    assert_eq!(with("-p middleware:=dds", "rmw_zenoh_cpp").unwrap().middleware, Middleware::Dds);
    let wrong = with("-p middleware:=pigeon", "rmw_fastrtps_cpp").unwrap_err();
    assert!(wrong.contains("middleware is \"pigeon\"; give dds"), "{wrong}");
    if cfg!(feature = "zenoh") {
        let all = with("-p local.middleware:=dds", "rmw_zenoh_cpp").unwrap();
        let on = |topic| all.middleware_of(topic);
        assert_eq!((on("/input"), on("/local/input")), (Middleware::Zenoh, Middleware::Dds));
        assert_eq!((on("/west/output"), on("/output")), (Middleware::Zenoh, Middleware::Zenoh));
        assert!(all.needs(Middleware::Dds) && all.needs(Middleware::Zenoh));
        assert!(!with("", "rmw_zenoh_cpp").unwrap().needs(Middleware::Dds));
    } else {
        for refused in [with("", "rmw_zenoh_cpp"), with("-p west.middleware:=zenoh", "")] {
            let refused = refused.unwrap_err();
            assert!(refused.contains("--features zenoh"), "{refused}");
        }
    }
}

#[test]
fn arguments_win_over_files_and_later_ones_over_earlier_ones() {
    let window =
        |files: &[&str], args: &str| settings(files, &format!("{TYPES} {args}")).unwrap().window;
    let one = "/**: {ros__parameters: {window: 1}}";
    let two = "fuseline: {ros__parameters: {window: 2}}";
    assert_eq!(window(&[one], ""), 1);
    assert_eq!(window(&[one, two], ""), 2);
    assert_eq!(window(&[two, one], ""), 1);
    assert_eq!(window(&[one, two], "-p window:=3 -p window:=4"), 4);
    assert_eq!(window(&[two], "-p fuseline:window:=3 -p other:window:=4"), 3);
    // Within one file the order of the names does not count.
    assert_eq!(
        window(
            &["fuseline: {ros__parameters: {window: 2}}\n/**: {ros__parameters: {window: 1}}"],
            ""
        ),
        2
    );
    assert_eq!(
        window(&["/*: {ros__parameters: {window: 2}}\n/**: {ros__parameters: {window: 1}}"], ""),
        2
    );
}

#[test]
fn names_of_nodes_match_with_and_without_slashes_and_with_wildcards() {
    let is_ours = |name: &str| {
        let file = format!("{name}:\n  ros__parameters: {{window: 2}}\n");
        settings(&[&file], &format!("{TYPES} {RENAMED} -r __ns:=/a")).unwrap().window == 2
    };
    for name in [
        "/car/front",
        "car/front",
        "\"**\"",
        "/**",
        "/**/front",
        "/*/front",
        "/car/*",
        "/*/*",
        "/car/**",
        "/**/**",
        "/car/front/**",
    ] {
        assert!(is_ours(name), "{name}");
    }
    for name in ["front", "/*", "/car", "/*/*/*", "/car/back", "/**/car"] {
        assert!(!is_ours(name), "{name}");
    }
    let nested = "car:\n  front:\n    ros__parameters: {window: 2}\n";
    assert_eq!(settings(&[nested], &format!("{TYPES} {RENAMED}")).unwrap().window, 2);
    let empty = "car:\n  front:\n    ros__parameters:\n      # window: 2\n";
    assert_eq!(settings(&[empty], &format!("{TYPES} {RENAMED}")).unwrap().window, 16);
}

#[test]
fn topics_are_remapped_after_they_are_named() {
    let args = "-r input:=/camera/image -r fuseline:~/status:=state -r /west/input:=up -p \
                 clouds:=[west] -p output.topic:=result -r output:=/no";
    let all = with(args).unwrap();
    assert_eq!(all.input.topic, "/camera/image");
    assert_eq!(all.output.topic, "/result");
    assert_eq!(all.status, "/state");
    assert!(matches!(&all.clouds[0].way, CloudConnection::Topics { input, .. } if input == "/up"));
}

/// D16.
#[test]
fn under_progressive_revisions_have_a_topic_of_their_own_beside_the_outputs() {
    let topic = |args: &str| {
        let all = with(&format!("-p commit:=progressive {args}")).unwrap();
        assert_eq!(all.commit, Commit::Progressive);
        let name = all.revisions.clone().unwrap();
        let topic = all.topic(&name);
        let expected = ("vision_msgs/msg/Detection2DArray", Role::Publisher);
        assert_eq!((topic.type_name.as_str(), topic.role), expected);
        (name.clone(), topic.qos.depth)
    };
    assert_eq!(topic(""), ("/output/revisions".into(), 5));
    assert_eq!(topic("-r output:=/detections"), ("/detections/revisions".into(), 5));
    assert_eq!(topic("-r output:=/a -r /a/revisions:=b"), ("/b".into(), 5));
    let qos = "-p qos_overrides./car/better.publisher.depth:=7";
    let named = format!("-p output.revisions_topic:=better -r __ns:=/car {qos}");
    assert_eq!(topic(&named), ("/car/better".into(), 7));
    assert!(with("-p commit:=patient").unwrap().revisions.is_none());
}

#[test]
fn the_environment_comes_last() {
    let domain = [("ROS_DOMAIN_ID", "42"), ("ROS_LOCALHOST_ONLY", "1")];
    let all = settings_in(&[], TYPES, &domain).unwrap();
    assert_eq!((all.domain, all.localhost_only), (42, true));
    let args = format!("{TYPES} -p domain_id:=3 -p localhost_only:=false");
    let all = settings_in(&[], &args, &domain).unwrap();
    assert_eq!((all.domain, all.localhost_only), (3, false));
    for (id, shown) in [("233", "233"), ("a", "\"a\"")] {
        let error = settings_in(&[], TYPES, &[("ROS_DOMAIN_ID", id)]).unwrap_err();
        assert_eq!(
            error,
            format!("ROS_DOMAIN_ID: domain_id is {shown}; give an integer from 0 to 232")
        );
    }
}

/// The warnings about the environment.
fn unheeded(args: &str, environment: &[(&str, &str)]) -> String {
    settings_in(&[], &format!("{TYPES} {args}"), environment).unwrap().unheeded.join("\n")
}

#[test]
fn enforced_security_is_refused() {
    let enable = ("ROS_SECURITY_ENABLE", "true");
    for strategy in ["Enforce", "enforce"] {
        let environment = [enable, ("ROS_SECURITY_STRATEGY", strategy)];
        let error = settings_in(&[], TYPES, &environment).unwrap_err();
        assert!(error.contains("Enforce, but this node has no DDS security (SROS2)"), "{error}");
        assert!(error.contains("unset ROS_SECURITY_ENABLE"), "{error}");
    }
    for environment in [&[enable][..], &[enable, ("ROS_SECURITY_STRATEGY", "Permissive")]] {
        assert!(unheeded("", environment).contains("it joins unsecured"));
    }
    let unclear =
        unheeded("", &[("ROS_SECURITY_ENABLE", "1"), ("ROS_SECURITY_STRATEGY", "Enforce")]);
    assert!(unclear.contains("is \"1\", which ROS 2 reads as false; give"), "{unclear}");
    assert_eq!(unheeded("", &[("ROS_SECURITY_ENABLE", "false")]), "");
    assert_eq!(unheeded("", &[("ROS_SECURITY_ENABLE", "")]), "");
}

#[test]
fn ranges_of_discovery_are_kept_or_reported() {
    const RANGE: &str = "ROS_AUTOMATIC_DISCOVERY_RANGE";
    for (range, is_near, words) in [
        ("LOCALHOST", true, ""),
        ("SUBNET", false, ""),
        ("SYSTEM_DEFAULT", false, ""),
        ("", false, ""),
        ("OFF", true, "finds its peers by discovery alone"),
        ("localhost", true, "is not a range; LOCALHOST is assumed"),
    ] {
        let all = settings_in(&[], TYPES, &[(RANGE, range)]).unwrap();
        let warnings = all.unheeded.join("\n");
        assert_eq!(all.localhost_only, is_near, "{range}");
        assert!(warnings.contains(words) && warnings.is_empty() == words.is_empty(), "{warnings}");
    }
    let yes = unheeded("", &[("ROS_LOCALHOST_ONLY", "true")]);
    assert!(yes.contains("is \"true\", which ROS 2 reads as 0"), "{yes}");
}

#[test]
fn what_is_not_read_is_reported() {
    for (variable, value, words) in [
        ("ROS_STATIC_PEERS", "10.0.0.2;10.0.0.3", "reach others over Zenoh"),
        ("ROS_DISCOVERY_SERVER", "10.0.0.2:11811", "may find none"),
        ("CYCLONEDDS_URI", "file:///etc/cyclonedds.xml", "this node does not read it"),
        ("FASTRTPS_DEFAULT_PROFILES_FILE", "/etc/profiles.xml", "this node does not read it"),
        ("FASTDDS_DEFAULT_PROFILES_FILE", "/etc/profiles.xml", "this node does not read it"),
        ("RMW_IMPLEMENTATION", "rmw_connextdds", "which this node does not know"),
    ] {
        let warnings = unheeded("", &[(variable, value)]);
        assert!(warnings.starts_with(&format!("{variable} is ")), "{warnings}");
        assert!(warnings.contains(words), "{warnings}");
        assert_eq!(unheeded("", &[(variable, "")]), "");
    }
    assert_eq!(unheeded("-p middleware:=dds", &[("RMW_IMPLEMENTATION", "rmw_connextdds")]), "");
    for known in ["rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp", "rmw_cyclonedds_cpp"] {
        assert_eq!(unheeded("", &[("RMW_IMPLEMENTATION", known)]), "");
    }
}

#[test]
fn the_level_of_the_own_logger_wins() {
    let level = |args: &str| with(args).unwrap().log_level;
    assert_eq!(
        level("--log-level warn --log-level other:=fatal --log-level error"),
        Some(Level::Error)
    );
    assert_eq!(
        level("--log-level car.fuseline:=debug --log-level error -r __ns:=/car"),
        Some(Level::Debug)
    );
    let other = unheeded("--log-level fuseline:=debug -r __ns:=/car", &[]);
    assert!(other.contains("no logger fuseline; its own is car.fuseline"), "{other}");
    assert_eq!(unheeded("--log-level debug --log-level fuseline:=warn", &[]), "");
}

#[test]
fn what_other_nodes_get_too_is_ignored_and_reported() {
    let file = "
/**:
  ros__parameters:
    robot: r2
    window: 3
    qos_overrides./scan.subscription.depth: 2
other:
  ros__parameters: {windows: [[1]]}
";
    let all = settings(&[file], TYPES).unwrap();
    assert_eq!(all.window, 3);
    let idle = all.cautions();
    assert_eq!(idle.len(), 2, "{idle:?}");
    assert!(idle[0].contains("qos_overrides./scan.subscription.depth"), "{idle:?}");
    assert!(idle[1].contains("0.yaml:4:5: robot is not a parameter of this node"), "{idle:?}");
}

/// D16.
#[test]
fn deadlines_and_clouds_change_at_run_time_and_nothing_else() {
    let all = with("-p clouds:=[west,east]").unwrap();
    let change = |name, value| all.check_change(name, &value).map_err(|error| error.to_string());
    let half = Duration::from_millis(500);
    assert_eq!(change("deadline", Value::Double(0.5)), Ok(Change::Deadline(half)));
    assert_eq!(change("local.deadline", Value::Double(0.5)), Ok(Change::LocalDeadline(half)));
    assert_eq!(
        change("east.deadline", Value::Double(0.5)),
        Ok(Change::CloudDeadline(1, Some(half)))
    );
    assert_eq!(change("west.deadline", Value::Integer(0)), Ok(Change::CloudDeadline(0, None)));
    assert_eq!(change("east.enabled", Value::Bool(false)), Ok(Change::CloudEnabled(1, false)));
    assert_eq!(change("use_sim_time", Value::Bool(true)), Ok(Change::SimTime(true)));
    let cases = [
        (
            "deadline",
            Value::Double(f64::INFINITY),
            "deadline cannot be .inf; give seconds, more than 0 and at most greatest_deadline (60)",
        ),
        ("west.enabled", Value::Integer(1), "west.enabled cannot be 1; give true or false"),
        (
            "window",
            Value::Integer(1),
            "window is fixed while the node runs; restart it with another value",
        ),
        (
            "north.enabled",
            Value::Bool(true),
            "there is no parameter north.enabled; the nearest is west.enabled",
        ),
    ];
    for (name, value, error) in cases {
        assert_eq!(change(name, value), Err(error.to_owned()));
    }
    let dynamic = all.declared.iter().filter(|parameter| parameter.spec.at_run_time);
    let dynamic: Vec<_> = dynamic.map(|parameter| parameter.name.as_str()).collect();
    let expected = [
        "deadline",
        "local.deadline",
        "west.deadline",
        "west.enabled",
        "east.deadline",
        "east.enabled",
        "use_sim_time",
    ];
    assert_eq!(dynamic, expected);
    // A declared parameter can be set to its own value.
    for parameter in all.declared.iter().filter(|parameter| parameter.spec.at_run_time) {
        assert!(all.check_change(&parameter.name, &parameter.value).is_ok(), "{}", parameter.name);
    }
}

#[test]
fn the_check_shows_what_is_resolved() {
    let shown = settings(&[FULL], RENAMED).unwrap().to_string();
    print!("{shown}");
    for line in [
        "/car/front in domain 7, this machine only\n",
        "keys: uint64 at byte 8 of input, header of output\n",
        "reliable, transient local, 1",
        "https://east:50051",
        "0.yaml:7:5",
    ] {
        assert!(shown.contains(line), "{line}");
    }
    assert!(shown.lines().all(|line| line.trim_end() == line));
}

/// E3.
#[test]
fn an_end_to_end_deadline_has_more_than_its_reserve() {
    let all = with("").unwrap();
    assert_eq!((all.end_to_end.within, all.end_to_end.reserve), (None, Duration::ZERO));
    assert_eq!(all.end_to_end.origin, "/input");
    let all = with("-p within:=0.5 -p reserve:=0.1 -p origin:=/camera/left").unwrap();
    assert_eq!(all.end_to_end.within, Some(Duration::from_millis(500)));
    assert_eq!(all.end_to_end.reserve, Duration::from_millis(100));
    assert_eq!(all.end_to_end.origin, "/camera/left");
    for wrong in ["-p reserve:=0.1", "-p within:=0.5 -p reserve:=0.5"] {
        let why = with(wrong).unwrap_err();
        assert!(why.contains("reserve") && why.contains("less than within"), "{why}");
    }
}

/// A node reads the lines of the table and no other parameters.
#[test]
fn each_line_of_the_table_is_read() {
    let guarded = "-p policy:=guarded -p policy.rate:=20 -p policy.margin:=3 -p local.in_flight:=7 \
                   -p policy.speed_topic:=odom -p window:=20 -p output.key:=uint64";
    let nodes = [
        settings(&[FULL], RENAMED).unwrap(),
        with(guarded).unwrap(),
        with("-p commit:=progressive").unwrap(),
    ];
    let declared = nodes.iter().flat_map(|node| &node.declared).map(|parameter| {
        let name = parameter.name.strip_prefix("west.");
        let part = name.or_else(|| parameter.name.strip_prefix("east."));
        part.map_or_else(|| parameter.name.clone(), |part| format!("<cloud>.{part}"))
    });
    let read: BTreeSet<_> = declared.filter(|name| !name.starts_with("qos_overrides.")).collect();
    let lines: BTreeSet<_> = TABLE.iter().map(|line| line.name.to_owned()).collect();
    assert_eq!(read, lines);
}

/// The first part of each line is the node's own, so no cloud may have that name.
#[test]
fn no_cloud_is_called_like_a_line_of_the_table() {
    let firsts = TABLE.iter().filter_map(|line| line.name.split('.').next());
    for first in firsts.filter(|first| *first != "<cloud>") {
        let why = with(&format!("-p clouds:=[{first}]")).unwrap_err();
        assert!(why.contains("the node's own parameters begin with that name"), "{first}: {why}");
    }
}

/// The book's table is the node's; `BLESS` writes it.
#[test]
fn book_has_the_table_of_parameters() {
    const HEAD: &str = "| parameter | default | |\n|---|---|---|\n";
    const NEXT: &str = "\n## The environment\n";
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../../docs/book/src/use/ros2-parameters.md");
    let page = std::fs::read_to_string(&path).unwrap();
    let (before, rest) = page.split_once(HEAD).unwrap();
    let (_, after) = rest.split_once(NEXT).unwrap();
    let table = TABLE.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
    let expected = [before, HEAD, &table, "\n", NEXT, after].concat();
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(&path, &expected).unwrap();
    }
    assert!(page == expected, "another table; run the test with BLESS=1");
}
