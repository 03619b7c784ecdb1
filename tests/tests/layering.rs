//! Checks that dependencies point inward: which crate may depend on which.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use cargo_metadata::{DependencyKind, MetadataCommand, Package, Target};
use ignore::WalkBuilder;
use toml::{Table, Value};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// The packages that each package depends on, by any kind of dependency, feature and target.
type Graph = BTreeMap<String, BTreeSet<String>>;

/// Returns the graph of the lock file. Unlike cargo's own graph it needs no package of another
/// platform.
fn graph() -> Graph {
    let lock = fs::read_to_string(format!("{ROOT}/Cargo.lock")).expect("the workspace is locked");
    let lock: Table = lock.parse().expect("cargo wrote it");
    let mut graph = Graph::new();
    for package in lock["package"].as_array().into_iter().flatten() {
        // A dependency is named with its version if two are locked.
        let to = package.get("dependencies").and_then(Value::as_array).into_iter().flatten();
        let to = to.filter_map(|dependency| dependency.as_str()?.split(' ').next());
        let name = package["name"].as_str().expect("a name").to_owned();
        graph.entry(name).or_default().extend(to.map(str::to_owned));
    }
    graph
}

/// Returns the packages that a package depends on, directly or not.
fn reached_from(from: &str, graph: &Graph) -> BTreeSet<String> {
    let mut reached = BTreeSet::new();
    let mut next = vec![from];
    while let Some(package) = next.pop() {
        let fresh = graph[package].iter().filter(|it| reached.insert((*it).clone()));
        next.extend(fresh.map(String::as_str));
    }
    reached
}

/// Returns the packages of the project that a package depends on, directly or not.
fn ours(from: &str, graph: &Graph) -> Vec<String> {
    reached_from(from, graph).into_iter().filter(|name| name.starts_with("fuseline")).collect()
}

/// Returns the members' manifests.
fn members() -> Vec<Package> {
    let metadata = MetadataCommand::new()
        .cargo_path(env!("CARGO"))
        .manifest_path(format!("{ROOT}/Cargo.toml"))
        .other_options(["--offline".into()])
        .no_deps()
        .exec()
        .expect("cargo reads the workspace");
    metadata.packages
}

fn member(name: &str) -> Package {
    let mut packages = members().into_iter();
    packages.find(|package| package.name.as_str() == name).expect("it is a member")
}

/// Cargo finds no tests by itself in a folder whose files are modules of one program.
#[test]
fn each_file_of_tests_is_a_program_or_a_module_of_one() {
    let targets = members().into_iter().flat_map(|package| package.targets);
    let programs: BTreeSet<PathBuf> =
        targets.filter_map(|target| fs::canonicalize(target.src_path).ok()).collect();
    let of_many: Vec<_> = programs.iter().filter(|path| path.ends_with("tests/main.rs")).collect();
    assert!(of_many.len() > 3, "only {of_many:?} have modules");
    for program in of_many {
        let modules = fs::read_to_string(program).expect("UTF-8");
        let files = fs::read_dir(program.parent().expect("a folder")).expect("a readable folder");
        for file in files.map(|file| file.expect("a readable folder").path()) {
            let name = file.file_stem().expect("a name").to_string_lossy();
            let is_module = modules.contains(&format!("\nmod {name};"));
            let is_source = file.extension().is_some_and(|extension| extension == "rs");
            assert!(
                !is_source || is_module || programs.contains(&file),
                "{} is not run",
                file.display()
            );
        }
    }
}

/// Returns `true` if `is_so` holds for the text of a Rust file at or below a folder.
fn has_file(folder: &Path, is_so: impl Fn(&str) -> bool) -> bool {
    let files = WalkBuilder::new(folder).build().map(|file| file.expect("a readable folder"));
    let mut files = files.filter(|file| file.path().extension().is_some_and(|it| it == "rs"));
    files.any(|file| is_so(&fs::read_to_string(file.path()).expect("UTF-8")))
}

fn has_test(text: &str) -> bool {
    let mut lines = text.lines().map(str::trim_start);
    lines.any(|line| line.starts_with("#[test]") || line.starts_with("#[tokio::test"))
}

/// Returns `true` if a code block in the documentation names no other language.
fn has_example(text: &str) -> bool {
    let lines = text.lines().map(str::trim_start);
    let fences = lines
        .filter_map(|line| line.strip_prefix("/// ```").or_else(|| line.strip_prefix("//! ```")));
    let mut begins = fences.step_by(2);
    begins.any(|language| ["", "rust", "no_run", "should_panic"].contains(&language))
}

/// Cargo is told that some libraries and programs have no tests or no examples, so that it builds
/// nothing in vain.
#[test]
fn what_is_said_to_have_no_tests_has_none() {
    let targets: Vec<_> = members().into_iter().flat_map(|package| package.targets).collect();
    let made = || targets.iter().filter(|target| target.is_lib() || target.is_bin());
    let folder = |target: &Target| target.src_path.parent().expect("a folder").to_owned();
    let tested: BTreeSet<_> = made().filter(|target| target.test).map(folder).collect();
    // If a library beside it is tested, only the program's own file is looked at.
    for target in made().filter(|target| !target.test && tested.contains(&folder(target))) {
        let text = fs::read_to_string(&target.src_path).expect("UTF-8");
        assert!(!has_test(&text), "the tests of {} do not run", target.src_path);
    }
    let untested: Vec<_> = made().filter(|target| !tested.contains(&folder(target))).collect();
    assert!(untested.len() > 5, "only {untested:?} have no tests");
    for target in untested {
        let has = has_file(folder(target).as_std_path(), has_test);
        assert!(!has, "the tests of {} do not run", target.name);
    }
    for target in made().filter(|target| target.is_lib() && !target.doctest) {
        let has = has_file(folder(target).as_std_path(), has_example);
        assert!(!has, "the examples of {} do not run", target.name);
    }
}

#[test]
fn core_depends_on_nothing_but_what_is_optional() {
    let core = member("fuseline-core");
    for dependency in &core.dependencies {
        let is_optional = dependency.optional && ["serde", "defmt"].contains(&&*dependency.name);
        let is_shipped = dependency.kind != DependencyKind::Development;
        assert!(is_optional || !is_shipped, "fuseline-core depends on {dependency:?}");
    }
    let by_default = core.features.get("default");
    assert!(by_default.is_none_or(Vec::is_empty), "features by default: {by_default:?}");
}

#[test]
fn nothing_of_the_project_is_reached_from_core() {
    assert_eq!(ours("fuseline-core", &graph()), [""; 0]);
}

/// The judge could share the core's faults.
#[test]
fn core_is_not_reached_from_traces() {
    let reached = reached_from("fuseline-traces", &graph());
    assert!(reached.contains("serde_json") && !reached.contains("fuseline-core"), "{reached:?}");
}

/// The ledger could share the core's faults.
#[test]
fn core_is_not_reached_from_the_kit() {
    assert_eq!(ours("fuseline-testkit", &graph()), ["fuseline-traces"]);
}

#[test]
fn threads_depends_only_on_the_core() {
    let mut graph = graph();
    // This dependency exists only under its own cfg.
    let is_there = graph.insert("loom".into(), BTreeSet::new()).is_some();
    assert!(is_there, "the packages behind fuseline-threads were not read");
    assert_eq!(ours("fuseline-threads", &graph), ["fuseline-core"]);
}

#[test]
fn core_behind_a_package_that_traces_uses_is_seen() {
    let mut graph = graph();
    graph.get_mut("serde_json").expect("a package").insert("fuseline-core".into());
    assert!(reached_from("fuseline-traces", &graph).contains("fuseline-core"));
}

#[test]
fn what_unpacks_and_reads_csv_is_optional_in_traces() {
    let traces = member("fuseline-traces");
    for heavy in ["csv", "mcap", "zstd"] {
        let found = traces.dependencies.iter().find(|it| it.name == heavy);
        assert!(found.is_some_and(|it| it.optional), "{heavy}: {found:?}");
    }
    let by_default = traces.features.get("default");
    assert!(by_default.is_none_or(Vec::is_empty), "features by default: {by_default:?}");
}
