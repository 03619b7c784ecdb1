//! An operator whose deadlines follow the vehicle's speed, and which also sends side requests to a
//! planner. Run it with `cargo run -p fuseline-tokio --example vehicle`.

use std::time::Duration;

use fuseline_tokio::deadline::{
    Expected, Guard, Impact, Invalid, MetresPerSecond, Parameters, Policy, Situation,
};
use fuseline_tokio::{Call, Config, Error, Local, Operator, Setup, SharedState, spawn, stream};
use tokio::runtime::Builder;
use tokio::time::timeout;

#[derive(Clone, Debug)]
struct Frame {
    speed: f64,
}

#[derive(Clone, Default)]
struct Plan {
    lane: u32,
}

struct Vehicle;

impl Operator for Vehicle {
    type Input = Frame;
    type Output = String;

    fn setup(self, setup: &mut Setup<Frame, String>) -> Local<Frame, String> {
        use_detector(setup).expect("the parameters are sound");
        use_planner(setup)
    }
}

/// Registers a cloud. Its deadline is as long as is safe at the current speed and worth the wait,
/// but at most 2 s.
fn use_detector(setup: &mut Setup<Frame, String>) -> Result<(), Invalid> {
    let guard = Guard::new(Parameters::default())?;
    let expected =
        Expected::<_>::new(Impact::from(&guard), Duration::from_micros(301_700), Some(16))?;
    let handle = |_frame: Frame, _call: Call| async { Ok("by the cloud".to_owned()) };
    let message_handler = |frame: &Frame, _t| Some((frame.clone(), Duration::from_secs(2)));
    let cloud = setup.use_cloud(handle, message_handler, Ok, 1);
    cloud.policy = Some(Box::new(guard.cap(expected)));
    setup.use_situation(|frame, _t| Situation::at(MetresPerSecond(frame.speed)));
    Ok(())
}

/// Registers a planner. Its answers are not outputs, but they help local with later messages.
fn use_planner(setup: &mut Setup<Frame, String>) -> Local<Frame, String> {
    let plan = SharedState::new(Plan::default());
    let newest = plan.clone();
    let message_handler = |frame: &Frame, _t| Some((frame.clone(), Duration::from_secs(1)));
    let response_handler = move |answer| {
        newest.with(|plan| *plan = answer);
        Ok(())
    };
    setup.use_side_request(ask_planner, message_handler, response_handler).calls = 2;
    setup.on_late_result(|hint| println!("{} came {:?} after its message", hint.value, hint.age));
    Local::blocking(move |_frame, _t| Ok(plan.with(|plan| format!("on board, lane {}", plan.lane))))
}

async fn ask_planner(_: Frame, _: Call) -> Result<Plan, Error> {
    Ok(Plan { lane: 1 })
}

/// Creates a runtime for the operator and reads the output on it, as a program without a runtime
/// must.
fn main() -> Result<(), Error> {
    let runtime = Builder::new_multi_thread().enable_all().build()?;
    let (mut camera, frames) = stream(8);
    let started = runtime.block_on(async { spawn(Vehicle, Config::default(), frames) });
    let (running, mut output) = started?;
    for speed in [0.0, 12.0, 25.0] {
        camera.write(Frame { speed })?; // never waits
        let reading = async { timeout(Duration::from_secs(5), output.read()).await };
        match runtime.block_on(reading) {
            Ok(Some(item)) => println!("at {speed} m/s: {:?}", item.value()),
            Ok(None) => break,                        // the operator has ended
            Err(_) => println!("nothing within 5 s"), // the next read has it
        }
    }
    drop(camera); // no more messages: the operator ends once all are answered
    runtime.block_on(running.join())?;
    runtime.shutdown_background(); // waits for no computation that hangs
    Ok(())
}
