//! An image that answers the inputs of `fuseline drive` with the machine alone, without an
//! operating system or an allocator.
#![no_std]
#![no_main]

use core::fmt::Write;

use cortex_m_rt::entry;
use cortex_m_semihosting::debug::{EXIT_FAILURE, EXIT_SUCCESS, exit};
use fuseline_core::{
    Admission, Deadline, DropReason, Fusion, Instant, OfferRefusal, Outcome, Priority, Timestamp,
};
use fuseline_cortex_m::console::Console;
use fuseline_cortex_m::line::{Decisions, Line};

/// The largest machine that `SPEC.md` allows.
type LargestFusion = Fusion<15, 1024>;
/// Collects the whole answer, so that the host is called only once for it. The largest answer has
/// 1024 timestamps with 16 timers each.
type AnswerText = heapless::String<{ 2 * 1024 * 1024 }>;

#[entry]
fn main() -> ! {
    static mut ANSWER: AnswerText = heapless::String::new();
    let mut console = Console::open();
    let mut machine: Option<LargestFusion> = None;
    loop {
        let Some(text) = console.line() else { end(EXIT_SUCCESS) };
        ANSWER.clear();
        if Line::parse(text).and_then(|line| reply(&mut machine, &line, ANSWER)).is_none()
            || console.write_str(ANSWER).is_err()
        {
            end(EXIT_FAILURE);
        }
    }
}

fn reply(machine: &mut Option<LargestFusion>, line: &Line<'_>, out: &mut AnswerText) -> Option<()> {
    if line.fuseline.is_some() {
        let (window, commit, clouds) = line.configuration()?;
        *machine = Some(LargestFusion::new(window, commit, &clouds).ok()?);
    } else {
        apply_line(machine.as_mut()?, line, out)?;
    }
    out.write_str("{\"ev\":\"done\"}\n").ok()
}

fn apply_line(machine: &mut LargestFusion, line: &Line<'_>, out: &mut AnswerText) -> Option<()> {
    let now = line.at?;
    // A decision bears the machine's instant, which does not go back (F0).
    let (commit, at) = (machine.commit(), machine.now().as_nanos().max(now));
    let mut decisions = Decisions { out, commit, at };
    let mut fired = Ok(());
    let mut ready = machine.ready(Instant::from_nanos(now), |firing| {
        fired = fired.and_then(|()| decisions.firing(&firing));
    });
    fired.ok()?;
    let t = Timestamp::new(line.t.unwrap_or_default());
    let number = line.p.unwrap_or_default();
    // A priority that does not fit 16 bits cannot be registered (A18).
    let p = u16::try_from(number).ok().map(Priority::new);
    let unknown = Outcome::Dropped(DropReason::Unknown);
    let written = match line.ev? {
        "tick" => Ok(()),
        "open" => {
            let opening = ready.open(t, line.deadline.map(Deadline::from_nanos));
            decisions.opening(t.as_u64(), opening)
        }
        "offer" => {
            let (deadline, backlog) = (Deadline::from_nanos(line.deadline?), line.backlog?);
            let unknown = Admission::Refused(OfferRefusal::Unknown);
            let admission = p.map_or(unknown, |p| ready.offer(t, p, deadline, backlog));
            decisions.admission(t.as_u64(), number, admission)
        }
        "result" => {
            let outcome = p.map_or(unknown, |p| ready.result(t, p));
            decisions.outcome(t.as_u64(), number, &outcome)
        }
        "fail" => {
            let outcome = p.map_or(unknown, |p| ready.fail(t, p));
            decisions.outcome(t.as_u64(), number, &outcome)
        }
        _ => return None,
    };
    written.ok()
}

fn end(status: cortex_m_semihosting::debug::ExitStatus) -> ! {
    loop {
        exit(status);
    }
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    end(EXIT_FAILURE)
}
