//! What `--json` prints is as `--json-schema` says, no less and no more.
#![cfg(unix)]

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Stdio;

use crate::common::{err, fuseline, out};
use serde_json::{Map, Value};
use tempfile::tempdir;

const CORPUS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../traces/corpus");
const COMMAND: &str = env!("CARGO_BIN_EXE_fuseline");

/// The keywords that only explain.
const WORDS: [&str; 7] =
    ["$schema", "title", "description", "format", "default", "$defs", "definitions"];

/// Why a value is not as the schema says. A key that the schema does not name is wrong too.
fn differs(root: &Value, schema: &Value, value: &Value) -> Result<(), String> {
    let keywords = match schema {
        Value::Bool(true) => return Ok(()),
        Value::Object(keywords) => keywords,
        _ => return Err(format!("no schema: {schema}")),
    };
    for (keyword, wanted) in keywords.iter().filter(|(word, _)| !WORDS.contains(&word.as_str())) {
        match keyword.as_str() {
            "$ref" => differs(root, referred(root, wanted), value)?,
            "type" => has_type(wanted, value)?,
            "const" if wanted != value => return Err(format!("{value} is not {wanted}")),
            "enum" if !wanted.as_array().unwrap().contains(value) => {
                return Err(format!("{value} is none of {wanted}"));
            }
            // It is about numbers: null may be another type that is allowed.
            "minimum" if value.is_number() && value.as_f64() < wanted.as_f64() => {
                return Err(format!("{value} is below {wanted}"));
            }
            "maximum" if value.as_f64() > wanted.as_f64() => {
                return Err(format!("{value} is above {wanted}"));
            }
            "anyOf" | "oneOf" => {
                let all = wanted.as_array().unwrap().iter();
                let wrong: Vec<String> =
                    all.filter_map(|one| differs(root, one, value).err()).collect();
                if wrong.len() == wanted.as_array().unwrap().len() {
                    return Err(format!("{value}: {}", wrong.join("; ")));
                }
            }
            // It holds, or is looked at below.
            "const"
            | "enum"
            | "minimum"
            | "maximum"
            | "required"
            | "properties"
            | "additionalProperties"
            | "items"
            | "minItems"
            | "maxItems" => {}
            unknown => return Err(format!("the keyword {unknown} is not known here")),
        }
    }
    match value {
        Value::Object(object) => has_properties(root, keywords, object),
        Value::Array(items) => has_items(root, keywords, items),
        _ => Ok(()),
    }
}

fn referred<'a>(root: &'a Value, reference: &Value) -> &'a Value {
    let pointer = reference.as_str().unwrap().strip_prefix('#').unwrap();
    root.pointer(pointer).unwrap_or_else(|| panic!("no {reference}"))
}

fn has_type(wanted: &Value, value: &Value) -> Result<(), String> {
    let is = |word: &Value| match word.as_str().unwrap() {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "string" => value.is_string(),
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        word => panic!("no type {word}"),
    };
    let fits = wanted.as_array().map_or_else(|| is(wanted), |words| words.iter().any(is));
    if fits { Ok(()) } else { Err(format!("{value} is no {wanted}")) }
}

fn has_properties(
    root: &Value,
    schema: &Map<String, Value>,
    object: &Map<String, Value>,
) -> Result<(), String> {
    let Some(properties) = schema.get("properties").and_then(Value::as_object) else {
        let Some(values) = schema.get("additionalProperties") else { return Ok(()) };
        return object.values().try_for_each(|value| differs(root, values, value));
    };
    for name in schema.get("required").and_then(Value::as_array).into_iter().flatten() {
        if !object.contains_key(name.as_str().unwrap()) {
            return Err(format!("no {name}"));
        }
    }
    for (name, value) in object {
        let property =
            properties.get(name).ok_or_else(|| format!("{name} is not in the schema"))?;
        differs(root, property, value).map_err(|why| format!("{name}: {why}"))?;
    }
    Ok(())
}

fn has_items(root: &Value, schema: &Map<String, Value>, items: &[Value]) -> Result<(), String> {
    let bound = |word: &str| schema.get(word).and_then(Value::as_u64);
    let len = items.len() as u64;
    if bound("minItems").is_some_and(|least| len < least)
        || bound("maxItems").is_some_and(|most| len > most)
    {
        return Err(format!("{len} items"));
    }
    let Some(wanted) = schema.get("items") else { return Ok(()) };
    items.iter().try_for_each(|item| differs(root, wanted, item))
}

/// The schema of a command's output.
fn schema(command: &[&str]) -> Value {
    let printed = fuseline(&[command, &["--json-schema"]].concat()).output().unwrap();
    assert_eq!(printed.status.code(), Some(0), "{command:?}: {}", err(&printed));
    serde_json::from_str(out(&printed)).unwrap()
}

/// Holds each line that the command prints against its schema.
fn conforms(directory: &Path, command: &[&str], args: &[&str]) -> Vec<Value> {
    let schema = schema(command);
    let printed = fuseline(&[command, args].concat()).current_dir(directory).output().unwrap();
    assert!(!printed.stdout.is_empty(), "{command:?} {args:?}: {}", err(&printed));
    let lines: Vec<Value> =
        out(&printed).lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    for line in &lines {
        if let Err(why) = differs(&schema, &schema, line) {
            panic!("{command:?} {args:?}: {why}\n{line}");
        }
        no_key_may_be_missing(&schema, line);
    }
    lines
}

/// The schema has teeth: without a key, or with another one, the same line is refused.
fn no_key_may_be_missing(schema: &Value, line: &Value) {
    let keys = schema.get("required").and_then(Value::as_array);
    for key in keys.into_iter().flatten().map(|key| key.as_str().unwrap()) {
        let mut less = line.clone();
        less.as_object_mut().unwrap().remove(key);
        assert!(differs(schema, schema, &less).is_err(), "without {key}");
    }
    let mut more = line.clone();
    more.as_object_mut().unwrap().insert("unheard of".into(), Value::Null);
    assert!(differs(schema, schema, &more).is_err());
}

#[test]
fn verdicts_are_as_their_schema_says() {
    let dir = tempdir().unwrap();
    let folders = [CORPUS.to_owned(), format!("{CORPUS}/bad")];
    let all: Vec<String> = folders
        .iter()
        .flat_map(|folder| fs::read_dir(folder).unwrap())
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "jsonl"))
        .map(|path| path.display().to_string())
        .collect();
    let files: Vec<&str> = all.iter().map(String::as_str).collect();
    let strict = conforms(dir.path(), &["check"], &[&["--json"], &files[..]].concat());
    assert!(strict.iter().any(|line| line["conforms"] == false), "no violation is held");
    let observed = ["--json", "--observed", "--tolerance", "0ns", "--lateness", "0ns", "--ended"];
    let observed = conforms(dir.path(), &["check"], &[&observed, &files[..]].concat());
    assert!(observed.iter().any(|line| line["violations"][0]["late"].is_u64()), "none is late");
}

#[test]
fn runs_are_as_their_schema_says() {
    let dir = tempdir().unwrap();
    let run = ["--json", "--seconds", "0.5", "--rate", "20"];
    conforms(dir.path(), &["run"], &run);
    // Bounds, a server that is not there, and models of which no AP is known.
    let cloud = "name=a,priority=1,url=http://127.0.0.1:1";
    let lost = ["--cloud", cloud, "--local", "DINO-SWIN-Large@a100"];
    conforms(dir.path(), &["run"], &[&run[..], &lost, &["--policy", "constant"]].concat());
}

#[test]
fn deadlines_are_as_their_schema_says() {
    let dir = tempdir().unwrap();
    let lines = conforms(dir.path(), &["deadline"], &["--speed", "11,18,20,22,24", "--json"]);
    assert_eq!(lines.len(), 5);
}

#[test]
fn scenarios_are_as_their_schemas_say() {
    let dir = tempdir().unwrap();
    for (scenario, args) in [
        ("traffic-jam", &["--speed", "22", "--rate", "2"][..]),
        ("traffic-jam", &["--cells-only", "--speed", "23"]),
        ("red-light", &["--variant", "skewed"]),
        ("jaywalking", &["--speed", "9,30"]),
        ("networks", &["--drive", "cicv5g/rural_n8_v10", "--speed", "22", "--starts", "4"]),
        ("arbitrage", &["--drive", "cicv5g/rural_n8_v10"]),
        ("link", &["--request-kb", "300", "--rate", "10", "--uplink", "10", "--seconds", "3"]),
    ] {
        let command = ["scenario", scenario];
        let lines = conforms(dir.path(), &command, &[&["--json"], args].concat());
        assert_eq!(lines[0]["scenario"], scenario);
    }
}

#[test]
fn drives_are_as_their_schema_says() {
    let dir = tempdir().unwrap();
    let mistakes = concat!(env!("CARGO_MANIFEST_DIR"), "/../traces/examples/mistakes.py");
    let drive = ["--json", "--wait", "120", "--cases", "3", "--save", "found", "--force", "--"];
    conforms(dir.path(), &["drive"], &[&drive[..], &[COMMAND, "impl"]].concat());
    let faulty = ["python3", mistakes, "--mistake", "first-response-wins"];
    let found = conforms(dir.path(), &["drive"], &[&drive[..], &faulty].concat());
    assert!(found[0]["found"][0]["violation"].is_object(), "{}", found[0]);
    let stray = ["sh", "-c", "read -r line; echo stray"];
    let dead = conforms(dir.path(), &["drive"], &[&drive[..], &stray].concat());
    assert!(dead[0]["found"][0]["misbehaviour"].is_string(), "{}", dead[0]);
}

#[test]
fn probes_are_as_their_schema_says() {
    let dir = tempdir().unwrap();
    let serve = ["probe", "--serve", "--listen", "127.0.0.1:0"];
    let mut server = fuseline(&serve).stdout(Stdio::piped()).spawn().unwrap();
    let mut printed = String::new();
    BufReader::new(server.stdout.take().unwrap()).read_line(&mut printed).unwrap();
    let url = printed.trim().rsplit(' ').next().unwrap();
    conforms(dir.path(), &["probe"], &["--json", "--seconds", "0.3", "-o", "plots", url]);
    server.kill().unwrap();
    server.wait().unwrap();
}
