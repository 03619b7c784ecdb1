use super::*;
use crate::source;

#[test]
fn the_committed_ledger_has_the_harnesses_that_there_are() {
    let tree = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
    let sources = source::read(tree).expect("the harnesses");
    let kept = Kept::load(tree).expect("a ledger");
    assert_eq!(kept.differs(&sources), Vec::<String>::new());
    assert_eq!(Kept::default().differs(&sources).len(), sources.harnesses.len());
    let all = sources.harnesses.len();
    assert!(kept.told("").contains(&format!(" of {all} harnesses proved")), "{}", kept.told(""));
}

fn about(sources: &str, change: &str) -> About {
    About { sources: sources.to_owned(), tools: "c 1".to_owned(), change: change.to_owned() }
}

fn ledger(lines: &[(&str, f64, About)]) -> Kept {
    let proof = |(name, seconds, about): &(&str, f64, About)| {
        let proof = Proof { seconds: *seconds, about: about.clone(), ..Proof::default() };
        ((*name).to_owned(), proof)
    };
    Kept { proved: lines.iter().map(proof).collect(), ..Kept::default() }
}

#[test]
fn what_the_ledger_does_not_answer_about_the_very_same_is_asked() {
    let mut kept = ledger(&[
        ("same", 5.0, about("now", "")),
        ("earlier", 5.0, about("then", "")),
        ("not yet", 5.0, about("now", "")),
        ("fault / same", 5.0, about("now", "a")),
        ("other fault / same", 5.0, about("now", "b")),
    ]);
    kept.proved.get_mut("not yet").expect("a line").verdict = NOT_YET.to_owned();
    let other_tools = About { tools: "c 2".to_owned(), ..about("now", "") };
    let questions = |tools: &About| {
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
        let (asked, told) = kept.sample(&questions(&about("now", "")), Duration::ZERO);
        let drawn: Vec<&String> = asked.iter().filter(|name| !anew.contains(&&***name)).collect();
        assert_eq!((asked.len(), drawn.len()), (anew.len() + 1, 1), "{asked:?}");
        assert!(
            told.starts_with("2 of 6 are in the ledger") && told.contains("4 others"),
            "{told}"
        );
    }
    let (asked, _) = kept.sample(&questions(&other_tools), Duration::ZERO);
    assert_eq!(asked.len(), 6);
}

#[test]
fn a_sample_is_of_about_the_time_it_may_take_and_each_is_drawn_at_some_time() {
    let names: Vec<String> = (0..20).map(|nth| format!("h{nth}")).collect();
    let lines: Vec<_> = names.iter().map(|name| (&**name, 10.0, about("now", ""))).collect();
    let kept = ledger(&lines);
    let questions: Vec<_> = names.iter().map(|name| (name.clone(), about("now", ""))).collect();
    let mut ever = BTreeSet::new();
    for _ in 0..1000 {
        let (asked, _) = kept.sample(&questions, Duration::from_secs(35));
        assert_eq!(asked.len(), 3);
        ever.extend(asked);
    }
    assert_eq!(ever.len(), names.len());
    let (all, _) = kept.sample(&questions, Duration::from_secs(200));
    assert_eq!(all.len(), names.len());
}
