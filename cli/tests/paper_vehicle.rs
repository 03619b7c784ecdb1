//! The book's vehicle: whatever one part dies, control has an output at each of its ticks (E1, E2, E4, E5).

#[path = "../examples/paper_vehicle/drive.rs"]
mod drive;
#[path = "../examples/paper_vehicle/operators.rs"]
mod operators;
#[path = "../examples/paper_vehicle/world.rs"]
mod world;

use std::path::Path;
use std::time::Duration;

use crate::common::{err, out, run};
use tempfile::tempdir;
use tokio::runtime::Builder;

use drive::{Driven, Figures, Options};
use operators::Mode;
use world::VehiclePart;

const MS: Duration = Duration::from_millis(1);

fn drive(mode: Mode, kill: Option<VehiclePart>) -> Driven {
    drive_into(None, mode, kill)
}

fn drive_into(traces: Option<&Path>, mode: Mode, kill: Option<VehiclePart>) -> Driven {
    let kill = kill.map(|part| (part, 10_000 * MS));
    drive_with(Options { mode, length: 20_000 * MS, kill, traces, frame: 31 })
}

fn drive_with(options: Options<'_>) -> Driven {
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
    assert_eq!(operators, ["detection", "tracking", "prediction", "planning", "control"]);
    for pair in both.life.windows(2) {
        assert!(pair[0].answered <= pair[1].taken_in, "{:?}", both.life);
    }
    assert!(both.life[4].answered <= 500 * MS, "{:?}", both.life);
}

/// E11: a cloud downstream takes no time from local's detection.
#[test]
fn no_frame_is_left_to_a_substitute() {
    let both = drive(Mode::Fusion, None);
    let substitutes = both.detected_by.keys().filter(|by| by.starts_with("substitute"));
    assert_eq!(substitutes.count(), 0, "{:?}", both.detected_by);
}

#[test]
fn the_book_has_the_figures_of_the_drive() {
    let chapter = include_str!("../../docs/book/src/use/pipelines.md");
    let modes = [("on board", Mode::Local), ("cloud", Mode::Cloud), ("both", Mode::Fusion)];
    for (name, mode) in modes {
        let length = 60_000 * MS;
        let driven = drive_with(Options { mode, length, kill: None, traces: None, frame: 121 });
        let Figures { ages, accuracy, stops } = driven.figures();
        let [p50, p99] = ages.map(|age| age.as_millis());
        let row = format!("| {name} | {p50} ms | {p99} ms | {accuracy:.1} | {stops} |");
        assert!(chapter.contains(&row), "the chapter on pipelines lacks {row}");
    }
}

/// What `fuseline frame` says of this operator's part in a frame, if it had one: its own line and those of its sources.
fn life_in(folder: &Path, stream: &str, seq: u64, operator: &str) -> Option<String> {
    let mut words = vec!["frame".to_owned(), "--seq".into(), seq.to_string()];
    words.extend(["--stream".to_owned(), stream.into()]);
    let traces = folder.read_dir().unwrap();
    words.extend(traces.map(|it| it.unwrap().path().to_str().unwrap().to_owned()));
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let ran = run(&words, "");
    assert_eq!(ran.status.code(), Some(0), "{}", err(&ran));
    let (_, life) = out(&ran).split_once(&format!("\n  {operator} "))?;
    let own =
        life.lines().enumerate().take_while(|(at, line)| *at == 0 || line.starts_with("    "));
    Some(own.map(|(_, line)| line.trim_start()).collect::<Vec<_>>().join("\n"))
}

#[test]
fn the_life_of_a_frame_shows_which_part_died() {
    let shows = |part, stream, from: u64, operator, how: &[&str]| {
        let folder = tempdir().unwrap();
        drive_into(Some(folder.path()), Mode::Fusion, Some(part));
        // Each cloud is requested for one frame of three.
        let lives =
            (from..from + 3).filter_map(|seq| life_in(folder.path(), stream, seq, operator));
        let lives: Vec<String> = lives.collect();
        let is_shown = |life: &String| {
            how.iter().all(|words| {
                life.lines().any(|line| {
                    words.split(' ').all(|word| {
                        line.split_whitespace().any(|of| word.split('|').any(|word| word == of))
                    })
                })
            })
        };
        assert!(lives.iter().any(is_shown), "{part:?}: {how:?} in {lives:#?}");
    };
    let (left, right) = ("left-camera", "right-camera");
    // The join waited 20 ms for the dead camera.
    shows(VehiclePart::LeftCamera, right, 130, "detection", &["20.0 ms to without left"]);
    shows(VehiclePart::RightCamera, left, 130, "detection", &["20.0 ms to without right"]);
    // Downstream too, up to control.
    shows(VehiclePart::RightCamera, left, 130, "control", &["local, without right"]);
    shows(VehiclePart::WestDetector, left, 130, "detection", &["west/dino-swin-t late"]);
    shows(VehiclePart::EastDetector, left, 130, "detection", &["east/detr-r101 late"]);
    shows(VehiclePart::CloudTracker, left, 130, "tracking", &["tracker late"]);
    shows(VehiclePart::LocalDetector, left, 130, "detection", &["missed:", "local failed|late"]);
    for (part, operator) in [
        (VehiclePart::LocalTracker, "tracking"),
        (VehiclePart::LocalPredictor, "prediction"),
        (VehiclePart::LocalPlanner, "planning"),
    ] {
        // Nobody walks there, so that the cloud does not track.
        shows(part, left, 150, operator, &["missed:", "local failed|late"]);
        // What was sent instead reaches control.
        shows(part, left, 150, "control", &["ms"]);
    }
    // Nothing waits for the localization.
    shows(VehiclePart::Localization, left, 130, "detection", &["0.0 ms to without localization"]);
}
