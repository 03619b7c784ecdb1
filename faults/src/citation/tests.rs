use ignore::WalkBuilder;

use super::*;

fn set<const N: usize>(ids: [&str; N]) -> BTreeSet<String> {
    ids.map(String::from).into()
}

#[test]
fn a_range_stands_for_all_between_and_the_gate_among_the_rules() {
    assert_eq!(identifiers("see F1–F3 and P2"), set(["F1", "F2", "F2g", "F3", "P2"]));
    assert_eq!(named("p1_to_p3_and_p11_hold"), set(["P1", "P2", "P3", "P11"]));
}

#[test]
fn a_word_that_only_begins_like_an_identifier_is_none() {
    assert_eq!(identifiers("F3x XP2 f1 A A100 P99"), set([]));
    assert_eq!(named("a_fold_p_f2gg_f2h"), set([]));
}

#[test]
fn python_test_cites_up_to_the_next_decorator() {
    let text = "# D8.\n@given(\n)\ndef test_a(\n    run: Run,\n) -> None:\n    \"\"\"D9.\"\"\"\n\n    # A3.\n\n\n\
        # F8\ndef test_b() -> None:\n    pass\n";
    let found = python_function(text, "test_a").expect("it is there");
    assert_eq!(identifiers(&found), set(["A3", "D8", "D9"]));
    assert_eq!(python_function(text, "test_"), None);
}

#[test]
fn a_test_cites_by_its_name_its_documentation_and_its_body() {
    let text = "/// F1.\n#[test]\nfn p2_never() {\n    // A3.\n}\n\n// F8\n";
    let found = function(text, "p2_never").expect("it is there");
    assert_eq!(identifiers(&found), ["A3", "F1"].map(String::from).into());
    assert_eq!(named("p2_never"), ["P2".to_owned()].into());
}

/// The citations of the project, without the specification's own.
#[derive(Default)]
struct Citations {
    /// By shipped code.
    code: BTreeSet<String>,
    /// By tests and traces of the corpus.
    witnesses: BTreeSet<String>,
    /// All of them, each with its place. Other files must cite what exists, and prove nothing.
    places: Vec<(String, String)>,
}

impl Citations {
    fn of_project(tree: &Tree) -> Self {
        let mut all = Self::default();
        // The files that git does not ignore.
        for entry in WalkBuilder::new(tree.root()).require_git(false).build() {
            let path = entry.expect("a readable folder").into_path();
            let file = path.strip_prefix(tree.root()).expect("it is below").to_owned();
            let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let text = || std::fs::read_to_string(&path).expect("UTF-8");
            match file.extension().and_then(|extension| extension.to_str()) {
                Some("jsonl") => {
                    if let Some(id) = name.split_once('-').and_then(|(first, _)| upper(first)) {
                        all.add(id, &file, 1, true);
                    }
                }
                // This file's own examples are not witnesses.
                _ if name == "SPEC.md" || path.ends_with("citation/tests.rs") => {}
                Some("rs" | "md" | "json" | "toml") => all.add_file(&file, &text()),
                Some("v") => all.add_file(&file, &comments(&text())),
                _ => {}
            }
        }
        all
    }

    fn add_file(&mut self, file: &Path, text: &str) {
        let within = |folder: &str| file.components().any(|part| part.as_os_str() == folder);
        let mut is_witness =
            ["tests", "testkit", "corpus"].into_iter().any(within) || file.ends_with("tests.rs");
        for (number, line) in (1..).zip(text.lines()) {
            is_witness |= line.trim_start().starts_with("mod tests {");
            let functions = line.split("fn ").skip(1).filter_map(|name| name.split_once('_'));
            let functions = functions.filter_map(|(first, _)| upper(first));
            for id in identifiers(line).into_iter().chain(functions) {
                // The compiler's own errors have four digits.
                if id.len() <= 4 && !OTHER_WORDS.contains(&&*id) {
                    self.add(id, file, number, is_witness);
                }
            }
        }
    }

    fn add(&mut self, id: String, file: &Path, line: usize, is_witness: bool) {
        if is_witness {
            self.witnesses.insert(id.clone());
        } else if file.extension().is_some_and(|extension| extension == "rs") {
            self.code.insert(id.clone());
        }
        self.places.push((id, format!("{}:{line}", file.display())));
    }

    /// Returns the places that cite what is not defined.
    fn unknown(&self, defined: &[String]) -> Vec<&(String, String)> {
        self.places.iter().filter(|(id, _)| !defined.contains(id)).collect()
    }
}

/// Returns the comments of a Coq file, each in its line; names in its proofs are not identifiers.
fn comments(text: &str) -> String {
    let mut kept = String::new();
    let mut depth = 0_usize;
    for word in text.split_inclusive([' ', '\n']) {
        depth += word.matches("(*").count();
        kept.push_str(if depth > 0 {
            word
        } else if word.ends_with('\n') {
            "\n"
        } else {
            " "
        });
        depth = depth.saturating_sub(word.matches("*)").count());
    }
    kept
}

fn tree() -> Tree {
    Tree::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..").into())
}

fn all_defined() -> Vec<String> {
    defined(&tree()).expect("SPEC.md is there").into_iter().map(|(id, _)| id).collect()
}

#[test]
fn every_cited_identifier_exists() {
    let citations = Citations::of_project(&tree());
    assert!(citations.places.len() > 100, "the project was not read: {}", citations.places.len());
    let unknown = citations.unknown(&all_defined());
    assert!(unknown.is_empty(), "SPEC.md does not define {unknown:#?}");
}

#[test]
fn code_and_a_test_or_trace_cite_every_promise() {
    let Citations { code, witnesses, .. } = Citations::of_project(&tree());
    for (cited, by) in [(code, "code"), (witnesses, "test or trace")] {
        let mut uncited = all_defined();
        uncited.retain(|id| !id.starts_with('A') && !cited.contains(id));
        assert!(uncited.is_empty(), "no {by} cites {uncited:?}");
    }
}

#[test]
fn identifiers_are_defined_once_and_without_gaps() {
    let mut families: BTreeMap<char, Vec<String>> = BTreeMap::new();
    for id in all_defined() {
        families.entry(id.chars().next().unwrap_or_default()).or_default().push(id);
    }
    let numbered = |family: char, from: usize, to: usize| -> Vec<String> {
        (from..=to).map(|number| format!("{family}{number}")).collect()
    };
    let mut rules = numbered('F', 0, 9);
    rules.insert(3, "F2g".into());
    assert_eq!(families[&'F'], rules);
    assert_eq!(families[&'P'], numbered('P', 1, 13));
    let last = families[&'A'].len();
    assert!(last >= 17, "ambiguities went missing: {last}");
    assert_eq!(families[&'A'], numbered('A', 1, last));
}

#[test]
fn every_rule_and_ambiguity_names_its_place_in_paper() {
    let spec = tree().text("SPEC.md").expect("SPEC.md is there");
    let marks = ["design", "techniques", "feasibility", "scenarios", "conclusion", "silent"];
    let is_marked = |text: &str| marks.iter().any(|mark| text.contains(mark));
    let table = spec.split("\n## 1 ").next().unwrap_or_default();
    assert!(
        marks.iter().all(|mark| table.contains(&format!("*{mark}"))),
        "a mark is not explained"
    );
    let rules = spec.split("\n### ").filter(|section| section.starts_with('F'));
    for section in rules {
        let paper = section.split_once("\n*Paper, ").map(|(_, paper)| paper);
        assert!(paper.is_some_and(is_marked), "{}", section.lines().next().unwrap_or_default());
    }
    let row = regex(r"^\| A\d+ \|");
    for line in spec.lines().filter(|line| row.is_match(line)) {
        let cells: Vec<_> = line.split('|').collect();
        assert_eq!(cells.len(), 6, "{line}");
        assert!(is_marked(cells[4]), "{line}");
    }
}

#[test]
fn an_identifier_beyond_the_specification_is_found() {
    let mut cited = Citations::default();
    let text = "/// P14: nothing of the kind, on an A100.\nfn f10_is_no_rule() {}";
    cited.add_file(Path::new("core/src/slot.rs"), text);
    let ids: Vec<_> = cited.unknown(&all_defined()).into_iter().map(|(id, _)| &**id).collect();
    assert_eq!(ids, ["P14", "F10"]);
}

#[test]
fn rule_cited_only_by_tests_is_uncited_by_code() {
    let mut cited = Citations::default();
    let text = "// F3 late.\n#[cfg(test)]\nmod tests {\n#[test]\nfn p2_never_late() {}\n}";
    cited.add_file(Path::new("core/src/slot.rs"), text);
    cited.add_file(Path::new("core/src/slot/tests.rs"), "// F4");
    cited.add_file(Path::new("README.md"), "F5");
    assert_eq!((cited.code, cited.witnesses), (set(["F3"]), set(["F4", "P2"])));
}

#[test]
fn of_a_file_of_coq_its_comments_are_read() {
    let text =
        "Lemma a : T9.\n(** P2 never\n    late. *)\nProof. destruct A as [F3 D99]. Qed. (* F4 *)\n";
    let mut cited = Citations::default();
    cited.add_file(Path::new("proofs/coq/A.v"), &comments(text));
    let places: Vec<_> = cited.places.iter().map(|(id, at)| (&**id, &**at)).collect();
    assert_eq!(places, [("P2", "proofs/coq/A.v:2"), ("F4", "proofs/coq/A.v:4")]);
}
