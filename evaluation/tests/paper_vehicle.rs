//! The book's vehicle: whichever part dies, control has an output at each of its ticks (E1, E2, E4,
//! E5).

#[path = "../examples/paper_vehicle/drive.rs"]
mod drive;
#[path = "../examples/paper_vehicle/operators.rs"]
mod operators;
#[path = "../examples/paper_vehicle/recording.rs"]
mod recording;
#[path = "../examples/paper_vehicle/score.rs"]
mod score;
#[path = "../examples/paper_vehicle/world.rs"]
mod world;

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use tempfile::tempdir;
use tokio::runtime::Builder;

use drive::{Driven, HEAD, Options};
use operators::Rule;
use recording::Recording;
use world::VehiclePart;

const MS: Duration = Duration::from_millis(1);
const CHAPTER: &str = include_str!("../../docs/book/src/use/pipelines.md");

struct Vehicle(Arc<Recording>);

impl Vehicle {
    fn load() -> Self {
        Self(Arc::new(Recording::load().unwrap()))
    }

    /// Plays a drive in which a part dies halfway.
    fn drive(
        &self,
        rule: Rule,
        seconds: u64,
        part: Option<VehiclePart>,
        traces: Option<&Path>,
    ) -> Driven {
        let length = Duration::from_secs(seconds);
        let kill = part.map(|part| (part, length / 2));
        let options = Options { rule, recording: &self.0, length, kill, traces, frame: 31 };
        let runtime = Builder::new_current_thread().enable_time().start_paused(true).build();
        runtime.unwrap().block_on(drive::drive(options)).unwrap()
    }
}

#[test]
fn control_outputs_at_each_tick_whatever_dies() {
    let vehicle = Vehicle::load();
    for rule in Rule::ALL {
        for part in [None].into_iter().chain(VehiclePart::ALL.map(Some)) {
            let driven = vehicle.drive(rule, 20, part, None);
            assert_eq!(driven.ticks, 400);
            assert_eq!(driven.commands.len(), 400, "{rule:?} without {part:?}");
            let slowest = driven.commands.iter().map(|command| command.took).max().unwrap();
            assert!(slowest <= 40 * MS, "{rule:?} without {part:?}: {slowest:?}");
        }
    }
}

#[test]
fn one_frame_is_answered_in_order() {
    let driven = Vehicle::load().drive(Rule::Eager, 20, None, None);
    let operators: Vec<_> = driven.life.iter().map(|stage| stage.operator).collect();
    assert_eq!(operators, ["detection", "tracking", "prediction", "planning", "control"]);
    for pair in driven.life.windows(2) {
        assert!(pair[0].answered <= pair[1].taken_in, "{:?}", driven.life);
    }
    assert!(driven.life[4].answered <= 500 * MS, "{:?}", driven.life);
}

/// Two of four people are found, then a box is wrong. The precision is 1 up to a recall of 0.5, and
/// 0 beyond.
#[test]
fn half_found_world_scores_half() {
    let person = |left| [left, 0.0, left + 10.0, 10.0];
    let found = |left, score| [left, 0.0, left + 10.0, 10.0, score];
    let people = [0.0, 20.0, 40.0, 60.0].map(person);
    let boxes = vec![found(80.0, 0.7), found(0.0, 0.9), found(20.0, 0.8)];
    let score = score::ap50([(boxes, &people[..])].into_iter());
    assert!((score - 51.0 / 101.0 * 100.0).abs() < 1e-9, "{score}");
}

/// A box that overlaps a person by less than half does not find that person, as when somebody has
/// walked on.
#[test]
fn stale_box_misses_who_walked_on() {
    let people = [[4.0, 0.0, 14.0, 10.0]];
    let stale = vec![[0.0, 0.0, 10.0, 10.0, 0.9]];
    assert!(score::ap50([(stale, &people[..])].into_iter()).abs() < 1e-9);
}

#[test]
fn the_book_has_the_figures_of_the_drive() {
    assert!(CHAPTER.contains(HEAD), "the chapter on pipelines lacks {HEAD}");
    let vehicle = Vehicle::load();
    let readme = include_str!("../../README.md");
    for rule in Rule::ALL {
        let driven = vehicle.drive(rule, 57, None, None);
        let row = driven.row(rule, &vehicle.0);
        assert!(CHAPTER.contains(&row), "the chapter on pipelines lacks {row}");
        if !matches!(rule, Rule::FirstResponse | Rule::Patient) {
            assert!(readme.contains(&row), "the README lacks {row}");
        }
    }
}

/// No message of this vehicle is left to a substitute, with or without clouds (E11).
#[test]
fn no_message_is_left_to_a_substitute() {
    let vehicle = Vehicle::load();
    for rule in [Rule::OnBoard, Rule::Eager, Rule::Patient, Rule::Progressive] {
        assert_eq!(vehicle.drive(rule, 57, None, None).substitutes, 0, "{rule:?}");
    }
}

#[test]
fn traces_of_a_broken_vehicle_break_no_rule() {
    let folder = tempdir().unwrap();
    let part = Some(VehiclePart::LocalTracker);
    Vehicle::load().drive(Rule::Eager, 57, part, Some(folder.path()));
    let files = folder.path().read_dir().unwrap().map(|file| file.unwrap().path());
    let judged = files.map(|file| {
        let trace = std::fs::read(&file).unwrap();
        let verdict = fuseline_traces::judge("trace", &trace[..]).unwrap();
        assert!(verdict.violations.is_empty(), "{}: {:?}", file.display(), verdict.violations);
    });
    assert!(judged.count() >= 5);
}
