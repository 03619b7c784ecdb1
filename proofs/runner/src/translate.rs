//! Translates a harness to C for the checker.
//!
//! rustc compiles it to wasm32, wasm2c translates that to C, and the memory of `proofs/engine` replaces
//! wasm2c's.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use regex::Regex;

use crate::error::Error;
use crate::source::Harness;
use crate::tools::Tools;

/// The size of a harness's stack. The smaller it is, the cheaper is each access at an address that is not
/// constant.
const STACK_BYTES: u32 = 4096;

/// The sources that are copied into the root.
pub(crate) const SOURCES: [&str; 5] =
    ["core/src", "proofs/src", "proofs/macros/src", "proofs/kani/src", "proofs/engine"];

/// Flags that make LLVM produce one function with as many constants as possible, and with every overflow
/// checked.
const FLAGS: &[&str] = &[
    "--edition=2024",
    "--target=wasm32-unknown-unknown",
    "-Cpanic=abort",
    "-Copt-level=3",
    "-Cdebug-assertions=on",
    "-Coverflow-checks=on",
    "-Ctarget-feature=+bulk-memory",
    "-Awarnings",
];

/// A copy of the sources inside the root, with the stand-in built.
pub(crate) struct Copy<'a> {
    tools: &'a Tools,
    folder: PathBuf,
}

/// A harness for the checker, in a file `main.gb`.
pub(crate) struct Generated {
    folder: PathBuf,
    /// The data segment, which contains texts.
    data: Vec<u8>,
}

impl<'a> Copy<'a> {
    /// Copies the sources of `tree` and builds the stand-in.
    ///
    /// # Errors
    /// Returns an error if a file cannot be copied or the stand-in does not build.
    pub(crate) fn new(tools: &'a Tools, tree: &Path) -> Result<Self, Error> {
        let folder = tools.work().join("sound");
        for source in SOURCES {
            copy(&tree.join(source), &folder.join(source))?;
        }
        let own = Self { tools, folder };
        own.macros()?;
        let stand_in = [
            "--crate-type=rlib",
            "--crate-name=fuseline_kani",
            "-Cembed-bitcode=yes",
            "--extern=fuseline_proof_macros=libfuseline_proof_macros.so",
            "-olibfuseline_kani.rlib",
            "proofs/kani/src/lib.rs",
        ];
        let arguments = FLAGS.iter().chain(&stand_in).map(|word| (*word).to_owned());
        own.tools.must(&own.folder, "rustc", "the stand-in", &arguments.collect::<Vec<_>>())?;
        Ok(own)
    }

    /// Builds the crate of macros.
    fn macros(&self) -> Result<(), Error> {
        let arguments = [
            "--edition=2024",
            "--crate-type=proc-macro",
            "--crate-name=fuseline_proof_macros",
            "--extern=proc_macro",
            "-olibfuseline_proof_macros.so",
            "proofs/macros/src/lib.rs",
        ];
        self.tools.must(&self.folder, "rustc", "the macros", &arguments.map(str::to_owned))
    }

    /// Returns a copy with one file replaced.
    ///
    /// # Errors
    /// Returns an error if a file cannot be written.
    pub(crate) fn with(&self, name: &str, file: &str, text: &str) -> Result<Self, Error> {
        let folder = self.tools.work().join(name);
        copy(&self.folder, &folder)?;
        let path = folder.join(file);
        fs::write(&path, text).map_err(Error::file(&path))?;
        Ok(Self { tools: self.tools, folder })
    }

    /// Removes the copy.
    pub(crate) fn remove(self) {
        let _ = fs::remove_dir_all(&self.folder);
    }

    /// Translates one harness for the checker, or returns the reason why that is not possible. If the harness
    /// has cases, one case is fixed as a constant.
    ///
    /// # Errors
    /// Returns an error if it does not build.
    pub(crate) fn generate(
        &self,
        harness: &Harness,
        case: Option<u32>,
    ) -> Result<Result<Generated, String>, Error> {
        let job = case.map_or(harness.name.clone(), |case| format!("{}.{case}", harness.name));
        let folder = self.folder.join("jobs").join(&job);
        fs::create_dir_all(&folder).map_err(Error::file(&folder))?;
        let own = |name: &str| format!("jobs/{job}/{name}");
        let mut arguments: Vec<String> = match case {
            Some(case) => vec![format!("FUSELINE_CASE={case}"), "rustc".to_owned()],
            None => vec!["rustc".to_owned()],
        };
        arguments.extend(FLAGS.iter().map(|word| (*word).to_owned()));
        arguments.extend([
            format!("--cfg=harness=\"{}\"", harness.name),
            "--crate-type=cdylib".to_owned(),
            "--crate-name=fuseline_proofs".to_owned(),
            "-Clto=fat".to_owned(),
            "-Ccodegen-units=1".to_owned(),
            "-Clinker=wasm-ld".to_owned(),
            format!("-Clink-arg=-zstack-size={STACK_BYTES}"),
            "-Clink-arg=--stack-first".to_owned(),
            // Calls and loops would hide which addresses are constants.
            "-Cllvm-args=-inline-threshold=10000".to_owned(),
            "-Cllvm-args=-unroll-threshold=2000".to_owned(),
            "--extern=kani=libfuseline_kani.rlib".to_owned(),
            "--extern=fuseline_proof_macros=libfuseline_proof_macros.so".to_owned(),
            "-L.".to_owned(),
            format!("-o{}", own("proofs.wasm")),
            "proofs/src/lib.rs".to_owned(),
        ]);
        let what = harness.name.as_str();
        self.tools.must(&self.folder, "env", what, &arguments)?;
        let words =
            |words: &[&str]| words.iter().map(|word| (*word).to_owned()).collect::<Vec<_>>();
        self.tools.must(&folder, "wasm-strip", what, &words(&["proofs.wasm"]))?;
        let names = ["proofs.wasm", "-n", "proofs", "-o", "proofs.c"];
        self.tools.must(&folder, "wasm2c", what, &words(&names))?;
        let path = folder.join("proofs.c");
        let text = fs::read_to_string(&path).map_err(Error::file(&path))?;
        let (text, data) = match with_memory(&text) {
            Ok(generated) => generated,
            Err(why) => return Ok(Err(why)),
        };
        let path = folder.join("generated.c");
        fs::write(&path, text).map_err(Error::file(&path))?;
        let covers =
            harness.covers.iter().fold(String::new(), |list, line| format!("{list}COVER({line}) "));
        let arguments = words(&[
            "-I.",
            "-I../../proofs/engine",
            "-DGENERATED=\"generated.c\"",
            &format!("-DCOVERS={covers}"),
            "../../proofs/engine/checker.c",
            "-omain.gb",
        ]);
        self.tools.must(&folder, "goto-cc", what, &arguments)?;
        Ok(Ok(Generated { folder, data }))
    }
}

impl Generated {
    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns the text at an address.
    pub(crate) fn text(&self, at: u64, len: u64) -> Option<String> {
        let from = usize::try_from(at.checked_sub(u64::from(STACK_BYTES))?).ok()?;
        let bytes = self.data.get(from..from.checked_add(usize::try_from(len).ok()?)?)?;
        String::from_utf8(bytes.to_vec()).ok()
    }
}

/// Returns wasm2c's C with the checker's memory, and the data segment.
fn with_memory(text: &str) -> Result<(String, Vec<u8>), String> {
    let stack_low = STACK_BYTES.checked_sub(frames(text)?).ok_or("the frames need more stack")?;
    let cut = |text: &str, from: &str, to: &str, by: &str| {
        let start = text.find(from).ok_or_else(|| format!("no {from}"))?;
        let end = text[start..].find(to).ok_or_else(|| format!("no {to}"))? + start;
        Ok::<_, String>(format!("{}{by}{}", &text[..start], &text[end..]))
    };
    let segment = Regex::new(
        r"LOAD_DATA\(instance->w2c_memory, (\d+)u, data_segment_data_w2c_proofs_d0, (\d+)\)",
    );
    let bytes = Regex::new(r"(?s)data_segment_data_w2c_proofs_d0\[\] = \{(.*?)\};");
    let (segment, bytes) = (segment.map_err(|e| e.to_string())?, bytes.map_err(|e| e.to_string())?);
    if text.matches("LOAD_DATA(instance").count() > 1 {
        return Err("there is more than one data segment".to_owned());
    }
    let mut data = Vec::new();
    if let Some(found) = segment.captures(text) {
        if found[1] != STACK_BYTES.to_string() {
            return Err(format!("the data segment is at {}", &found[1]));
        }
        let bytes = bytes.captures(text).ok_or("no bytes of the data segment")?;
        for byte in bytes[1].split(',').map(str::trim).filter(|byte| !byte.is_empty()) {
            let digits = byte.trim_start_matches("0x");
            data.push(u8::from_str_radix(digits, 16).map_err(|error| error.to_string())?);
        }
    }
    let mut memory = format!("#define STACK_BYTES {STACK_BYTES}\n#define STACK_LOW {stack_low}\n");
    let _ = writeln!(memory, "#define DATA_BYTES {}", data.len());
    memory.push_str("#define DATA_INIT { ");
    for byte in &data {
        let _ = write!(memory, "{byte}, ");
    }
    memory.push_str("0 }\n#include \"memory.h\"\n");
    let text = cut(text, "static inline void memory_fill(", "static inline void memory_init(", "")?;
    let start = text.find("DEFINE_LOAD(i32_load,").ok_or("no accessors")?;
    let end = text.find("DEFINE_STORE(i64_store32").ok_or("no accessors")?;
    let end = text[end..].find('\n').ok_or("no end of the accessors")? + end + 1;
    Ok((cleared(&format!("{}{memory}{}", &text[..start], &text[end..]))?, data))
}

/// The code with which a function takes a frame.
const FRAME: &str = r"= instance->w2c_g0;\s+var_i1 = (\d+)u;\s+var_i0 -= var_i1;";

/// Fills each frame with zeros when it is taken. Nothing reads the old contents; but bytes between fields,
/// which nothing writes, would hide that the word around them is constant.
fn cleared(text: &str) -> Result<String, String> {
    let frame = Regex::new(FRAME).map_err(|error| error.to_string())?;
    let fill = "$0\n  memory_fill(&instance->w2c_memory, var_i0, 0, var_i1);";
    Ok(frame.replace_all(text, fill).into_owned())
}

/// Returns the greatest number of bytes of stack that the harness and its callees can take, each function at
/// most once; beyond that they are trapped. Returns an error if one of them calls through a pointer. Such
/// calls write the texts of panics, but nothing writes those here.
fn frames(text: &str) -> Result<u32, String> {
    let head = Regex::new(r"(?m)^\w+ (w2c_proofs_\w+)\(w2c_proofs\* instance[^;{]*\) \{$");
    let call = Regex::new(r"\b(w2c_proofs_\w+)\(instance");
    let frame = Regex::new(FRAME);
    let (head, call) = (head.map_err(|e| e.to_string())?, call.map_err(|e| e.to_string())?);
    let frame = frame.map_err(|e| e.to_string())?;
    let mut bodies = BTreeMap::new();
    for found in head.captures_iter(text) {
        let body = &text[found.get(0).map_or(0, |head| head.end())..];
        bodies.insert(found[1].to_owned(), &body[..body.find("\n}").unwrap_or(body.len())]);
    }
    let mut reached = BTreeSet::new();
    let mut next = vec!["w2c_proofs_harness_0".to_owned()];
    let mut bytes: u32 = 0;
    while let Some(name) = next.pop() {
        if reached.contains(&name) {
            continue;
        }
        let body = bodies.get(&name).ok_or_else(|| format!("no function {name}"))?;
        if body.contains("CALL_INDIRECT(") {
            return Err("there is an indirect call in what is proved".to_owned());
        }
        for found in frame.captures_iter(body) {
            let own: u32 = found[1].parse().map_err(|_| "a frame that is no number")?;
            bytes = bytes.saturating_add(own.next_multiple_of(16));
        }
        next.extend(call.captures_iter(body).map(|found| found[1].to_owned()));
        reached.insert(name);
    }
    Ok(bytes)
}

/// Copies files and folders, except build output.
fn copy(from: &Path, to: &Path) -> Result<(), Error> {
    fs::create_dir_all(to).map_err(Error::file(to))?;
    for entry in fs::read_dir(from).map_err(Error::file(from))? {
        let entry = entry.map_err(Error::file(from))?;
        let (path, name) = (entry.path(), entry.file_name());
        if path.is_dir() {
            if name != "jobs" {
                copy(&path, &to.join(name))?;
            }
        } else {
            fs::copy(&path, to.join(name)).map_err(Error::file(&path))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const C: &str = "static void w2c_proofs_harness_0(w2c_proofs*);\n\
        void w2c_proofs_harness_0(w2c_proofs* instance) {\n  w2c_proofs_f3(instance, var_i0);\n}\n\n\
        u32 w2c_proofs_f3(w2c_proofs* instance, u32 var_p0) {\n  var_i0 = instance->w2c_g0;\n  \
        var_i1 = 24u;\n  var_i0 -= var_i1;\n  var_i0 = 1u;\n}\n\n\
        void w2c_proofs_f4(w2c_proofs* instance) {\n  CALL_INDIRECT(instance->w2c_T0);\n}\n";

    #[test]
    fn indirect_call_counts_where_the_harness_gets() {
        assert!(frames(C).is_ok());
        assert!(frames(&C.replace("var_i0 = 1u", "w2c_proofs_f4(instance)")).is_err());
        assert!(frames("").is_err());
    }

    #[test]
    fn frame_is_cleared_when_it_is_taken() {
        let clear = "var_i0 -= var_i1;\n  memory_fill(&instance->w2c_memory, var_i0, 0, var_i1);";
        assert_eq!(cleared(C), Ok(C.replace("var_i0 -= var_i1;", clear)));
    }

    #[test]
    fn frames_of_what_is_called_are_counted_in_whole_slots() {
        assert_eq!(frames(C), Ok(32));
    }
}
