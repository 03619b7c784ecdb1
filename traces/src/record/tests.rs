//! Tests what stays in memory after an error.

use tempfile::TempDir;

use super::*;
use crate::event::Commit;

/// A recorder does not grow after its first error (D10).
#[test]
fn after_its_first_error_a_recorder_does_not_grow() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("trace.jsonl");
    let header = Header { operator: None, window: 1, commit: Commit::Eager, clouds: Vec::new() };
    let mut recorder = Recorder::create(&path, &header, Recording::default()).unwrap();
    // The file is opened for reading, so writing to it fails.
    recorder.out.file = File::open(&path).unwrap();
    recorder.input(&Input::Tick { at: 0 });
    recorder.flush();
    assert!(recorder.error().is_some());
    let before = (recorder.gathered.capacity(), recorder.inputs.capacity(), recorder.size);
    for at in 1..10_000 {
        recorder.input(&Input::Tick { at });
        recorder.decision(&Decision::Miss { at, t: at });
    }
    let after = (recorder.gathered.capacity(), recorder.inputs.capacity(), recorder.size);
    assert_eq!(after, before);
    assert_eq!(recorder.inputs, [0; 0]);
}
