//! A parameter file's sections: nodes' names, and the parameters below them.

use std::collections::BTreeMap;
use std::path::Path;

use crate::names::{NodeName, check_token};
use crate::parameters::value::{self, FlawResult, Value};
use crate::parameters::yaml::{self, Content, Node, Position, YamlEntry, YamlError};
use crate::parameters::{ParameterError, ParameterFlaw, ParameterOverride, ValueOrigin};

/// The key above a node's parameters.
const PARAMETERS: &str = "ros__parameters";

/// Returns the parameters that a file gives to a node, in order.
pub(super) fn overrides(
    path: &Path,
    text: &str,
    node: &NodeName,
) -> Result<Vec<ParameterOverride>, ParameterError> {
    let origin = |(line, column)| ValueOrigin::File(path.to_owned(), line, column);
    let fault = |(mark, flaw)| ParameterError::ParameterFlaw { origin: origin(mark), flaw };
    let root = yaml::read(text).map_err(|(mark, error)| fault((mark, error.into())))?;
    let mut sections = Vec::new();
    if let Some(root) = &root {
        walk(&[], root, &mut sections).map_err(fault)?;
    }
    let full = node.full();
    let parts: Vec<&str> = full[1..].split('/').collect();
    sections.retain(|(pattern, _)| matches(pattern, &parts));
    sections.sort_by_key(|(pattern, _)| specificity(pattern));
    let mut all = Vec::new();
    for (pattern, parameters) in &sections {
        let is_shared = pattern.last().is_some_and(|part| part.starts_with('*'));
        let mut flat = BTreeMap::new();
        flatten("", parameters, &mut flat).map_err(fault)?;
        all.extend(flat.into_iter().map(|(name, (mark, value))| ParameterOverride {
            name,
            value,
            origin: origin(mark),
            is_shared,
        }));
    }
    Ok(all)
}

/// The parts of a node's name, with wildcards, and its parameters.
type Section<'a> = (Vec<&'a str>, &'a [YamlEntry]);

/// Values and the origins of their names, by dotted name.
type Flat = BTreeMap<String, (Position, Value)>;

/// Finds the keys above parameters; the keys on the way there make up the node's name.
fn walk<'a>(above: &[&'a str], node: &'a Node, sections: &mut Vec<Section<'a>>) -> FlawResult<()> {
    let Content::Mapping(entries) = &node.content else {
        return Err((node.mark, ParameterFlaw::Node));
    };
    for YamlEntry { mark, key, value } in entries {
        if key != PARAMETERS {
            let mut pattern = above.to_owned();
            for part in key.strip_prefix('/').unwrap_or(key).split('/') {
                if part != "*" && part != "**" {
                    let flaw =
                        |source| (*mark, ParameterFlaw::Pattern { name: key.clone(), source });
                    check_token(part).map_err(flaw)?;
                }
                pattern.push(part);
            }
            walk(&pattern, value, sections)?;
        } else if above.is_empty() {
            return Err((*mark, ParameterFlaw::Node));
        } else {
            match &value.content {
                Content::Mapping(parameters) => sections.push((above.to_owned(), parameters)),
                // All parameters may be commented out.
                Content::Scalar { text, is_plain: true } if text.is_empty() => {}
                Content::Scalar { .. } | Content::List(_) => {
                    return Err((value.mark, ParameterFlaw::Parameters));
                }
            }
        }
    }
    Ok(())
}

/// Returns `true` if the pattern matches the name: `*` stands for one part and `**` for any number
/// of parts.
fn matches(pattern: &[&str], name: &[&str]) -> bool {
    let (mut part, mut at) = (0, 0);
    // The last ** and where the name goes on after it; earlier ones need no second try.
    let mut wild = None;
    while let Some(&next) = name.get(at) {
        match (pattern.get(part), wild) {
            (Some(&"**"), _) => {
                part += 1;
                wild = Some((part, at));
            }
            (Some(&expected), _) if expected == "*" || expected == next => {
                (part, at) = (part + 1, at + 1);
            }
            (_, Some((after, from))) => {
                (part, at) = (after, from + 1);
                wild = Some((after, at));
            }
            (_, None) => return false,
        }
    }
    pattern[part..].iter().all(|part| *part == "**")
}

/// Returns 0 for a pattern of all nodes, 1 for some nodes, 2 for one.
fn specificity(pattern: &[&str]) -> u8 {
    if pattern.iter().all(|part| *part == "**") {
        0
    } else if pattern.iter().any(|part| part.starts_with('*')) {
        1
    } else {
        2
    }
}

/// Joins the names of nested parameters with dots.
fn flatten(above: &str, entries: &[YamlEntry], flat: &mut Flat) -> FlawResult<()> {
    for YamlEntry { mark, key, value } in entries {
        let name = if above.is_empty() { key.clone() } else { format!("{above}.{key}") };
        match &value.content {
            Content::Mapping(entries) => flatten(&name, entries, flat)?,
            Content::Scalar { .. } | Content::List(_) => {
                let value = value::read(&name, value)?;
                if flat.insert(name.clone(), (*mark, value)).is_some() {
                    return Err((*mark, YamlError::Twice(name).into()));
                }
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn wildcards_stand_for_one_part_or_any_number() {
        let matches = |pattern: &str, name: &str| {
            let split = |text: &'static str| text.split('/').collect::<Vec<_>>();
            matches(&split(pattern.to_owned().leak()), &split(name.to_owned().leak()))
        };
        for pattern in ["**", "a/b/c", "*/b/*", "a/**", "**/c", "**/b/**", "a/**/b/**/c/**"] {
            assert!(matches(pattern, "a/b/c"), "{pattern}");
        }
        for pattern in ["*", "a/b", "a/*", "**/b", "b/**", "a/b/c/*", "**/c/**/b"] {
            assert!(!matches(pattern, "a/b/c"), "{pattern}");
        }
        assert!(matches("**/a/b", "a/a/b/a/b"));
        assert!(!matches(&"**/*/".repeat(1000), &"a/".repeat(900)));
    }

    #[test]
    fn parameters_for_nodes_of_this_name_are_not_shared() {
        let node = NodeName::new("/car", "front").unwrap();
        let shared = |name: &str| {
            let text = format!("{name}: {{ros__parameters: {{a: 1}}}}");
            overrides(Path::new("a"), &text, &node).unwrap()[0].is_shared
        };
        assert!(shared("/**") && shared("/car/*"));
        assert!(!shared("/**/front") && !shared("/car/front"));
    }

    proptest! {
        #[test]
        fn any_text_gives_parameters_or_an_error(
            above in "/[*]{1,2}|n",
            parameters in "([ab.]{1,3}: [a1'. \\[\\]{}]{0,5}, ){0,5}",
        ) {
            let node = NodeName::new("/", "n").unwrap();
            let text = format!("{above}: {{ros__parameters: {{{parameters}}}}}");
            drop(overrides(Path::new("a"), &text, &node));
        }
    }
}
