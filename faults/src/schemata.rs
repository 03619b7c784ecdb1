//! Mutant schemata: one file with many faults, each behind a number that an environment variable
//! selects.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::ops::Range;

use crate::error::FaultsError;
use crate::fault::SeededFault;
use crate::items::Function;

/// The variable that selects a fault by its number. No fault has the number 0.
pub(crate) const VARIABLE: &str = "FUSELINE_FAULT";
/// The variable that names the file to which programs append the numbers of the faults whose
/// functions are called.
pub(crate) const REACHED: &str = "FUSELINE_REACHED";

/// A function with its faults.
type FaultyFunction<'a> = (&'a Function, Vec<(u32, &'a SeededFault)>);

/// A file with faults.
pub(crate) struct Rewritten {
    pub(crate) text: String,
    /// The bytes of each copy of a function, with the faults that are to blame if it does not
    /// compile.
    copies: Vec<(Range<usize>, BTreeSet<u32>)>,
}

impl Rewritten {
    /// Returns the faults that a place of the text belongs to.
    pub(crate) fn faults_at(&self, at: usize) -> BTreeSet<u32> {
        let around = self.copies.iter().filter(|(range, _)| range.contains(&at));
        around.min_by_key(|(range, _)| range.len()).map(|(_, of)| of.clone()).unwrap_or_default()
    }
}

/// Returns the file with each faulty function's body once for each fault, and once unchanged.
///
/// `constants` are the words `const` to remove. A constant function can neither read a variable nor
/// call a function that does.
///
/// # Errors
/// Returns an error if a fault is not within the body of a function.
pub(crate) fn rewrite(
    text: &str,
    faults: &[(u32, &SeededFault)],
    constants: &[Range<usize>],
) -> Result<Rewritten, FaultsError> {
    let copy = |from: usize, to: usize| {
        let mut part = text[from..to].to_owned();
        for word in constants.iter().filter(|word| from <= word.start && word.end <= to) {
            part.replace_range(word.start - from..word.end - from, "     ");
        }
        part
    };
    let mut functions: BTreeMap<usize, FaultyFunction> = BTreeMap::new();
    for (number, fault) in faults {
        let Some(function) = fault.function.as_ref().filter(|_| can_share(fault)) else {
            let why = "it is in no body of a function".to_owned();
            return Err(FaultsError::Seed { name: fault.name.clone(), why });
        };
        functions
            .entry(function.body.start)
            .or_insert_with(|| (function, Vec::new()))
            .1
            .push((*number, fault));
    }
    let (mut rewritten, mut copies, mut done) = (String::new(), Vec::new(), 0);
    for (function, faults) in functions.values() {
        rewritten.push_str(&copy(done, function.body.start));
        let whole = rewritten.len();
        let numbers: Vec<String> =
            faults.iter().map(|(number, _)| format!("{number}\\n")).collect();
        rewritten.push_str(&SELECT.replace("NUMBERS", &numbers.concat()));
        for (number, fault) in faults {
            let start = rewritten.len();
            let _ = write!(rewritten, " {number} => ");
            rewritten.push_str(&text[function.body.start..fault.at.start]);
            rewritten.push_str(&fault.replace);
            rewritten.push_str(&text[fault.at.end..function.body.end]);
            copies.push((start..rewritten.len(), BTreeSet::from([*number])));
        }
        rewritten.push_str(" _ => ");
        rewritten.push_str(&text[function.body.clone()]);
        rewritten.push_str(" } }");
        copies.push((whole..rewritten.len(), faults.iter().map(|(number, _)| *number).collect()));
        done = function.body.end;
    }
    rewritten.push_str(&copy(done, text.len()));
    Ok(Rewritten { text: rewritten, copies })
}

/// Returns `true` if a fault can stand beside others in one build.
#[must_use]
pub fn can_share(fault: &SeededFault) -> bool {
    fault.own_build.is_none()
        && fault.parts().all(|part| {
            let body = part.function.as_ref().map(|function| &function.body);
            body.is_some_and(|body| body.start < part.at.start && part.at.end < body.end)
        })
}

/// Begins a body. It links std by itself, because some crates do not.
const SELECT: &str = "{ fn fuseline_fault() -> u32 { extern crate std as with_std; \
    use with_std::{env, fs::OpenOptions, io::Write as _, sync::OnceLock}; \
    static FAULT: OnceLock<u32> = OnceLock::new(); \
    *FAULT.get_or_init(|| { if let Some(path) = env::var_os(\"FUSELINE_REACHED\") { \
    let file = OpenOptions::new().create(true).append(true).open(path); \
    let _ = file.and_then(|mut file| file.write_all(b\"NUMBERS\")); } \
    env::var(\"FUSELINE_FAULT\").ok().and_then(|it| it.parse().ok()).unwrap_or(0) }) } \
    match fuseline_fault() {";

#[cfg(test)]
mod tests {
    use super::*;

    fn fault(text: &str, find: &str, replace: &str, function: Function) -> SeededFault {
        let at = text.find(find).expect("it is there");
        SeededFault::of_test(function, at..at + find.len(), find, replace)
    }

    #[test]
    fn each_fault_has_a_body_of_its_own() -> Result<(), FaultsError> {
        let text = "const fn f(a: u8) -> u8 { a + 1 }\nfn g() {}\n";
        let function = Function {
            path: "x::f".into(),
            file: "x.rs".into(),
            whole: 0..32,
            body: 24..33,
            constant: Some(0..5),
        };
        assert_eq!(&text[function.body.clone()], "{ a + 1 }");
        let faults = [fault(text, "a + 1", "a", function.clone()), fault(text, "1", "2", function)];
        let rewritten =
            rewrite(text, &[(7, &faults[0]), (8, &faults[1])], std::slice::from_ref(&(0..5)))?;
        let expected = " 7 => { a } 8 => { a + 2 } _ => { a + 1 } } }\nfn g() {}\n";
        assert!(rewritten.text.ends_with(expected), "{}", rewritten.text);
        assert!(rewritten.text.starts_with("      fn f(a: u8) -> u8 { fn fuseline_fault"));
        let at = rewritten.text.find("a + 2").expect("it is there");
        assert_eq!(rewritten.faults_at(at), BTreeSet::from([8]));
        assert_eq!(rewritten.faults_at(at + 12), BTreeSet::from([7, 8]));
        assert_eq!(rewritten.faults_at(0), BTreeSet::new());
        syn::parse_file(&rewritten.text).map(drop).expect("it is Rust");
        Ok(())
    }
}
