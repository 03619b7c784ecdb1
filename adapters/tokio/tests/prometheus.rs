//! Metrics as Prometheus sees them. One test, since a program has one metrics recorder.
#![cfg(feature = "prometheus")]

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};

use fuseline_tokio::{Config, Local, Operator, Setup, prometheus, spawn, stream};

struct Double;

impl Operator for Double {
    type Input = u64;
    type Output = u64;

    fn setup(self, _: &mut Setup<u64, u64>) -> Local<u64, u64> {
        Local::blocking(|message, _| Ok(message * 2))
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn counters_and_histograms_are_served_over_http() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap();
    assert!(prometheus(address).is_err());
    drop(taken);
    prometheus(address).unwrap();

    let (mut writer, input) = stream(8);
    let (running, _) = spawn(Double, Config::default(), input).unwrap();
    writer.write(21).unwrap();
    drop(writer);
    running.join().await.unwrap();

    let page = tokio::task::spawn_blocking(move || {
        let mut socket = TcpStream::connect(address).unwrap();
        socket.write_all(b"GET /metrics HTTP/1.0\r\n\r\n").unwrap();
        let mut page = String::new();
        socket.read_to_string(&mut page).unwrap();
        page
    });
    let page = page.await.unwrap();
    for line in [
        "fuseline_messages_total{operator=\"operator\"} 1",
        "fuseline_outputs_total{operator=\"operator\",source=\"local\",outcome=\"arrival\"} 1",
        "fuseline_response_seconds_count{operator=\"operator\",source=\"local\"} 1",
        "fuseline_response_seconds_bucket{operator=\"operator\",source=\"local\",le=\"10\"} 1",
    ] {
        assert!(page.contains(line), "no {line} in\n{page}");
    }
}
