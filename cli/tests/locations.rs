//! Two vehicles share their locations through `fuseline serve --locations`.

#[path = "../src/serve/location.rs"]
mod location;
#[path = "../examples/two_vehicles/vehicle.rs"]
mod vehicle;

use std::io::{BufRead, BufReader};
use std::process::{Child, Stdio};

use crate::common::{err, fuseline, out, run};
use location::Location;
use tempfile::tempdir;
use tokio::time::{Duration, timeout};
use vehicle::drive;

/// It ends with this.
struct Server(Child);

impl Drop for Server {
    fn drop(&mut self) {
        drop(self.0.kill());
        drop(self.0.wait());
    }
}

fn start(args: &[&str]) -> (Server, String) {
    let all = [&["serve", "--listen", "127.0.0.1:0", "--locations"], args].concat();
    let mut child = fuseline(&all).stdout(Stdio::piped()).spawn().unwrap();
    let mut printed = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut printed).unwrap();
    let url = printed.trim().strip_prefix("locations of vehicles at ").unwrap().to_owned();
    (Server(child), url)
}

fn named(name: &str, x_m: f64) -> Location {
    let vehicle = name.to_owned();
    Location { vehicle, time_s: 0.0, x_m, y_m: 0.0, vx_mps: 10.0, vy_mps: 0.0 }
}

/// D2: what a vehicle receives of another is what that one sent.
#[tokio::test(flavor = "multi_thread")]
async fn two_vehicles_know_each_other_and_their_traces_conform() {
    let dir = tempdir().unwrap();
    let (_server, url) = start(&[]);
    let traces = ["ego.jsonl", "runner.jsonl"].map(|name| dir.path().join(name));
    let both = async {
        tokio::try_join!(
            drive(&url, named("ego", 0.0), 10, &traces[0]),
            drive(&url, named("runner", 500.0), 10, &traces[1]),
        )
    };
    let (ego, runner) = timeout(Duration::from_secs(60), both).await.unwrap().unwrap();
    for (known, other) in [(ego, "runner"), (runner, "ego")] {
        let locations: Vec<&Location> = known.iter().flatten().collect();
        assert!(
            !locations.is_empty() && locations.iter().all(|locations| locations.vehicle == other),
            "{known:?}"
        );
        assert!(known.iter().all(|known| known.len() <= 1), "{known:?}");
        // The last report, and where the other was at its time.
        assert!(locations.is_sorted_by(|one, next| one.time_s <= next.time_s), "{locations:?}");
        let x = if other == "ego" { 0.0 } else { 500.0 };
        assert!(
            locations.iter().all(|it| (it.x_m - x - 10.0 * it.time_s).abs() < 1e-6),
            "{locations:?}"
        );
    }
    for trace in &traces {
        let checked = run(&["check", trace.to_str().unwrap()], "");
        assert_eq!(checked.status.code(), Some(0), "{}{}", out(&checked), err(&checked));
        assert!(out(&checked).contains("conforms, 10 timestamps judged"), "{}", out(&checked));
    }
}

/// D8.
#[tokio::test(flavor = "multi_thread")]
async fn a_vehicle_too_many_is_alone_and_goes_on() {
    let dir = tempdir().unwrap();
    let (_server, url) = start(&["--vehicles", "1", "--age", "60"]);
    let trace = |name: &str| dir.path().join(name);
    let first = drive(&url, named("first", 0.0), 1, &trace("first.jsonl")).await.unwrap();
    let second = drive(&url, named("second", 0.0), 2, &trace("second.jsonl")).await.unwrap();
    assert_eq!((first.concat(), second.concat()), (vec![], vec![]));
    let second = trace("second.jsonl");
    assert!(std::fs::read_to_string(&second).unwrap().contains("\"ev\":\"fail\""));
    assert_eq!(run(&["check", second.to_str().unwrap()], "").status.code(), Some(0));
}
