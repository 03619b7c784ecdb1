//! Messages through many operators while everything around them breaks.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

use fuseline_tokio::Error;
use tokio::time::{Instant, sleep, sleep_until};

use crate::checks::{Course, checks};
use crate::field::Field;
use crate::fleet::{Fate, Fleet, Late};
use crate::gauges::{Lateness, Overruns, Taken};
use crate::record::{self, Soaked};
use crate::spell::{Done, Spell};
use crate::strike::{Harm, Strike, schedule};

/// How many clouds there are; each operator has two of them.
const CLOUDS: usize = 3;

/// After so long of calm nothing is left of what was before: pings and connecting again included.
const SETTLES: Duration = Duration::from_secs(4);

/// How long a calm is looked at.
const LOOK: Duration = Duration::from_secs(3);

/// After so long of a strike, what came before it is over.
const BITES: Duration = Duration::from_millis(500);

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Messages in all, shared out among the operators.
    #[arg(long, default_value_t = 100_000)]
    messages: u64,
    #[arg(long, default_value_t = 40)]
    operators: u32,
    /// Messages a second of each operator.
    #[arg(long, default_value_t = 15)]
    rate: u32,
    /// Decides what breaks when; by default one that was never played.
    #[arg(long)]
    seed: Option<u64>,
    /// Keeps the record in the project at this path.
    #[arg(long, value_name = "ROOT")]
    keep: Option<PathBuf>,
}

/// Whether everything held.
pub(crate) async fn soak(args: Args) -> Result<bool, Error> {
    let sources = args.keep.as_deref().map(record::digest).transpose()?;
    let seed = args.seed.unwrap_or_else(|| fastrand::u64(..));
    let each = args.messages.div_ceil(args.operators.into());
    let (operators, rate) = (args.operators, args.rate);
    println!("seed {seed}: {operators} operators, {each} messages each, {rate} a second each");
    let folder = tempfile::tempdir()?;
    let mut field = Field::new(folder.path(), CLOUDS)?;
    let lateness = Lateness::start();
    let (start, before) = (Instant::now(), Taken::now()?);
    let late = Late { outputs: Overruns::new(), calls: Overruns::new() };
    let fleet = Fleet::launch(&field, operators, each, rate, folder.path(), &late)?;
    let messages = fleet.messages();

    let mut course = run(&mut field, &fleet, seed, start).await?;
    let fates = fleet.land().await?;
    course.left = (before, emptied(before).await?);
    let seconds = start.elapsed().as_secs();
    let checks = checks(messages, &course, &fates, &late, &lateness);
    print!("{}", course.table());
    for check in &checks {
        println!("{check}");
    }
    let soaked = Soaked {
        sources: sources.unwrap_or_default(),
        seed,
        operators,
        messages,
        seconds,
        greatest_timer_lateness_us: u64::try_from(lateness.greatest().as_micros())?,
        broken: checks.iter().filter(|check| !check.holds()).map(ToString::to_string).collect(),
        ..summed(course, &fates)
    };
    println!("{soaked}");
    if let Some(root) = &args.keep {
        record::keep(root, &soaked)?;
    }
    Ok(soaked.broken.is_empty())
}

/// Rounds of every strike, each with a calm behind it, as many strikes as there is time for, and a calm.
async fn run(field: &mut Field, fleet: &Fleet, seed: u64, start: Instant) -> Result<Course, Error> {
    let mut course = Course::default();
    sleep(SETTLES).await;
    for (number, strike) in schedule(seed, CLOUDS).enumerate() {
        let needed = strike.lasts + strike.calm + (SETTLES + LOOK) * 2 + LOOK;
        if number >= Harm::ALL.len() && needed > fleet.remains() {
            break;
        }
        if number > 0 && number % Harm::ALL.len() == 0 {
            calm(fleet, &mut course).await?;
        }
        println!("{:6.1} s: {strike}", start.elapsed().as_secs_f64());
        struck(field, fleet, strike, &mut course.strikes).await?;
        sleep(strike.calm).await;
    }
    calm(fleet, &mut course).await?;
    Ok(course)
}

/// Strikes, looks and mends.
async fn struck(
    field: &mut Field,
    fleet: &Fleet,
    strike: Strike,
    strikes: &mut BTreeMap<&'static str, Spell>,
) -> Result<(), Error> {
    let ends = Instant::now() + strike.lasts;
    field.strike(strike)?;
    sleep(BITES).await;
    let (from, before) = (Instant::now(), Done::of(&fleet.tallies()));
    sleep_until(ends).await;
    let now = Done::of(&fleet.tallies());
    field.mend(strike)?;
    let of = (!strike.harm.is_of_all()).then_some(strike.cloud);
    let spell = now.since(&before, of, from.elapsed());
    strikes.entry(strike.harm.as_str()).or_default().add(&spell);
    Ok(())
}

/// Looks at what there is while nothing breaks: each operator hears each of its clouds.
async fn calm(fleet: &Fleet, course: &mut Course) -> Result<(), Error> {
    sleep(SETTLES).await;
    let (from, before) = (Instant::now(), fleet.tallies());
    let mut taken = Vec::new();
    while from.elapsed() < LOOK {
        taken.push(Taken::now()?);
        sleep(Duration::from_millis(100)).await;
    }
    let now = Done::of(&fleet.tallies());
    course.calm.add(&now.since(&Done::of(&before), None, from.elapsed()));
    course.unheard.extend(fleet.unheard(&before));
    course.taken.push(Taken::median(&taken));
    Ok(())
}

/// What the process takes once it takes no more than it did before, or in ten seconds.
async fn emptied(before: Taken) -> Result<Taken, Error> {
    let until = Instant::now() + Duration::from_secs(10);
    loop {
        let now = Taken::now()?;
        if (now.files <= before.files && now.tasks <= before.tasks) || Instant::now() > until {
            return Ok(now);
        }
        sleep(Duration::from_millis(100)).await;
    }
}

/// The sums over all operators; the rest is the caller's.
fn summed(course: Course, fates: &[Result<Fate, String>]) -> Soaked {
    let (mut answers, mut failures) = (BTreeMap::new(), BTreeMap::new());
    let mut soaked = Soaked {
        strikes: course.strikes.into_iter().map(|(harm, spell)| (harm.to_owned(), spell)).collect(),
        calm: course.calm,
        taken: course.taken,
        ..Soaked::default()
    };
    for fate in fates.iter().flatten() {
        for (source, count) in &fate.seen.answers {
            *answers.entry(source.clone()).or_default() += count;
        }
        for (why, count) in fate.tally.sources.iter().flat_map(|source| source.reasons.iter()) {
            *failures.entry(why.to_owned()).or_default() += count;
        }
        let longest = u64::try_from(fate.seen.longest.as_micros()).unwrap_or(u64::MAX);
        soaked.longest_output_us = soaked.longest_output_us.max(longest);
        soaked.trace_lines += fate.trace_lines;
        soaked.trace_bytes += fate.trace_bytes;
    }
    Soaked { answers, failures, ..soaked }
}
