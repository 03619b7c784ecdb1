//! Prints the Kaplan-Meier estimate for a CSV file on standard input with the columns
//! `response_s,answered,count`. Each step is one line.

use std::io;
use std::time::Duration;

use fuseline_deadline::{Observation, Survival};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut observations = Vec::new();
    for line in io::stdin().lines().skip(1) {
        let line = line?;
        let cells: Vec<&str> = line.split(',').collect();
        let [response, answered, count] = cells[..] else {
            return Err(format!("three columns are wanted: {line}").into());
        };
        observations.push(Observation {
            response: Duration::try_from_secs_f64(response.parse()?)?,
            is_answered: answered == "1",
            count: count.parse()?,
        });
    }
    observations.sort_by_key(Observation::key);
    println!("response_s,survival");
    for step in Survival::new(observations.into_iter(), &[]) {
        println!("{:?},{:?}", step.response.as_secs_f64(), step.survival);
    }
    Ok(())
}
