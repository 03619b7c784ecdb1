use fuseline_testkit::{Coverage, CoverageShare, Generator, Mark};
use fuseline_traces::Commit;

#[test]
fn thousand_runs_reach_every_mark() {
    for (seed, commit) in [(1, None), (2, Some(Commit::Eager)), (3, Some(Commit::Patient))] {
        // These marks exist only under progressive.
        let is_absent = |name: &str| {
            commit.is_some() && (name == "F9" || name.ends_with("ends after its last output"))
        };
        let (generator, mut coverage) =
            (Generator { seed, commit, clouds: 4 }, Coverage::default());
        (0..1000).for_each(|number| coverage.watch(&generator.run(number)));
        for CoverageShare { kind, mut missing, .. } in coverage.shares() {
            missing.retain(|name| !is_absent(name));
            assert!(missing.is_empty(), "{generator:?}, {kind}: no run reached {missing:?}");
        }
    }
}

#[test]
fn marks_of_all_kinds_have_names_of_their_own() {
    let marks: Vec<_> = Mark::kinds().into_iter().flat_map(|(_, marks)| marks).collect();
    let names: std::collections::BTreeSet<_> = marks.iter().map(|mark| mark.name()).collect();
    assert_eq!(names.len(), marks.len());
}
