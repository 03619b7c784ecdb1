//! Arrows point inward: who may depend on whom.

use std::collections::{BTreeMap, BTreeSet};

use cargo_lock::Lockfile;
use cargo_metadata::{DependencyKind, MetadataCommand, Package};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// Every package that each package depends on, by whatever kind of dependency, feature and target.
type Graph = BTreeMap<String, BTreeSet<String>>;

/// The graph as locked: unlike cargo's own it needs no package of another platform to be there.
fn graph() -> Graph {
    let lock = Lockfile::load(format!("{ROOT}/Cargo.lock")).expect("the workspace is locked");
    let mut graph = Graph::new();
    for package in lock.packages {
        let to = package.dependencies.iter().map(|dependency| dependency.name.to_string());
        graph.entry(package.name.to_string()).or_default().extend(to);
    }
    graph
}

fn reached_from(from: &str, graph: &Graph) -> BTreeSet<String> {
    let mut reached = BTreeSet::new();
    let mut next = vec![from];
    while let Some(package) = next.pop() {
        for dependency in &graph[package] {
            if reached.insert(dependency.clone()) {
                next.push(dependency);
            }
        }
    }
    reached
}

/// What a member's manifest says.
fn member(name: &str) -> Package {
    let metadata = MetadataCommand::new()
        .cargo_path(env!("CARGO"))
        .manifest_path(format!("{ROOT}/Cargo.toml"))
        .other_options(["--offline".into()])
        .no_deps()
        .exec()
        .expect("cargo reads the workspace");
    let mut packages = metadata.packages.into_iter();
    packages.find(|package| package.name.as_str() == name).expect("it is a member")
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
    let reached = reached_from("fuseline-core", &graph());
    let ours: Vec<_> = reached.iter().filter(|name| name.starts_with("fuseline")).collect();
    assert!(ours.is_empty(), "fuseline-core reaches {ours:?}");
}

#[test]
fn core_is_not_reached_from_traces() {
    let reached = reached_from("fuseline-traces", &graph());
    assert!(reached.contains("serde_json"), "the packages behind fuseline-traces were not read");
    assert!(!reached.contains("fuseline-core"), "the judge could share the core's faults");
}

#[test]
fn core_is_not_reached_from_the_kit() {
    let reached = reached_from("fuseline-testkit", &graph());
    assert!(
        reached.contains("fuseline-traces"),
        "the packages behind fuseline-testkit were not read"
    );
    assert!(!reached.contains("fuseline-core"), "the ledger could share the core's faults");
}

#[test]
fn the_machine_for_many_threads_reaches_of_ours_the_core_alone() {
    let mut graph = graph();
    // Under a cfg of its own alone.
    let is_there = graph.insert("loom".into(), BTreeSet::new()).is_some();
    assert!(is_there, "the packages behind fuseline-threads were not read");
    let reached = reached_from("fuseline-threads", &graph);
    let reached: Vec<_> = reached.iter().filter(|name| name.starts_with("fuseline")).collect();
    assert_eq!(reached, ["fuseline-core"]);
}

#[test]
fn core_behind_a_package_that_traces_uses_is_seen() {
    let mut graph = graph();
    graph.get_mut("serde_json").expect("a package").insert("fuseline-core".into());
    assert!(reached_from("fuseline-traces", &graph).contains("fuseline-core"));
}

#[test]
fn the_arbiter_reaches_of_ours_core_and_traces_alone() {
    let engine = member("fuseline-engine");
    let shipped = engine.dependencies.iter().filter(|it| it.kind != DependencyKind::Development);
    let always: Vec<_> = shipped.filter(|it| !it.optional).map(|it| it.name.as_str()).collect();
    assert_eq!(always, ["fuseline-core", "fuseline-traces"]);
    let reached = [always[0], always[1]].map(|name| reached_from(name, &graph()));
    for heavy in ["metrics", "tracing", "tokio"] {
        assert!(!reached.iter().any(|of| of.contains(heavy)), "the arbiter reaches {heavy}");
    }
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
