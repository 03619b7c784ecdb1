//! Compares the vendored header with the one that cbindgen generates from the sources.

use std::fs;
use std::path::Path;

const CRATE: &str = env!("CARGO_MANIFEST_DIR");

#[test]
fn the_header_is_what_the_sources_say() {
    let root = Path::new(CRATE);
    let mut config = cbindgen::Config::from_file(root.join("cbindgen.toml")).expect("its settings");
    let defines = config.after_includes.expect("the macros of the header");
    config.after_includes = Some(defines.replace("@VERSION@", env!("CARGO_PKG_VERSION")));
    let bindings = cbindgen::Builder::new()
        .with_config(config)
        .with_src(root.join("src/plain.rs"))
        .with_src(root.join("src/storage.rs"))
        .with_src(root.join("src/shared_storage.rs"))
        .with_src(root.join("src/calls.rs"))
        .with_src(root.join("src/shared.rs"))
        .generate();
    let mut generated = Vec::new();
    bindings.expect("sources that cbindgen reads").write(&mut generated);
    let generated = String::from_utf8(generated).expect("a text");
    let path = root.join("include/fuseline.h");
    if std::env::var_os("FUSELINE_WRITE_HEADER").is_some() {
        fs::write(&path, &generated).expect("a writable header");
    }
    let committed = fs::read_to_string(&path).unwrap_or_default();
    assert!(
        committed == generated,
        "include/fuseline.h is not what the sources say; make it again:\n  \
         FUSELINE_WRITE_HEADER=1 cargo test -p fuseline-c --test header"
    );
}
