//! The cases that a command is driven through, each with an identifier that stays.

use std::fmt::Write as _;
use std::io::BufReader;
use std::path::Path;

use fuseline_testkit::{Run, VariedGenerator};
use fuseline_traces::corpus::CASES;
use fuseline_traces::unpack;
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
    /// The settings that generated runs share.
    pub(super) generator: VariedGenerator,
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

/// The digest covers at most this many generated cases.
const DIGESTED: u64 = 200;
/// The most clouds of a generated run, by default.
pub(super) const MOST_CLOUDS: u8 = 15;
/// The version of the generator, which never makes another run of a seed and number.
pub(super) const GENERATOR: u8 = 2;

impl Suite {
    /// Returns the corpus, and this many generated runs.
    pub(super) fn whole(generator: VariedGenerator, generated: u64) -> Result<Self, Fault> {
        let case = |case: &fuseline_traces::corpus::Example| {
            let run = Run::read(case.name, case.trace.as_bytes())?;
            Ok(DriveCase { id: case.name.to_owned(), name: case.name.to_owned(), run })
        };
        let mut fixed = CASES.iter().map(case).collect::<Result<Vec<_>, Fault>>()?;
        fixed.retain(|DriveCase { run: Run { header, .. }, .. }| {
            let is_of_rule = generator.commit.is_none_or(|commit| commit == header.commit);
            is_of_rule && header.clouds.len() <= usize::from(generator.clouds)
        });
        let left_out = CASES.len() - fixed.len();
        Ok(Self { fixed, left_out, generator, generated })
    }

    /// Returns the cases with these names: files, cases of the corpus, generated ones.
    pub(super) fn of(names: &[String], generator: VariedGenerator) -> Result<Self, Fault> {
        let case = |name: &String| -> Result<DriveCase, Fault> {
            let (id, name) = (name.clone(), name.clone());
            if let Some(case) = CASES.iter().find(|case| case.name == name) {
                let run = Run::read(&name, case.trace.as_bytes())?;
                return Ok(DriveCase { id, name, run });
            }
            if let Some((seed, number)) = generated(&name) {
                let run = VariedGenerator { seed, ..generator }.run(number);
                return Ok(DriveCase { id, name, run });
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
        format!("g{GENERATOR}-{}-{number}", self.generator.seed)
    }

    /// Returns a generated case.
    pub(super) fn case(&self, number: u64) -> DriveCase {
        let (id, run) = (self.id(number), self.generator.run(number));
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

/// Returns the seed and the number in `g2-SEED-NUMBER`.
fn generated(name: &str) -> Option<(u64, u64)> {
    let (seed, number) = name.strip_prefix(&format!("g{GENERATOR}-"))?.split_once('-')?;
    Some((seed.parse().ok()?, number.parse().ok()?))
}

/// Returns a file's name without its folder and what follows the first dot.
fn stem(name: &str) -> String {
    let file = Path::new(name).file_name().unwrap_or_default().to_string_lossy();
    let stem = file.split('.').next().unwrap_or_default();
    if stem.is_empty() { file.into_owned() } else { stem.to_owned() }
}
