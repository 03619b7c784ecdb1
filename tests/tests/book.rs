//! The run that the book's first chapter shows is what the rules make of its inputs.

use std::fs;
use std::path::Path;

use fuseline_traces::{Event, Events, Header, Input, judge};

fn of_book(file: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/book/src").join(file);
    fs::read_to_string(path).expect("a file of the book")
}

fn inputs(trace: &str) -> (Header, Vec<Input>) {
    let mut events = Events::new("trace", trace.as_bytes()).expect("a header");
    let mut inputs = Vec::new();
    while let Some(event) = events.next_event().expect("an event") {
        if let Event::Input(input) = event {
            inputs.push(input);
        }
    }
    (events.header().clone(), inputs)
}

#[test]
fn the_first_run_of_the_book_conforms_and_is_that_of_its_inputs() {
    let run = of_book("start/mine.jsonl");
    let verdict = judge("mine.jsonl", run.as_bytes()).expect("a trace");
    assert!(verdict.conforms, "{verdict}");
    let printed = format!("{} timestamps judged in {} lines", verdict.judged, verdict.lines);
    assert!(of_book("start.md").contains(&printed), "{printed}");
    assert_eq!(inputs(&run), inputs(&of_book("start/inputs.jsonl")));
}
