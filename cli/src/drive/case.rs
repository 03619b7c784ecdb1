//! The cases that a command is driven through, each with an identifier that stays.

use std::fmt::Write as _;
use std::io::BufReader;
use std::path::Path;

use fuseline_testkit::{Generator, Run};
use fuseline_traces::corpus::CASES;
use fuseline_traces::{Commit, unpack};
use sha2::{Digest, Sha256};

use crate::fault::Fault;
use crate::input::open;

#[derive(Clone, Debug)]
pub(super) struct DriveCase {
    pub(super) id: String,
    /// Its name on a command line.
    pub(super) name: String,
    pub(super) run: Run,
}

/// All cases: the fixed ones are all driven, the generated ones up to the first difference.
pub(super) struct Suite {
    pub(super) fixed: Vec<DriveCase>,
    pub(super) generator: Generate,
    /// How many generated ones there are; with a time instead, as many as were begun in it.
    pub(super) generated: u64,
}

/// What generated runs have in common. Every other one is wide: it has more clouds and more inputs.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Generate {
    pub(super) seed: u64,
    /// The commit rule, if it is to be but one.
    pub(super) commit: Option<Commit>,
    /// The most clouds, if they are not those of each kind.
    pub(super) clouds: Option<u8>,
}

impl Generate {
    /// The most clouds of a run.
    pub(super) fn most_clouds(self) -> u8 {
        self.clouds.unwrap_or(WIDE_CLOUDS)
    }

    fn with(self, clouds: u8) -> Generator {
        let Self { seed, commit, .. } = self;
        Generator { seed, commit, clouds: self.clouds.unwrap_or(clouds) }
    }

    fn run(self, kind: CaseKind, number: u64) -> Run {
        match kind {
            CaseKind::Narrow => self.with(CLOUDS).run(number),
            CaseKind::Wide => self.with(WIDE_CLOUDS).wide(number),
        }
    }
}

#[derive(Clone, Copy)]
enum CaseKind {
    Narrow,
    Wide,
}

/// The most clouds of a generated run that is not wide, by default.
const CLOUDS: u8 = 4;
/// The same of one that is.
const WIDE_CLOUDS: u8 = 15;

impl Suite {
    /// The corpus, and this many generated runs.
    pub(super) fn whole(generator: Generate, generated: u64) -> Result<Self, Fault> {
        let case = |case: &fuseline_traces::corpus::Example| {
            let run = Run::read(case.name, case.trace.as_bytes())?;
            Ok(DriveCase { id: case.name.to_owned(), name: case.name.to_owned(), run })
        };
        let fixed = CASES.iter().map(case).collect::<Result<_, Fault>>()?;
        Ok(Self { fixed, generator, generated })
    }

    /// The cases with these names: files, cases of the corpus, generated ones.
    pub(super) fn of(names: &[String], generator: Generate) -> Result<Self, Fault> {
        let case = |name: &String| -> Result<DriveCase, Fault> {
            let (id, name) = (name.clone(), name.clone());
            if let Some(case) = CASES.iter().find(|case| case.name == name) {
                let run = Run::read(&name, case.trace.as_bytes())?;
                return Ok(DriveCase { id, name, run });
            }
            if let Some((kind, seed, number)) = generated(&name) {
                return Ok(DriveCase {
                    id,
                    name,
                    run: Generate { seed, ..generator }.run(kind, number),
                });
            }
            let (file, text) = open(Path::new(&name))?;
            let text = unpack(BufReader::new(text))
                .map_err(|source| Fault::Open { name: file.clone(), source })?;
            Ok(DriveCase { id: stem(&name), run: Run::read(&file, text)?, name })
        };
        let fixed = names.iter().map(case).collect::<Result<_, _>>()?;
        Ok(Self { fixed, generator, generated: 0 })
    }

    pub(super) fn len(&self) -> u64 {
        (self.fixed.len() as u64).saturating_add(self.generated)
    }

    /// The name of a generated case.
    pub(super) fn id(&self, number: u64) -> String {
        let letter = if number.is_multiple_of(2) { 'g' } else { 'w' };
        format!("{letter}-{}-{}", self.generator.seed, number / 2)
    }

    /// A generated case: every other one is wide.
    pub(super) fn case(&self, number: u64) -> DriveCase {
        let (id, kind) =
            (self.id(number), [CaseKind::Narrow, CaseKind::Wide][usize::from(number % 2 == 1)]);
        DriveCase { name: id.clone(), id, run: self.generator.run(kind, number / 2) }
    }

    /// A digest of the cases, of the generated ones up to a thousand, in hexadecimal.
    pub(super) fn hash(&self) -> String {
        let mut hasher = Sha256::new();
        let mut feed = |case: &DriveCase| {
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

/// The kind, the seed and the number in `g-SEED-NUMBER` or `w-SEED-NUMBER`.
fn generated(name: &str) -> Option<(CaseKind, u64, u64)> {
    let (letter, rest) = name.split_once('-')?;
    let kind = match letter {
        "g" => CaseKind::Narrow,
        "w" => CaseKind::Wide,
        _ => return None,
    };
    let (seed, number) = rest.split_once('-')?;
    Some((kind, seed.parse().ok()?, number.parse().ok()?))
}

/// A file's name without its folder and what follows the first dot.
fn stem(name: &str) -> String {
    let file = Path::new(name).file_name().unwrap_or_default().to_string_lossy();
    let stem = file.split('.').next().unwrap_or_default();
    if stem.is_empty() { file.into_owned() } else { stem.to_owned() }
}
