//! ERDOS as a fusion operator with a TimestampDeadline: `erdos deadline FOLDER SCENARIO`. Local's
//! result comes on the left stream at once, the cloud's on the right one after its delay.

use std::collections::HashSet;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use erdos::dataflow::context::{SetupContext, TwoInOneOutContext};
use erdos::dataflow::operator::TwoInOneOut;
use erdos::dataflow::stream::{IngestStream, Stream, StreamId};
use erdos::dataflow::{Message, OperatorConfig, Timestamp, TimestampDeadline};
use others::DrivenRun;

#[derive(Clone)]
struct Fuse {
    harness: Arc<DrivenRun>,
    streams: [StreamId; 2],
    /// The messages that were sent. ERDOS leaves it to its user to send each once.
    sent: Arc<Mutex<HashSet<usize>>>,
}

impl Fuse {
    fn emit(&self, timestamp: &Timestamp, p: u8) {
        let Timestamp::Time(counters) = timestamp else { return };
        let t = counters[0] as usize;
        if self.sent.lock().unwrap().insert(t) {
            self.harness.record("emit", t, &format!(r#","p":{p}"#));
        }
    }
}

impl TwoInOneOut<(), usize, usize, usize> for Fuse {
    fn setup(&mut self, context: &mut SetupContext<()>) {
        let (own, deadline) = (self.clone(), self.harness.deadline());
        let missed = move |_: &(), t: &Timestamp| own.emit(t, 0); // local's result is there
        let deadline = TimestampDeadline::new(move |_: &(), _: &Timestamp| deadline, missed);
        let on_both = self.streams.iter().fold(deadline, |all, id| all.on_read_stream(*id));
        context.add_deadline(on_both);
    }

    fn on_left_data(&mut self, _: &mut TwoInOneOutContext<(), usize>, _: &usize) {}

    fn on_right_data(&mut self, context: &mut TwoInOneOutContext<(), usize>, _: &usize) {
        self.emit(context.timestamp(), 1);
    }

    fn on_watermark(&mut self, _: &mut TwoInOneOutContext<(), usize>) {}
}

fn main() {
    let harness = DrivenRun::new();
    let port = || std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let mut config = erdos::Configuration::new(0, vec![port()], vec![port()], 4);
    config.logging_level = None;
    let node = erdos::node::Node::new(config);
    let (mut local, mut cloud) = (IngestStream::<usize>::new(), IngestStream::<usize>::new());
    let streams = [Stream::id(&local), Stream::id(&cloud)];
    let fuse = Fuse { harness: harness.clone(), streams, sent: Arc::default() };
    let config = OperatorConfig::new().name("fuse");
    let _output =
        erdos::connect_two_in_one_out(move || fuse.clone(), || {}, config, &local, &cloud);
    let _node = node.run_async();
    std::thread::sleep(Duration::from_secs(3)); // nothing says when the node is ready

    // The arrivals in order: local at once, and the cloud unless its delay is null.
    let period = harness.time("period", 60).as_millis() as u64;
    let mut arrivals = Vec::new();
    for (t, delay) in harness.delays().iter().enumerate() {
        let opened = t as u64 * period;
        arrivals.push((opened, t, 0));
        arrivals.extend(delay.as_u64().map(|delay| (opened + delay, t, 1)));
    }
    arrivals.sort_unstable();
    let start = Instant::now();
    for (at, t, p) in arrivals {
        std::thread::sleep(Duration::from_millis(at).saturating_sub(start.elapsed()));
        if p == 0 {
            harness.record("open", t, "");
            let deadline = harness.deadline().as_nanos();
            harness.record("request", t, &format!(r#","p":1,"deadline":{deadline}"#));
        }
        harness.record("result", t, &format!(r#","p":{p}"#));
        let stream = if p == 0 { &mut local } else { &mut cloud };
        stream.send(Message::new_message(Timestamp::Time(vec![t as u64]), t)).unwrap();
    }
    std::thread::sleep(Duration::from_millis(500));
    harness.end();
    std::process::exit(0);
}
