//! Finds the decisions of a Rust file, and adds calls to the file that record them.

use std::ops::Range;
use std::path::Path;

use proc_macro2::Span;
use syn::spanned::Spanned;
use syn::visit::{self, Visit};
use syn::{Arm, BinOp, Expr, ExprConst, ExprIf, ExprWhile, ItemMod, UnOp};

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
    /// The conditions: the parts that remain without `&&`, `||`, `!` and parentheses.
    pub conditions: Vec<String>,
}

/// Returns the file with calls around its decisions, which are added to `decisions`.
pub(crate) fn instrument(
    file: &str,
    text: &str,
    decisions: &mut Vec<SourceDecision>,
) -> Result<String, FaultsError> {
    let not_rust = |error: syn::Error| FaultsError::content(Path::new(file), error.to_string());
    let parsed = syn::parse_file(text).map_err(not_rust)?;
    let mut instrumenter = Instrumenter { file, text, decisions, insertions: Vec::new() };
    if !file.ends_with("tests.rs") {
        instrumenter.visit_file(&parsed);
    }
    Ok(instrumenter.rewritten())
}

struct Instrumenter<'a> {
    file: &'a str,
    text: &'a str,
    decisions: &'a mut Vec<SourceDecision>,
    /// The insertions by place; earlier ones come first at the same place.
    insertions: Vec<(usize, String)>,
}

impl Instrumenter<'_> {
    fn decide(&mut self, whole: &Expr) {
        let mut conditions = Vec::new();
        leaves(whole, &mut conditions);
        // Patterns do not count as conditions.
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

    /// Returns the text with all insertions.
    fn rewritten(mut self) -> String {
        // The sort is stable, so insertions at the same place keep their order.
        self.insertions.sort_by_key(|(at, _)| *at);
        let (mut rewritten, mut done) = (String::new(), 0);
        for (at, inserted) in &self.insertions {
            rewritten.push_str(&self.text[done..*at]);
            rewritten.push_str(inserted);
            done = *at;
        }
        rewritten.push_str(&self.text[done..]);
        rewritten
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

    // The compiler itself evaluates this, so no test can.
    fn visit_expr_const(&mut self, _: &'ast ExprConst) {}

    fn visit_item_mod(&mut self, item: &'ast ItemMod) {
        if !item.attrs.iter().any(is_of_tests) {
            visit::visit_item_mod(self, item);
        }
    }
}

/// Returns `true` if it is `a && b` or `a || b`.
const fn is_tree(expression: &Expr) -> bool {
    matches!(expression, Expr::Binary(binary) if matches!(binary.op, BinOp::And(_) | BinOp::Or(_)))
}

/// Collects the conditions of a decision, from left to right.
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
        let text = "fn f(a: bool, b: bool) -> u8 { if !(a && b) { 1 } else { 2 } }\n";
        let mut decisions = Vec::new();
        let rewritten = instrument("f.rs", text, &mut decisions)?;
        assert_eq!(decisions.len(), 1);
        assert_eq!(decisions[0].conditions, ["a", "b"]);
        let condition = "!(crate::mcdc::condition(0, a) && crate::mcdc::condition(1, b))";
        let whole =
            format!("if crate::mcdc::end(0, {{ crate::mcdc::begin(2); {condition} }}) {{ 1 }}");
        assert!(rewritten.contains(&whole), "{rewritten}");
        Ok(())
    }

    #[test]
    fn a_decision_within_a_condition_is_one_of_its_own() -> Result<(), FaultsError> {
        let text = "fn f(a: Option<u8>) -> bool { a.is_some_and(|x| x > 1 && x < 5) && g() }\n";
        let mut decisions = Vec::new();
        instrument("f.rs", text, &mut decisions)?;
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
        assert_eq!(instrument("f.rs", text, &mut decisions)?, text);
        assert_eq!(decisions, []);
        Ok(())
    }
}
