use fuseline_faults::{Tree, load_faults};

use super::*;

#[test]
fn each_fault_has_a_catcher_or_a_reason() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let faults = load_faults(&Tree::new(root.to_owned())).expect("the faults");
    let uncatchable = UncatchableFaults::load(root, &faults).expect("the reasons");
    let record = Record::load(root).expect("the record");
    assert_eq!(record.uncaught(&faults, &uncatchable), Vec::<String>::new());
    let expected = faults.iter().filter(|fault| !uncatchable.holds(fault)).count();
    assert_eq!(Record::default().uncaught(&faults, &uncatchable).len(), expected);
    assert!(expected > 0);
}
