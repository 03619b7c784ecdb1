//! Replays the seeds of the fuzz targets of every parser, so that every `cargo test` checks earlier
//! findings.

use std::alloc::System;
use std::fs;
use std::path::Path;

use cap::Cap;
use fuseline_system_tests::parsers::{ALL, Ends, MEMORY};

/// A greater allocation ends the test.
#[global_allocator]
static BOUNDED: Cap<System> = Cap::new(System, MEMORY);

const SEEDS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fuzz/seeds");

#[test]
fn seeds_find_nothing_and_come_to_every_end() {
    for parser in ALL {
        let folder = Path::new(SEEDS).join(parser.name);
        let mut ends = Ends::new();
        for entry in fs::read_dir(&folder).expect("a folder of seeds for each parser") {
            let path = entry.expect("a readable folder").path();
            let bytes = fs::read(&path).expect("a readable file");
            if let Err(fault) = (parser.check)(&bytes, &mut ends) {
                panic!("{}: {fault}", path.display());
            }
        }
        let missing: Vec<_> = parser.ends.iter().filter(|end| !ends.contains(*end)).collect();
        assert!(missing.is_empty(), "no seed in {} comes to {missing:?}", folder.display());
        let unknown: Vec<_> = ends.iter().filter(|end| !parser.ends.contains(end)).collect();
        assert!(
            unknown.is_empty(),
            "{} has ends that it does not report: {unknown:?}",
            parser.name
        );
    }
}
