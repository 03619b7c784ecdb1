//! Tests the reference machine's queries. The corpus and the comparison with the core test its
//! decisions.

use fuseline_traces::{Cloud, Commit, Header, Input, Reference};

#[test]
fn reports_clock_next_due_and_open_timestamps() {
    let clouds = vec![Cloud { p: 1, name: None, limit: 31, resume: 30 }];
    let header = Header { operator: None, window: 4, commit: Commit::Eager, clouds };
    let mut reference = Reference::new(&header);
    assert_eq!((reference.now(), reference.next_due()), (0, None));
    let mut apply = |input: Input| {
        reference.apply(&input, &mut Vec::new());
        (reference.now(), reference.next_due(), [3, 4].map(|t| reference.is_open(t)))
    };
    let opened = apply(Input::Open { at: 7, t: 3, deadline: Some(10) });
    assert_eq!(opened, (7, Some(17), [true, false]));
    let offered = apply(Input::Offer { at: 5, t: 3, p: 1, deadline: 4, backlog: 0 });
    assert_eq!(offered, (7, Some(11), [true, false]));
    assert_eq!(apply(Input::Tick { at: 11 }), (11, Some(17), [true, false]));
    assert_eq!(apply(Input::Tick { at: 17 }), (17, None, [false, false]));
}
