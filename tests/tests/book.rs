//! Checks that the book's first run follows from its inputs, and that the lines that chapters
//! repeat are those of their files.

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
fn first_run_of_the_book_conforms() {
    let run = of_book("start/mine.jsonl");
    let verdict = judge("mine.jsonl", run.as_bytes()).expect("a trace");
    assert!(verdict.conforms, "{verdict}");
    let printed = format!("{} timestamps judged in {} lines", verdict.judged, verdict.lines);
    let chapter = of_book("start.md");
    assert!(chapter.contains(&printed), "{printed}");
    assert_eq!(inputs(&run), inputs(&of_book("start/inputs.jsonl")));
    for file in ["start/inputs.jsonl", "start/mine.jsonl"] {
        assert!(chapter.contains(&format!("json\n{}```", of_book(file))), "{file}");
    }
}

/// A code host does not expand includes, so these chapters repeat lines of the sources.
#[test]
fn chapters_quote_their_sources() {
    for (chapter, first_line, source) in [
        ("core.md", "impl Operator {", "core/examples/operator.rs"),
        ("c.md", "struct Planner", "adapters/c/README.md"),
        ("c.md", "/* A message comes", "adapters/c/examples/first.c"),
        ("tokio.md", "let runtime", "adapters/tokio/examples/vehicle.rs"),
        ("pipelines.md", "let mut cameras", "evaluation/examples/paper_vehicle/drive.rs"),
        ("pipelines.md", "Local::future", "evaluation/examples/paper_vehicle/operators.rs"),
    ] {
        let trimmed =
            |file: &str| of_book(file).lines().map(str::trim).collect::<Vec<_>>().join("\n");
        let (page, source_text) =
            (trimmed(&format!("use/{chapter}")), trimmed(&format!("../../../{source}")));
        let mut blocks = page.split("\n```").filter_map(|block| Some(block.split_once('\n')?.1));
        let is_quote =
            |block: &str| block.starts_with(first_line) && source_text.contains(block.trim_end());
        assert!(blocks.any(is_quote), "{chapter}: no block quotes {source} from {first_line}");
    }
}

#[test]
fn first_change_names_a_comment_of_the_core() {
    let step = of_book("built/contributing.md").replace("\n   ", " ");
    let comment = step.split_once("Find the comment *").expect("a comment").1;
    let comment = comment.split_once('*').expect("its end").0;
    assert!(of_book("../../../core/src/slot.rs").contains(&format!("// {comment}")), "{comment}");
}
