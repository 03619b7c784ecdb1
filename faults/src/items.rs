//! The functions of the project by their item paths, however they are spread over files.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use serde::Deserialize;
use syn::spanned::Spanned as _;
use syn::{Attribute, Block, ImplItem, Item, Signature, TraitItem, Type};

use crate::error::FaultsError;
use crate::tree::Tree;

/// One function with a body.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Function {
    /// Its path, such as `fuseline_core::slot::Slot::step`. A function of a trait has the path
    /// `module::<Type as Trait>::name`.
    pub path: String,
    /// The file that it is in, from the root.
    pub file: String,
    /// The bytes from its signature to its end.
    pub whole: Range<usize>,
    /// The bytes of its body, with the braces.
    pub body: Range<usize>,
    /// The bytes of the word `const`, if it is a constant function.
    pub constant: Option<Range<usize>>,
}

impl Function {
    /// Returns the crate that it is in.
    #[must_use]
    pub fn of_crate(&self) -> &str {
        self.path.split("::").next().unwrap_or_default()
    }

    /// Returns its own name.
    #[must_use]
    pub fn name(&self) -> &str {
        self.path.rsplit("::").next().unwrap_or_default()
    }
}

/// The crates of the project. Each crate is read when it is first needed.
pub struct FunctionIndex<'a> {
    tree: &'a Tree,
    folders: BTreeMap<String, CrateFiles>,
    read: BTreeMap<String, Vec<Function>>,
}

/// The root files of a crate.
struct CrateFiles {
    roots: Vec<String>,
}

#[derive(Deserialize)]
struct Manifest {
    package: Option<Package>,
    lib: Option<Lib>,
    workspace: Option<Workspace>,
}

#[derive(Deserialize)]
struct Package {
    name: String,
}

#[derive(Deserialize)]
struct Lib {
    name: Option<String>,
}

#[derive(Deserialize)]
struct Workspace {
    #[serde(default)]
    members: Vec<String>,
    #[serde(default)]
    exclude: Vec<String>,
}

fn manifest(tree: &Tree, folder: &str) -> Result<Manifest, FaultsError> {
    let file =
        if folder.is_empty() { "Cargo.toml".to_owned() } else { format!("{folder}/Cargo.toml") };
    let wrong = |error: toml::de::Error| FaultsError::content(&tree.path(&file), error.to_string());
    toml::from_str(&tree.text(&file)?).map_err(wrong)
}

impl<'a> FunctionIndex<'a> {
    /// Finds the crates of the project.
    ///
    /// # Errors
    /// Returns an error if a manifest cannot be read.
    pub fn new(tree: &'a Tree) -> Result<Self, FaultsError> {
        let mut folders = BTreeMap::new();
        let Some(workspace) = manifest(tree, "")?.workspace else {
            return Err(FaultsError::content(&tree.path("Cargo.toml"), "it is no workspace"));
        };
        for folder in workspace.members.into_iter().chain(workspace.exclude) {
            let Manifest { package: Some(package), lib, .. } = manifest(tree, &folder)? else {
                continue;
            };
            let named = lib.and_then(|lib| lib.name);
            let name = named.unwrap_or_else(|| package.name.replace('-', "_"));
            let roots = ["lib", "main"].map(|root| format!("{folder}/src/{root}.rs"));
            let roots = roots.into_iter().filter(|root| tree.path(root).exists()).collect();
            folders.insert(name, CrateFiles { roots });
        }
        Ok(Self { tree, folders, read: BTreeMap::new() })
    }

    /// Returns all functions of a crate.
    ///
    /// # Errors
    /// Returns an error if there is no such crate, or a file of it cannot be read as Rust.
    pub fn of_crate(&mut self, name: &str) -> Result<&[Function], FaultsError> {
        if !self.read.contains_key(name) {
            let Some(CrateFiles { roots }) = self.folders.get(name) else {
                return Err(FaultsError::content(Path::new(name), "the project has no such crate"));
            };
            let mut found = Functions { tree: self.tree, functions: Vec::new() };
            for root in roots {
                let folder = root.rsplit_once('/').map_or("", |(folder, _)| folder);
                found.file(root, folder, name)?;
            }
            // A module that is declared for two systems is found twice.
            found.functions.sort_by(|a, b| (&a.file, a.whole.start).cmp(&(&b.file, b.whole.start)));
            found.functions.dedup_by(|a, b| a.file == b.file && a.whole == b.whole);
            self.read.insert(name.to_owned(), found.functions);
        }
        Ok(&self.read[name])
    }

    /// Returns the innermost function of a file around some bytes, if there is one.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read as Rust.
    pub fn around(
        &mut self,
        file: &str,
        at: &Range<usize>,
    ) -> Result<Option<Function>, FaultsError> {
        let is_of = |it: &CrateFiles| {
            let folders = it.roots.iter().filter_map(|root| root.rsplit_once('/'));
            folders.into_iter().any(|(folder, _)| file.starts_with(&format!("{folder}/")))
        };
        let name = self.folders.iter().find(|(_, it)| is_of(it)).map(|(name, _)| name.clone());
        let is_rust = Path::new(file).extension().is_some_and(|it| it == "rs");
        let Some(name) = name.filter(|_| is_rust) else { return Ok(None) };
        let functions = self.of_crate(&name)?.iter();
        let around = functions
            .filter(|it| it.file == file && it.whole.start <= at.start && at.end <= it.whole.end);
        Ok(around.min_by_key(|it| it.whole.len()).cloned())
    }

    /// Returns the names of the crates.
    #[must_use]
    pub fn crates(&self) -> Vec<String> {
        self.folders.keys().cloned().collect()
    }
}

struct Functions<'a> {
    tree: &'a Tree,
    functions: Vec<Function>,
}

impl Functions<'_> {
    /// Adds the functions of a file, whose modules are in `folder`.
    fn file(&mut self, file: &str, folder: &str, path: &str) -> Result<(), FaultsError> {
        let text = self.tree.text(file)?;
        let parsed = syn::parse_file(&text);
        let parsed =
            parsed.map_err(|e| FaultsError::content(&self.tree.path(file), e.to_string()))?;
        self.items(&parsed.items, file, folder, path)
    }

    fn items(
        &mut self,
        items: &[Item],
        file: &str,
        folder: &str,
        path: &str,
    ) -> Result<(), FaultsError> {
        for item in items {
            match item {
                Item::Fn(item) => self.add(file, path, &item.sig, &item.block),
                Item::Impl(item) => {
                    let of = type_name(&item.self_ty);
                    let of = match &item.trait_ {
                        Some((_, of_trait, _)) => {
                            let last = of_trait.segments.last().map(written);
                            format!("{path}::<{of} as {}>", last.unwrap_or_default())
                        }
                        None => format!("{path}::{of}"),
                    };
                    for inner in &item.items {
                        if let ImplItem::Fn(inner) = inner {
                            self.add(file, &of, &inner.sig, &inner.block);
                        }
                    }
                }
                Item::Trait(item) => {
                    let of = format!("{path}::{}", item.ident);
                    for inner in &item.items {
                        if let TraitItem::Fn(inner) = inner
                            && let Some(body) = &inner.default
                        {
                            self.add(file, &of, &inner.sig, body);
                        }
                    }
                }
                Item::Mod(item) if !item.attrs.iter().any(is_of_tests) => {
                    let (name, inner) = (item.ident.to_string(), format!("{path}::{}", item.ident));
                    let below = format!("{folder}/{name}");
                    match &item.content {
                        Some((_, items)) => self.items(items, file, &below, &inner)?,
                        None => self.module(item, folder, &below, &inner)?,
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn module(
        &mut self,
        item: &syn::ItemMod,
        folder: &str,
        below: &str,
        path: &str,
    ) -> Result<(), FaultsError> {
        let named = item.attrs.iter().find_map(|attribute| {
            let syn::Meta::NameValue(pair) = &attribute.meta else { return None };
            let syn::Expr::Lit(literal) = &pair.value else { return None };
            let syn::Lit::Str(file) = &literal.lit else { return None };
            pair.path.is_ident("path").then(|| format!("{folder}/{}", file.value()))
        });
        // Code of another crate that a proof includes belongs to that crate.
        if named.as_ref().is_some_and(|file| file.contains("..")) {
            return Ok(());
        }
        let files = [named, Some(format!("{below}.rs")), Some(format!("{below}/mod.rs"))];
        match files.into_iter().flatten().find(|file| self.tree.path(file).exists()) {
            Some(file) => self.file(&file, below, path),
            // The module is for another system, or a build script creates it.
            None => Ok(()),
        }
    }

    fn add(&mut self, file: &str, path: &str, signature: &Signature, body: &Block) {
        let body = body.span().byte_range();
        self.functions.push(Function {
            path: format!("{path}::{}", signature.ident),
            file: file.to_owned(),
            whole: signature.span().byte_range().start..body.end,
            body,
            constant: signature.constness.map(|word| word.span.byte_range()),
        });
    }
}

/// Returns the name of a type, without its parameters.
fn type_name(of: &Type) -> String {
    match of {
        Type::Path(of) => {
            of.path.segments.last().map(|last| last.ident.to_string()).unwrap_or_default()
        }
        Type::Reference(of) => format!("&{}", type_name(&of.elem)),
        other => written(other),
    }
}

/// Returns tokens without white space.
fn written(tokens: &impl quote::ToTokens) -> String {
    tokens.to_token_stream().to_string().split_whitespace().collect()
}

pub(crate) fn is_of_tests(attribute: &Attribute) -> bool {
    attribute.path().is_ident("cfg")
        && attribute.parse_args::<syn::Ident>().is_ok_and(|it| it == "test")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_have_their_item_paths() -> Result<(), FaultsError> {
        let root = std::env::temp_dir().join(format!("fuseline-items-{}", std::process::id()));
        let tree = Tree::new(root.clone());
        let files = [
            ("Cargo.toml", "[workspace]\nmembers = [\"x\"]\n"),
            ("x/Cargo.toml", "[package]\nname = \"a-b\"\n"),
            ("x/src/lib.rs", "mod c;\nmod e { fn f() {} }\n#[cfg(test)] mod tests { fn g() {} }\n"),
            (
                "x/src/c.rs",
                "struct D<T>(T);\nimpl<T> D<T> { const fn g() {} }\n\
                 impl<T> From<T> for D<T> { fn from(t: T) -> Self { D(t) } }\n",
            ),
        ];
        for (file, text) in files {
            let path = tree.path(file);
            let folder = path.parent().unwrap_or(&path);
            std::fs::create_dir_all(folder).map_err(FaultsError::file(folder))?;
            std::fs::write(&path, text).map_err(FaultsError::file(&path))?;
        }
        let mut items = FunctionIndex::new(&tree)?;
        let found: Vec<&str> = items.of_crate("a_b")?.iter().map(|f| &*f.path).collect();
        assert_eq!(found, ["a_b::c::D::g", "a_b::c::<D as From<T>>::from", "a_b::e::f"]);
        assert!(items.of_crate("a_b")?[0].constant.is_some());
        assert!(items.of_crate("z").is_err());
        std::fs::remove_dir_all(&root).map_err(FaultsError::file(&root))
    }
}
