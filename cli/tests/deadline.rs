//! `fuseline deadline`, run as a user runs it.

use std::process::Output;

use crate::common::{err, out, run};
use serde_json::Value;

const SPEEDS: &str = "11,18,20,22,24";

fn deadline(args: &[&str], input: &str) -> Output {
    run(&[&["deadline"], args].concat(), input)
}

fn json(args: &[&str], input: &str) -> Vec<Value> {
    let output = deadline(&[args, &["--json"]].concat(), input);
    assert_eq!((output.status.code(), err(&output)), (Some(0), ""));
    out(&output).lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn figures(rows: &[Value], key: &str) -> Vec<f64> {
    rows.iter().map(|row| row[key].as_f64().unwrap()).collect()
}

fn assert_near(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() <= 0.000_05, "{found}, not {expected}");
    }
}

#[test]
fn the_guards_deadlines_are_those_of_the_specification() {
    let rows = json(&["--speed", SPEEDS, "--policy", "guard"], "");
    let keys = ["budget_cloud", "budget_local", "case", "deadline", "guard", "loss", "speed"];
    assert!(rows.iter().all(|row| row.as_object().unwrap().keys().eq(keys)));
    assert_eq!(figures(&rows, "case"), [1.0, 1.0, 1.0, 2.0, 2.0]);
    assert_near(&figures(&rows, "guard"), &[2.4253, 0.6506, 0.3117, 0.9192, 0.5700]);
    assert_eq!(figures(&rows, "guard"), figures(&rows, "deadline"));
    let words: Vec<_> = figures(&rows, "guard").iter().map(|it| format!("{it:.4}")).collect();
    let (last, others) = words.split_last().unwrap();
    let words = format!("prints {} and {last} s for the default vehicle", others.join(", "));
    let chapter = include_str!("../../docs/book/src/use/deadlines.md");
    assert!(chapter.contains(&words), "the chapter on deadlines lacks: {words}");
}

#[test]
fn what_was_observed_chooses_among_the_safe_deadlines() {
    let calls = "answered,count,response_s\n1,98,0.35\n0,1,0.5\n0,,inf\n1,1,0.7\n";
    let rows = json(&["--speed", "20,22", "--policy", "expected", "--calls", "-"], calls);
    assert_near(&figures(&rows, "deadline"), &[0.3017, 0.35]);
    assert!(figures(&rows, "deadline")[1] > 0.35, "a result at its due instant is late");
    let unseen = json(&["--speed", "22", "--policy", "expected"], "");
    assert_near(&figures(&unseen, "deadline"), &[0.3017]);
    assert!(figures(&rows, "loss")[1] < figures(&unseen, "loss")[0]);
}

#[test]
fn figures_that_are_not_known_exactly_allow_less() {
    let exact = json(&["--speed", "18"], "");
    for uncertain in [
        ["--deceleration", "7.2..7.8"],
        ["--brake-delay", "100ms..200ms"],
        ["--rate", "20..30"],
        ["--range-local", "38..40"],
        ["--reveal", "38"],
        ["--class", "1,38.5,57"],
    ] {
        let rows = json(&[&["--speed", "18"], &uncertain[..]].concat(), "");
        assert!(figures(&rows, "guard") < figures(&exact, "guard"), "{uncertain:?}");
    }
    let both = json(&["--speed", "22", "--class", "1,39,57", "--class", "2,43,60"], "");
    assert_eq!(figures(&both, "case"), [3.0], "the second class is between the cases");
}

#[test]
fn a_table_says_why() {
    let printed = deadline(&["--speed", SPEEDS], "");
    let text = out(&printed);
    for part in ["0.3117 s", "1: local alone stops", "2: the cloud alone might", "Nothing was"] {
        assert!(text.contains(part), "{text}");
    }
    let widest = text.lines().map(|line| line.chars().count()).max();
    assert!(widest <= Some(100), "{text}");
}

#[test]
fn what_makes_no_sense_is_reported_in_one_line_with_a_remedy() {
    let observed = &["--speed", "20", "--calls", "-"];
    let cases: [(&[&str], &str, &str); 16] = [
        (&[], "", "--speed <V,V,…>; see --help"),
        (&["--speed", "20,0"], "", "write a number of m/s above 0; see --help"),
        (&["--speed", "20", "--rate", "0"], "", "write a number of Hz above 0; see --help"),
        (
            &["--speed", "20", "--deceleration", "-1"],
            "",
            "deceleration: -1 m/s²; it must be from 0.1 to 20 m/s²; change --deceleration",
        ),
        (&["--speed", "20", "--local-response", "2s..1s"], "", "change --local-response"),
        // Milliseconds as seconds, and a speed that is none.
        (
            &["--speed", "20", "--local-response", "301.7s"],
            "",
            "301.7 s; it must be from 0.000001 to",
        ),
        (&["--speed", "200"], "", "speed: 200 m/s; it must be from 0 to 150 m/s; change --speed"),
        (
            &["--speed", "20", "--range-cloud", "30"],
            "",
            "no deadline is safe; change --range-local",
        ),
        (&["--speed", "20", "--class", "1,2"], "", "such as 1,39,57; see --help"),
        // Classes have ranges of their own, and nothing else.
        (&["--speed", "20", "--class", "1,57,39"], "", "; change --class"),
        (
            &["--speed", "20", "--class", "1,39,57", "--deceleration", "-1"],
            "",
            "; change --deceleration",
        ),
        (observed, "response_s\n0.1\n", "stdin:1: there is no column \"answered\""),
        (observed, "response_s,answered\n0.1,1\n0.2,x\n", "stdin:3: column \"answered\": \"x\""),
        (observed, "response_s,answered\ninf,1\n", "stdin:2: column \"response_s\": \"inf\""),
        (observed, "response_s,answered,count\n1,1,-3\n", "stdin:2: column \"count\": \"-3\""),
        (observed, "response_s,answered\n", "stdin: there are no calls below the first row"),
    ];
    for (args, input, message) in cases {
        let printed = deadline(args, input);
        assert_eq!((printed.status.code(), out(&printed)), (Some(2), ""), "{args:?}");
        assert!(err(&printed).contains(message), "{:?}, not {message:?}", err(&printed));
        assert_eq!(err(&printed).lines().count(), 1, "{}", err(&printed));
    }
    let missing = deadline(&["--speed", "20", "--calls", "missing.csv"], "");
    assert!(err(&missing).starts_with("error: missing.csv: No such file"), "{}", err(&missing));
}
