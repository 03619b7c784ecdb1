//! Reads cargo's JSON while it builds: the programs, and the places that do not compile.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::work::Programs;

/// Adds the program that a message names, if it names one.
pub(crate) fn take_program(message: &Value, programs: &mut Programs) {
    let (Some(executable), Some(manifest)) =
        (message["executable"].as_str(), message["manifest_path"].as_str())
    else {
        return;
    };
    let id = message["package_id"].as_str().unwrap_or_default();
    let (path, version) = id.rsplit_once('#').unwrap_or_default();
    let package = version
        .split_once('@')
        .map_or_else(|| path.rsplit('/').next().unwrap_or_default(), |it| it.0);
    let target = message["target"]["name"].as_str().unwrap_or_default();
    let folder = Path::new(manifest).parent().unwrap_or(Path::new(manifest)).to_owned();
    let place = (PathBuf::from(executable), folder);
    let key = (package.to_owned(), target.to_owned());
    // A library's tests take precedence over a program of the same name.
    let is_library = message["target"]["kind"][0] == "lib";
    if is_library || !programs.contains_key(&key) {
        programs.insert(key, place);
    }
}

/// Returns the primary places of a compiler message: each file, from the root, and a byte in it.
pub(crate) fn primary_places(message: &Value) -> Vec<(String, usize)> {
    let spans = message["spans"].as_array().into_iter().flatten();
    let primary = spans.filter(|span| span["is_primary"] == true);
    let place = |span: &Value| {
        let at = usize::try_from(span["byte_start"].as_u64()?).ok()?;
        Some((plain(span["file_name"].as_str()?), at))
    };
    primary.filter_map(place).collect()
}

/// Resolves each `..` of a path by removing the folder before it.
fn plain(path: &str) -> String {
    let mut parts = Vec::new();
    for part in path.split('/') {
        if part == ".." {
            parts.pop();
        } else {
            parts.push(part);
        }
    }
    parts.join("/")
}
