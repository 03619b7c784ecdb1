//! The macros of the proofs: the attributes of a harness, and the window over cells.
//!
//! [`proof`], [`unwind`] and [`solver`] replace Kani's on hosts without Kani, and `proofs/kani`
//! exports them. A harness stays a plain function, and is also an export for the checker.
//! [`over_cells`] is used with Kani too.

use std::fs;

use proc_macro::{TokenStream, TokenTree};

/// Marks a harness. For wasm it is exported by its name.
#[proc_macro_attribute]
pub fn proof(_arguments: TokenStream, harness: TokenStream) -> TokenStream {
    let mut tokens = harness.clone().into_iter();
    tokens.find(|token| matches!(token, TokenTree::Ident(word) if word.to_string() == "fn"));
    let Some(TokenTree::Ident(name)) = tokens.next() else {
        return "compile_error!(\"a harness is a function\");".parse().unwrap_or_default();
    };
    // One harness is built at a time, so that the checker sees only that harness.
    let export = format!(
        "#[cfg(all(target_arch = \"wasm32\", harness = \"{name}\"))]
         const _: () = {{
             #[unsafe(export_name = \"harness\")]
             extern \"C\" fn export() {{ {name}() }}
         }};"
    );
    harness.into_iter().chain(export.parse::<TokenStream>().unwrap_or_default()).collect()
}

/// States how often a loop is unwound. The runner reads it.
#[proc_macro_attribute]
pub fn unwind(_bound: TokenStream, harness: TokenStream) -> TokenStream {
    harness
}

/// States which solver to use. The runner reads it.
#[proc_macro_attribute]
pub fn solver(_name: TokenStream, harness: TokenStream) -> TokenStream {
    harness
}

/// Includes the text of a file of the core with three changes. A field `[T; CAPACITY]` or
/// `[[T; CAPACITY]; 2]` becomes a `Cells<T>`. The functions that begin with these texts are left
/// out, and so is the file's own documentation.
///
/// ```text
/// over_cells!("core/src/window.rs" without "fn new()" "fn iter(");
/// ```
///
/// The path starts at the root of the workspace, where the compiler runs. The file must be formatted by
/// rustfmt: a field is on one line, and a function ends with a brace in the column of its first word.
///
/// # Panics
/// Panics if the file cannot be read or is not Rust. The compiler reports this at the macro.
#[proc_macro]
pub fn over_cells(arguments: TokenStream) -> TokenStream {
    let words = arguments.into_iter().map(|word| word.to_string().trim_matches('"').to_owned());
    let words: Vec<String> = words.collect();
    let file = &words[0];
    let text = fs::read_to_string(file).unwrap_or_else(|error| panic!("{file}: {error}"));
    // The compiler builds again when a file that was included changes.
    let included = format!("const _: &[u8] = include_bytes!(concat!(\"../../\", {file:?}));\n");
    let text = included + &over(&text, &words[2..]);
    text.parse().unwrap_or_else(|error| panic!("{file}: {error}"))
}

fn over(text: &str, without: &[String]) -> String {
    let is_head = |line: &str| without.iter().any(|head| line.contains(head.as_str()));
    let mut out = String::new();
    // The beginning of the line that ends the part that is left out.
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
            let array = |begin, end| line.strip_suffix(end)?.split_once(begin);
            let array = array(": [[", "; CAPACITY]; 2],").or_else(|| array(": [", "; CAPACITY],"));
            match array {
                Some((field, of)) => out.extend([field, ": Cells<", of, ">,\n"]),
                None => out.extend([line, "\n"]),
            }
        }
    }
    out
}
