//! Tests graphs of operators that are drawn by seed, in virtual time (E1 to E7). `GRAPH_SEED=N`
//! repeats one graph, and `GRAPHS=N` runs N of them.

use tokio::runtime::Builder;

use crate::graph;

fn number(name: &str) -> Option<u64> {
    std::env::var(name).ok().map(|number| number.parse().expect("a number"))
}

/// Every drawn graph keeps the promises about graphs (E1, E2, E3, E6, E7).
#[test]
fn a_graph_of_any_shape_keeps_its_promises() {
    let seeds = match number("GRAPH_SEED") {
        Some(seed) => seed..seed + 1,
        None => 0..number("GRAPHS").unwrap_or(150),
    };
    let (count, mut all_refused) = (seeds.end - seeds.start, 0);
    for seed in seeds {
        let runtime = Builder::new_current_thread().enable_time().start_paused(true).build();
        let (wrong, refused) = runtime.unwrap().block_on(graph::wrongs(seed));
        all_refused += refused;
        assert!(wrong.is_empty(), "GRAPH_SEED={seed}: {wrong:#?}");
    }
    assert!(count < 100 || all_refused > 0, "no link was ever full");
}
