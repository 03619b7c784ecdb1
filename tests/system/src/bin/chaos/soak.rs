//! Sends messages through many operators while everything around them is disrupted.
//!
//! `disruption` decides what is disrupted and when, `field` disrupts it, and `checks` says what
//! must hold.

use std::collections::BTreeMap;
use std::time::Duration;

use fuseline_testkit::Rng;
use fuseline_tokio::Error;
use tokio::time::{Instant, sleep, sleep_until};

use crate::checks::{ChaosCheck, ObservedRun, checks};
use crate::disruption::{Disruption, ScheduledDisruption, schedule};
use crate::field::Testbed;
use crate::fleet::{Fleet, LateItem, OperatorOutcome};
use crate::gauges::{Lateness, Overruns, ResourceUsage};
use crate::span::{ChaosTotals, TimeSpan};
use crate::summary::Summary;

/// The number of clouds. Each operator has two of them.
const CLOUDS: usize = 3;

/// After this much calm, nothing remains of earlier disruptions, including pings and reconnecting.
const SETTLES: Duration = Duration::from_secs(4);

/// How long a calm period is observed, and how long it may take until each operator has results
/// from each of its clouds again. A busy host starves some of them for seconds.
const LOOK: Duration = Duration::from_secs(3);
const LONGEST_LOOK: Duration = Duration::from_secs(60);

/// This long after a disruption begins, everything from before it has ended.
const BITES: Duration = Duration::from_millis(500);

#[derive(clap::Args)]
pub(crate) struct Args {
    /// The number of messages, shared out among the operators.
    #[arg(long, default_value_t = 100_000)]
    messages: u64,
    #[arg(long, default_value_t = 40)]
    operators: u32,
    /// The messages per second of each operator.
    #[arg(long, default_value_t = 15)]
    rate: u32,
    /// Decides what is disrupted and when; by default a seed that was never played.
    #[arg(long)]
    seed: Option<u64>,
}

/// Runs the soak. Returns `true` if everything held.
pub(crate) async fn soak(args: Args) -> Result<bool, Error> {
    let seed = args.seed.unwrap_or_else(|| Rng::by_chance().next_u64());
    let each = args.messages.div_ceil(args.operators.into());
    let (operators, rate) = (args.operators, args.rate);
    println!("seed {seed}: {operators} operators, {each} messages each, {rate} a second each");
    let folder = tempfile::tempdir()?;
    let mut field = Testbed::new(folder.path(), CLOUDS)?;
    let lateness = Lateness::start();
    let (start, before) = (Instant::now(), ResourceUsage::now()?);
    let late = LateItem { outputs: Overruns::new(), calls: Overruns::new() };
    let fleet = Fleet::launch(&field, operators, each, rate, folder.path(), &late)?;
    let messages = fleet.messages();

    let mut observed = run(&mut field, &fleet, seed, start).await?;
    let fates = fleet.land().await?;
    observed.before_and_after = (before, emptied(before).await?);
    let seconds = start.elapsed().as_secs();
    let checks = checks(messages, &observed, &fates, &late, &lateness);
    print!("{}", observed.table());
    for check in &checks {
        println!("{check}");
    }
    let summary = Summary {
        seed,
        operators,
        messages,
        seconds,
        disruptions: observed.disruptions.values().map(|span| span.times).sum(),
        longest_output_us: longest_output_us(&fates),
        greatest_timer_lateness_us: u64::try_from(lateness.greatest().as_micros())?,
        taken: observed.usage,
    };
    println!("{summary}");
    Ok(checks.iter().all(ChaosCheck::holds))
}

/// Runs rounds of every disruption while there is time. Observes a calm period after each round and
/// at the end.
async fn run(
    field: &mut Testbed,
    fleet: &Fleet,
    seed: u64,
    start: Instant,
) -> Result<ObservedRun, Error> {
    let mut observed = ObservedRun::default();
    sleep(SETTLES).await;
    for (number, disruption) in schedule(seed, CLOUDS).enumerate() {
        let needed = disruption.lasts + disruption.calm + (SETTLES + LOOK) * 2 + LOOK;
        if number >= Disruption::ALL.len() && needed > fleet.remains() {
            break;
        }
        if number > 0 && number % Disruption::ALL.len() == 0 {
            calm(fleet, &mut observed).await?;
        }
        println!("{:6.1} s: {disruption}", start.elapsed().as_secs_f64());
        observe_disruption(field, fleet, disruption, &mut observed.disruptions).await?;
        sleep(disruption.calm).await;
    }
    calm(fleet, &mut observed).await?;
    Ok(observed)
}

/// Disrupts something, observes the effect, and ends the disruption.
async fn observe_disruption(
    field: &mut Testbed,
    fleet: &Fleet,
    disruption: ScheduledDisruption,
    disruptions: &mut BTreeMap<&'static str, TimeSpan>,
) -> Result<(), Error> {
    let ends = Instant::now() + disruption.lasts;
    field.disruption(disruption)?;
    sleep(BITES).await;
    let (from, before) = (Instant::now(), ChaosTotals::of(&fleet.tallies()));
    sleep_until(ends).await;
    let now = ChaosTotals::of(&fleet.tallies());
    field.repair(disruption)?;
    let of = (!disruption.harm.is_of_all()).then_some(disruption.cloud);
    let span = now.since(&before, of, from.elapsed());
    disruptions.entry(disruption.harm.as_str()).or_default().add(&span);
    Ok(())
}

/// Observes a calm period, in which each operator must have results from each of its clouds.
async fn calm(fleet: &Fleet, observed: &mut ObservedRun) -> Result<(), Error> {
    sleep(SETTLES).await;
    let (from, before) = (Instant::now(), fleet.tallies());
    let mut usage = Vec::new();
    let goes_on = |elapsed: Duration| {
        let more = elapsed < LONGEST_LOOK && fleet.remains() > LOOK;
        elapsed < LOOK || more && !fleet.unanswered(&before).is_empty()
    };
    while goes_on(from.elapsed()) {
        usage.push(ResourceUsage::now()?);
        sleep(Duration::from_millis(100)).await;
    }
    let now = ChaosTotals::of(&fleet.tallies());
    observed.calm.add(&now.since(&ChaosTotals::of(&before), None, from.elapsed()));
    observed.unanswered.extend(fleet.unanswered(&before));
    observed.usage.push(ResourceUsage::median(&usage));
    Ok(())
}

/// Returns the resources of the process once it uses no more than before, or after ten seconds.
async fn emptied(before: ResourceUsage) -> Result<ResourceUsage, Error> {
    let until = Instant::now() + Duration::from_secs(10);
    loop {
        let now = ResourceUsage::now()?;
        if (now.files <= before.files && now.tasks <= before.tasks) || Instant::now() > until {
            return Ok(now);
        }
        sleep(Duration::from_millis(100)).await;
    }
}

/// Returns the longest time to an output, over all operators.
fn longest_output_us(fates: &[Result<OperatorOutcome, String>]) -> u64 {
    let longest = fates.iter().flatten().map(|outcome| outcome.log.longest.as_micros()).max();
    u64::try_from(longest.unwrap_or_default()).unwrap_or(u64::MAX)
}
