//! Builds the faults: all at once, except faults that need a build of their own.

use std::collections::{BTreeMap, BTreeSet};

use crate::campaign::Campaign;
use crate::error::FaultsError;
use crate::fault::SeededFault;
use crate::items::{Function, FunctionIndex};
use crate::schemata::{self, Rewritten};
use crate::work::{Built, FaultyCopy, Programs};

/// The files that differ from the project's, with their texts.
pub(crate) type Texts = BTreeMap<String, String>;

/// The faults of a file, and the words `const` that are removed from it.
type FileChanges<'a> = (Vec<(u32, &'a SeededFault)>, Vec<std::ops::Range<usize>>);

impl Campaign<'_> {
    /// Builds all faults at once. A fault that does not compile beside the others gets a build of
    /// its own.
    pub(crate) fn build_shared(
        &self,
        work: &FaultyCopy,
        apart: &mut BTreeMap<u32, String>,
        report: &impl Fn(&str),
    ) -> Result<(BTreeMap<&'static str, Programs>, Texts), FaultsError> {
        'again: loop {
            let rewritten = self.rewritten(apart)?;
            let texts: Texts =
                rewritten.iter().map(|(file, it)| (file.clone(), it.text.clone())).collect();
            self.tree.copy_to(&work.copy, texts.clone())?;
            let mut programs = BTreeMap::new();
            for (name, suite) in self.suites() {
                report(&format!("building {name}"));
                match work.build(suite)? {
                    Built::Programs(built) => drop(programs.insert(name, built)),
                    Built::Refused(places, said) => {
                        let faults = places
                            .iter()
                            .filter_map(|(file, at)| Some(rewritten.get(file)?.faults_at(*at)));
                        let mut faults: BTreeSet<u32> = faults.flatten().collect();
                        // With faults in it a function is no longer `const`, so a constant that
                        // calls it does not compile. The error names no fault then.
                        if faults.is_empty() && said.contains("[E0015]") {
                            let is_constant = |fault: &SeededFault| {
                                fault.function.as_ref().is_some_and(|it| it.constant.is_some())
                            };
                            let constant = self.parts().filter(|(_, fault)| is_constant(fault));
                            let constant = constant.map(|(number, _)| number);
                            faults.extend(constant.filter(|number| !apart.contains_key(number)));
                        }
                        if faults.is_empty() {
                            return Err(FaultsError::content(
                                work.copy.root(),
                                format!("{name} does not build:\n{said}"),
                            ));
                        }
                        for number in faults {
                            report(&format!(
                                "{} does not compile beside the others",
                                self.name(number)
                            ));
                            apart.insert(
                                number,
                                "it does not compile beside the function as it is".to_owned(),
                            );
                        }
                        continue 'again;
                    }
                }
            }
            return Ok((programs, texts));
        }
    }

    /// Returns the files with all faults that share a build.
    fn rewritten(
        &self,
        apart: &BTreeMap<u32, String>,
    ) -> Result<BTreeMap<String, Rewritten>, FaultsError> {
        let mut files: BTreeMap<String, FileChanges> = BTreeMap::new();
        for (number, part) in self.parts().filter(|(number, _)| !apart.contains_key(number)) {
            files.entry(part.file.clone()).or_default().0.push((number, part));
        }
        for function in self.constants(apart)? {
            files.entry(function.file).or_default().1.extend(function.constant);
        }
        let rewritten = files.into_iter().map(|(file, (faults, constants))| {
            let rewritten = schemata::rewrite(&self.tree.text(&file)?, &faults, &constants)?;
            Ok((file, rewritten))
        });
        rewritten.collect()
    }

    /// Returns the constant functions with faults, and the constant functions that call them.
    fn constants(&self, apart: &BTreeMap<u32, String>) -> Result<Vec<Function>, FaultsError> {
        let faulty = self.parts().filter(|(number, _)| !apart.contains_key(number));
        let faulty = faulty.filter_map(|(_, fault)| fault.function.clone());
        let mut found: Vec<Function> = faulty.filter(|it| it.constant.is_some()).collect();
        let crates: BTreeSet<String> = found.iter().map(|it| it.of_crate().to_owned()).collect();
        let mut items = FunctionIndex::new(self.tree)?;
        for name in crates {
            let constant = items.of_crate(&name)?.iter().filter(|it| it.constant.is_some());
            let constant: Vec<&Function> = constant.collect();
            loop {
                let calls = |it: &Function| -> Result<bool, FaultsError> {
                    let text = self.tree.text(&it.file)?;
                    let body = &text[it.body.clone()];
                    let of_crate = found.iter().filter(|known| known.of_crate() == name);
                    Ok(of_crate.map(Function::name).any(|name| body.contains(&format!("{name}("))))
                };
                let mut more = Vec::new();
                for function in &constant {
                    if !found.contains(function) && calls(function)? {
                        more.push((*function).clone());
                    }
                }
                if more.is_empty() {
                    break;
                }
                found.extend(more);
            }
        }
        found.sort_by(|a, b| (&a.file, a.whole.start).cmp(&(&b.file, b.whole.start)));
        found.dedup();
        Ok(found)
    }

    /// Builds one fault by itself, in a file without other faults.
    pub(crate) fn build_apart(
        &self,
        work: &FaultyCopy,
        texts: &Texts,
        fault: &SeededFault,
    ) -> Result<BTreeMap<&'static str, Programs>, FaultsError> {
        let mut texts = texts.clone();
        for part in fault.parts() {
            texts.insert(part.file.clone(), self.tree.text(&part.file)?);
        }
        // The parts are replaced from the end of a file on, so that the places of the others stay
        // right.
        let mut parts: Vec<&SeededFault> = fault.parts().collect();
        parts.sort_by_key(|part| std::cmp::Reverse(part.at.start));
        for part in parts {
            if let Some(text) = texts.get_mut(&part.file) {
                *text = part.seed(text)?;
            }
        }
        self.tree.copy_to(&work.copy, texts)?;
        let mut programs = BTreeMap::new();
        for kind in self.seeing(fault) {
            if programs.contains_key(kind.suite.name) {
                continue;
            }
            match work.build(kind.suite)? {
                Built::Programs(built) => drop(programs.insert(kind.suite.name, built)),
                Built::Refused(_, said) => {
                    let why = format!("it does not compile:\n{said}");
                    return Err(FaultsError::Seed { name: fault.name.clone(), why });
                }
            }
        }
        Ok(programs)
    }
}
