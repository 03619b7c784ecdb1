//! The recorder.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;

use crate::event::{Decision, Header, Input};

/// How many bytes are gathered before they are written.
const GATHERED: usize = 64 * 1024;

/// How a run is recorded; by default into one plain file.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Recording {
    /// Begin another file where one holds this many bytes before compression.
    pub rotate: Option<u64>,
    /// Compress with gzip.
    pub gzip: bool,
}

/// Writes one operator's trace to a file while it runs.
///
/// Lines are gathered and written between two inputs, so that even a process killed outright leaves
/// a trace that ends with a whole input's decisions (a compressed one may be cut short). What is
/// gathered is written when the recorder is dropped, by a panic too.
///
/// It asks the operating system to write, not the disk: what a power cut takes is lost.
///
/// A recorder never stops its operator: after the first error it records no more, and
/// [`finish`](Self::finish) tells the error.
///
/// With [`Recording::rotate`], `trace.jsonl` is followed by `trace.1.jsonl`, `trace.2.jsonl`… once
/// it is full. Each begins with the header, so each can be read, but a later one cannot be judged
/// alone, since what is open, the gates and the clock carry over. Without the later headers the
/// parts put together are the one trace that they were:
/// `(cat trace.jsonl; tail -qn +2 trace.1.jsonl trace.2.jsonl) | fuseline check`.
#[derive(Debug)]
pub struct Recorder {
    path: PathBuf,
    header: Vec<u8>,
    recording: Recording,
    out: Out,
    gathered: Vec<u8>,
    /// How many bytes this file holds, gathered ones too.
    size: u64,
    part: u64,
    error: Option<io::Error>,
}

/// Where lines go.
#[derive(Debug)]
enum Out {
    Plain(File),
    Gzip(GzEncoder<File>),
}

impl Recorder {
    /// Creates the file, or empties it, and records the header.
    ///
    /// # Errors
    /// If the file cannot be made or written.
    pub fn create(
        path: impl AsRef<Path>,
        header: &Header,
        recording: Recording,
    ) -> io::Result<Self> {
        let path = path.as_ref().to_path_buf();
        let out = Out::create(&path, recording)?;
        let mut line = Vec::new();
        header.write(&mut line);
        line.push(b'\n');
        let mut recorder = Self {
            path,
            out,
            recording,
            gathered: line.clone(),
            size: line.len() as u64,
            header: line,
            part: 0,
            error: None,
        };
        recorder.write_gathered()?;
        Ok(recorder)
    }

    /// Records an input, before its decisions.
    pub fn input(&mut self, input: &Input) {
        if self.recording.rotate.is_some_and(|most| self.size >= most) {
            self.attempt(Self::rotate);
        } else if self.gathered.len() >= GATHERED {
            self.attempt(Self::write_gathered);
        }
        self.line(|out| input.write(out));
    }

    /// Records a decision about the input recorded last.
    pub fn decision(&mut self, decision: &Decision) {
        self.line(|out| decision.write(out));
    }

    /// Writes what is gathered, for one who wants to read along.
    pub fn flush(&mut self) {
        self.attempt(|recorder| {
            recorder.write_gathered()?;
            recorder.out.flush()
        });
    }

    /// Ends the trace.
    ///
    /// # Errors
    /// The first error met since the recorder was made; the trace is whole up to there.
    pub fn finish(mut self) -> io::Result<()> {
        self.attempt(Self::end);
        self.error.take().map_or(Ok(()), Err)
    }

    /// The file that part `part` is written to; 0 is the first.
    #[must_use]
    pub fn part(path: &Path, part: u64) -> PathBuf {
        if part == 0 {
            return path.to_path_buf();
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let (stem, end) = match name.char_indices().skip(1).find(|(_, c)| *c == '.') {
            Some((dot, _)) => name.split_at(dot),
            None => (&*name, ""),
        };
        path.with_file_name(format!("{stem}.{part}{end}"))
    }

    fn line(&mut self, write: impl FnOnce(&mut Vec<u8>)) {
        if self.error.is_some() {
            return;
        }
        let before = self.gathered.len();
        write(&mut self.gathered);
        self.gathered.push(b'\n');
        self.size += (self.gathered.len() - before) as u64;
    }

    fn attempt(&mut self, step: impl FnOnce(&mut Self) -> io::Result<()>) {
        if self.error.is_none()
            && let Err(error) = step(self)
        {
            self.gathered.clear();
            self.error = Some(error);
        }
    }

    fn write_gathered(&mut self) -> io::Result<()> {
        self.out.write_all(&self.gathered)?;
        self.gathered.clear();
        Ok(())
    }

    fn rotate(&mut self) -> io::Result<()> {
        self.end()?;
        self.part += 1;
        self.out = Out::create(&Self::part(&self.path, self.part), self.recording)?;
        self.gathered.extend_from_slice(&self.header);
        self.size = self.header.len() as u64;
        Ok(())
    }

    fn end(&mut self) -> io::Result<()> {
        self.write_gathered()?;
        self.out.end()
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.attempt(Self::end);
    }
}

impl Out {
    fn create(path: &Path, recording: Recording) -> io::Result<Self> {
        let file = File::create(path)?;
        if recording.gzip {
            return Ok(Self::Gzip(GzEncoder::new(file, Compression::default())));
        }
        Ok(Self::Plain(file))
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Plain(file) => file.write_all(bytes),
            Self::Gzip(file) => file.write_all(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Plain(file) => file.flush(),
            Self::Gzip(file) => file.flush(),
        }
    }

    fn end(&mut self) -> io::Result<()> {
        match self {
            Self::Plain(file) => file.flush(),
            Self::Gzip(file) => file.try_finish(),
        }
    }
}
