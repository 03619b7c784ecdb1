//! Policies: what they are made of, and what cannot work.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use fuseline_deadline::Metres;
use fuseline_ros2::parameters::Value;
use fuseline_ros2::settings::{Change, PolicyKind};

use crate::{TYPES, with};

#[test]
fn d16_policies_are_made_of_their_parameters() {
    let all = with("").unwrap();
    assert_eq!(all.deadlines.kind, PolicyKind::Set);
    assert!(all.deadlines.policy().unwrap().is_none());
    assert_eq!((all.deadlines.speed, all.deadlines.rate), (None, None));
    for (kind, expected) in [
        ("guard", PolicyKind::Guard),
        ("expected", PolicyKind::Expected),
        ("guarded", PolicyKind::Guarded),
    ] {
        let args = format!(
            "-p policy:={kind} -p policy.rate:=20 -p policy.margin:=3 -p local.in_flight:=7"
        );
        let all = with(&format!("{args} -p policy.speed_topic:=odom -p window:=20")).unwrap();
        assert_eq!(all.deadlines.kind, expected);
        assert!(all.deadlines.policy().unwrap().is_some());
        assert_eq!(all.deadlines.parameters.margin, Metres(3.0));
        assert_eq!(all.deadlines.parameters.period_cloud, Duration::from_millis(50).into());
        let speed = all.deadlines.speed.unwrap();
        assert_eq!(
            (speed.topic.as_str(), speed.type_name.as_str()),
            ("/odom", "nav_msgs/msg/Odometry")
        );
        assert_eq!(speed.age, Duration::from_millis(500));
    }
    let lingers = with("-p clouds:=[west] -p west.linger:=2.0").unwrap();
    assert_eq!(lingers.clouds[0].linger, Duration::from_secs(2));
}

#[test]
fn d15_figures_that_make_no_policy_are_reported_where_they_are() {
    let guard = "-p policy:=guard -p policy.speed_topic:=odom";
    let error = with(&format!("{guard} -p policy.range_cloud:=38.0")).unwrap_err();
    assert!(error.contains("range is shorter than local's"), "{error}");
    let error = with(&format!("{guard} -p policy.deceleration:=0.0")).unwrap_err();
    assert!(error.contains("deceleration: 0 m/s²; it must be from 0.1 to 20 m/s²"), "{error}");
    let error = with("-p policy:=fast").unwrap_err();
    assert!(error.ends_with("give set, guard, expected or guarded"), "{error}");
    let error = with("-p policy.speed_topic:=odom -p policy.speed_type:=a/msg/B").unwrap_err();
    assert!(error.ends_with("give nav_msgs/msg/Odometry or std_msgs/msg/Float64"), "{error}");
    for kind in ["guard", "guarded"] {
        let error = with(&format!("-p policy:={kind}")).unwrap_err();
        assert_eq!(
            error,
            format!(
                "-p policy:={kind}: policy is {kind}, which needs the speed, but no topic reports it; \
                 give policy.speed_topic, or another policy"
            )
        );
    }
}

/// T1, T2: what the guard promises is about one output a message.
#[test]
fn d15_a_guard_under_progressive_is_refused_with_the_remedy() {
    let under = |kind: &str, commit: &str| {
        with(&format!(
            "-p policy:={kind} -p policy.speed_topic:=odom -p commit:={commit} -p clouds:=[west]"
        ))
    };
    for kind in ["guard", "guarded"] {
        assert_eq!(
            under(kind, "progressive").unwrap_err(),
            format!(
                "-p policy:={kind}: policy is refused: the policy of west assumes one output for each \
                 message, but commit progressive may send more; give another policy, or commit patient"
            )
        );
        assert!(under(kind, "patient").is_ok());
    }
    assert!(under("expected", "progressive").is_ok() && under("set", "progressive").is_ok());
}

/// A guard for a camera of 30 Hz.
const GUARD: &str = "-p clouds:=[west] -p policy:=guard -p policy.speed_topic:=odom \
                     -p deadline:=2.4253 -p policy.local_response:=0.3";
/// The message that says what falls short, and what to do about it.
const SHORT: &str = "a window of 16 for 30 messages a second that are open for up to 2.4253 s: give 75, or cap \
     deadlines at 0.462 s; 8 calls at once to west for 30 a second that take up to 2.4253 s: give \
     73, or cap deadlines at 0.266 s; 4 local computations at once for 30 a second that take 0.3 s: \
     give 10, or send at most 13.3 messages a second";
const ENOUGH: &str = "-p window:=75 -p west.in_flight:=73 -p local.in_flight:=10";

#[test]
fn d15_what_cannot_keep_up_is_reported_with_a_remedy() {
    let unknown = with(GUARD).unwrap().to_string();
    let line = "deadlines: guard by the speed on /odom; without policy.rate nothing checks that \
                the node keeps up\n";
    assert!(unknown.contains(line), "{unknown}");
    let error = with(&format!("{GUARD} -p policy.rate:=30")).unwrap_err();
    assert_eq!(
        error,
        format!(
            "-p policy.rate:=30: policy.rate is more than the node can keep up with: {SHORT} (by \
             window, <cloud>.in_flight, local.in_flight and deadline)"
        )
    );
    let enough = with(&format!("{GUARD} {ENOUGH} -p policy.rate:=30")).unwrap();
    let line =
        "deadlines: guard by the speed on /odom; the node keeps up with 30 messages a second\n";
    assert!(enough.to_string().contains(line), "{enough}");
    // Deadlines that are set need no window of theirs.
    assert!(with("-p clouds:=[west] -p deadline:=2.4253 -p policy.rate:=30").is_ok());
}

#[test]
fn d15_a_deadline_that_the_node_cannot_keep_up_with_is_not_set_while_it_runs() {
    let all = with(&format!("{GUARD} {ENOUGH} -p policy.rate:=30")).unwrap();
    let change = |name, seconds| all.check_change(name, &Value::Double(seconds));
    let third = Duration::from_millis(300);
    assert_eq!(change("deadline", 0.3), Ok(Change::Deadline(third)));
    assert_eq!(change("west.deadline", 0.3), Ok(Change::CloudDeadline(0, Some(third))));
    for name in ["deadline", "west.deadline"] {
        let error = change(name, 3.0).unwrap_err().to_string();
        let start = format!(
            "{name} cannot be 3.0: -p policy.rate:=30: policy.rate is more than the node can keep up \
             with: a window of 75 for 30 messages a second"
        );
        assert!(error.starts_with(&start), "{error}");
        assert!(error.contains("give 93, or cap deadlines at "), "{error}");
    }
}

#[test]
fn hints_of_calls_that_end_when_they_are_due_are_none() {
    let args = "-p clouds:=[west] -p west.grpc.url:=http://a:1 -p west.hints:=late";
    assert_eq!(
        with(args).unwrap_err(),
        "-p west.hints:=late: west.hints is given, but calls end when they are due, so no result \
         comes late; give west.linger too"
    );
    let lingers = with(&format!("{args} -p west.linger:=1.0")).unwrap();
    assert_eq!(lingers.clouds[0].hints.as_deref(), Some("/late"));
    let shared = with("-p clouds:=[west] -p west.hints:=output").unwrap_err();
    assert_eq!(
        shared,
        "-p west.hints:=output: west.hints is /output, and so is output.topic; give each a topic of \
         its own"
    );
}

/// The time that the command has to end by itself.
const LONG: Duration = Duration::from_secs(30);

/// The command's end in `folder`, with a trace to be recorded there; by force if it goes on.
fn ended(folder: &Path, first: &[&str], args: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fuseline-ros2"));
    command.current_dir(folder).env_remove("RUST_LOG").args(first);
    command.arg("--ros-args").args(TYPES.split(' ')).args(args.split(' '));
    command.args(["-p", "trace.file:=run.jsonl", "-p", "localhost_only:=true"]);
    let mut running = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let start = Instant::now();
    while running.try_wait().unwrap().is_none() && start.elapsed() < LONG {
        sleep(Duration::from_millis(5));
    }
    // Nothing, if it has ended.
    running.kill().unwrap();
    running.wait_with_output().unwrap()
}

/// D15, D12.
#[test]
fn what_cannot_work_ends_the_start_and_the_check_alike_before_anything_is_started() {
    let rate = format!("{GUARD} -p policy.rate:=30");
    let cases = [
        (
            &*rate,
            format!("policy.rate is more than the node can keep up with: {SHORT} (by window,"),
        ),
        (
            "-p policy.probe_every:=0",
            "policy.probe_every is 0; give an integer from 1 to 64".into(),
        ),
        (
            "-p clouds:=[west] -p west.grpc.url:=http://localhost:1 -p west.grpc.token_file:=none",
            "the cloud west: none cannot be read: ".into(),
        ),
    ];
    let folder = tempfile::tempdir().unwrap();
    for (args, reported) in cases {
        for first in [&[][..], &["--check"]] {
            let ended = ended(folder.path(), first, args);
            let stderr = String::from_utf8(ended.stderr).unwrap();
            assert_eq!(ended.status.code(), Some(2), "{args}: {stderr}");
            assert!(
                stderr.starts_with("fuseline-ros2: ") && stderr.contains(&reported),
                "{stderr}"
            );
            assert_eq!(stderr.lines().count(), 1, "{stderr}");
            assert!(ended.stdout.is_empty(), "something else was printed");
            assert!(std::fs::read_dir(folder.path()).unwrap().next().is_none(), "{args}: a file");
        }
    }
    let fits = ended(folder.path(), &["--check"], &format!("{GUARD} {ENOUGH} -p policy.rate:=30"));
    let stdout = String::from_utf8(fits.stdout).unwrap();
    assert!(fits.status.success() && stdout.contains("keeps up with 30 messages"), "{stdout}");
}
