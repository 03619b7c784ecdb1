//! A vehicle, its operator, and what it knows of the others.

use std::error::Error;
use std::path::Path;
use std::time::Duration;

use fuseline_tokio::grpc::{self, Connection, Reply, Request};
use fuseline_tokio::{Config, Local, Operator, Recording, Setup, Trace, spawn, stream};
use prost::Message;

use super::location::{Location, Locations};
use tokio::time::{Instant, interval};

/// How often a vehicle reports.
const PERIOD: Duration = Duration::from_millis(100);
/// How long it waits for the others' reports.
const DEADLINE: Duration = Duration::from_millis(500);

/// The others, as far as is known.
struct OtherVehicles {
    connection: Connection,
}

impl Operator for OtherVehicles {
    type Input = Location;
    type Output = Vec<Location>;

    fn setup(self, setup: &mut Setup<Location, Vec<Location>>) -> Local<Location, Vec<Location>> {
        let message_handler = |own: &Location, timestamp| {
            Some((
                Request { timestamp, payload: own.encode_to_vec().into(), lineage: None },
                DEADLINE,
            ))
        };
        let response_handler = |reply: Reply| Ok(Locations::decode(reply.payload)?.others);
        let handle = grpc::infer(self.connection);
        let cloud = setup.use_cloud(handle, message_handler, response_handler, 1);
        "sharing".clone_into(&mut cloud.name);
        Local::blocking(|_, _| Ok(Vec::new()))
    }
}

/// A vehicle that drives straight on for so many reports; gives what it knew of the others after each.
pub(crate) async fn drive(
    url: &str,
    start: Location,
    reports: u16,
    trace: &Path,
) -> Result<Vec<Vec<Location>>, Box<dyn Error + Send + Sync>> {
    let config = Config {
        name: start.vehicle.clone(),
        trace: Some(Trace { path: trace.to_owned(), recording: Recording::default() }),
        ..Config::default()
    };
    let connection = grpc::Remote::new(url).connect()?;
    let (mut locations, input) = stream(1);
    let (running, mut output) = spawn(OtherVehicles { connection }, config, input)?;
    let (mut period, began) = (interval(PERIOD), Instant::now());
    let mut known = Vec::new();
    for _ in 0..reports {
        period.tick().await;
        let elapsed = began.elapsed().as_secs_f64();
        let own = Location {
            time_s: start.time_s + elapsed,
            x_m: start.x_m + start.vx_mps * elapsed,
            y_m: start.y_m + start.vy_mps * elapsed,
            ..start.clone()
        };
        if locations.write(own).is_err() {
            break;
        }
        let item = output.read().await;
        let others = item.as_deref().and_then(|item| Some(item.forwarded()?.value.clone()));
        known.push(others.unwrap_or_default());
    }
    drop((locations, output));
    running.join().await?;
    Ok(known)
}
