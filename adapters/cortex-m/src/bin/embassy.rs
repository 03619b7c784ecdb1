//! An image that runs the operator of `fuseline-embassy` and prints its trace. The image moves the
//! clock itself.
#![no_std]
#![no_main]

use cortex_m as _;
use cortex_m_rt::entry;
use cortex_m_semihosting::debug::{EXIT_FAILURE, EXIT_SUCCESS, ExitStatus, exit};
use embassy_futures::block_on;
use embassy_futures::select::select;
use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_time::{Duration, MockDriver};
use fuseline_core::{Cloud, Commit, Deadline, Fusion, Held, Instant, Outcome, Priority, Timestamp};
use fuseline_cortex_m::console::Console;
use fuseline_cortex_m::line::Decisions;
use fuseline_embassy::{Arrival, Report, operate};

use core::fmt::{self, Write};

const CLOUD: Priority = Priority::new(1);

/// A result's value: the message and the source that it belongs to.
type HeldNumber = (Timestamp, Priority);

static INBOX: Channel<CriticalSectionRawMutex, Arrival<HeldNumber>, 8> = Channel::new();

#[entry]
fn main() -> ! {
    let Ok(mut fusion) = Fusion::<1, 4>::new(4, Commit::Eager, &[Cloud::new(CLOUD, 31)]) else {
        end(EXIT_FAILURE)
    };
    let mut console = Console::open();
    let header =
        r#"{"fuseline":1,"window":4,"commit":"eager","clouds":[{"p":1,"limit":31,"resume":30}]}"#;
    let mut written = writeln!(console, "{header}");
    let mut are_values_right = true;
    let write_answer = |at: Instant, reported: Report<HeldNumber, 1>| {
        are_values_right &= has_its_value(&reported);
        written = written.and_then(|()| say(&mut console, at.as_nanos(), &reported));
    };
    let mut held = Held::new();
    block_on(select(operate(&mut fusion, &mut held, INBOX.receiver(), write_answer), messages()));
    let is_over = fusion.is_empty() && held.is_empty();
    end(if written.is_ok() && are_values_right && is_over { EXIT_SUCCESS } else { EXIT_FAILURE })
}

/// Sends five messages. The cloud answers two in time and one too late. It fails one, and for the
/// last one neither the cloud nor local answers.
async fn messages() {
    for t in (0..5).map(Timestamp::new) {
        INBOX.send(Arrival::Message(t, Some(Deadline::from_millis(80)))).await;
        INBOX.send(Arrival::Request(t, CLOUD, Deadline::from_millis(40), 0)).await;
        pass(10).await;
        let local = result(t, Priority::LOCAL);
        match t.as_u64() {
            4 => pass(80).await,
            3 => {
                INBOX.send(Arrival::Failure(t, CLOUD)).await;
                INBOX.send(local).await;
            }
            late => {
                INBOX.send(local).await;
                pass(if late == 2 { 60 } else { 10 }).await;
                INBOX.send(result(t, CLOUD)).await;
            }
        }
        pass(5).await;
    }
}

fn result(t: Timestamp, source: Priority) -> Arrival<HeldNumber> {
    Arrival::Result(t, source, (t, source))
}

/// Returns `true` if a forwarded result comes with its own value, and nothing else comes with a
/// value.
fn has_its_value(reported: &Report<HeldNumber, 1>) -> bool {
    let (t, outcome, value) = match reported {
        Report::Fired(firing, value) => (firing.timestamp, firing.outcome, value),
        Report::Concluded(t, _, outcome, value) => (*t, *outcome, value),
        Report::Took(_) | Report::Opened(..) | Report::Offered(..) => return true,
    };
    match outcome {
        Outcome::Preliminary { by, .. } | Outcome::Forwarded { by, .. } => *value == Some((t, by)),
        Outcome::Dropped(_)
        | Outcome::Held
        | Outcome::Waiting
        | Outcome::Final { .. }
        | Outcome::Missed => value.is_none(),
    }
}

/// Lets the operator take its inputs, then moves the clock by this many milliseconds.
async fn pass(millis: u64) {
    for _ in 0..4 {
        yield_now().await;
    }
    for _ in 0..millis {
        MockDriver::get().advance(Duration::from_millis(1));
        yield_now().await;
    }
}

/// Writes the lines of the trace for a report.
fn say(out: &mut Console, at: u64, reported: &Report<HeldNumber, 1>) -> fmt::Result {
    let mut decisions = Decisions { out: &mut *out, commit: Commit::Eager, at };
    match *reported {
        Report::Took(None) => writeln!(out, r#"{{"ev":"tick","at":{at}}}"#),
        Report::Took(Some(Arrival::Message(t, limit))) => {
            let t = t.as_u64();
            write!(out, r#"{{"ev":"open","at":{at},"t":{t}"#)?;
            if let Some(limit) = limit {
                write!(out, r#","deadline":{}"#, limit.as_nanos())?;
            }
            out.write_str("}\n")
        }
        Report::Took(Some(Arrival::Request(t, p, deadline, backlog))) => {
            let (t, p, deadline) = (t.as_u64(), p.as_u16(), deadline.as_nanos());
            write!(out, r#"{{"ev":"offer","at":{at},"t":{t},"p":{p},"deadline":{deadline}"#)?;
            writeln!(out, r#","backlog":{backlog}}}"#)
        }
        Report::Took(Some(Arrival::Result(t, p, ()))) => {
            writeln!(out, r#"{{"ev":"result","at":{at},"t":{},"p":{}}}"#, t.as_u64(), p.as_u16())
        }
        Report::Took(Some(Arrival::Failure(t, p))) => {
            writeln!(out, r#"{{"ev":"fail","at":{at},"t":{},"p":{}}}"#, t.as_u64(), p.as_u16())
        }
        Report::Fired(firing, _) => decisions.firing(&firing),
        Report::Opened(t, opening) => decisions.opening(t.as_u64(), opening),
        Report::Offered(t, p, admission) => {
            decisions.admission(t.as_u64(), p.as_u16().into(), admission)
        }
        Report::Concluded(t, p, outcome, _) => {
            decisions.outcome(t.as_u64(), p.as_u16().into(), &outcome)
        }
    }
}

fn end(status: ExitStatus) -> ! {
    loop {
        exit(status);
    }
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    end(EXIT_FAILURE)
}
