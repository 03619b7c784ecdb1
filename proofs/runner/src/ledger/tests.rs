use super::*;
use crate::source;

#[test]
fn committed_ledger_has_all_harnesses() {
    let tree = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let sources = source::read(tree).expect("the harnesses");
    let ledger = VerdictLedger::load(tree).expect("a ledger");
    assert_eq!(ledger.differs(&sources), Vec::<String>::new());
    assert_eq!(VerdictLedger::default().differs(&sources).len(), sources.harnesses.len());
    let all = sources.harnesses.len();
    assert!(
        ledger.summary("").contains(&format!(" of {all} harnesses proved")),
        "{}",
        ledger.summary("")
    );
}

fn provenance(sources: &str, change: &str) -> Provenance {
    let (sources, change) = (sources.to_owned(), change.to_owned());
    Provenance { bounds: "1 cloud; unwind 20".to_owned(), sources, tools: "c 1".to_owned(), change }
}

fn ledger_of(lines: &[(&str, f64, Provenance)]) -> VerdictLedger {
    let proof = |(name, seconds, provenance): &(&str, f64, Provenance)| {
        let proof = Proof { seconds: *seconds, provenance: provenance.clone(), ..Proof::default() };
        ((*name).to_owned(), proof)
    };
    VerdictLedger { proved: lines.iter().map(proof).collect(), ..VerdictLedger::default() }
}

#[test]
fn asks_what_the_ledger_does_not_answer() {
    let mut ledger = ledger_of(&[
        ("same", 5.0, provenance("now", "")),
        ("earlier", 5.0, provenance("then", "")),
        ("not yet", 5.0, provenance("now", "")),
        ("fault / same", 5.0, provenance("now", "a")),
        ("other fault / same", 5.0, provenance("now", "b")),
    ]);
    ledger.proved.get_mut("not yet").expect("a line").verdict = NOT_YET.to_owned();
    let other_tools = Provenance { tools: "c 2".to_owned(), ..provenance("now", "") };
    let questions = |tools: &Provenance| {
        let of = |name: &str, change: &str| (name.to_owned(), tools.with(change.to_owned()));
        [
            of("same", ""),
            of("earlier", ""),
            of("not yet", ""),
            of("new", ""),
            of("fault / same", "a"),
        ]
        .into_iter()
        .chain([of("other fault / same", "c")])
        .collect::<Vec<_>>()
    };
    let anew = ["earlier", "new", "not yet", "other fault / same"];
    for _ in 0..100 {
        let (chosen, summary) = ledger.sample(&questions(&provenance("now", "")), Duration::ZERO);
        let drawn: Vec<&String> = chosen.iter().filter(|name| !anew.contains(&&***name)).collect();
        assert_eq!((chosen.len(), drawn.len()), (anew.len() + 1, 1), "{chosen:?}");
        assert!(
            summary.starts_with("2 of 6 are in the ledger") && summary.contains("4 others"),
            "{summary}"
        );
    }
    let (chosen, _) = ledger.sample(&questions(&other_tools), Duration::ZERO);
    assert_eq!(chosen.len(), 6);
    let other_bounds =
        Provenance { bounds: "1 cloud; unwind 21".to_owned(), ..provenance("now", "") };
    let (chosen, _) = ledger.sample(&questions(&other_bounds), Duration::ZERO);
    assert_eq!(chosen.len(), 6);
}

#[test]
fn sample_takes_its_time_and_draws_all_eventually() {
    let names: Vec<String> = (0..20).map(|nth| format!("h{nth}")).collect();
    let lines: Vec<_> = names.iter().map(|name| (&**name, 10.0, provenance("now", ""))).collect();
    let ledger = ledger_of(&lines);
    let questions: Vec<_> =
        names.iter().map(|name| (name.clone(), provenance("now", ""))).collect();
    let mut ever = BTreeSet::new();
    for _ in 0..1000 {
        let (chosen, _) = ledger.sample(&questions, Duration::from_secs(35));
        assert_eq!(chosen.len(), 3);
        ever.extend(chosen);
    }
    assert_eq!(ever.len(), names.len());
    let (all, _) = ledger.sample(&questions, Duration::from_secs(200));
    assert_eq!(all.len(), names.len());
}

#[test]
fn comments_inline_and_unwind_keep_the_digest() {
    let code = b"fn step() {\n    a();\n}\n";
    let said =
        b"/// Steps.\n#[inline]\n#[kani::unwind(20)]\nfn step() {\n    // First.\n    a();\n}\n";
    assert_eq!(meaning(said), meaning(code));
    assert_eq!(meaning(b"#[inline(never)] fn f() {}\n"), b"#[inline(never)] fn f() {}\n");
    assert_ne!(meaning(b"a(); // first\n"), meaning(b"b(); // first\n"));
}
