//! Compares the table with the paper's, cell by cell.

use std::time::Duration;

use crate::approach::{Approach, Vehicle};
use crate::paper::PAPER;
use crate::tests::REFERENCE as PIPELINED;
use crate::traffic_jam::cells::{CellParameters, Colour, DeadlineChoice, Jam};
use crate::traffic_jam::narrow::{holds, misses};

/// Returns the guard's deadline.
pub(crate) fn guard(vehicle: &Vehicle, speed: f64) -> Duration {
    Jam::new(*vehicle, DeadlineChoice::Guard).unwrap().deadline(speed, 0.0)
}

fn all_90(vehicle: Vehicle) -> (usize, usize) {
    let jam = Jam::new(vehicle, DeadlineChoice::Guard).unwrap();
    let (mut collide, mut cells) = (0, 0);
    for speed in PAPER.traffic_jam.speeds() {
        for approach in [Approach::Local, Approach::Cloud, Approach::Ours] {
            for response in &PAPER.traffic_jam.cloud_response_s {
                let question = CellParameters { speed, approach, response: *response };
                let cell = jam.cell(&question, None).unwrap();
                assert!(cell.paper.is_some() && cell.is_as_in_paper(), "{cell:?}");
                cells += 1;
                collide += usize::from(cell.outcome == Colour::Collides);
            }
        }
    }
    (cells, collide)
}

#[test]
fn all_90_cells_are_the_papers_if_local_is_pipelined() {
    assert_eq!(all_90(PIPELINED), (90, 33));
}

#[test]
fn all_90_cells_are_the_papers_if_local_computes_one_frame_at_a_time() {
    let serial = Vehicle { local_serial: true, range_local: 55.2, ..PIPELINED };
    assert_eq!(all_90(serial), (90, 33));
}

#[test]
fn each_parameter_beyond_its_interval_breaks_the_table() {
    assert!(holds(PIPELINED, DeadlineChoice::Guard));
    for changed in [
        Vehicle { deceleration: 7.15, ..PIPELINED },
        Vehicle { deceleration: 7.8, ..PIPELINED },
        Vehicle { range_local: 36.5, ..PIPELINED },
        Vehicle { range_local: 42.7, ..PIPELINED },
        Vehicle { range_cloud: 55.5, ..PIPELINED },
        Vehicle { range_cloud: 58.1, ..PIPELINED },
        Vehicle { rate: 17.0, ..PIPELINED },
        Vehicle { frames: 6, ..PIPELINED },
    ] {
        assert!(!holds(changed, DeadlineChoice::Guard), "{changed:?}");
    }
}

#[test]
fn every_constant_deadline_misses_at_least_three_cells() {
    let constants = (1..=90).map(|step| f64::from(step) * 0.05).chain([0.01, 0.3117, 0.65, 4.49]);
    for deadline in constants {
        let misses = misses(PIPELINED, deadline);
        assert!(misses >= 3, "{deadline} s misses {misses}");
    }
    assert_eq!((misses(PIPELINED, 0.5), misses(PIPELINED, 0.76)), (9, 4));
}

#[test]
fn some_phases_may_collide_and_others_not() {
    let jam = Jam::new(PIPELINED, DeadlineChoice::Guard).unwrap();
    let of = |speed| {
        let question = CellParameters { speed, approach: Approach::Local, response: 0.0 };
        jam.cell(&question, None).unwrap()
    };
    let cells: Vec<_> = (0..=40).map(|step| of(20.5 + f64::from(step) * 0.02)).collect();
    let mixed = cells.iter().find(|cell| cell.outcome == Colour::Mixed).unwrap();
    assert!(mixed.impact.is_some() && mixed.gap.is_some(), "{mixed:?}");
}
