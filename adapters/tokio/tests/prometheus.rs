//! Tests the metrics that Prometheus reads. A program has only one metrics recorder.
#![cfg(feature = "prometheus")]

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::OnceLock;
use std::time::Duration;

use fuseline_tokio::deadline::{Guard, MetresPerSecond, Parameters, Situation};
use fuseline_tokio::{Config, Local, Operator, Setup, prometheus, spawn, stream};

/// Removes local's deadline of a second, which a thread may exceed on a busy host.
fn without_deadline<I, O>(mut local: Local<I, O>) -> Local<I, O> {
    local.deadline = None;
    local
}

struct Double;

impl Operator for Double {
    type Input = u64;
    type Output = u64;

    fn setup(self, _: &mut Setup<u64, u64>) -> Local<u64, u64> {
        without_deadline(Local::blocking(|message, _| Ok(message * 2)))
    }
}

/// Serves the metrics of this program, once for all tests. Returns the address.
fn served() -> SocketAddr {
    static ADDRESS: OnceLock<SocketAddr> = OnceLock::new();
    *ADDRESS.get_or_init(|| {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        // The server must not run on a test's runtime, which ends with the test.
        let serve = move || prometheus(address).is_ok();
        assert!(!std::thread::spawn(serve).join().unwrap(), "the address is taken");
        drop(listener);
        assert!(std::thread::spawn(serve).join().unwrap());
        address
    })
}

/// Returns the metrics as they are served now.
async fn scrape() -> String {
    let page = tokio::task::spawn_blocking(|| {
        let mut socket = TcpStream::connect(served()).unwrap();
        socket.write_all(b"GET /metrics HTTP/1.0\r\n\r\n").unwrap();
        let mut page = String::new();
        socket.read_to_string(&mut page).unwrap();
        page
    });
    page.await.unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn counters_and_histograms_are_served_over_http() {
    served();
    let (mut writer, input) = stream(8);
    let (running, _) = spawn(Double, Config::default(), input).unwrap();
    writer.write(21).unwrap();
    drop(writer);
    running.join().await.unwrap();

    let page = scrape().await;
    for line in [
        "fuseline_messages_total{operator=\"operator\"} 1",
        "fuseline_outputs_total{operator=\"operator\",source=\"local\",outcome=\"arrival\"} 1",
        "fuseline_response_seconds_count{operator=\"operator\",source=\"local\"} 1",
        "fuseline_response_seconds_bucket{operator=\"operator\",source=\"local\",le=\"10\"} 1",
    ] {
        assert!(page.contains(line), "no {line} in\n{page}");
    }
}

/// An operator whose messages are speeds in m/s.
struct Vehicle;

impl Operator for Vehicle {
    type Input = f64;
    type Output = f64;

    fn setup(self, setup: &mut Setup<f64, f64>) -> Local<f64, f64> {
        setup.use_situation(|speed, _| Situation::at(MetresPerSecond(*speed)));
        let message_handler = |speed: &f64, _| Some((*speed, Duration::from_secs(2)));
        let cloud = setup.use_cloud(|speed, _| async move { Ok(speed) }, message_handler, Ok, 1);
        cloud.name = "west".into();
        cloud.policy = Some(Box::new(Guard::new(Parameters::default()).unwrap()));
        without_deadline(Local::blocking(|speed, _| Ok(*speed)))
    }
}

/// The deadline in force and its reason follow the speed from one scrape to the next (D11).
#[tokio::test(flavor = "multi_thread")]
async fn d11_the_deadline_in_force_and_why_follow_the_speed_from_one_scrape_to_the_next() {
    served();
    let (mut writer, input) = stream(8);
    let config = Config { name: "vehicle".into(), ..Config::default() };
    let (running, mut output) = spawn(Vehicle, config, input).unwrap();
    let of = |page: &str, metric: &str, labels: &str| -> f64 {
        let name = format!("{metric}{{operator=\"vehicle\",source=\"west\"{labels}}} ");
        let value = page.lines().find_map(|line| line.strip_prefix(&name));
        value.unwrap_or_else(|| panic!("no {name} in\n{page}")).parse().unwrap()
    };
    let steps = [
        (18.0, 0.6506, "local-stops", 1.0),
        (22.0, 0.9192, "cloud-alone", 1.0),
        (20.0, 0.3117, "local-stops", 2.0),
        (f64::NAN, 0.3017, "unsure", 1.0),
        (18.0, 0.6506, "local-stops", 3.0),
    ];
    for (speed, deadline, why, count) in steps {
        writer.write(speed).unwrap();
        output.read().await.unwrap();
        let page = scrape().await;
        let in_force = of(&page, "fuseline_deadline_seconds", "");
        assert!((in_force - deadline).abs() < 1e-4, "{in_force} s at {speed} m/s");
        let why = format!(",why=\"{why}\"");
        let chosen: f64 = of(&page, "fuseline_deadlines_total", &why);
        assert!((chosen - count).abs() < 0.1, "{chosen} deadlines{why}");
    }
    drop(writer);
    running.join().await.unwrap();
}
