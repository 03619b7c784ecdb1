//! `fuseline probe`, run as a user runs it, against its server behind a relay of known delays.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::thread;
use std::time::Duration;

use crate::common::certificates::certificates;
use crate::common::running::{adds_up, report, run_in};
use crate::common::signal::interrupt;
use crate::common::{err, fuseline, out, run};
use fuseline_tokio::grpc::{self, InferClient, Request, tonic};
use serde_json::Value;
use tempfile::tempdir;
use tokio::net::TcpListener;
use tokio::runtime::Runtime;
use tokio::time::{Instant, sleep};

/// `fuseline probe --serve`; it ends with this.
struct Server {
    child: Child,
    url: String,
}

impl Server {
    fn start(directory: &Path, args: &[&str]) -> Self {
        let all = [&["probe", "--serve", "--listen", "127.0.0.1:0"], args].concat();
        let mut child =
            fuseline(&all).current_dir(directory).stdout(Stdio::piped()).spawn().unwrap();
        let mut printed = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut printed).unwrap();
        let url = printed.trim().rsplit(' ').next().unwrap().replace("127.0.0.1", "localhost");
        Self { child, url }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// The relay's record of one request.
#[derive(Clone, Copy, Debug)]
struct RelayedRequest {
    /// Its index among the probe's requests.
    slot: u64,
    /// Requests that it held already.
    queued: usize,
    received_at: Duration,
    /// The time until it was answered.
    held: Duration,
}

/// The rule for how long a relay holds requests.
#[derive(Clone, Copy)]
enum Hold {
    For(fn(u64) -> Duration),
    /// Once, from the tenth on, until 31 wait.
    Stall,
}

impl Hold {
    async fn wait(self, slot: u64, queued: &Mutex<usize>, is_over: &AtomicBool) {
        match self {
            Self::For(delay) => sleep(delay(slot)).await,
            Self::Stall => {
                while slot >= 10 && !is_over.load(Ordering::SeqCst) {
                    sleep(Duration::from_millis(1)).await;
                    if *queued.lock().unwrap() >= 31 {
                        // One more would come within that time, and the drawing shows it.
                        sleep(Duration::from_secs(2)).await;
                        is_over.store(true, Ordering::SeqCst);
                    }
                }
            }
        }
    }
}

/// Hands requests on to `server` after it held them.
struct Relay {
    url: String,
    requests: Arc<Mutex<Vec<RelayedRequest>>>,
    _runtime: Runtime,
}

impl Relay {
    fn start(server: &Server, pattern: Hold) -> Self {
        let runtime = Runtime::new().unwrap();
        let requests = Arc::<Mutex<Vec<RelayedRequest>>>::default();
        let log = Arc::clone(&requests);
        let url = runtime.block_on(async {
            let client = InferClient::new(grpc::Remote::new(&server.url).connect().unwrap());
            let (first, queued) = (Arc::new(OnceLock::new()), Arc::new(Mutex::new(0_usize)));
            let is_over = Arc::new(AtomicBool::new(false));
            let relay = move |request: Request| {
                let (mut client, log) = (client.clone(), Arc::clone(&log));
                let (queued, is_over) = (Arc::clone(&queued), Arc::clone(&is_over));
                let start: Instant = *first.get_or_init(Instant::now);
                async move {
                    let received_at = start.elapsed();
                    let before = {
                        let mut queued = queued.lock().unwrap();
                        *queued += 1;
                        *queued - 1
                    };
                    pattern.wait(request.timestamp, &queued, &is_over).await;
                    let slot = request.timestamp;
                    let reply = client.infer(tonic::Request::new(request)).await;
                    *queued.lock().unwrap() -= 1;
                    log.lock().unwrap().push(RelayedRequest {
                        slot,
                        queued: before,
                        received_at,
                        held: start.elapsed().saturating_sub(received_at),
                    });
                    reply.map(tonic::Response::into_inner)
                }
            };
            let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
            let url = format!("http://{}", listener.local_addr().unwrap());
            let everybody = grpc::Server::default();
            tokio::spawn(grpc::serve(relay, everybody, listener, std::future::pending()));
            url
        });
        Self { url, requests, _runtime: runtime }
    }

    /// All but the first, which does not count.
    fn requests(&self) -> Vec<RelayedRequest> {
        let mut requests = self.requests.lock().unwrap().clone();
        requests.sort_by_key(|request| request.received_at);
        requests.split_off(1)
    }
}

/// The rows of a recording, by column.
fn rows(csv: &Path) -> Vec<Vec<String>> {
    let text = fs::read_to_string(csv).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("sent_ms,rtt_ms,queued,utc_ms"));
    lines.map(|line| line.split(',').map(ToOwned::to_owned).collect()).collect()
}

fn ms(text: &str) -> f64 {
    text.parse().unwrap()
}

fn millis(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

#[test]
fn behind_a_relay_the_quantiles_are_those_that_it_measured_and_a_run_takes_the_recording() {
    let dir = tempdir().unwrap();
    let server = Server::start(dir.path(), &[]);
    let relay =
        Relay::start(&server, Hold::For(|slot| Duration::from_millis(20 + 40 * (slot % 5))));
    let probe = ["probe", &relay.url, "--for", "4s", "--json"];
    let probed = fuseline(&probe).current_dir(dir.path()).output().unwrap();
    let summary = report(&probed);
    let requests = relay.requests();
    assert_eq!(summary["answered"], requests.len(), "{summary}");
    assert_eq!(summary["failed"], 0, "{summary}");
    assert_eq!(summary["paper_ms"]["p99"], 3027.0);

    let rows = rows(&dir.path().join("fuseline-probe.csv"));
    assert_eq!(rows.len() as u64, summary["sent"].as_u64().unwrap());
    assert!(rows.is_sorted_by(|one, next| ms(&one[0]) < ms(&next[0])));
    // The time for which the relay held an answer is in its round trip, and in the best of all
    // little else. Two that were sent at once may come in either order, so each is found by its
    // slot.
    let mut sent = requests.clone();
    sent.sort_by_key(|request| request.slot);
    let beyond = rows.iter().zip(&sent).map(|(row, request)| ms(&row[1]) - millis(request.held));
    let least = beyond.fold(f64::INFINITY, f64::min);
    assert!((-0.1..20.0).contains(&least), "{least}");
    let mut trips: Vec<f64> = rows.iter().map(|row| ms(&row[1])).collect();
    trips.sort_unstable_by(f64::total_cmp);
    let mut held: Vec<f64> = requests.iter().map(|request| millis(request.held)).collect();
    held.sort_unstable_by(f64::total_cmp);
    for (quantile, percent) in [("p50", 50), ("p90", 90), ("p99", 99)] {
        let printed = summary["answers_ms"][quantile].as_f64().unwrap();
        let index = (held.len() * percent).div_ceil(100) - 1;
        // A histogram has values in steps, which are greater the greater they are, as on a busy
        // host.
        let step = (trips[index] / 1e4).max(0.01);
        assert!((printed - trips[index]).abs() < step, "{quantile}: {printed} of {}", trips[index]);
        assert!(printed >= held[index] - 0.1, "{quantile}: {printed} of {}", held[index]);
    }
    let ran = run_in(dir.path(), &["--for", "1s", "--json", "--drive", "west=fuseline-probe.csv"]);
    let report = report(&ran);
    adds_up(&report);
    assert_eq!(report["sources"][1]["drive"], "fuseline-probe.csv", "{report}");
}

#[test]
fn a_stall_leaves_31_unanswered_and_then_nothing_is_sent() {
    let dir = tempdir().unwrap();
    let server = Server::start(dir.path(), &[]);
    let relay = Relay::start(&server, Hold::Stall);
    let probe = ["probe", &relay.url, "--for", "6s", "-o", "plots"];
    let probed = fuseline(&probe).current_dir(dir.path()).output().unwrap();
    assert_eq!(probed.status.code(), Some(0), "{}", err(&probed));
    assert!(out(&probed).contains("\n1 pause, "), "{}", out(&probed));
    let requests = relay.requests();
    assert_eq!(requests.iter().map(|request| request.queued + 1).max(), Some(31));
    let last = requests.iter().position(|request| request.queued == 30).unwrap();
    let stalled = &requests[last - 30..=last];
    let next = requests[last + 1];
    assert_eq!(next.queued, 0);
    assert!(stalled.iter().all(|one| one.received_at + one.held <= next.received_at));
    let rows = rows(&dir.path().join("fuseline-probe.csv"));
    let pauses: Vec<&Vec<String>> = rows.iter().filter(|row| row[1] == "-1").collect();
    let [pause] = pauses[..] else { panic!("{pauses:?}") };
    assert_eq!(pause[2], "31");
    assert_eq!(rows.len(), requests.len() + 1);

    let printed = "\nplots: index.html, and as SVG and PNG: round-trips, distribution\n";
    assert!(out(&probed).contains(printed), "{}", out(&probed));
    let plots = dir.path().join("plots");
    let svg = plotted(&plots, &["round-trips", "distribution"]);
    let answers = format!("{} answers, 0 failed or unanswered, 1 pause; p50 ", requests.len());
    assert!(svg.iter().all(|svg| svg.contains(&answers)), "{answers}");
    // The key's and the pause's own, which is about a third of the 6 s, and less of what a busy
    // host makes of them.
    let bands = bands(&svg[0]);
    assert_eq!(bands.len(), 2, "{bands:?}");
    assert!((150.0..450.0).contains(&bands[0].max(bands[1])), "{bands:?}");
    for paper in ["68 ms", "336 ms", "3027 ms"] {
        assert!(svg[1].contains(paper), "{paper}");
    }
}

/// The drawings on light ground; each is there as a picture too, and on the page.
fn plotted(folder: &Path, names: &[&str]) -> Vec<String> {
    let page = fs::read_to_string(folder.join("index.html")).unwrap();
    let plotted = names.iter().map(|name| {
        for suffix in ["", "-dark"] {
            let png = fs::read(folder.join(format!("{name}{suffix}.png"))).unwrap();
            assert!(png.starts_with(b"\x89PNG"), "{name}{suffix}");
        }
        let svg = fs::read_to_string(folder.join(format!("{name}.svg"))).unwrap();
        assert!(page.contains(&svg), "{name}");
        svg
    });
    plotted.collect()
}

/// Returns the widths of the shapes that are drawn like a pause, in units of the drawing.
fn bands(svg: &str) -> Vec<f64> {
    let rects =
        svg.split("<rect ").filter(|it| it.starts_with("x=") && it.contains("opacity=\"0.22\""));
    rects.map(|it| ms(it.split("width=\"").nth(1).unwrap().split('"').next().unwrap())).collect()
}

#[test]
fn plots_a_recording_again_and_refuses_a_wrong_one() {
    let dir = tempdir().unwrap();
    let mut text = "sent_ms,rtt_ms,queued\n".to_owned();
    for slot in 0..40_u32 {
        text.extend([format!("{},{},{}\n", slot * 33, 10 + slot * 20, slot % 30)]);
    }
    fs::write(dir.path().join("drive.csv"), &text).unwrap();
    let plot = |name| {
        let args = ["probe", "--plot", name, "-o", "plots"];
        fuseline(&args).current_dir(dir.path()).output().unwrap()
    };
    let printed = plot("drive.csv");
    assert_eq!(printed.status.code(), Some(0), "{}", err(&printed));
    let plots = dir.path().join("plots");
    let svg = plotted(&plots, &["round-trips", "distribution"]);
    assert!(svg[0].contains("40 answers, 0 failed or unanswered, 0 pauses; p50 390 ms"));
    assert_eq!(bands(&svg[0]).len(), 1);

    fs::remove_dir_all(&plots).unwrap();
    let of_two = "second,a_rtt_ms,b_rtt_ms\n0,1,7\n1,-1,8\n";
    fs::write(dir.path().join("two.csv"), of_two).unwrap();
    assert_eq!(plot("two.csv:b").status.code(), Some(0));
    let svg = plotted(&plots, &["round-trips"]);
    assert!(svg[0].contains("2 answers, 0 failed or unanswered, 0 pauses; p50 7.0 ms"));

    fs::remove_dir_all(&plots).unwrap();
    for (wrong, expected) in [
        ("sent_ms,rtt_ms\n0,1\n0,1\n", "wrong.csv:3: sent_ms is \"0\"; it must be a number "),
        ("sent_ms,rtt_ms\n0,-2\n", "wrong.csv:2: rtt_ms is \"-2\"; it must be milliseconds "),
        ("sent_ms,rtt_ms\n0,NaN\n", "wrong.csv:2: rtt_ms is \"NaN\"; "),
        (of_two, "wrong.csv:1: the file has several networks; name one of them: wrong.csv:a "),
        ("second\n0\n", "wrong.csv:1: no column \"rtt_ms\"; "),
        (&"x".repeat(1 << 20), "wrong.csv:1: no time column; "),
    ] {
        fs::write(dir.path().join("wrong.csv"), wrong).unwrap();
        let refused = plot("wrong.csv");
        let printed = err(&refused);
        assert_eq!(refused.status.code(), Some(2), "{printed}");
        assert!(
            printed.starts_with("error: ") && printed.contains(expected),
            "{expected}: {printed}"
        );
        assert_eq!(
            (printed.lines().count(), fs::read_dir(&plots).unwrap().count()),
            (1, 0),
            "{printed}"
        );
    }
}

#[test]
fn a_plot_that_cannot_be_written_is_one_error_and_the_recording_stays() {
    let dir = tempdir().unwrap();
    let server = Server::start(dir.path(), &[]);
    // A file cannot take a folder's name.
    fs::create_dir_all(dir.path().join("plots/round-trips.svg/taken")).unwrap();
    let probe = ["probe", &server.url, "--for", "0.5s", "--force", "-o", "plots"];
    let probed = fuseline(&probe).current_dir(dir.path()).output().unwrap();
    assert_eq!(probed.status.code(), Some(2));
    let printed = err(&probed);
    assert!(
        printed.lines().last().unwrap().starts_with("error: plots/round-trips.svg: "),
        "{printed}"
    );
    assert!(out(&probed).contains("15 slots at 30 a second"), "{}", out(&probed));
    assert_eq!(fs::read_dir(dir.path().join("plots")).unwrap().count(), 1);
    // A busy machine misses slots.
    let recorded = rows(&dir.path().join("fuseline-probe.csv")).len();
    assert!((1..=15).contains(&recorded), "{recorded}");
}

#[test]
fn ctrl_c_ends_a_probe_with_its_summary_and_a_whole_recording() {
    let dir = tempdir().unwrap();
    let server = Server::start(dir.path(), &[]);
    let child = fuseline(&["probe", &server.url, "--json", "-o", "plots"])
        .current_dir(dir.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let csv = dir.path().join("fuseline-probe.csv");
    while fs::metadata(&csv).map_or(0, |file| file.len()) < 200 {
        thread::sleep(Duration::from_millis(50));
    }
    interrupt(&child);
    let ended = child.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(0));
    let summary: Value = serde_json::from_str(out(&ended)).unwrap();
    assert_eq!(summary["interrupted"], true);
    let rows = rows(&csv);
    assert_eq!(rows.len() as u64, summary["sent"].as_u64().unwrap());
    assert!(rows.iter().all(|row| row.len() == 4));
    let svg = plotted(&dir.path().join("plots"), &["round-trips", "distribution"]);
    assert!(svg[0].contains(&format!("{} answers, ", summary["answered"])));
    assert_eq!(summary["plots"][0], "round-trips.svg");
    assert_eq!(summary["page"], "plots/index.html");
}

#[test]
fn a_token_is_required_and_sent() {
    let dir = tempdir().unwrap();
    fs::write(dir.path().join("token"), "open-sesame\n").unwrap();
    let server = Server::start(dir.path(), &["--token-file", "token"]);
    let probe = ["probe", &server.url, "--for", "0.2s"];
    let refused = fuseline(&probe).current_dir(dir.path()).output().unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        err(&refused)
            .contains("a bearer token is needed; give the server's token with --token-file"),
        "{}",
        err(&refused)
    );
    assert!(!dir.path().join("fuseline-probe.csv").exists());
    let bearing = [&probe[..], &["--token-file", "token"]].concat();
    let probed = fuseline(&bearing).current_dir(dir.path()).output().unwrap();
    assert_eq!(probed.status.code(), Some(0), "{}", err(&probed));
}

#[test]
fn over_tls_only_the_right_certificates_and_token_are_answered() {
    let dir = certificates();
    fs::write(dir.path().join("token"), "open-sesame\n").unwrap();
    let locks = ["--cert", "server.pem", "--key", "server.key", "--client-ca", "ca.pem"];
    let server = Server::start(dir.path(), &[&locks[..], &["--token-file", "token"]].concat());
    assert!(server.url.starts_with("https://localhost:"), "{}", server.url);
    let probe = |url: &str, keys: &str| {
        let keys: Vec<&str> = keys.split_whitespace().collect();
        let args = [&["probe", url, "--for", "0.2s", "--json"], &keys[..]].concat();
        fuseline(&args).current_dir(dir.path()).output().unwrap()
    };
    let plain = server.url.replace("https", "http");
    let (client, token) = ("--cert client.pem --key client.key", "--token-file token");
    for (url, keys, expected) in [
        (
            &server.url,
            format!("--ca other.pem {client} {token}"),
            "invalid peer certificate: BadSignature; give the server's CA",
        ),
        (&server.url, format!("--ca ca.pem {token}"), "--cert and --key if it wants this side's"),
        (
            &server.url,
            format!("--ca ca.pem --cert stranger.pem --key stranger.key {token}"),
            "--cert and --key if it wants this side's",
        ),
        (&server.url, format!("--ca ca.pem {client}"), "a bearer token is needed; give"),
        (&plain, token.to_owned(), "the connection broke; if it speaks TLS, give an https URL"),
    ] {
        let refused = probe(url, &keys);
        let printed = err(&refused);
        assert_eq!((refused.status.code(), out(&refused)), (Some(2), ""), "{keys}: {printed}");
        assert!(
            printed.starts_with(&format!("error: {url}: ")) && printed.contains(expected),
            "{keys}: {printed}"
        );
        assert_eq!(printed.lines().count(), 1, "{printed}");
        assert!(!dir.path().join("fuseline-probe.csv").exists(), "{keys}");
    }
    let probed = probe(&server.url, &format!("--ca ca.pem {client} {token}"));
    assert_eq!(probed.status.code(), Some(0), "{}", err(&probed));
    let summary = report(&probed);
    assert_eq!((&summary["answered"], &summary["failed"]), (&summary["sent"], &0.into()));
    assert_ne!(summary["sent"], 0, "{summary}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_folder_that_takes_no_files_is_reported_before_anything_is_measured() {
    let dir = tempdir().unwrap();
    let server = Server::start(dir.path(), &[]);
    fs::write(dir.path().join("file"), "").unwrap();
    // Nobody makes files in /proc, not even root.
    for folder in ["/proc", "file", "file/in"] {
        let probe = ["probe", &server.url, "--for", "600s", "-o", folder];
        let refused = fuseline(&probe).current_dir(dir.path()).output().unwrap();
        let printed = err(&refused);
        assert_eq!((refused.status.code(), out(&refused)), (Some(2), ""), "{printed}");
        assert!(printed.starts_with(&format!("error: {folder}: ")), "{printed}");
        assert!(printed.ends_with("; name a folder that can be written to\n"), "{printed}");
        assert_eq!(printed.lines().count(), 1, "{printed}");
        assert!(!dir.path().join("fuseline-probe.csv").exists());
    }
}

#[test]
fn bad_options_are_one_line_and_exit_2_and_write_nothing() {
    let dir = tempdir().unwrap();
    let server = Server::start(dir.path(), &[]);
    for (args, expected) in [
        (&[][..], "<URL>"),
        (&["http://127.0.0.1:9"], "http://127.0.0.1:9: connection refused; start"),
        (&["ftp://h"], "ftp://h: the cloud's URL must be http"),
        (&["http://h", "--serve"], "cannot be used with"),
        (&[&server.url, "--rate", "0"], "'--rate <HZ>': it must be from 0.1 to 1000"),
        (&[&server.url, "--for", "0s"], "'--for <TIME>': it must be more than 0"),
        (&[&server.url, "--csv", "-"], "--csv -: "),
        (&[&server.url, "--csv", "."], ".: this is a directory"),
    ] {
        let all = [&["probe"], args].concat();
        let refused = fuseline(&all).current_dir(dir.path()).output().unwrap();
        assert_eq!(refused.status.code(), Some(2), "{args:?}: {}", out(&refused));
        let printed = err(&refused);
        assert!(
            printed.starts_with("error: ") && printed.contains(expected),
            "{args:?}: {printed}"
        );
        assert_eq!((printed.lines().count(), out(&refused)), (1, ""), "{args:?}: {printed}");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0, "{args:?}");
    }
    assert_eq!(run(&["probe", "--help"], "").status.code(), Some(0));
}
