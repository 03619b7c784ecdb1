//! The book's vehicle: whatever one part dies, control has an output at each of its ticks (E1, E2, E4, E5).

#[path = "../examples/paper_vehicle/drive.rs"]
mod drive;
#[path = "../examples/paper_vehicle/operators.rs"]
mod operators;
#[path = "../examples/paper_vehicle/world.rs"]
mod world;

use std::time::Duration;

use tokio::runtime::Builder;

use crate::drive::{Driven, Options};
use crate::operators::Mode;
use crate::world::VehiclePart;

const MS: Duration = Duration::from_millis(1);

fn drive(mode: Mode, kill: Option<VehiclePart>) -> Driven {
    let kill = kill.map(|part| (part, 10_000 * MS));
    let options = Options { mode, length: 20_000 * MS, kill, traces: None, frame: 30 };
    let runtime = Builder::new_current_thread().enable_time().start_paused(true).build().unwrap();
    runtime.block_on(drive::drive(options)).unwrap()
}

fn accuracy(driven: &Driven) -> f64 {
    driven.commands.iter().filter_map(|command| command.plan).map(|(_, accuracy)| accuracy).sum()
}

#[test]
fn whatever_one_part_dies_control_has_an_output_at_each_tick() {
    for mode in [Mode::Local, Mode::Cloud, Mode::Fusion] {
        for kill in [None].into_iter().chain(VehiclePart::ALL.map(Some)) {
            let driven = drive(mode, kill);
            assert_eq!(driven.ticks, 400);
            assert_eq!(driven.commands.len(), 400, "{mode:?} without {kill:?}");
            let slowest = driven.commands.iter().map(|command| command.took).max().unwrap();
            assert!(slowest <= 40 * MS, "{mode:?} without {kill:?}: {slowest:?}");
        }
    }
}

#[test]
fn both_are_better_than_on_board_alone_and_one_frame_has_its_answers_in_order() {
    let (local, both) = (drive(Mode::Local, None), drive(Mode::Fusion, None));
    assert!(accuracy(&both) > accuracy(&local));
    let operators: Vec<_> = both.life.iter().map(|stage| stage.operator).collect();
    assert_eq!(operators, ["detection", "tracking", "planning"]);
    for pair in both.life.windows(2) {
        assert!(pair[0].answered <= pair[1].taken_in, "{:?}", both.life);
    }
    assert!(both.life[2].answered <= 500 * MS, "{:?}", both.life);
}
