//! `fuseline serve` and `fuseline run` against it, run as a user runs them.

use std::ffi::OsStr;
use std::fs;
use std::future::{pending, ready};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use crate::common::certificates::certificates;
use crate::common::running::{adds_up, report, run_in};
use crate::common::signal::interrupt;
use crate::common::{err, fuseline, out, run};
use fuseline_tokio::grpc;
use serde_json::Value;
use tempfile::tempdir;
use tokio::net::TcpListener;
use tokio::runtime::Runtime;
use tokio::time::sleep;

/// A server that was started and says where it listens; it ends with this.
struct Server {
    child: Child,
    port: String,
}

impl Server {
    fn start(directory: &Path, args: &[&str]) -> Self {
        Self::start_with(directory, args, "".as_ref())
    }

    /// Starts the server with a token in its environment.
    fn start_with(directory: &Path, args: &[&str], token: &OsStr) -> Self {
        let all = [&["--listen", "127.0.0.1:0"], args].concat();
        let (child, printed) = begun(directory, &all, token);
        let port = printed.trim().rsplit(':').next().unwrap().to_owned();
        assert!(port.parse::<u16>().is_ok(), "{printed}");
        Self { child, port }
    }

    fn cloud(&self, scheme: &str, rest: &str) -> String {
        let port = &self.port;
        format!("name=east,priority=2,model=DINO-SWIN-Tiny,url={scheme}://localhost:{port}{rest}")
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // It has ended where a test ended it.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// A server that was started, and what it first says: where it listens, or nothing if it is
/// refused.
fn begun(directory: &Path, args: &[&str], token: &OsStr) -> (Child, String) {
    let mut child = fuseline(&[&["serve"], args].concat())
        .current_dir(directory)
        .env("FUSELINE_TOKEN", token)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut printed = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut printed).unwrap();
    (child, printed)
}

/// Returns how a server ends that must not start.
fn refused(directory: &Path, args: &[&str], token: &OsStr) -> Output {
    let (mut child, printed) = begun(directory, args, token);
    if !printed.is_empty() {
        child.kill().unwrap();
        child.wait().unwrap();
        panic!("{args:?}, {}: {printed}", token.display());
    }
    child.wait_with_output().unwrap()
}

/// Returns how the requests of a short run to this cloud ended.
fn requests(directory: &Path, cloud: &str) -> Value {
    let long = ["--for", "0.5s", "--policy", "constant", "--deadline", "20s", "--json", "--cloud"];
    let ran = run_in(directory, &[&long[..], &[cloud]].concat());
    let report = report(&ran);
    adds_up(&report);
    let trace = directory.join("fuseline-trace.jsonl");
    assert_eq!(run(&["check", trace.to_str().unwrap()], "").status.code(), Some(0));
    report["sources"][1]["requests"].clone()
}

#[test]
fn a_server_elsewhere_answers_a_run() {
    let dir = tempdir().unwrap();
    let server = Server::start(dir.path(), &["--model", "DINO-SWIN-Tiny"]);
    assert_eq!(requests(dir.path(), &server.cloud("http", ""))["forwarded"], 5);
}

#[test]
fn a_recorded_network_is_put_before_a_server() {
    let dir = tempdir().unwrap();
    fs::write(dir.path().join("drive.csv"), "sent_ms,rtt_ms\n0,40\n60000,40\n").unwrap();
    let server = Server::start(dir.path(), &["--model", "DINO-SWIN-Tiny"]);
    let behind = format!("http://127.0.0.1:{}", server.port);
    let network = Server::start(dir.path(), &["--forward", &behind, "--drive", "drive.csv"]);
    assert_eq!(requests(dir.path(), &network.cloud("http", ""))["forwarded"], 5);
    drop(server);
    // The server behind it is gone, and then back again.
    assert_eq!(requests(dir.path(), &network.cloud("http", ""))["failed"], 5);
    let port = behind.rsplit_once(':').unwrap().1;
    let again = ["--listen", &format!("127.0.0.1:{port}"), "--model", "DINO-SWIN-Tiny"];
    let (mut again, _) = begun(dir.path(), &again, "".as_ref());
    assert_eq!(requests(dir.path(), &network.cloud("http", ""))["forwarded"], 5);
    again.kill().unwrap();
    again.wait().unwrap();
}

#[test]
fn a_server_that_cannot_be_behind_a_network_is_one_line_and_exit_2() {
    let dir = tempdir().unwrap();
    let drive = ["--drive", "cicv5g/urban_n78_v40"];
    let url = ["--forward", "http://127.0.0.1:1"];
    for (args, expected) in [
        (
            &["--forward", "localhost:50051"][..],
            "--forward localhost:50051: the cloud's URL must be",
        ),
        (&["--forward", "http://a b"], "--forward http://a b: the cloud's URL"),
        (&[&url[..], &["--model", "DETR-ResNet-50"]].concat(), "cannot be used with"),
        (&[&url[..], &["--start", "86400s"]].concat(), "beyond the drive"),
    ] {
        let refused = refused(dir.path(), &[args, &drive].concat(), "".as_ref());
        assert_eq!(refused.status.code(), Some(2), "{args:?}");
        let err = err(&refused);
        assert!(err.lines().count() == 1 && err.contains(expected), "{args:?}: {err}");
    }
    let refused = refused(dir.path(), &url, "".as_ref());
    assert!(err(&refused).contains("--drive"), "{}", err(&refused));
    assert_eq!(refused.status.code(), Some(2));
}

/// D15.
#[test]
fn the_tables_report_what_a_server_says_it_serves_and_of_a_difference() {
    let dir = tempdir().unwrap();
    let args = ["--model", "DETR-ResNet-101", "--drive", "vnperf/highway:sprint", "--start", "1s"];
    let server = Server::start(dir.path(), &args);
    let cloud = server.cloud("http", "");
    let ran = run_in(dir.path(), &["--for", "0.3s", "--cloud", &cloud]);
    assert_eq!(
        err(&ran).lines().next(),
        Some(
            "warning: east: its server serves DETR-ResNet-101 on A100, not DINO-SWIN-Tiny on A100; \
             the tables show what it serves"
        )
    );
    let line = out(&ran).lines().find(|line| line.contains("http://")).unwrap();
    assert!(line.starts_with("  2 east   DETR-ResNet-101 on A100"), "{line}");
    assert!(line.ends_with(&format!("{}, vnperf/highway:sprint", server.port)), "{line}");

    let printed = cloud.replace("DINO-SWIN-Tiny", "DETR-ResNet-101");
    for same in [printed.as_str(), &printed.replace("model=DETR-ResNet-101,", "")] {
        let ran = run_in(dir.path(), &["--for", "0.3s", "--json", "--cloud", same]);
        assert!(!err(&ran).contains("warning"), "{}", err(&ran));
        let east = &report(&ran)["sources"][1];
        assert_eq!(east["model"], "DETR-ResNet-101 on A100");
        assert_eq!(
            (&east["drive"], &east["emulated"]),
            (&"vnperf/highway:sprint".into(), &true.into())
        );
        assert_eq!(east["unsaid"], Value::Null);
    }
}

#[test]
fn of_a_server_that_does_not_say_what_it_serves_the_tables_say_so() {
    let dir = tempdir().unwrap();
    let echo = |request: grpc::Request| {
        ready(Ok(grpc::Reply { payload: request.payload, ..grpc::Reply::default() }))
    };
    let runtime = Runtime::new().unwrap();
    let listener = runtime.block_on(TcpListener::bind("127.0.0.1:0")).unwrap();
    let url = format!("url=http://{}", listener.local_addr().unwrap());
    runtime.spawn(grpc::serve(echo, grpc::Server::default(), listener, pending()));
    for (model, known) in [
        ("model=DINO-SWIN-Tiny,", "its model is the one that --cloud names"),
        ("", "its model is unknown"),
    ] {
        let cloud = format!("name=east,priority=2,{model}{url}");
        let ran = run_in(dir.path(), &["--for", "0.3s", "--cloud", &cloud]);
        let note = format!(
            "east: its server did not say what it serves (it does not know this call); {known}."
        );
        assert!(out(&ran).lines().any(|line| line == note), "{}", out(&ran));
    }
}

/// D8, D16.
#[test]
fn no_more_calls_to_a_cloud_are_under_way_at_once_than_was_said() {
    let dir = tempdir().unwrap();
    let (now, most) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
    let greatest = Arc::clone(&most);
    let slow = move |request: grpc::Request| {
        let now = Arc::clone(&now);
        most.fetch_max(now.fetch_add(1, Ordering::Relaxed) + 1, Ordering::Relaxed);
        async move {
            sleep(Duration::from_millis(100)).await;
            now.fetch_sub(1, Ordering::Relaxed);
            Ok(grpc::Reply { payload: request.payload, ..grpc::Reply::default() })
        }
    };
    let runtime = Runtime::new().unwrap();
    let listener = runtime.block_on(TcpListener::bind("127.0.0.1:0")).unwrap();
    let cloud = format!("name=east,priority=2,url=http://{}", listener.local_addr().unwrap());
    runtime.spawn(grpc::serve(slow, grpc::Server::default(), listener, pending()));
    // Twice as many frames as calls of that length can take.
    let many = ["--rate", "40", "--calls", "2", "--for", "0.5s", "--json", "--policy"];
    let patient = ["constant", "--deadline", "20s", "--cloud", &cloud];
    adds_up(&report(&run_in(dir.path(), &[&many[..], &patient].concat())));
    assert_eq!(greatest.load(Ordering::Relaxed), 2);
}

/// D11, D15.
#[test]
fn a_line_says_why_a_cloud_failed_and_only_what_was_written_counts_as_sent() {
    let dir = certificates();
    fs::write(dir.path().join("token"), "open-sesame\n").unwrap();
    let plain = Server::start(dir.path(), &[]);
    let locked = Server::start(dir.path(), &["--token-file", "token"]);
    let secure = Server::start(dir.path(), &["--cert", "server.pem", "--key", "server.key"]);
    let nobody = "name=east,priority=2,url=http://127.0.0.1:1".to_owned();
    for (cloud, why, is_written) in [
        (nobody, "connection refused", false),
        (locked.cloud("http", ""), "a bearer token is needed", true),
        (plain.cloud("https", ",ca=ca.pem"), "the server does not speak TLS", false),
        (
            secure.cloud("http", ""),
            "the connection broke; if it speaks TLS, give an https URL and a ca",
            true,
        ),
    ] {
        let patient = ["--for", "0.3s", "--policy", "constant", "--deadline", "20s"];
        let short = [&patient[..], &["--cloud", &cloud]].concat();
        let ran = run_in(dir.path(), &short);
        let line = format!("east: 3 × {why}");
        assert!(out(&ran).lines().any(|printed| printed == line), "{line}: {}", out(&ran));
        let json = report(&run_in(dir.path(), &[&short[..], &["--json"]].concat()));
        let why = why.split(';').next().unwrap();
        assert_eq!(json["sources"][1]["failures"][why], 3, "{json}");
        if !is_written {
            assert_eq!(json["sources"][1]["sent_bytes"], 0, "{json}");
            for policy in json["policies"].as_array().unwrap() {
                assert_eq!(policy["sent_bytes"], 0, "{json}");
            }
        }
    }
}

#[test]
fn a_server_without_network_in_its_drive_is_late() {
    let dir = tempdir().unwrap();
    let server = Server::start(dir.path(), &["--drive", "vnperf/highway:wifi"]);
    let cloud = server.cloud("http", "");
    let short = ["--for", "0.5s", "--json", "--policy", "constant", "--cloud", &cloud];
    let report = report(&run_in(dir.path(), &short));
    assert_eq!(report["sources"][1]["requests"]["late"], 5, "{report}");
    // What a server elsewhere would have answered after its deadline is not known, but too
    // late.
    assert_eq!(report["policies"][2]["mean_ap"], 0.0, "{report}");
    assert!(report["policies"][2]["response_ms"]["p50"]["at_least"].is_number(), "{report}");
}

/// D12.
#[test]
fn only_clients_with_certificate_and_token_are_answered() {
    let dir = certificates();
    fs::write(dir.path().join("token"), "open-sesame\n").unwrap();
    fs::write(dir.path().join("wrong"), "open-barley\n").unwrap();
    let locks = ["--cert", "server.pem", "--key", "server.key", "--client-ca", "ca.pem"];
    let server = Server::start(dir.path(), &[&locks[..], &["--token-file", "token"]].concat());
    let client = ",ca=ca.pem,cert=client.pem,key=client.key";
    for (rest, request_outcome) in [
        (format!("{client},token=token"), "forwarded"),
        (format!("{client},token=wrong"), "failed"),
        (client.to_owned(), "failed"),
        (client.replace("client.", "stranger.") + ",token=token", "failed"),
        (",ca=ca.pem,token=token".to_owned(), "failed"),
    ] {
        let requests = requests(dir.path(), &server.cloud("https", &rest));
        assert_eq!(requests[request_outcome], 5, "{rest}: {requests}");
    }
}

/// D12.
#[test]
fn without_a_ca_the_systems_authorities_are_taken() {
    let dir = certificates();
    let server = Server::start(dir.path(), &["--cert", "server.pem", "--key", "server.key"]);
    let cloud = server.cloud("https", "");
    let forwarded = |authorities: &str| {
        let args = ["run", "--for", "0.5s", "--force", "--json", "--cloud", &cloud];
        let ran = fuseline(&args)
            .current_dir(dir.path())
            .env("SSL_CERT_FILE", dir.path().join(authorities))
            .output()
            .unwrap();
        report(&ran)["sources"][1]["requests"]["failed"].clone()
    };
    assert_eq!((forwarded("ca.pem"), forwarded("other.pem")), (0.into(), 5.into()));
}

#[test]
fn a_key_of_another_certificate_is_refused_before_an_address_is_reported() {
    let dir = certificates();
    let args = ["--listen", "127.0.0.1:0", "--cert", "server.pem", "--key", "client.key"];
    let ended = refused(dir.path(), &args, OsStr::new(""));
    assert_eq!((ended.status.code(), err(&ended).lines().count()), (Some(2), 1), "{}", err(&ended));
}

#[test]
fn a_token_of_the_environment_is_required() {
    use std::os::unix::ffi::OsStrExt;

    let dir = tempdir().unwrap();
    fs::write(dir.path().join("token"), "open-sesame").unwrap();
    let locked = Server::start_with(dir.path(), &[], "open-sesame".as_ref());
    assert_eq!(requests(dir.path(), &locked.cloud("http", ",token=token"))["forwarded"], 5);
    assert_eq!(requests(dir.path(), &locked.cloud("http", ""))["failed"], 5);
    // Nothing is required where nothing is set.
    let open = Server::start_with(dir.path(), &[], "".as_ref());
    assert_eq!(requests(dir.path(), &open.cloud("http", ""))["forwarded"], 5);
    for unreadable in [&b"open-ses\xffme"[..], b"open sesame", "sésame".as_bytes(), b"\n"] {
        let token = OsStr::from_bytes(unreadable);
        let refused = refused(dir.path(), &["--listen", "127.0.0.1:0"], token);
        assert_eq!(refused.status.code(), Some(2), "{unreadable:?}");
        assert!(err(&refused).starts_with("error: FUSELINE_TOKEN: "), "{}", err(&refused));
    }
}

#[test]
fn a_file_without_what_a_cloud_has_is_refused_at_the_start() {
    let dir = certificates();
    fs::write(dir.path().join("empty"), "\n").unwrap();
    for (files, expected) in [
        ("ca=empty", "error: empty: the file has no certificate"),
        (
            "ca=client.key",
            "error: client.key: the file has no certificate; give one in PEM (this is",
        ),
        (
            "ca=ca.pem,cert=client.key,key=client.pem",
            "error: client.key: the file has no certificate",
        ),
        ("ca=ca.pem,cert=client.pem,key=ca.pem", "error: ca.pem: the file has no private key"),
    ] {
        let cloud = format!("name=a,priority=1,url=https://localhost:1,{files}");
        let refused = run_in(dir.path(), &["--cloud", &cloud]);
        assert_eq!(refused.status.code(), Some(2), "{files}");
        assert!(err(&refused).starts_with(expected), "{}", err(&refused));
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

/// D12: a token or a certificate that is set and cannot be read ends the start.
#[test]
fn bad_options_are_one_line_and_exit_2() {
    let dir = certificates();
    let server = Server::start(dir.path(), &[]);
    let address = format!("127.0.0.1:{}", server.port);
    fs::write(dir.path().join("empty"), "\n").unwrap();
    for (args, expected) in [
        (&["--listen", &address][..], "choose an address of this host and a free port"),
        (&["--listen", "50051"], "invalid socket address"),
        (&["--model", "yolo"], "no model \"yolo\""),
        (&["--drive", "none.csv"], "no readable file"),
        (&["--start", "1s"], "--drive"),
        (&["--cert", "server.pem"], "--key"),
        (&["--client-ca", "ca.pem"], "--cert"),
        (&["--cert", "none.pem", "--key", "server.key"], "none.pem: No such file"),
        (&["--cert", "empty", "--key", "server.key"], "error: empty: the file has no certificate"),
        (
            &["--cert", "server.key", "--key", "server.pem"],
            "error: server.key: the file has no certificate; give one in PEM (this is a private key)",
        ),
        (
            &["--cert", "server.pem", "--key", "ca.pem"],
            "error: ca.pem: the file has no private key; give one in PEM (this is a certificate)",
        ),
        (
            &["--cert", "server.pem", "--key", "server.key", "--client-ca", "empty"],
            "error: empty: the file has no certificate",
        ),
        (&["--token-file", "empty"], "visible ASCII"),
    ] {
        let listen = if args[0] == "--listen" { &[][..] } else { &["--listen", "127.0.0.1:0"] };
        let refused = refused(dir.path(), &[listen, args].concat(), "".as_ref());
        assert_eq!(refused.status.code(), Some(2), "{args:?}: {}", err(&refused));
        assert!(err(&refused).contains(expected), "{args:?}: {}", err(&refused));
        assert_eq!(err(&refused).lines().count(), 1, "{args:?}: {}", err(&refused));
    }
}

/// A wrong token is no mistake of the trace, and yet no success.
#[test]
fn a_cloud_that_answers_nothing_is_in_doubt() {
    let dir = tempdir().unwrap();
    fs::write(dir.path().join("token"), "open-sesame\n").unwrap();
    let locked = Server::start(dir.path(), &["--token-file", "token"]);
    let cloud = locked.cloud("http", "");
    let short = ["--for", "1s", "--json", "--cloud", &cloud];
    let ran = run_in(dir.path(), &short);
    assert_eq!(ran.status.code(), Some(3), "{}", err(&ran));
    assert_eq!(report(&ran)["sources"][1]["forwarded"], 0);
    let doubt = &report(&ran)["trace"]["doubts"][0];
    assert_eq!((&doubt["kind"], &doubt["accepted"]), (&"silent".into(), &false.into()));
    let accepted = run_in(dir.path(), &[&short[..], &["--accept", "silent"]].concat());
    assert_eq!(accepted.status.code(), Some(0), "{}", err(&accepted));
    let open = Server::start(dir.path(), &[]);
    let cloud = open.cloud("http", "");
    // A busy host may leave no time for an answer.
    let args = ["--for", "1s", "--json", "--cloud", &cloud, "--accept", "silent"];
    let ran = run_in(dir.path(), &args);
    assert_eq!(ran.status.code(), Some(0), "{}", err(&ran));
}

#[test]
fn a_probe_of_a_model_says_that_it_measures_the_model_too() {
    let dir = tempdir().unwrap();
    let server = Server::start(dir.path(), &["--model", "DINO-SWIN-Large"]);
    let url = format!("http://127.0.0.1:{}", server.port);
    let args = ["probe", &url, "--for", "0.2s"];
    let probed = fuseline(&args).current_dir(dir.path()).output().unwrap();
    assert_eq!(probed.status.code(), Some(0), "{}", err(&probed));
    let warning = err(&probed).lines().find(|line| line.starts_with("warning: "));
    let warning = warning.unwrap_or_else(|| panic!("{}", err(&probed)));
    for part in [&*url, "DINO-SWIN-Large", " ms", "fuseline probe --serve"] {
        assert!(warning.contains(part), "{warning}");
    }
    // A server that answers only probes gets no warning.
    let args = ["probe", "--serve", "--listen", "127.0.0.1:0"];
    let mut child = fuseline(&args).stdout(Stdio::piped()).spawn().unwrap();
    let mut printed = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut printed).unwrap();
    let url = printed.trim().rsplit(' ').next().unwrap();
    let args = ["probe", url, "--for", "0.2s"];
    let probed = fuseline(&args).current_dir(dir.path()).output().unwrap();
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!((probed.status.code(), err(&probed).contains("warning")), (Some(0), false));
}
