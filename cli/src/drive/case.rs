//! The cases that a command is driven through, each with an identifier that stays.

use std::fmt::Write as _;
use std::io::BufReader;
use std::path::Path;

use clap::ValueEnum;
use fuseline_testkit::{Generator, Run, VariedGenerator};
use fuseline_traces::corpus::CASES;
use fuseline_traces::{Commit, Header, unpack};
use ring::digest::{Context, SHA256};

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
    /// The number of the corpus's cases that are not driven, because they have another commit rule
    /// or more clouds.
    pub(super) left_out: usize,
    pub(super) generator: Generate,
    /// The number of generated cases. Until it is known, it is the greatest number that there can
    /// be.
    pub(super) generated: u64,
}

/// The place of a case in a suite.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum CasePlace {
    /// Its index among the fixed ones.
    Fixed(usize),
    /// Its number among the generated ones.
    Generated(u64),
}

/// The generator that makes the runs. A seed keeps its runs under each of them.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub(super) enum GeneratorVersion {
    /// Runs of a few hundred nanoseconds, every other one wide: it has more clouds and more inputs.
    #[value(name = "1")]
    First,
    /// Runs at all scales of time, with long chains, full windows and numbers of all widths.
    #[value(name = "2")]
    Second,
}

/// The settings that generated runs share.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Generate {
    pub(super) version: GeneratorVersion,
    pub(super) seed: u64,
    /// The commit rule, if it is to be but one.
    pub(super) commit: Option<Commit>,
    /// The most clouds, if they are not those of each kind.
    pub(super) clouds: Option<u8>,
}

impl GeneratorVersion {
    pub(super) const fn number(self) -> u8 {
        match self {
            Self::First => 1,
            Self::Second => 2,
        }
    }
}

impl Generate {
    /// Returns the greatest number of clouds of a run.
    pub(super) fn most_clouds(self) -> u8 {
        self.clouds.unwrap_or(MOST_CLOUDS)
    }

    /// Returns `true` if a case of the corpus is to be driven.
    fn takes(self, header: &Header) -> bool {
        let is_of_rule = self.commit.is_none_or(|commit| commit == header.commit);
        is_of_rule && header.clouds.len() <= usize::from(self.most_clouds())
    }

    fn run(self, kind: CaseKind, number: u64) -> Run {
        let Self { seed, commit, .. } = self;
        let first = |clouds| Generator { seed, commit, clouds: self.clouds.unwrap_or(clouds) };
        match kind {
            CaseKind::Narrow => first(NARROW_CLOUDS).run(number),
            CaseKind::Wide => first(MOST_CLOUDS).wide(number),
            CaseKind::Varied => {
                VariedGenerator { seed, commit, clouds: self.most_clouds() }.run(number)
            }
        }
    }
}

#[derive(Clone, Copy)]
enum CaseKind {
    Narrow,
    Wide,
    Varied,
}

/// The digest covers at most this many generated cases.
const DIGESTED: u64 = 200;
/// The most clouds of a run of the first generator that is not wide, by default.
const NARROW_CLOUDS: u8 = 4;
/// The most clouds of any other run, by default.
const MOST_CLOUDS: u8 = 15;

impl Suite {
    /// Returns the corpus, and this many generated runs.
    pub(super) fn whole(generator: Generate, generated: u64) -> Result<Self, Fault> {
        let case = |case: &fuseline_traces::corpus::Example| {
            let run = Run::read(case.name, case.trace.as_bytes())?;
            Ok(DriveCase { id: case.name.to_owned(), name: case.name.to_owned(), run })
        };
        let mut fixed = CASES.iter().map(case).collect::<Result<Vec<_>, Fault>>()?;
        fixed.retain(|case| generator.takes(&case.run.header));
        let left_out = CASES.len() - fixed.len();
        Ok(Self { fixed, left_out, generator, generated })
    }

    /// Returns the cases with these names: files, cases of the corpus, generated ones.
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
        Ok(Self { fixed, left_out: 0, generator, generated: 0 })
    }

    /// Returns the name of a generated case.
    pub(super) fn id(&self, number: u64) -> String {
        let seed = self.generator.seed;
        match (self.generator.version, number % 2) {
            (GeneratorVersion::Second, _) => format!("g2-{seed}-{number}"),
            (GeneratorVersion::First, 0) => format!("g-{seed}-{}", number / 2),
            (GeneratorVersion::First, _) => format!("w-{seed}-{}", number / 2),
        }
    }

    /// Returns a generated case: of the first generator every other one is wide.
    pub(super) fn case(&self, number: u64) -> DriveCase {
        let id = self.id(number);
        let run = match (self.generator.version, number % 2) {
            (GeneratorVersion::Second, _) => self.generator.run(CaseKind::Varied, number),
            (GeneratorVersion::First, 0) => self.generator.run(CaseKind::Narrow, number / 2),
            (GeneratorVersion::First, _) => self.generator.run(CaseKind::Wide, number / 2),
        };
        DriveCase { name: id.clone(), id, run }
    }

    /// Returns the case at a place; none if no case is there.
    pub(super) fn at(&self, place: CasePlace) -> Option<DriveCase> {
        match place {
            CasePlace::Fixed(index) => self.fixed.get(index).cloned(),
            CasePlace::Generated(number) => Some(self.case(number)),
        }
    }

    /// Returns a digest of the cases, of the first generated ones too, in hexadecimal.
    pub(super) fn hash(&self) -> String {
        let mut hasher = Context::new(&SHA256);
        let mut feed = |case: &DriveCase| {
            let mut text = case.id.clone().into_bytes();
            text.push(b'\n');
            case.run.write(&mut text);
            hasher.update(&text);
        };
        self.fixed.iter().for_each(&mut feed);
        (0..self.generated.min(DIGESTED)).for_each(|number| feed(&self.case(number)));
        let mut hash = String::new();
        for byte in hasher.finish().as_ref() {
            // Writing to a string does not fail.
            let _ = write!(hash, "{byte:02x}");
        }
        hash
    }
}

/// Returns the kind, the seed and the number in `g2-SEED-NUMBER`, `g-SEED-NUMBER` or
/// `w-SEED-NUMBER`.
fn generated(name: &str) -> Option<(CaseKind, u64, u64)> {
    let (letter, rest) = name.split_once('-')?;
    let kind = match letter {
        "g2" => CaseKind::Varied,
        "g" => CaseKind::Narrow,
        "w" => CaseKind::Wide,
        _ => return None,
    };
    let (seed, number) = rest.split_once('-')?;
    Some((kind, seed.parse().ok()?, number.parse().ok()?))
}

/// Returns a file's name without its folder and what follows the first dot.
fn stem(name: &str) -> String {
    let file = Path::new(name).file_name().unwrap_or_default().to_string_lossy();
    let stem = file.split('.').next().unwrap_or_default();
    if stem.is_empty() { file.into_owned() } else { stem.to_owned() }
}
