//! A camera, a detector with a cloud, and a brake, as tasks that Copper schedules and logs.

mod detector;

use std::path::Path;
use std::{env, thread};

use cu29::prelude::*;
use rustix::process::{Signal, getpid, kill_process};

use crate::detector::Detector;

/// The number of frames, and the time from one to the next.
const FRAMES: u64 = 60;
const PERIOD_NS: u64 = 50_000_000;

/// Sends the number of a frame each 50 ms.
#[derive(Reflect)]
struct Camera {
    frame: u64,
    next: u64,
}

/// Prints each detection, and stops the run when every frame has one.
#[derive(Reflect)]
struct Brake {
    answered: u64,
}

#[copper_runtime(config = "copperconfig.ron")]
struct Robot {}

impl Freezable for Camera {}

impl CuSrcTask for Camera {
    type Resources<'r> = ();
    type Output<'m> = output_msg!(u64);

    fn new(_: Option<&ComponentConfig>, (): ()) -> CuResult<Self> {
        Ok(Self { frame: 0, next: 0 })
    }

    fn process(&mut self, context: &CuContext, output: &mut Self::Output<'_>) -> CuResult<()> {
        let now = context.now();
        output.clear_payload();
        if self.frame < FRAMES && self.next <= now.as_nanos() {
            output.tov = Tov::Time(now);
            output.set_payload(self.frame);
            (self.frame, self.next) = (self.frame + 1, now.as_nanos() + PERIOD_NS);
        }
        Ok(())
    }
}

impl Freezable for Brake {}

impl CuSinkTask for Brake {
    type Resources<'r> = ();
    type Input<'m> = input_msg!((u64, Option<u64>));

    fn new(_: Option<&ComponentConfig>, (): ()) -> CuResult<Self> {
        Ok(Self { answered: 0 })
    }

    fn process(&mut self, _: &CuContext, input: &Self::Input<'_>) -> CuResult<()> {
        let Some((frame, distance)) = input.payload() else { return Ok(()) };
        match distance {
            Some(distance) => println!("frame {frame}: {distance} mm"),
            None => println!("frame {frame}: nothing in time"),
        }
        self.answered += 1;
        if self.answered == FRAMES {
            kill_process(getpid(), Signal::INT).map_err(|_| CuError::from("no signal"))?;
        }
        Ok(())
    }
}

fn main() -> CuResult<()> {
    let log = env::args().nth(1).ok_or("give the path of Copper's log")?;
    thread::spawn(detector::serve_cloud);
    let app = Robot::builder().with_log_path(Path::new(&log), Some(16 << 20))?.build()?;
    app.run_until_shutdown()?;
    Ok(())
}
