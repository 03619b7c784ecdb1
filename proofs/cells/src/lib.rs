//! A source of the core with cells in the place of its arrays, so that a proof need not choose how long they are.

use std::fs;

use proc_macro::TokenStream;

/// The text of a file of the core with three changes: a field `[T; CAPACITY]` is a `Cells<T, CAPACITY>`, the functions
/// that begin so are left out, and the file's own documentation is.
///
/// ```text
/// over_cells!("core/src/window.rs" without "fn new()" "fn iter(");
/// ```
///
/// The file is named from the root of the workspace, where the compiler runs. It is formatted as rustfmt formats it: a
/// field has one line, and a function ends at a brace in the column of its first word.
///
/// # Panics
/// The file cannot be read, or is no Rust: the compiler says so where the macro stands.
#[proc_macro]
pub fn over_cells(arguments: TokenStream) -> TokenStream {
    let words = arguments.into_iter().map(|word| word.to_string().trim_matches('"').to_owned());
    let words: Vec<String> = words.collect();
    let file = &words[0];
    let text = fs::read_to_string(file).unwrap_or_else(|error| panic!("{file}: {error}"));
    // The compiler builds anew when a file changes that it saw included.
    let seen = format!("const _: &[u8] = include_bytes!(concat!(\"../../\", {file:?}));\n");
    let text = seen + &over(&text, &words[2..]);
    text.parse().unwrap_or_else(|error| panic!("{file}: {error}"))
}

fn over(text: &str, without: &[String]) -> String {
    let is_head = |line: &str| without.iter().any(|head| line.contains(head.as_str()));
    let mut kept = String::new();
    // How the line begins that ends what is left out.
    let mut until = None;
    for line in text.lines() {
        if until.is_none() && is_head(line) {
            let indent = line.len() - line.trim_start().len();
            until = Some(format!("{}}}", &line[..indent]));
        }
        if let Some(end) = &until {
            if line == end {
                until = None;
            }
        } else if !line.starts_with("//!") {
            let array = line.strip_suffix("; CAPACITY],").and_then(|line| line.split_once(": ["));
            match array {
                Some((field, of)) => kept.extend([field, ": Cells<", of, ", CAPACITY>,\n"]),
                None => kept.extend([line, "\n"]),
            }
        }
    }
    kept
}
