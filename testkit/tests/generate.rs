use fuseline_testkit::{Generator, Run, RunContext};
use fuseline_traces::{Commit, Input};

const GENERATOR: Generator = Generator { seed: 1, commit: None, clouds: 4 };

#[test]
fn same_number_makes_the_same_run() {
    assert_eq!(GENERATOR.run(17), GENERATOR.run(17));
    assert_ne!(GENERATOR.run(17), GENERATOR.run(18));
    assert_ne!(GENERATOR.run(17), Generator { seed: 2, ..GENERATOR }.run(17));
}

#[test]
fn generator_keeps_to_its_rule_and_clouds() {
    let generator = Generator { commit: Some(Commit::Patient), clouds: 2, ..GENERATOR };
    let headers = || (0..100).map(|number| generator.run(number).header);
    assert!(headers().all(|header| header.commit == Commit::Patient));
    let most = headers().map(|header| header.clouds.len()).max();
    assert_eq!(most, Some(2));
}

#[test]
fn as_many_clouds_are_registered_as_there_may_be() {
    let generator = Generator { clouds: 15, ..GENERATOR };
    let most = (0..1000).map(|number| generator.run(number).header.clouds.len()).max();
    assert_eq!(most, Some(15));
}

#[test]
fn a_run_is_read_as_it_was_written() {
    let (run, mut text) = (GENERATOR.run(17), Vec::new());
    run.write(&mut text);
    assert_eq!(Run::read("run", &text[..]).expect("a trace"), run);
}

#[test]
fn shortened_run_keeps_only_what_the_fault_needs() {
    let run = GENERATOR.run(25);
    let opens = |run: &Run| run.inputs.iter().filter(|i| matches!(i, Input::Open { .. })).count();
    assert!(opens(&run) > 3);
    let (shortest, found) =
        run.shortened(|run| (opens(run) >= 3).then(|| opens(run))).expect("it has that many");
    assert_eq!((shortest.inputs.len(), found), (3, 3));
    assert_eq!(run.shortened(|_| None::<()>), None);
}

#[test]
fn floods_fill_and_refill_the_greatest_window() {
    let run = GENERATOR.run(125);
    let mut context = RunContext::new(&run.header);
    let (mut fills, mut least) = (0, 0);
    for input in &run.inputs {
        context.apply(input);
        let open = context.open().len();
        least = open.min(least);
        // The window is full, and at least a hundred fewer were open before.
        if open == 1024 && least + 100 < open {
            fills += 1;
            least = open;
        }
    }
    assert!(fills > 4, "filled {fills} times");
}
