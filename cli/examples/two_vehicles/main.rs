//! Two vehicles that share their locations through `fuseline serve --locations`, by ordinary operators: each message is a
//! vehicle's own location, local answers that nobody is there, and the cloud who is.
//!
//! ```sh
//! fuseline serve --locations
//! cargo run --example two_vehicles -- http://127.0.0.1:50051
//! fuseline check ego.jsonl runner.jsonl
//! ```

#[path = "../../src/serve/location.rs"]
mod location;
mod vehicle;

use std::error::Error;
use std::path::Path;

use location::Location;
use vehicle::drive;

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let url = std::env::args().nth(1).ok_or("name the server: http://127.0.0.1:50051")?;
    let vehicle = |vehicle: &str, x_m, y_m, vx_mps, vy_mps| {
        let vehicle = vehicle.to_owned();
        Location { vehicle, time_s: 0.0, x_m, y_m, vx_mps, vy_mps }
    };
    let (ego, runner) = tokio::try_join!(
        drive(&url, vehicle("ego", -36.0, -1.75, 12.0, 0.0), 30, Path::new("ego.jsonl")),
        drive(&url, vehicle("runner", 1.75, -42.0, 0.0, 14.0), 30, Path::new("runner.jsonl")),
    )?;
    for (i, (ego, runner)) in ego.iter().zip(&runner).enumerate() {
        let position = |known: &[Location]| match known.first() {
            Some(Location { vehicle, x_m, y_m, .. }) => format!("{vehicle} at {x_m:.1}, {y_m:.1}"),
            None => "nobody".to_owned(),
        };
        println!("report {i:>2}: ego knows {}; runner knows {}", position(ego), position(runner));
    }
    Ok(())
}
