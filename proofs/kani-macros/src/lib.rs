//! Kani's attributes for the stand-in: a harness stays the function that it is, and is an export for the checker.

use proc_macro::{TokenStream, TokenTree};

/// Marks a harness. For wasm it is exported by its name.
#[proc_macro_attribute]
pub fn proof(_arguments: TokenStream, harness: TokenStream) -> TokenStream {
    let mut tokens = harness.clone().into_iter();
    tokens.find(|token| matches!(token, TokenTree::Ident(word) if word.to_string() == "fn"));
    let Some(TokenTree::Ident(name)) = tokens.next() else {
        return "compile_error!(\"a harness is a function\");".parse().unwrap_or_default();
    };
    // One harness is built at a time, so that what is checked is that harness and nothing else.
    let export = format!(
        "#[cfg(all(target_arch = \"wasm32\", harness = \"{name}\"))]
         const _: () = {{
             #[unsafe(export_name = \"harness\")]
             extern \"C\" fn export() {{ {name}() }}
         }};"
    );
    harness.into_iter().chain(export.parse::<TokenStream>().unwrap_or_default()).collect()
}

/// How often a loop is unwound; the runner reads it.
#[proc_macro_attribute]
pub fn unwind(_bound: TokenStream, harness: TokenStream) -> TokenStream {
    harness
}

/// Which solver is asked; the runner reads it.
#[proc_macro_attribute]
pub fn solver(_name: TokenStream, harness: TokenStream) -> TokenStream {
    harness
}
