use std::vec;
use std::vec::Vec;

use fuseline_core::{Cause, OfferRefusal, Source};

use super::*;

fn source(index: u8) -> Source {
    Source::new(index).unwrap()
}

/// Returns every state that a message with these clouds can have, with and without a deadline for
/// local.
fn reachable(commit: Commit, clouds: u8) -> Vec<Slot> {
    let mut found = vec![Slot::open(false), Slot::open(true)];
    for at in 0.. {
        let Some(slot) = found.get(at).copied() else { break };
        let sources = (0..=clouds).map(source);
        let stepped = sources.flat_map(|source| {
            let (admitted, refusal): (_, Option<OfferRefusal>) = slot.offer(source);
            let timers = Cause::Timers(Sources::EMPTY.with(source));
            let causes = [Cause::Result(source), Cause::Failure(source), timers];
            let steps = causes.map(|cause| slot.step(commit, cause).0);
            steps.into_iter().chain(refusal.is_none().then_some(admitted))
        });
        for next in stepped.collect::<Vec<_>>() {
            if next.is_open() && !found.contains(&next) {
                found.push(next);
            }
        }
    }
    found
}

fn every_state_survives<const CLOUDS: usize>(commit: Commit, clouds: u8) {
    let states = reachable(commit, clouds);
    assert!(states.len() > 2);
    for slot in states {
        let packed = PackedSlot::<CLOUDS>::from_bits(0).opened(slot);
        assert_eq!(packed.slot(commit), slot);
        assert_eq!(packed.stepped(slot), packed);
        assert!(packed.is_open() && !packed.stepped(Slot::RETIRED).is_open());
    }
}

/// The armed timers survive too, although the word does not store them (P8).
#[test]
fn p8_every_state_survives_its_word() {
    for commit in [Commit::Eager, Commit::Patient] {
        every_state_survives::<1>(commit, 1);
        every_state_survives::<3>(commit, 3);
        every_state_survives::<15>(commit, 3);
    }
}

#[test]
fn the_greatest_sources_survive() {
    let all = (1..Source::COUNT).fold(Slot::open(true), |slot, cloud| slot.offer(source(cloud)).0);
    for held in [14, 0] {
        let (slot, _) = all.step(Commit::Patient, Cause::Result(source(held)));
        let packed = PackedSlot::<15>::from_bits(u64::MAX).opened(slot);
        assert_eq!((packed.slot(Commit::Patient), packed.generation()), (slot, 0));
    }
}

#[test]
fn the_generation_wraps_from_retired_to_open() {
    let last = PackedSlot::<15>::from_bits(u64::from(u32::MAX) << 32);
    assert!(last.is_open());
    let retired = last.stepped(Slot::RETIRED);
    assert_eq!(retired, PackedSlot::from_bits(0));
    assert_eq!(retired.opened(Slot::open(false)).generation(), 1);
    let last = PackedSlot::<0>::from_bits(u64::MAX << 2);
    assert_eq!(last.stepped(Slot::RETIRED), PackedSlot::from_bits(0));
}
