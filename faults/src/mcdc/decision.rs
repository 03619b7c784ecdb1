//! Decisions of a file of Rust, and the file with calls that record them.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::Path;

use proc_macro2::Span;
use syn::spanned::Spanned;
use syn::visit::{self, Visit};
use syn::{
    Arm, BinOp, Expr, ExprCall, ExprConst, ExprIf, ExprWhile, ImplItemConst, ItemConst, ItemMod,
    Signature, UnOp,
};

use crate::error::FaultsError;
use crate::items::is_of_tests;

/// The condition of an `if`, `while` or match arm, or a tree of `&&` and `||` elsewhere.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SourceDecision {
    /// The file, from the root.
    pub file: String,
    /// Its line, counted from 1.
    pub line: usize,
    /// Its text, in one line.
    pub text: String,
    /// The conditions: what is left of it without `&&`, `||`, `!` and parentheses.
    pub conditions: Vec<String>,
}

/// The names of constant functions with a decision that constants of these files call.
pub(crate) fn constant_functions(
    files: &[(String, String)],
) -> Result<BTreeSet<String>, FaultsError> {
    let mut constants = ConstantCalls::default();
    for (file, text) in files {
        constants.visit_file(&parse(file, text)?);
    }
    let calls: BTreeSet<String> = constants.calls.into_iter().map(|(name, _)| name).collect();
    Ok(calls.intersection(&constants.functions).cloned().collect())
}

fn parse(file: &str, text: &str) -> Result<syn::File, FaultsError> {
    let not_rust = |error: syn::Error| FaultsError::content(Path::new(file), error.to_string());
    syn::parse_file(text).map_err(not_rust)
}

/// The file with calls around its decisions, which are added to `decisions`.
///
/// No constant can record anything: of the functions `constant` a copy stays as it is, and constants call that.
pub(crate) fn instrument(
    file: &str,
    text: &str,
    constant: &BTreeSet<String>,
    decisions: &mut Vec<SourceDecision>,
) -> Result<String, FaultsError> {
    let parsed = parse(file, text)?;
    let mut constants = ConstantCalls::default();
    constants.visit_file(&parsed);
    let calls = constants.calls.into_iter().filter(|(name, _)| constant.contains(name));
    let insertions = calls.map(|(_, end)| (end, IN_CONSTANTS.to_owned())).collect();
    let mut instrumenter =
        Instrumenter { file, text, constant, decisions, insertions, consts: Vec::new() };
    if !file.ends_with("tests.rs") {
        instrumenter.visit_file(&parsed);
    }
    Ok(instrumenter.rewritten())
}

/// What the name of the copy of a function ends in that constants call.
const IN_CONSTANTS: &str = "_in_constants";

struct Instrumenter<'a> {
    file: &'a str,
    text: &'a str,
    constant: &'a BTreeSet<String>,
    decisions: &'a mut Vec<SourceDecision>,
    /// What is put in where; what comes first stands before what comes later at the same place.
    insertions: Vec<(usize, String)>,
    /// The words `const` of functions with a decision: recording is nothing that a constant can do.
    consts: Vec<Range<usize>>,
}

impl Instrumenter<'_> {
    fn decide(&mut self, whole: &Expr) {
        let mut conditions = Vec::new();
        leaves(whole, &mut conditions);
        // A pattern is no condition.
        if conditions.iter().any(|it| matches!(it, Expr::Let(_))) {
            return visit::visit_expr(self, whole);
        }
        let number = self.decisions.len();
        self.decisions.push(SourceDecision {
            file: self.file.to_owned(),
            line: whole.span().start().line,
            text: self.quote(whole.span()),
            conditions: conditions.iter().map(|it| self.quote(it.span())).collect(),
        });
        let Range { start, end } = whole.span().byte_range();
        let begin = format!("crate::mcdc::begin({});", conditions.len());
        self.insertions.push((start, format!("crate::mcdc::end({number}, {{ {begin} ")));
        for (i, condition) in conditions.into_iter().enumerate() {
            let Range { start, end } = condition.span().byte_range();
            self.insertions.push((start, format!("crate::mcdc::condition({i}, ")));
            visit::visit_expr(self, condition);
            self.insertions.push((end, ")".to_owned()));
        }
        self.insertions.push((end, " })".to_owned()));
    }

    fn quote(&self, span: Span) -> String {
        let text = self.text.get(span.byte_range()).unwrap_or_default();
        text.split_whitespace().collect::<Vec<_>>().join(" ")
    }

    /// The text with everything put in.
    fn rewritten(mut self) -> String {
        // Stable: what was put in first at a place stands first there.
        self.insertions.sort_by_key(|(at, _)| *at);
        let (mut rewritten, mut done) = (String::new(), 0);
        let copy = |from: usize, to: usize| {
            let mut part = self.text.get(from..to).unwrap_or_default().to_owned();
            for range in self.consts.iter().rev().filter(|it| (from..to).contains(&it.start)) {
                part.replace_range(range.start - from..range.end - from, "");
            }
            part
        };
        for (at, inserted) in &self.insertions {
            rewritten.push_str(&copy(done, *at));
            rewritten.push_str(inserted);
            done = *at;
        }
        rewritten.push_str(&copy(done, self.text.len()));
        rewritten
    }

    /// A function that decides something is no `const fn` in the copy.
    fn function(&mut self, signature: &Signature, whole: Span, inner: impl FnOnce(&mut Self)) {
        let before = self.decisions.len();
        inner(self);
        let Some(word) = signature.constness else { return };
        if self.decisions.len() > before {
            self.consts.push(word.span.byte_range());
        }
        if self.constant.contains(&signature.ident.to_string()) {
            let Range { start, end } = whole.byte_range();
            let name = signature.ident.span().byte_range().end;
            let part = |range| self.text.get(range).unwrap_or_default();
            let copied = [part(start..name), IN_CONSTANTS, part(name..end)].concat();
            self.insertions.push((end, copied));
        }
    }
}

impl<'ast> Visit<'ast> for Instrumenter<'_> {
    fn visit_expr(&mut self, expression: &'ast Expr) {
        if is_tree(expression) {
            self.decide(expression);
        } else {
            visit::visit_expr(self, expression);
        }
    }

    fn visit_expr_if(&mut self, expression: &'ast ExprIf) {
        self.decide(&expression.cond);
        self.visit_block(&expression.then_branch);
        if let Some((_, otherwise)) = &expression.else_branch {
            self.visit_expr(otherwise);
        }
    }

    fn visit_expr_while(&mut self, expression: &'ast ExprWhile) {
        self.decide(&expression.cond);
        self.visit_block(&expression.body);
    }

    fn visit_arm(&mut self, arm: &'ast Arm) {
        if let Some((_, guard)) = &arm.guard {
            self.decide(guard);
        }
        self.visit_expr(&arm.body);
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        self.function(&item.sig, item.span(), |it| visit::visit_item_fn(it, item));
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        self.function(&item.sig, item.span(), |it| visit::visit_impl_item_fn(it, item));
    }

    // What the compiler evaluates, it shows itself.
    fn visit_expr_const(&mut self, _: &'ast ExprConst) {}

    fn visit_item_mod(&mut self, item: &'ast ItemMod) {
        if !item.attrs.iter().any(is_of_tests) {
            visit::visit_item_mod(self, item);
        }
    }
}

/// The functions that constants call, and those that they may.
#[derive(Default)]
struct ConstantCalls {
    /// The name of each function that is called, and where that ends.
    calls: Vec<(String, usize)>,
    /// Only those in which something may be decided: the others can stay as they are.
    functions: BTreeSet<String>,
    is_within: bool,
    decides: bool,
}

impl ConstantCalls {
    fn within(&mut self, inner: impl FnOnce(&mut Self)) {
        self.is_within = true;
        inner(self);
        self.is_within = false;
    }

    fn function(&mut self, signature: &Signature, inner: impl FnOnce(&mut Self)) {
        let outer = std::mem::take(&mut self.decides);
        inner(self);
        if signature.constness.is_some() && self.decides {
            self.functions.insert(signature.ident.to_string());
        }
        self.decides = outer;
    }
}

impl<'ast> Visit<'ast> for ConstantCalls {
    fn visit_item_const(&mut self, item: &'ast ItemConst) {
        self.within(|it| visit::visit_item_const(it, item));
    }

    fn visit_impl_item_const(&mut self, item: &'ast ImplItemConst) {
        self.within(|it| visit::visit_impl_item_const(it, item));
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        self.function(&item.sig, |it| visit::visit_item_fn(it, item));
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        self.function(&item.sig, |it| visit::visit_impl_item_fn(it, item));
    }

    fn visit_expr(&mut self, expression: &'ast Expr) {
        self.decides |= is_tree(expression) || matches!(expression, Expr::If(_) | Expr::While(_));
        visit::visit_expr(self, expression);
    }

    fn visit_arm(&mut self, arm: &'ast Arm) {
        self.decides |= arm.guard.is_some();
        visit::visit_arm(self, arm);
    }

    fn visit_expr_call(&mut self, call: &'ast ExprCall) {
        if let (true, Expr::Path(path)) = (self.is_within, &*call.func) {
            let idents = path.path.segments.last().map(|name| &name.ident);
            let ends = idents.map(|it| (it.to_string(), it.span().byte_range().end));
            self.calls.extend(ends);
        }
        visit::visit_expr_call(self, call);
    }
}

/// Whether it is `a && b` or `a || b`.
const fn is_tree(expression: &Expr) -> bool {
    matches!(expression, Expr::Binary(binary) if matches!(binary.op, BinOp::And(_) | BinOp::Or(_)))
}

/// The conditions of a decision, from left to right.
fn leaves<'a>(expression: &'a Expr, into: &mut Vec<&'a Expr>) {
    match expression {
        Expr::Binary(binary) if is_tree(expression) => {
            leaves(&binary.left, into);
            leaves(&binary.right, into);
        }
        Expr::Unary(unary) if matches!(unary.op, UnOp::Not(_)) => leaves(&unary.expr, into),
        Expr::Paren(inner) => leaves(&inner.expr, into),
        leaf => into.push(leaf),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_condition_is_recorded_within_its_decision() -> Result<(), FaultsError> {
        let text = "const fn f(a: bool, b: bool) -> u8 { if !(a && b) { 1 } else { 2 } }\n";
        let mut decisions = Vec::new();
        let rewritten = instrument("f.rs", text, &BTreeSet::new(), &mut decisions)?;
        assert_eq!(decisions.len(), 1);
        assert_eq!(decisions[0].conditions, ["a", "b"]);
        let condition = "!(crate::mcdc::condition(0, a) && crate::mcdc::condition(1, b))";
        let whole =
            format!("if crate::mcdc::end(0, {{ crate::mcdc::begin(2); {condition} }}) {{ 1 }}");
        assert!(rewritten.contains(&whole), "{rewritten}");
        assert!(!rewritten.contains("const"), "{rewritten}");
        Ok(())
    }

    #[test]
    fn only_constant_functions_that_decide_are_copied() -> Result<(), FaultsError> {
        let text = "const fn f(a: bool) -> u8 { if a { 1 } else { 2 } }\n\
            const fn g() -> u8 { 3 }\n\
            const X: u8 = f(true) + g();\n";
        let constant = constant_functions(&[("f.rs".to_owned(), text.to_owned())])?;
        assert_eq!(constant, BTreeSet::from(["f".to_owned()]));
        Ok(())
    }

    #[test]
    fn a_decision_within_a_condition_is_one_of_its_own() -> Result<(), FaultsError> {
        let text = "fn f(a: Option<u8>) -> bool { a.is_some_and(|x| x > 1 && x < 5) && g() }\n";
        let mut decisions = Vec::new();
        instrument("f.rs", text, &BTreeSet::new(), &mut decisions)?;
        let texts: Vec<&[String]> = decisions.iter().map(|it| &*it.conditions).collect();
        assert_eq!(texts, [&["a.is_some_and(|x| x > 1 && x < 5)", "g()"][..], &["x > 1", "x < 5"]]);
        Ok(())
    }

    #[test]
    fn patterns_tests_and_constants_are_no_decisions() -> Result<(), FaultsError> {
        let text = "fn f(a: Option<u8>) { if let Some(_) = a {} }\n\
            const X: () = const { assert!(1 < 2 && 2 < 3) };\n\
            #[cfg(test)] mod tests { fn g(a: bool) { if a {} } }\n";
        let mut decisions = Vec::new();
        assert_eq!(instrument("f.rs", text, &BTreeSet::new(), &mut decisions)?, text);
        assert_eq!(decisions, []);
        Ok(())
    }
}
