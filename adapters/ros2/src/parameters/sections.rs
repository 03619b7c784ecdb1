//! A parameter file's sections: nodes' names, and what is given below them.

use std::path::Path;

use crate::names::{NodeName, check_token};
use crate::parameters::value::{self, Flawed, Value};
use crate::parameters::yaml::{self, Content, Entry, Mark, Node, YamlError};
use crate::parameters::{Flaw, Given, ParameterError, Place};

/// What holds a node's parameters.
const PARAMETERS: &str = "ros__parameters";

/// What a file gives to a node, in order.
pub(super) fn given(
    path: &Path,
    text: &str,
    node: &NodeName,
) -> Result<Vec<Given>, ParameterError> {
    let place = |(line, column)| Place::File(path.to_owned(), line, column);
    let fault = |(mark, flaw)| ParameterError::Flaw { place: place(mark), flaw };
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
        let is_shared = specificity(pattern) < 2;
        let mut flat = Vec::new();
        flatten("", parameters, &mut flat).map_err(fault)?;
        all.extend(flat.into_iter().map(|(name, mark, value)| Given {
            name,
            value,
            place: place(mark),
            is_shared,
        }));
    }
    Ok(all)
}

/// The parts of a node's name, with wildcards, and what is given to it.
type Section<'a> = (Vec<&'a str>, &'a [Entry]);

/// Finds what holds parameters; the keys on the way there make the node's name.
fn walk<'a>(above: &[&'a str], node: &'a Node, sections: &mut Vec<Section<'a>>) -> Flawed<()> {
    let Content::Mapping(entries) = &node.content else { return Err((node.mark, Flaw::Node)) };
    for Entry { mark, key, value } in entries {
        if key != PARAMETERS {
            let mut pattern = above.to_owned();
            for part in key.strip_prefix('/').unwrap_or(key).split('/') {
                if part != "*" && part != "**" {
                    let flaw = |source| (*mark, Flaw::Pattern { name: key.clone(), source });
                    check_token(part).map_err(flaw)?;
                }
                // One is as good as several, and soon matched.
                if part != "**" || pattern.last() != Some(&"**") {
                    pattern.push(part);
                }
            }
            walk(&pattern, value, sections)?;
        } else if above.is_empty() {
            return Err((*mark, Flaw::Node));
        } else {
            match &value.content {
                Content::Mapping(parameters) => sections.push((above.to_owned(), parameters)),
                // All of them may be commented out.
                Content::Scalar { text, is_plain: true } if text.is_empty() => {}
                Content::Scalar { .. } | Content::List(_) => {
                    return Err((value.mark, Flaw::Parameters));
                }
            }
        }
    }
    Ok(())
}

/// Whether `*` as one part and `**` as any number of them make the pattern the name.
fn matches(pattern: &[&str], name: &[&str]) -> bool {
    match (pattern.split_first(), name.split_first()) {
        (None, None) => true,
        (Some((&"**", rest)), _) => (0..=name.len()).any(|skip| matches(rest, &name[skip..])),
        (Some((part, rest)), Some((first, others))) => {
            (*part == "*" || part == first) && matches(rest, others)
        }
        (None, Some(_)) | (Some(_), None) => false,
    }
}

/// 0 for all nodes, 1 for some, 2 for one.
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
fn flatten(above: &str, entries: &[Entry], flat: &mut Vec<(String, Mark, Value)>) -> Flawed<()> {
    for Entry { mark, key, value } in entries {
        let name = if above.is_empty() { key.clone() } else { format!("{above}.{key}") };
        match &value.content {
            Content::Mapping(entries) => flatten(&name, entries, flat)?,
            Content::Scalar { .. } | Content::List(_) => {
                let value = value::read(&name, value)?;
                if flat.iter().any(|(other, ..)| *other == name) {
                    return Err((*mark, YamlError::Twice(name).into()));
                }
                flat.push((name, *mark, value));
            }
        }
    }
    Ok(())
}
