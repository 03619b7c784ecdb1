//! Tests reading, refusing and following drives.

use std::time::Duration;
use std::{fs, io};

use fuseline_testkit::networks::{Drive, DriveError, built_in, each_row};

const GAP: &str = "second,rtt_ms\n10,100\n11,-1\n12,-1\n13,50\n14,-1\n";

fn read(text: &str) -> Result<Drive, DriveError> {
    Drive::read("d.csv", None, text.as_bytes())
}

fn fault(text: &str) -> String {
    read(text).unwrap_err().to_string()
}

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

#[test]
fn every_built_in_drive_is_readable() {
    for name in built_in() {
        let network = if name.starts_with("vnperf") { ":sprint" } else { "" };
        let drive = Drive::load(&format!("{name}{network}")).unwrap();
        let text = fs::read_to_string(format!("../testkit/data/{name}.csv")).unwrap();
        assert_eq!(drive.samples().len(), text.lines().count() - 1, "{name}");
        assert_eq!(drive.samples().next().unwrap().0, Duration::ZERO, "{name}");
    }
}

#[test]
fn a_sample_holds_until_the_next() {
    let drive = Drive::load("cicv5g/rural_n8_v10").unwrap();
    assert_eq!(drive.round_trip(ms(0)), Some(ms(48)));
    assert_eq!(drive.round_trip(ms(54)), Some(ms(48)));
    assert_eq!(drive.round_trip(ms(55)), Some(ms(25)));
}

#[test]
fn a_drive_starts_again_after_its_last_sample() {
    let drive = read("sent_ms,rtt_ms\n0,1\n50,2\n").unwrap();
    assert_eq!(drive.length(), ms(100));
    assert_eq!(drive.round_trip(ms(99)), Some(ms(2)));
    assert_eq!(drive.round_trip(ms(100)), Some(ms(1)));
}

#[test]
fn waits_for_the_next_sample_with_a_network() {
    let drive = read(GAP).unwrap();
    assert_eq!(drive.round_trip(ms(999)), Some(ms(100)));
    assert_eq!(drive.round_trip(ms(1000)), Some(ms(2050)));
    assert_eq!(drive.round_trip(ms(2900)), Some(ms(150)));
    // The wait of the last row continues into the next lap.
    assert_eq!(drive.round_trip(ms(4400)), Some(ms(700)));
}

#[test]
fn a_network_that_never_is_there_never_replies() {
    let drive = Drive::load("vnperf/highway:wifi").unwrap();
    assert_eq!(drive.round_trip(ms(12_345)), None);
}

#[test]
fn several_networks_must_be_named() {
    let fault = Drive::load("vnperf/highway").unwrap_err().to_string();
    assert!(fault.contains("vnperf/highway:verizon or vnperf/highway:sprint"), "{fault}");
    let fault = Drive::load("vnperf/highway:nokia").unwrap_err().to_string();
    assert!(fault.contains("no column \"nokia_rtt_ms\""), "{fault}");
}

#[test]
fn bad_recordings_name_the_line_and_the_column() {
    for (text, expected) in [
        ("sent_ms,rtt_ms\n0,1\n", "fewer than two rows"),
        ("ms,rtt_ms\n0,1\n1,1\n", "d.csv:1: no time column"),
        ("sent_ms,delay\n0,1\n1,1\n", "d.csv:1: no column \"rtt_ms\"; it has sent_ms, delay"),
        ("sent_ms,rtt_ms\n0,1\n50,x\n", "d.csv:3: rtt_ms is \"x\""),
        ("sent_ms,rtt_ms\n0,1\n50,-2\n", "d.csv:3: rtt_ms is \"-2\""),
        ("sent_ms,rtt_ms\n0,1\n50,NaN\n", "d.csv:3: rtt_ms is \"NaN\""),
        ("sent_ms,rtt_ms\n0,1\n50,86400001\n", "d.csv:3: rtt_ms is \"86400001\""),
        ("sent_ms,rtt_ms\n0,1\n0,1\n", "d.csv:3: sent_ms is \"0\""),
        ("second,rtt_ms\n0,1\n31536000,1\n31536001,1\n", "d.csv:4: second is \"31536001\""),
        ("second,rtt_ms\n0,1\n1e19,1\n", "d.csv:3: second is \"1e19\""),
        ("sent_ms,rtt_ms\nx,1\n1,1\n", "d.csv:2: sent_ms is \"x\""),
        ("sent_ms,rtt_ms\n0,1\ninf,1\n", "d.csv:3: sent_ms is \"inf\""),
        ("sent_ms,rtt_ms\n0,1\n2\n", "d.csv:3: 1 cells, where the first row has 2"),
        ("", "d.csv:1: no time column"),
    ] {
        assert!(fault(text).contains(expected), "{text:?}: {}", fault(text));
    }
}

#[test]
fn a_drive_may_say_what_its_link_carries() {
    let text = "second,a_rtt_ms,b_rtt_ms,a_uplink_mbps,uplink_mbps\n0,1,1,8,9\n1,1,1,0,9\n";
    let drive = Drive::read("d.csv", Some("a"), text.as_bytes()).unwrap();
    assert_eq!(drive.rate(0, ms(400)), Some((8_000_000, ms(600))));
    assert_eq!(drive.rate(0, ms(1000)), Some((0, ms(1000))));
    assert_eq!(drive.rate(0, ms(2000)), Some((8_000_000, ms(1000))));
    assert_eq!(drive.rate(1, ms(0)), None);
    let other = Drive::read("d.csv", Some("b"), text.as_bytes()).unwrap();
    assert!(drive.has_rates() && !other.has_rates());
    let rows = "second,rtt_ms,uplink_mbps\n0,1,0\n1,1,";
    assert!(fault(&format!("{rows}-1\n")).contains("d.csv:3: uplink_mbps is \"-1\""));
    assert!(fault(&format!("{rows}0\n")).contains("d.csv:3: uplink_mbps is \"0\""));
}

#[test]
fn an_endless_recording_is_refused() {
    let endless = io::repeat(b'1');
    let fault = Drive::read("d.csv", None, endless).unwrap_err();
    assert!(matches!(fault, DriveError::TooLarge { .. }), "{fault}");
}

#[test]
fn default_drives_lose_networks_apart_and_together() {
    let west = Drive::load("cicv5g/rural_n8_v10").unwrap();
    let east = Drive::load("vnperf/highway:sprint").unwrap();
    let lost = |drive: &Drive, start, at: u64| {
        drive.round_trip(ms(start + at)).is_none_or(|round_trip| round_trip > ms(1000))
    };
    let at = |at| (lost(&west, 62_000, at), lost(&east, 150_000, at));
    assert_eq!(at(5_000), (false, false));
    assert_eq!(at(13_000), (true, false));
    assert_eq!(at(18_000), (true, true));
    assert_eq!(at(24_000), (false, true));
}

#[test]
fn rows_have_their_own_times_and_queues() {
    let text = "sent_ms,rtt_ms,queued\n500,2,30\n550,-1,31\n600,3,\n";
    let mut rows = Vec::new();
    let has_rate = each_row("d.csv", None, text.as_bytes(), |row| rows.push(row)).unwrap();
    assert_eq!(has_rate, [false; 2]);
    let rows: Vec<_> =
        rows.iter().map(|row| (row.sent, row.at, row.round_trip, row.queued)).collect();
    let expected = [
        (0.5, ms(0), Some(ms(2)), Some(30)),
        (0.55, ms(50), None, Some(31)),
        (0.6, ms(100), Some(ms(3)), None),
    ];
    assert_eq!(rows, expected);
}
