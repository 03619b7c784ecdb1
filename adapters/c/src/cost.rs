//! Gives the inputs of `tests/cost/cost.c` to the machine from Rust. The difference is the cost of
//! the C interface.
#![expect(unsafe_code, reason = "exports a function to C")]

use fuseline_core::{
    Cloud, Commit, Deadline, Fusion, Instant, Outcome, Priority, Ready, Timestamp,
};

/// Gives six inputs for each of `messages` messages. Returns the number of messages that were
/// forwarded.
#[unsafe(no_mangle)]
pub extern "C" fn fuseline_cost_in_rust(messages: u64) -> u64 {
    let clouds = [1, 2, 3].map(|p| Cloud::new(Priority::new(p), 31));
    let Ok(mut fusion) = Fusion::<3, 16>::new(16, Commit::Eager, &clouds) else { return 0 };
    let mut forwarded = 0;
    for t in 0..messages {
        let now = t.wrapping_mul(100);
        let _ = core::hint::black_box(
            ready(&mut fusion, now, &mut forwarded).open(Timestamp::new(t), None),
        );
        for p in 1..=3 {
            let mut ready = ready(&mut fusion, now, &mut forwarded);
            let deadline = Deadline::from_nanos(350);
            let _ = core::hint::black_box(ready.offer(
                Timestamp::new(t),
                Priority::new(p),
                deadline,
                0,
            ));
        }
        let at = now.wrapping_add(20);
        for p in [Priority::LOCAL, Priority::new(2)] {
            let outcome = ready(&mut fusion, at, &mut forwarded).result(Timestamp::new(t), p);
            count(&core::hint::black_box(outcome), &mut forwarded);
        }
    }
    forwarded
}

fn ready<'a>(fusion: &'a mut Fusion<3, 16>, now: u64, forwarded: &mut u64) -> Ready<'a, 3, 16> {
    fusion.ready(Instant::from_nanos(now), |firing| {
        count(&core::hint::black_box(firing).outcome, forwarded);
    })
}

fn count(outcome: &Outcome<3>, forwarded: &mut u64) {
    if matches!(outcome, Outcome::Forwarded { .. }) {
        *forwarded = forwarded.wrapping_add(1);
    }
}
