//! Tests a server among well-behaved and hostile clients, in virtual time. `VISITORS_SEED=N`
//! repeats one run, and `VISITORS=N` makes N runs.
#![cfg(feature = "grpc")]

#[path = "support/hostile_clients.rs"]
mod hostile_clients;
#[path = "support/memory.rs"]
mod memory;
#[path = "support/visitors.rs"]
mod visitors;
#[path = "support/well_behaved_clients.rs"]
mod well_behaved_clients;
#[path = "support/years.rs"]
mod years;

use tokio::runtime::Builder;

fn number(name: &str) -> Option<u64> {
    std::env::var(name).ok().map(|number| number.parse().expect("a number"))
}

/// Hostile clients are closed at their bounds and leave nothing behind (D6, D8, D12).
#[test]
fn hostile_clients_leave_nothing_behind() {
    let seeds = match number("VISITORS_SEED") {
        Some(seed) => seed..seed + 1,
        None => 0..number("VISITORS").unwrap_or(8),
    };
    for seed in seeds {
        let runtime = Builder::new_current_thread().enable_time().start_paused(true).build();
        let wrong = runtime.unwrap().block_on(visitors::server_wrongs(seed));
        assert!(wrong.is_empty(), "VISITORS_SEED={seed}: {wrong:#?}");
    }
}

/// Each bound ends what reached it at its own instant, after a day, a year, and beyond the range of
/// the runtime's timer wheel (D6, D8, D9).
#[test]
fn each_bound_of_a_server_ends_what_reached_it_at_its_own_instant_however_far() {
    let runtime = Builder::new_current_thread().enable_time().start_paused(true).build();
    let wrong = runtime.unwrap().block_on(years::years_wrongs());
    assert!(wrong.is_empty(), "{wrong:#?}");
}
