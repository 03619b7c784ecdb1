//! The smallest traces of other people's systems still break what the book says they break.

use std::fs;

use crate::common::{err, out, run};
use serde_json::Value;

#[test]
fn each_trace_breaks_the_rule_that_its_header_names() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/others/traces");
    let mut count = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let text = fs::read_to_string(&path).unwrap();
        let header: Value = serde_json::from_str(text.lines().next().unwrap()).unwrap();
        let stated = &header["x"];
        let options = stated["options"].as_array().unwrap().iter().map(|it| it.as_str().unwrap());
        let mut args = vec!["check", "--json", "--observed", "--tolerance", "3ms"];
        args.extend(["--lateness", "20ms"]);
        args.extend(options);
        args.push(path.to_str().unwrap());
        let judged = run(&args, "");
        let verdict: Value = serde_json::from_str(out(&judged)).unwrap();
        let violations = verdict["violations"].as_array().unwrap();
        assert!(!violations.is_empty(), "{} conforms {}", path.display(), err(&judged));
        for violation in violations {
            assert_eq!(violation["rule"], stated["breaks"], "{}", path.display());
        }
        count += 1;
    }
    assert!(count >= 12, "only {count} traces");
}
