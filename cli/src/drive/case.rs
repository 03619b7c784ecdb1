//! The cases that a command is driven through, each with an identifier that stays.

use std::fmt::Write as _;
use std::io::BufReader;
use std::path::Path;

use fuseline_testkit::{Generator, Run};
use fuseline_traces::corpus::CASES;
use fuseline_traces::unpack;
use sha2::{Digest, Sha256};

use crate::fault::Fault;
use crate::input::open;

/// A run with its name.
#[derive(Clone, Debug)]
pub(super) struct Case {
    pub(super) id: String,
    /// Its name on a command line.
    pub(super) name: String,
    pub(super) run: Run,
}

/// All cases: the fixed ones are all driven, the generated ones up to the first difference.
pub(super) struct Suite {
    pub(super) fixed: Vec<Case>,
    pub(super) generator: Generator,
    pub(super) generated: u64,
}

impl Suite {
    /// The corpus, and this many generated runs.
    pub(super) fn whole(generator: Generator, generated: u64) -> Result<Self, Fault> {
        let case = |case: &fuseline_traces::corpus::Example| {
            let run = Run::read(case.name, case.trace.as_bytes())?;
            Ok(Case { id: case.name.to_owned(), name: case.name.to_owned(), run })
        };
        let fixed = CASES.iter().map(case).collect::<Result<_, Fault>>()?;
        Ok(Self { fixed, generator, generated })
    }

    /// The cases with these names: files, cases of the corpus, generated ones.
    pub(super) fn of(names: &[String], generator: Generator) -> Result<Self, Fault> {
        let case = |name: &String| -> Result<Case, Fault> {
            let (id, name) = (name.clone(), name.clone());
            if let Some(case) = CASES.iter().find(|case| case.name == name) {
                let run = Run::read(&name, case.trace.as_bytes())?;
                return Ok(Case { id, name, run });
            }
            if let Some((seed, number)) = generated(&name) {
                return Ok(Case { id, name, run: Generator { seed, ..generator }.run(number) });
            }
            let (file, text) = open(Path::new(&name))?;
            let text = unpack(BufReader::new(text))
                .map_err(|source| Fault::Open { name: file.clone(), source })?;
            Ok(Case { id: stem(&name), run: Run::read(&file, text)?, name })
        };
        let fixed = names.iter().map(case).collect::<Result<_, _>>()?;
        Ok(Self { fixed, generator, generated: 0 })
    }

    /// How many cases there are.
    pub(super) fn len(&self) -> u64 {
        self.fixed.len() as u64 + self.generated
    }

    /// A generated case.
    pub(super) fn case(&self, number: u64) -> Case {
        let id = format!("g-{}-{number}", self.generator.seed);
        Case { name: id.clone(), id, run: self.generator.run(number) }
    }

    /// A digest of the cases, of the generated ones up to a thousand, in hexadecimal.
    pub(super) fn hash(&self) -> String {
        let mut hasher = Sha256::new();
        let mut feed = |case: &Case| {
            let mut text = case.id.clone().into_bytes();
            text.push(b'\n');
            case.run.write(&mut text);
            hasher.update(&text);
        };
        self.fixed.iter().for_each(&mut feed);
        (0..self.generated.min(1000)).for_each(|number| feed(&self.case(number)));
        let mut hash = String::new();
        for byte in hasher.finalize() {
            // Writing to a string does not fail.
            let _ = write!(hash, "{byte:02x}");
        }
        hash
    }
}

/// The seed and the number in `g-SEED-NUMBER`.
fn generated(name: &str) -> Option<(u64, u64)> {
    let (seed, number) = name.strip_prefix("g-")?.split_once('-')?;
    Some((seed.parse().ok()?, number.parse().ok()?))
}

/// A file's name without its folder and what follows the first dot.
fn stem(name: &str) -> String {
    let file = Path::new(name).file_name().unwrap_or_default().to_string_lossy();
    let stem = file.split('.').next().unwrap_or_default();
    if stem.is_empty() { file.into_owned() } else { stem.to_owned() }
}
