//! The book's vehicle: whatever one part dies, control has an output at each of its ticks (E1, E2, E4, E5).

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

use crate::common::{err, out, run};
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

    /// A drive in which a part dies halfway.
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

/// Two of four people, then a box that is nobody's: precision 1 up to a recall of 0.5, and 0 beyond.
#[test]
fn half_found_world_scores_half() {
    let person = |left| [left, 0.0, left + 10.0, 10.0];
    let found = |left, score| [left, 0.0, left + 10.0, 10.0, score];
    let people = [0.0, 20.0, 40.0, 60.0].map(person);
    let boxes = vec![found(80.0, 0.7), found(0.0, 0.9), found(20.0, 0.8)];
    let score = score::ap50([(boxes, &people[..])].into_iter());
    assert!((score - 51.0 / 101.0 * 100.0).abs() < 1e-9, "{score}");
}

/// Boxes that overlap a person by less than half find nobody, as those of somebody who has walked on.
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
        if matches!(rule, Rule::OnBoard | Rule::Progressive) {
            assert!(readme.contains(&row), "the README lacks {row}");
        }
    }
}

/// E11: clouds leave no message of this vehicle to a substitute.
#[test]
fn no_message_is_left_to_a_substitute() {
    let vehicle = Vehicle::load();
    for rule in [Rule::OnBoard, Rule::Eager, Rule::Patient, Rule::Progressive] {
        assert_eq!(vehicle.drive(rule, 57, None, None).substitutes, 0, "{rule:?}");
    }
}

/// The words after `fuseline` that look for a frame in the traces of a folder.
fn frame(folder: &Path, words: &[&str]) -> String {
    let traces = folder.read_dir().unwrap().map(|it| it.unwrap().path());
    let traces = traces.map(|path| path.to_str().unwrap().to_owned());
    let words: Vec<_> =
        ["frame"].iter().chain(words).map(ToString::to_string).chain(traces).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let ran = run(&words, "");
    assert_eq!(ran.status.code(), Some(0), "{}", err(&ran));
    out(&ran).to_owned()
}

#[test]
fn the_book_has_the_life_of_a_frame() {
    let folder = tempdir().unwrap();
    let part = Some(VehiclePart::LocalTracker);
    Vehicle::load().drive(Rule::Eager, 57, part, Some(folder.path()));
    let words = CHAPTER.lines().find_map(|line| line.strip_prefix("`fuseline frame "));
    let (words, _) = words.unwrap().split_once(" run/local-tracker/").unwrap();
    let printed = frame(folder.path(), &words.split(' ').collect::<Vec<_>>());
    assert!(CHAPTER.contains(&format!("```text\n{printed}```")), "{printed}");
}

/// What `fuseline frame` says of this operator's part in a frame, if it had one: its own line and those of its sources.
fn life_in(folder: &Path, stream: &str, seq: u64, operator: &str) -> Option<String> {
    let printed = frame(folder, &["--seq", &seq.to_string(), "--stream", stream]);
    let (_, life) = printed.split_once(&format!("\n  {operator} "))?;
    let own =
        life.lines().enumerate().take_while(|(at, line)| *at == 0 || line.starts_with("    "));
    Some(own.map(|(_, line)| line.trim_start()).collect::<Vec<_>>().join("\n"))
}

#[test]
fn the_life_of_a_frame_shows_which_part_died() {
    let vehicle = Vehicle::load();
    let shows = |part, stream, from: u64, operator, how: &[&str]| {
        let folder = tempdir().unwrap();
        vehicle.drive(Rule::Eager, 20, Some(part), Some(folder.path()));
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
    shows(VehiclePart::LeftCamera, right, 80, "detection", &["20.0 ms to without left"]);
    shows(VehiclePart::RightCamera, left, 80, "detection", &["20.0 ms to without right"]);
    // Downstream too, up to control.
    shows(VehiclePart::RightCamera, left, 80, "control", &["local, without right"]);
    shows(VehiclePart::WestDetector, left, 80, "detection", &["west late|not"]);
    shows(VehiclePart::EastDetector, left, 80, "detection", &["east late"]);
    shows(VehiclePart::CloudTracker, left, 80, "tracking", &["tracker late"]);
    shows(VehiclePart::LocalDetector, left, 80, "detection", &["local failed|late"]);
    for (part, operator) in [
        (VehiclePart::LocalTracker, "tracking"),
        (VehiclePart::LocalPredictor, "prediction"),
        (VehiclePart::LocalPlanner, "planning"),
    ] {
        // Nobody walks there, so that the cloud does not track.
        shows(part, left, 120, operator, &["missed:", "local failed|late"]);
        // What was sent instead reaches control.
        shows(part, left, 120, "control", &["ms"]);
    }
    // Nothing waits for the localization.
    shows(VehiclePart::Localization, left, 80, "detection", &["0.0 ms to without localization"]);
}
