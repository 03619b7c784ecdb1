//! One name, one concept: a type's name that stands in two places of the repository, public or not, says the same in both. And no
//! type has a name that only somebody who knows this project could guess.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::PathBuf;
use std::sync::LazyLock;

use ignore::WalkBuilder;
use regex::Regex;
use serde::Deserialize;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// A type of a module, with its name.
static TYPE: LazyLock<Regex> = LazyLock::new(|| {
    regex(
        r"(?m)^(?:pub(?:\([a-z: ]+\))? )?(?:const |unsafe |auto )*(?:struct|enum|union|trait|type) (\w+)",
    )
});
/// Any type, tests' own ones among them.
static ANY_TYPE: LazyLock<Regex> = LazyLock::new(|| {
    regex(
        r"(?m)^ *(?:pub(?:\([a-z: ]+\))? )?(?:const |unsafe |auto )*(?:struct|enum|union|trait|type) (\w+)",
    )
});
/// What no type is called: body parts, furniture, a household, verbs of speech, participles and riddles of one word.
const NOT_NAMES: &str = "About Act Alive Asked Asker Aside Beside Bell Bill Bomb Bond Book Brought Came Caught Coming Course \
    Desk Does Doorman Ears Fate Flaw Forsaken Found Garbage Given Going Guest Hall Hands Harm Heard Here Home House How Judged Kept \
    Known Lane Leave Left Liar Life Made Manner Misbehaviour Mouth Named Nothing Of Only Out Outer Outside Owed Part Place Placed \
    Played Priced Ran Realm Rest Rhythm Ring Room Said Seal Seat Seen Settled Shaky Sheet Shown Sight Speak Spell Spot Standing \
    Story Strays Strike Tape Taken Tallied Teller Told Trouble Turn Turned Unread Vessel Voice Waits Wanted Watch Way Weather What \
    Woken Wonder Word Words";

/// The enum and the set that the models' table of properties makes.
static TABLE: LazyLock<Regex> =
    LazyLock::new(|| regex(r"(?s)\bproperties! \{.*?\n    (\w+),\n.*?\n    (\w+),\n"));

fn regex(pattern: &str) -> Regex {
    Regex::new(pattern).expect("a sound pattern")
}

/// A name that stands in several places.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Shared {
    /// The one concept that it serves.
    concept: String,
    /// The files that define it, from the root; none if any file may, by a convention of Rust's.
    places: BTreeSet<String>,
}

/// Where each name is defined, by file.
type Names = BTreeMap<String, Vec<String>>;

/// The types that a file defines, private ones too. What its own tests define, or a function, is its own.
fn defined(text: &str) -> impl Iterator<Item = &str> {
    let shipped = text.split("\nmod tests {").next().unwrap_or_default();
    let of_table = TABLE.captures_iter(shipped).flat_map(|found| {
        let (_, [one, set]) = found.extract();
        [one, set]
    });
    let types = TYPE.captures_iter(shipped).map(|found| found.extract::<1>().1[0]);
    types.chain(of_table)
}

/// The Rust sources of the whole repository but for tests, benches and examples, which are programs of their own.
fn sources() -> impl Iterator<Item = PathBuf> {
    let files = WalkBuilder::new(ROOT).require_git(false).build();
    let files = files.map(|entry| entry.expect("a readable folder").into_path());
    files.filter(|path| {
        let inner = path.strip_prefix(ROOT).expect("below the root");
        let mut folders = inner.components().map(|part| part.as_os_str().to_string_lossy());
        let is_other =
            folders.any(|name| ["benches", "examples", "tests.rs"].contains(&name.as_ref()));
        // Kani's stand-in has Kani's names.
        let is_test =
            inner.to_string_lossy().contains("/tests/") || inner.starts_with("proofs/kani");
        path.extension().is_some_and(|extension| extension == "rs") && !is_other && !is_test
    })
}

fn names() -> Names {
    let mut names = Names::new();
    for path in sources() {
        let text = fs::read_to_string(&path).expect("UTF-8");
        let path_name = path.strip_prefix(ROOT).expect("below the root").display().to_string();
        for name in defined(&text) {
            names.entry(name.to_owned()).or_default().push(path_name.clone());
        }
    }
    names
}

fn shared() -> BTreeMap<String, Shared> {
    toml::from_str(include_str!("../names.toml")).expect("a table a name")
}

/// What is wrong with names and table, in words.
fn wrong(names: &Names, shared: &BTreeMap<String, Shared>) -> Vec<String> {
    let mut wrong = Vec::new();
    for (name, places) in names.iter().filter(|(_, places)| places.len() > 1) {
        if !shared.contains_key(name) {
            wrong.push(format!(
                "{name} stands in {places:?}: rename one, or name the one concept in tests/names.toml"
            ));
        }
    }
    for (name, entry) in shared {
        let places = names.get(name).map(Vec::as_slice).unwrap_or_default();
        let is_convention = entry.places.is_empty();
        if places.len() < 2 || !is_convention && !places.iter().eq(&entry.places) {
            wrong.push(format!(
                "tests/names.toml says {name} stands in {:?}, it stands in {places:?}",
                entry.places
            ));
        }
        if entry.concept.is_empty() {
            wrong.push(format!("tests/names.toml says no concept of {name}"));
        }
    }
    wrong
}

#[test]
fn a_name_serves_one_concept() {
    let mut names = names();
    for name in ["Fusion", "Ledger", "Claim", "Sightings", "Shared", "Observations"] {
        assert!(names.contains_key(name), "the libraries were not read: {name} is not there");
    }
    for places in names.values_mut() {
        places.sort();
    }
    let wrong = wrong(&names, &shared());
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// The names of a file that no type should have.
fn riddles(text: &str) -> Vec<&str> {
    let not_names: BTreeSet<&str> = NOT_NAMES.split_whitespace().collect();
    let names = ANY_TYPE.captures_iter(text).map(|found| found.extract::<1>().1[0]);
    names.filter(|name| not_names.contains(name)).collect()
}

#[test]
fn no_type_has_a_name_that_only_its_authors_could_guess() {
    let mut read = 0;
    let mut riddles_found = Vec::new();
    for entry in WalkBuilder::new(ROOT).require_git(false).build() {
        let path = entry.expect("a readable folder").into_path();
        let path_name = path.strip_prefix(ROOT).expect("below the root").display().to_string();
        if path.extension().is_none_or(|extension| extension != "rs") {
            continue;
        }
        let text = fs::read_to_string(&path).expect("UTF-8");
        riddles_found.extend(riddles(&text).iter().map(|name| format!("{path_name}: {name}")));
        read += 1;
    }
    assert!(read > 400, "only {read} files were read");
    assert!(riddles_found.is_empty(), "{riddles_found:#?}");
}

#[test]
fn a_riddle_is_seen_whether_or_not_it_is_public() {
    let text = "struct Told;\n    pub(crate) enum Fate {}\npub struct Report;\nfn f() { struct Way; }\ntype What = u8;";
    assert_eq!(riddles(text), ["Told", "Fate", "What"]);
}

#[test]
fn a_name_in_two_places_and_a_stale_entry_are_found() {
    let names = |places: &[&str]| -> Names {
        [("Slot".to_owned(), places.iter().map(|path_name| (*path_name).to_owned()).collect())]
            .into()
    };
    let entry = |places: &[&str]| -> BTreeMap<String, Shared> {
        let places = places.iter().map(|path_name| (*path_name).to_owned()).collect();
        [("Slot".to_owned(), Shared { concept: "a slot".into(), places })].into()
    };
    assert!(wrong(&names(&["a.rs"]), &BTreeMap::new()).is_empty());
    assert_eq!(wrong(&names(&["a.rs", "b.rs"]), &BTreeMap::new()).len(), 1);
    assert!(wrong(&names(&["a.rs", "b.rs"]), &entry(&["a.rs", "b.rs"])).is_empty());
    assert_eq!(wrong(&names(&["a.rs", "b.rs"]), &entry(&["a.rs", "c.rs"])).len(), 1);
    assert_eq!(wrong(&names(&["a.rs"]), &entry(&["a.rs"])).len(), 1);
}

#[test]
fn types_of_modules_are_seen_and_those_of_tests_and_functions_are_not() {
    let text = "pub struct A;\nenum B {}\npub(crate) struct C;\npub type D = A;\n// pub trait E\n\
        fn f() {\n    struct H;\n}\nproperties! {\n    /// One.\n    F,\n    /// All.\n    G,\n    always: h;\n}\nmod tests {\nstruct I;\n}";
    assert_eq!(defined(text).collect::<Vec<_>>(), ["A", "B", "C", "D", "F", "G"]);
}
