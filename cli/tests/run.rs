//! `fuseline run` and `fuseline serve`, run as a user runs them: real sockets, real time.

mod common;
#[path = "common/signal.rs"]
mod signal;

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

use common::{err, fuseline, out, run};
use rcgen::{BasicConstraints, CertificateParams, CertifiedIssuer, IsCa, KeyPair};
use serde_json::Value;
use signal::interrupt;
use tempfile::{TempDir, tempdir};

/// Runs it in a directory of its own.
fn run_in(directory: &Path, args: &[&str]) -> Output {
    fuseline(&[&["run"], args].concat()).current_dir(directory).output().unwrap()
}

fn report(output: &Output) -> Value {
    assert_eq!(out(output).lines().count(), 1, "{}{}", out(output), err(output));
    serde_json::from_str(out(output)).unwrap()
}

fn sum<'a>(counts: impl IntoIterator<Item = &'a Value>) -> u64 {
    counts.into_iter().map(|count| count.as_u64().unwrap()).sum()
}

/// What each message and each request came to adds up.
fn adds_up(report: &Value) {
    let messages = report["messages"].as_u64().unwrap();
    let sources = report["sources"].as_array().unwrap();
    let forwarded = sum(sources.iter().map(|source| &source["forwarded"]));
    let ends = [&report["missed"], &report["refused"], &report["open"]];
    assert_eq!(forwarded + sum(ends), messages, "{report}");
    for source in sources {
        let fates = source["requests"].as_object().unwrap();
        let refused = report["refused"].as_u64().unwrap();
        // Each message taken on was offered once to each cloud, and given to local.
        assert_eq!(sum(fates.values()), messages - refused, "{source}");
        assert_eq!(fates["forwarded"], source["forwarded"]);
    }
    assert_eq!(report["policies"].as_array().unwrap().len(), sources.len() + 2, "{report}");
}

/// The names in a directory.
fn names(directory: &Path) -> Vec<String> {
    let entries = fs::read_dir(directory).unwrap();
    entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn a_run_adds_up_and_leaves_a_trace_that_conforms() {
    let dir = tempdir().unwrap();
    let ran = run_in(dir.path(), &["--seconds", "2", "--json"]);
    assert_eq!(ran.status.code(), Some(0), "{}", err(&ran));
    let report = report(&ran);
    adds_up(&report);
    assert_eq!(report["messages"], 20);
    assert_eq!(report["trace"]["conforms"], true);
    assert_eq!(report["trace"]["judged"], 20);
    assert_eq!(names(dir.path()), ["fuseline-trace.jsonl"]);

    let trace = dir.path().join("fuseline-trace.jsonl");
    let trace = trace.to_str().unwrap();
    assert_eq!(run(&["check", trace], "").status.code(), Some(0));
    assert_eq!(out(&run(&["replay", trace], "")), fs::read_to_string(trace).unwrap());

    // Within what this machine took at most to serve a timer, the trace conforms as an observed one too.
    let lag_ms = report["timer_lag_ms"].as_f64().unwrap_or(0.0);
    let lateness = format!("{}us", (lag_ms * 1000.0).ceil() + 1.0);
    let observed = ["check", "--observed", "--tolerance", "1us", "--lateness", &lateness, trace];
    let checked = run(&observed, "");
    assert_eq!(checked.status.code(), Some(0), "{}", out(&checked));
    assert!(out(&checked).contains("conforms, 20 timestamps judged"), "{}", out(&checked));
}

#[test]
fn when_both_networks_are_lost_local_answers_everything() {
    let dir = tempdir().unwrap();
    let lost = ["--seconds", "1", "--json", "--start", "west=75", "--start", "east=165"];
    for commit in ["eager", "patient"] {
        let ran = run_in(dir.path(), &[&lost[..], &["--commit", commit]].concat());
        let report = report(&ran);
        adds_up(&report);
        assert_eq!(report["sources"][0]["forwarded"], 10, "{report}");
        for cloud in [1, 2] {
            let requests = &report["sources"][cloud]["requests"];
            assert_eq!(sum([&requests["late"], &requests["superseded"]]), 10, "{report}");
            assert_eq!(report["policies"][cloud + 1]["mean_ap"], 0.0, "{report}");
        }
    }
}

#[test]
fn what_a_full_window_refuses_is_counted() {
    let dir = tempdir().unwrap();
    let ran = run_in(dir.path(), &["--seconds", "1", "--window", "1", "--json"]);
    let report = report(&ran);
    adds_up(&report);
    assert_ne!(report["refused"], 0, "{report}");
}

#[test]
fn all_policies_have_the_same_limits() {
    let dir = tempdir().unwrap();
    let full = ["--seconds", "2", "--rate", "100", "--window", "256", "--workers", "64"];
    let ran = run_in(dir.path(), &[&full[..], &["--calls", "1", "--json"]].concat());
    let report = report(&ran);
    adds_up(&report);
    assert_eq!(report["calls"], 1);
    assert_ne!(report["sources"][2]["requests"]["refused"], 0, "{report}");
    // Fusion has in hand whatever comes first, so that nothing is in time without it.
    let [fusion, .., first] = &report["policies"].as_array().unwrap()[..] else { unreachable!() };
    let in_time = |policy: &Value| policy["in_time"].as_u64().unwrap();
    let sent = |policy: &Value| policy["sent_bytes"].as_u64().unwrap();
    assert!(in_time(fusion) >= in_time(first), "{report}");
    let ap = |policy: &Value| policy["mean_ap"].as_f64().unwrap();
    assert!(ap(fusion) >= ap(first), "{report}");
    // No cloud answered what it was never asked.
    for (place, cloud) in report["sources"].as_array().unwrap()[1..].iter().enumerate() {
        let requests = cloud["requests"].as_object().unwrap();
        let admitted = sum(requests.values()) - requests["refused"].as_u64().unwrap();
        assert!(in_time(&report["policies"][place + 2]) <= admitted, "{report}");
        assert_eq!(sent(&report["policies"][place + 2]), admitted * 33_300, "{report}");
    }
}

#[test]
fn a_run_leaves_its_page_if_wanted_and_never_in_place_of_its_trace() {
    let dir = tempdir().unwrap();
    let short = ["--seconds", "0.3", "--trace", "t.jsonl"];
    let ran = run_in(dir.path(), &[&short[..], &["--report"]].concat());
    assert_eq!(ran.status.code(), Some(0), "{}", err(&ran));
    assert_eq!(out(&ran).lines().last(), Some("report.html: the page of this run"));
    let page = fs::read_to_string(dir.path().join("report.html")).unwrap();
    assert!(page.contains(r#""file":"t.jsonl""#));
    let named = run_in(dir.path(), &[&short[..], &["--json", "--report=mine.html"]].concat());
    report(&named);
    assert!(dir.path().join("mine.html").is_file());

    let trace = fs::read(dir.path().join("t.jsonl")).unwrap();
    for same in ["--report=t.jsonl", "--report=./t.jsonl"] {
        let refused = run_in(dir.path(), &[&short[..], &[same]].concat());
        assert_eq!(refused.status.code(), Some(2), "{}", out(&refused));
        assert!(err(&refused).contains("give the page"));
    }
    assert_eq!(fs::read(dir.path().join("t.jsonl")).unwrap(), trace);
    let alone = run_in(dir.path(), &["--open"]);
    assert!(err(&alone).contains("--report"), "{}", err(&alone));
}

#[test]
fn people_read_tables_of_at_most_100_columns() {
    let dir = tempdir().unwrap();
    let ran = run_in(dir.path(), &["--seconds", "1", "--trace", "mine.jsonl"]);
    for part in [
        "DETR-ResNet-50 on Orin",
        "pipelined over 4 workers",
        "emulated",
        "requests   forwarded   discarded   late   failed   superseded   refused",
        "10 messages: ",
        "fusion",
        "local only",
        "cloud only: west",
        "first response wins",
        "mine.jsonl: conforms, 10 timestamps judged",
    ] {
        assert!(out(&ran).contains(part), "{part} is not in\n{}", out(&ran));
    }
    assert!(out(&ran).lines().all(|line| line.chars().count() <= 100), "{}", out(&ran));
    assert_eq!(names(dir.path()), ["mine.jsonl"]);
}

#[test]
fn ctrl_c_ends_a_run_with_its_tables_and_a_whole_trace() {
    let dir = tempdir().unwrap();
    let mut child = fuseline(&["run", "--seconds", "3600"])
        .current_dir(dir.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
    assert!(lines.next().unwrap().contains("a second for 3600 s"));
    interrupt(&child);
    let told: Vec<String> = lines.collect();
    assert!(told.iter().any(|line| line.starts_with("Ended early")), "{told:?}");
    assert!(told.last().unwrap().contains("fuseline-trace.jsonl: conforms"), "{told:?}");
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert_eq!(names(dir.path()), ["fuseline-trace.jsonl"]);
}

/// Frames come much faster than before while the operator makes up for three seconds: neither a
/// frame nor an output may wait for the other.
#[cfg(unix)]
#[test]
fn a_run_that_stood_still_goes_on_and_ctrl_c_ends_it() {
    for presses in [false, true] {
        let dir = tempdir().unwrap();
        let seconds = if presses { "3600" } else { "5" };
        let args = ["run", "--rate", "100", "--seconds", seconds, "--window", "128"];
        let mut child = fuseline(&args)
            .current_dir(dir.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
        assert!(lines.next().unwrap().contains("takes 100 frames"));
        thread::sleep(Duration::from_secs(1));
        signal::send(&child, "STOP");
        thread::sleep(Duration::from_secs(3));
        signal::send(&child, "CONT");
        if presses {
            thread::sleep(Duration::from_secs(1));
            interrupt(&child);
        }
        let told = ended(child, lines);
        assert!(told.last().unwrap().contains("fuseline-trace.jsonl: conforms"), "{told:?}");
    }
}

/// What it still prints; a command that does not end within a minute is ended, and fails the test.
#[cfg(unix)]
fn ended(mut child: Child, lines: impl Iterator<Item = String>) -> Vec<String> {
    let (id, (done, is_done)) = (child.id(), channel());
    let guard = thread::spawn(move || {
        let hangs = is_done.recv_timeout(Duration::from_secs(60)).is_err();
        if hangs {
            let killed = Command::new("kill").args(["-9", &id.to_string()]).status();
            assert!(killed.unwrap().success());
        }
        hangs
    });
    let told: Vec<String> = lines.collect();
    // Who guards has given up where nobody listens.
    let _ = done.send(());
    assert!(!guard.join().unwrap(), "it hangs: {told:?}");
    assert_eq!(child.wait().unwrap().code(), Some(0), "{told:?}");
    told
}

#[test]
fn bad_options_are_one_line_and_exit_2_and_write_nothing() {
    let dir = tempdir().unwrap();
    fs::write(dir.path().join("bad.csv"), "sent_ms,rtt_ms\n0,1\n50,x\n").unwrap();
    let remote = "name=a,priority=1,url=";
    for (args, what) in [
        (&["--seconds", "0"][..], "'--seconds <S>': it must be seconds"),
        (&["--rate", "1001"], "'--rate <HZ>': it must be from 0.1 to 1000"),
        (&["--seconds", "86400", "--rate", "1000"], "86400000 frames are too many"),
        (&["--deadline", "0"], "--deadline"),
        (&["--window", "1025"], "--window"),
        (&["--commit", "lazy"], "--commit"),
        (&["--local", "yolo"], "no model \"yolo\""),
        (&["--drive", "west"], "is not KEY=VALUE"),
        (&["--drive", "north=bad.csv"], "there are west, east"),
        (&["--drive", "west=bad.csv"], "bad.csv:3: rtt_ms is \"x\""),
        (&["--drive", "west=none.csv"], "no readable file \"none.csv\""),
        (&["--drive", "west=vnperf/highway"], "which network?"),
        (&["--start", "west=1000000"], "beyond the drive"),
        (&["--cloud", "name=a"], "priority is missing"),
        (&["--cloud", &format!("{remote}ftp://h")], "the cloud's URL must be http"),
        (&["--cloud", &format!("{remote}https://h")], "needs the certificate of the CA"),
        (&["--cloud", &format!("{remote}https://h,ca=none.pem")], "none.pem: No such file"),
        (&["--trace", "."], "error: .: a directory; name a file in it"),
        (&["--trace", "none/t.jsonl"], "error: none/t.jsonl: No such file or directory; "),
        (&["--trace", "/dev/null"], "error: /dev/null: a device or a pipe; "),
        (&["--trace", "-"], "error: --trace -: "),
    ] {
        let refused = run_in(dir.path(), args);
        assert_eq!(refused.status.code(), Some(2), "{args:?}: {}", out(&refused));
        let told = err(&refused);
        assert!(told.starts_with("error: ") && told.contains(what), "{args:?}: {told}");
        assert_eq!((told.lines().count(), out(&refused)), (1, ""), "{args:?}: {told}");
        assert_eq!(names(dir.path()), ["bad.csv"], "{args:?}");
    }
    let same = format!("{remote}http://127.0.0.1:1");
    let two = run_in(dir.path(), &["--cloud", &same, "--cloud", &same.replace("=a", "=b")]);
    assert!(err(&two).contains("two clouds with priority 1"), "{}", err(&two));
    assert_eq!(names(dir.path()), ["bad.csv"]);
}

#[test]
fn a_failed_run_leaves_an_earlier_trace_as_it_was() {
    let dir = tempdir().unwrap();
    let trace = dir.path().join("fuseline-trace.jsonl");
    fs::write(&trace, "earlier").unwrap();
    assert_eq!(run_in(dir.path(), &["--drive", "west=none.csv"]).status.code(), Some(2));
    assert_eq!(fs::read_to_string(&trace).unwrap(), "earlier");
}

mod serve {
    use super::*;

    /// A server that was started and says where it listens; it ends with this.
    struct Server {
        child: Child,
        port: String,
    }

    impl Server {
        fn start(directory: &Path, args: &[&str]) -> Self {
            Self::start_with(directory, args, "".as_ref())
        }

        /// With a token in its environment.
        fn start_with(directory: &Path, args: &[&str], token: &std::ffi::OsStr) -> Self {
            let all = [&["serve", "--listen", "127.0.0.1:0"], args].concat();
            let mut child = fuseline(&all)
                .current_dir(directory)
                .env("FUSELINE_TOKEN", token)
                .stdout(Stdio::piped())
                .stderr(Stdio::piped())
                .spawn()
                .unwrap();
            let mut told = String::new();
            BufReader::new(child.stdout.take().unwrap()).read_line(&mut told).unwrap();
            let port = told.trim().rsplit(':').next().unwrap().to_owned();
            assert!(port.parse::<u16>().is_ok(), "{told}");
            Self { child, port }
        }

        fn cloud(&self, scheme: &str, rest: &str) -> String {
            let port = &self.port;
            format!(
                "name=east,priority=2,model=DINO-SWIN-Tiny,url={scheme}://localhost:{port}{rest}"
            )
        }
    }

    impl Drop for Server {
        fn drop(&mut self) {
            // It has ended where a test ended it.
            drop(self.child.kill());
            drop(self.child.wait());
        }
    }

    /// How the requests of a short run to this cloud ended.
    fn requests(directory: &Path, cloud: &str) -> Value {
        let long = ["--seconds", "0.5", "--deadline", "20000", "--json", "--cloud"];
        let ran = run_in(directory, &[&long[..], &[cloud]].concat());
        let report = report(&ran);
        adds_up(&report);
        assert_eq!(report["sources"][1]["drive"], Value::Null);
        report["sources"][1]["requests"].clone()
    }

    /// A directory with `ca.pem`, a server's and a client's certificate, and a stranger's.
    fn certificates() -> TempDir {
        let dir = tempdir().unwrap();
        let issuer = |name: &str| {
            let mut params = CertificateParams::new(vec![name.to_owned()]).unwrap();
            params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
            CertifiedIssuer::self_signed(params, KeyPair::generate().unwrap()).unwrap()
        };
        let write = |name: &str, text: String| fs::write(dir.path().join(name), text).unwrap();
        let (ca, other) = (issuer("ca"), issuer("other"));
        write("ca.pem", ca.pem());
        for (name, ca) in [("server", &ca), ("client", &ca), ("stranger", &other)] {
            let key = KeyPair::generate().unwrap();
            let params = CertificateParams::new(vec!["localhost".to_owned()]).unwrap();
            write(&format!("{name}.pem"), params.signed_by(&key, ca).unwrap().pem());
            write(&format!("{name}.key"), key.serialize_pem());
        }
        dir
    }

    #[test]
    fn a_server_elsewhere_answers_a_run() {
        let dir = tempdir().unwrap();
        let server = Server::start(dir.path(), &["--model", "DINO-SWIN-Tiny"]);
        assert_eq!(requests(dir.path(), &server.cloud("http", ""))["forwarded"], 5);
    }

    #[test]
    fn a_server_without_network_in_its_drive_is_late() {
        let dir = tempdir().unwrap();
        let server = Server::start(dir.path(), &["--drive", "vnperf/highway:wifi"]);
        let short = ["--seconds", "0.5", "--json", "--cloud", &server.cloud("http", "")];
        let report = report(&run_in(dir.path(), &short));
        assert_eq!(report["sources"][1]["requests"]["late"], 5, "{report}");
        // What a server elsewhere would have answered after its deadline is not known, but too
        // late.
        assert_eq!(report["policies"][2]["mean_ap"], 0.0, "{report}");
        assert!(report["policies"][2]["response_ms"]["p50"]["at_least"].is_number(), "{report}");
    }

    #[test]
    fn only_clients_with_certificate_and_token_are_answered() {
        let dir = certificates();
        fs::write(dir.path().join("token"), "open-sesame\n").unwrap();
        fs::write(dir.path().join("wrong"), "open-barley\n").unwrap();
        let locks = ["--cert", "server.pem", "--key", "server.key", "--client-ca", "ca.pem"];
        let server = Server::start(dir.path(), &[&locks[..], &["--token-file", "token"]].concat());
        let client = ",ca=ca.pem,cert=client.pem,key=client.key";
        for (rest, fate) in [
            (format!("{client},token=token"), "forwarded"),
            (format!("{client},token=wrong"), "failed"),
            (client.to_owned(), "failed"),
            (client.replace("client.", "stranger.") + ",token=token", "failed"),
            (",ca=ca.pem,token=token".to_owned(), "failed"),
        ] {
            let requests = requests(dir.path(), &server.cloud("https", &rest));
            assert_eq!(requests[fate], 5, "{rest}: {requests}");
        }
    }

    #[test]
    fn a_token_of_the_environment_is_asked_for() {
        use std::ffi::OsStr;
        use std::os::unix::ffi::OsStrExt;

        let dir = tempdir().unwrap();
        fs::write(dir.path().join("token"), "open-sesame").unwrap();
        let locked = Server::start_with(dir.path(), &[], "open-sesame".as_ref());
        assert_eq!(requests(dir.path(), &locked.cloud("http", ",token=token"))["forwarded"], 5);
        assert_eq!(requests(dir.path(), &locked.cloud("http", ""))["failed"], 5);
        // Nothing is asked for where nothing is set.
        let open = Server::start_with(dir.path(), &[], "".as_ref());
        assert_eq!(requests(dir.path(), &open.cloud("http", ""))["forwarded"], 5);
        for unreadable in [&b"open-ses\xffme"[..], b"open sesame", "sésame".as_bytes(), b"\n"] {
            let mut serve = fuseline(&["serve", "--listen", "127.0.0.1:0"]);
            let serve = serve.env("FUSELINE_TOKEN", OsStr::from_bytes(unreadable));
            let mut child = serve.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
            let mut told = String::new();
            BufReader::new(child.stdout.take().unwrap()).read_line(&mut told).unwrap();
            drop(child.kill());
            let refused = child.wait_with_output().unwrap();
            assert_eq!((told.as_str(), refused.status.code()), ("", Some(2)), "{unreadable:?}");
            assert!(err(&refused).starts_with("error: FUSELINE_TOKEN: "), "{}", err(&refused));
        }
    }

    #[test]
    fn a_file_without_what_a_cloud_is_told_with_is_refused_at_the_start() {
        let dir = certificates();
        fs::write(dir.path().join("empty"), "\n").unwrap();
        for (files, what) in [
            ("ca=empty", "error: empty: no certificate in it"),
            ("ca=client.key", "error: client.key: no certificate in it; give one as PEM (this is"),
            ("ca=ca.pem,cert=client.key,key=client.pem", "error: client.key: no certificate"),
            ("ca=ca.pem,cert=client.pem,key=ca.pem", "error: ca.pem: no private key in it"),
        ] {
            let cloud = format!("name=a,priority=1,url=https://localhost:1,{files}");
            let refused = run_in(dir.path(), &["--cloud", &cloud]);
            assert_eq!(refused.status.code(), Some(2), "{files}");
            assert!(err(&refused).starts_with(what), "{}", err(&refused));
            assert_eq!((err(&refused).lines().count(), out(&refused)), (1, ""));
        }
    }

    #[test]
    fn ctrl_c_ends_a_server() {
        let dir = tempdir().unwrap();
        let mut server = Server::start(dir.path(), &[]);
        interrupt(&server.child);
        assert_eq!(server.child.wait().unwrap().code(), Some(0));
    }

    #[test]
    fn bad_options_are_one_line_and_exit_2() {
        let dir = certificates();
        let server = Server::start(dir.path(), &[]);
        let taken = format!("127.0.0.1:{}", server.port);
        fs::write(dir.path().join("empty"), "\n").unwrap();
        for (args, what) in [
            (&["--listen", &taken][..], "choose an address of this machine and a free port"),
            (&["--listen", "50051"], "invalid socket address"),
            (&["--model", "yolo"], "no model \"yolo\""),
            (&["--drive", "none.csv"], "no readable file"),
            (&["--start", "1"], "--drive"),
            (&["--cert", "server.pem"], "--key"),
            (&["--client-ca", "ca.pem"], "--cert"),
            (&["--cert", "none.pem", "--key", "server.key"], "none.pem: No such file"),
            (&["--cert", "empty", "--key", "server.key"], "error: empty: no certificate in it"),
            (
                &["--cert", "server.key", "--key", "server.pem"],
                "error: server.key: no certificate in it; give one as PEM (this is a private key)",
            ),
            (
                &["--cert", "server.pem", "--key", "ca.pem"],
                "error: ca.pem: no private key in it; give one as PEM (this is a certificate)",
            ),
            (
                &["--cert", "server.pem", "--key", "server.key", "--client-ca", "empty"],
                "error: empty: no certificate in it",
            ),
            (&["--token-file", "empty"], "visible ASCII"),
        ] {
            let listen = if args[0] == "--listen" { &[][..] } else { &["--listen", "127.0.0.1:0"] };
            let refused = fuseline(&[&["serve"], listen, args].concat())
                .current_dir(dir.path())
                .output()
                .unwrap();
            assert_eq!(refused.status.code(), Some(2), "{args:?}: {}", err(&refused));
            assert!(err(&refused).contains(what), "{args:?}: {}", err(&refused));
            assert_eq!(err(&refused).lines().count(), 1, "{args:?}: {}", err(&refused));
        }
    }
}
