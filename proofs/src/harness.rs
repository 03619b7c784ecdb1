//! The harnesses, one file for each group.
//!
//! A harness starts from any valid state (`arbitrary.rs`), takes one step of the shipped code, and asserts
//! what `SPEC.md` says of it. Its name begins with the rule or promise that it shows.

pub mod fusion;
pub mod gate;
pub mod slot;
pub mod time;
pub mod wait;
pub mod window;

/// A harness with its name.
pub type NamedHarness = (&'static str, fn());

macro_rules! listed {
    ($($group:ident: $($name:ident)+;)+) => { &[$($((stringify!($name), $group::$name as fn())),+),+] };
}

/// All harnesses, as functions. A test compares this list with the sources.
#[cfg(not(target_arch = "wasm32"))]
pub const ALL: &[NamedHarness] = listed! {
    fusion: f0_queries_return_the_state f1_a_new_machine_is_valid f1_open_by_the_rule f2_offer_and_its_due
        f2_offer_refusal_is_that_of_the_offer
        p2_never_late_by_the_clock f4_fail_has_its_outcome f5_expire_by_the_rule f5_firing_is_settled;
    gate: f2g_gate p10_order_of_clouds;
    slot: every_valid_state_is_generated_and_accepted p1_once p2_never_late p3_best_available
        p4_prompt p5_local_floor p6_free_without_cloud p7_no_stall p8_timers p11_accounted
        p12_bounded_wait p13_as_patient
        f2_offer_by_the_rule f3_result_by_the_rule f4_fail_by_the_rule f6_settle_by_the_rule;
    time: a14_due_saturates a14_deadline_saturates;
    window: p9_earliest_of_a_timestamp p9_lookup p9_next_due p9_open p9_offer p9_close p9_retire;
    wait: p7_retired_by_the_latest_due p12_retired_by_the_last_request p12_retired_by_local_at_last
        p10_lateness_decides_nothing;
};
