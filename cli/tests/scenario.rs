//! `fuseline scenario`, run as a user runs it; what scenarios come to is tested in `evaluation`.

use std::fs;
use std::path::Path;

use crate::common::{err, out, run};

#[test]
fn scenario_has_no_colours_in_a_pipe() {
    let output = run(&["scenario", "arbitrage"], "");
    assert_eq!((output.status.code(), err(&output)), (Some(0), ""));
    assert!(out(&output).contains("DETR-ResNet-101") && !out(&output).contains('\u{1b}'));
}

#[test]
fn scenario_alone_lists_the_scenarios() {
    let output = run(&["scenario"], "");
    assert_eq!((output.status.code(), out(&output)), (Some(2), ""));
    for name in ["traffic-jam", "red-light", "jaywalking", "networks", "arbitrage"] {
        assert!(err(&output).contains(name), "{}", err(&output));
    }
}

#[test]
fn folder_that_takes_no_files_is_reported_first() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file").display().to_string();
    fs::write(&file, "").unwrap();
    let mut refusing = vec![file.clone(), format!("{file}/in")];
    if cfg!(target_os = "linux") {
        // Nobody makes files there, not even root.
        refusing.push("/proc".to_owned());
    }
    for refusing in &refusing {
        for option in ["-o", "--trace"] {
            for name in ["traffic-jam", "red-light", "jaywalking"] {
                let printed = run(&["scenario", name, option, refusing], "");
                assert_eq!((printed.status.code(), out(&printed)), (Some(2), ""), "{name}");
                assert!(
                    err(&printed).starts_with(&format!("error: {refusing}: ")),
                    "{}",
                    err(&printed)
                );
                let remedy = "; name a folder that can be written to\n";
                assert!(err(&printed).ends_with(remedy), "{}", err(&printed));
                assert_eq!(err(&printed).lines().count(), 1, "{}", err(&printed));
            }
        }
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn senseless_scenario_is_one_line_with_a_remedy() {
    let cases: [(&[&str], &str); 13] = [
        (&["traffic-jam", "--speed", "0"], "write a number of m/s from 0.1 to 150; see --help"),
        (
            &["traffic-jam", "--deadline", "soon"],
            "write guard, expected or a deadline: it must be from 0 to 1day",
        ),
        (&["traffic-jam", "--rate", "0"], "write a number of Hz from 0.1 to 1000"),
        (&["traffic-jam", "--approach", "luck"], "see --help"),
        (&["traffic-jam", "--range-cloud", "30"], "change --range-local or --range-cloud"),
        (&["traffic-jam", "--speed", "1", "--rate", "1000"], "lower --rate or the deadline"),
        (&["red-light", "--round-trip", "-1s"], "see --help"),
        (&["red-light", "--variant", "roundabout"], "see --help"),
        (&["jaywalking", "--response", "0.5"], "such as 0.5s: write 0.5s"),
        (&["networks", "--policy", "never"], "write local, cloud, first, guard, expected or"),
        (&["networks", "--drive", "nowhere"], "no built-in drive and no readable file"),
        (&["arbitrage", "--json", "--markdown"], "cannot be used with '--markdown'; see --help"),
        (&["networks", "--trace", "never-made"], "choose fewer with --drive, --speed"),
    ];
    for (args, message) in cases {
        let printed = run(&[&["scenario"], args].concat(), "");
        assert_eq!((printed.status.code(), out(&printed)), (Some(2), ""), "{args:?}");
        assert!(err(&printed).contains(message), "{:?}, not {message:?}", err(&printed));
        assert_eq!(err(&printed).lines().count(), 1, "{}", err(&printed));
    }
    assert!(!Path::new("never-made").exists());
}
