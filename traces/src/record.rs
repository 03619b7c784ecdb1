//! [`Recorder`]: writes an operator's trace while it runs, and never stops the operator. An error ends the trace.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;

use crate::annotations::{Annotations, HeaderAnnotations};
use crate::event::{Decision, Event, Header, Input};

/// The number of bytes that are gathered before they are written.
const GATHERED: usize = 64 * 1024;

/// The settings of a recording. By default it is one plain file.
///
/// A killed process loses the lines that were not written yet. A [`Recorder`] by itself writes 64
/// KiB at a time, or when it is [flushed](Recorder::flush). An operator flushes its recorder twice
/// a second, and whenever a message is missed or refused. A power cut also loses what the operating
/// system has not brought to the disk; on Linux that is about the last half minute.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Recording {
    /// Starts another file when the current one holds this many bytes before compression.
    pub rotate: Option<u64>,
    /// Compresses with gzip. The bytes of one write are compressed by themselves.
    pub gzip: bool,
    /// Writes each input with its decisions at once, so that a kill costs at most the last input.
    pub every_input: bool,
    /// Waits for the disk after each write, so that a power cut costs no more than a kill.
    pub sync: bool,
}

/// Writes one operator's trace to a file while it runs, under the file's own name from the start.
///
/// Lines are gathered and written between two inputs. So a process that is killed leaves a trace
/// that ends with all decisions of an input, unless it is killed in the middle of a write. Dropping
/// the recorder writes what is gathered, even in a panic.
///
/// A recorder never stops its operator. After the first error it records nothing more. It cuts off
/// what was partly written, so that the trace ends with all decisions of an input.
/// [`error`](Self::error) and [`finish`](Self::finish) report the error.
///
/// With [`Recording::rotate`], `trace.jsonl` is followed by `trace.1.jsonl`, `trace.2.jsonl`… once
/// it is full. Each part begins with the header, so each can be read. A later part cannot be judged
/// by itself, because open timestamps, gates and the clock carry over. Without the later headers
/// the parts together are the one trace:
/// `(cat trace.jsonl; tail -qn +2 trace.1.jsonl trace.2.jsonl) | fuseline check`.
///
/// ```
/// use fuseline_traces::{Input, Line, Recorder, Recording, parse};
///
/// let header = br#"{"fuseline":1,"window":16,"clouds":[]}"#;
/// let Ok(Line::Header(header)) = parse(header) else { panic!("a header") };
/// let file = std::env::temp_dir().join("fuseline-recorder-example.jsonl");
/// let mut recorder = Recorder::create(&file, &header, Recording::default())?;
/// recorder.input(&Input::Tick { at: 7 });
/// recorder.finish()?;
/// assert!(std::fs::read_to_string(&file)?.ends_with("{\"ev\":\"tick\",\"at\":7}\n"));
/// # std::fs::remove_file(file)?;
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug)]
pub struct Recorder {
    path: PathBuf,
    header: Vec<u8>,
    recording: Recording,
    out: LineSink,
    gathered: Vec<u8>,
    /// The places in `gathered` at which inputs begin. Everything before such a place is whole.
    inputs: Vec<usize>,
    /// The number of bytes in this file, with the gathered ones, before compression.
    size: u64,
    part: u64,
    error: Option<io::Error>,
}

/// The file that lines are written to.
#[derive(Debug)]
struct LineSink {
    file: File,
    recording: Recording,
    /// The number of bytes in the file, which end with all decisions of an input.
    len: u64,
    packed: Vec<u8>,
}

impl Recorder {
    /// Creates the file, or empties it, and records the header.
    ///
    /// # Errors
    /// Returns an error if the file cannot be created or written.
    pub fn create(
        path: impl AsRef<Path>,
        header: &Header,
        recording: Recording,
    ) -> io::Result<Self> {
        Self::create_annotated(path, header, &HeaderAnnotations::default(), recording)
    }

    /// Creates the file, or empties it, and records the header with further keys.
    ///
    /// # Errors
    /// Returns an error if the file cannot be created or written.
    pub fn create_annotated(
        path: impl AsRef<Path>,
        header: &Header,
        annotations: &HeaderAnnotations,
        recording: Recording,
    ) -> io::Result<Self> {
        let path = path.as_ref().to_path_buf();
        let out = LineSink::create(&path, recording)?;
        let mut line = Vec::new();
        header.write_annotated(annotations, &mut line);
        line.push(b'\n');
        let mut recorder = Self {
            path,
            out,
            recording,
            gathered: line.clone(),
            inputs: Vec::new(),
            size: line.len() as u64,
            header: line,
            part: 0,
            error: None,
        };
        recorder.write_gathered()?;
        Ok(recorder)
    }

    /// Records an input. Call this before recording its decisions.
    pub fn input(&mut self, input: &Input) {
        self.annotated_input(input, &Annotations::NONE);
    }

    /// Records an input with further keys. Call this before recording its decisions.
    pub fn annotated_input(&mut self, input: &Input, annotations: &Annotations) {
        let most = if self.recording.every_input { 0 } else { GATHERED };
        self.begin(input, annotations, most);
    }

    /// Records a decision about the input recorded last.
    pub fn decision(&mut self, decision: &Decision) {
        self.line(|out| decision.write(out));
    }

    /// Records a decision with further keys about the input recorded last.
    pub fn annotated_decision(&mut self, decision: &Decision, annotations: &Annotations) {
        self.line(|out| Event::Decision(*decision).write_annotated(annotations, out));
    }

    /// Records whole inputs with their decisions and further keys, and writes them together.
    pub fn extend<'a>(&mut self, events: impl IntoIterator<Item = (Event, &'a Annotations)>) {
        for (event, annotations) in events {
            match event {
                Event::Input(input) => self.begin(&input, annotations, GATHERED),
                Event::Decision(decision) => self.annotated_decision(&decision, annotations),
            }
        }
        self.flush();
    }

    /// Writes what is gathered. Call this between two inputs.
    pub fn flush(&mut self) {
        self.attempt(Self::write_gathered);
    }

    /// Returns the first error, after which nothing is recorded.
    #[must_use]
    pub const fn error(&self) -> Option<&io::Error> {
        self.error.as_ref()
    }

    /// Returns how the recorder records.
    #[must_use]
    pub const fn recording(&self) -> Recording {
        self.recording
    }

    /// Returns the file that is being written, which is the latest part.
    #[must_use]
    pub fn file(&self) -> PathBuf {
        Self::part(&self.path, self.part)
    }

    /// Ends the trace.
    ///
    /// # Errors
    /// Returns the first error since the recorder was created. The trace is whole up to there.
    pub fn finish(mut self) -> io::Result<()> {
        self.flush();
        self.error.take().map_or(Ok(()), Err)
    }

    /// Returns the path of part `part`; 0 is the first.
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

    /// Begins the lines of an input, and first writes those of earlier inputs if they exceed `most`
    /// bytes.
    fn begin(&mut self, input: &Input, annotations: &Annotations, most: usize) {
        if self.recording.rotate.is_some_and(|full| self.size >= full) {
            self.attempt(Self::rotate);
        } else if self.gathered.len() >= most {
            self.attempt(Self::write_gathered);
        }
        // After an error nothing is gathered, not even the places of inputs.
        if self.error.is_none() {
            self.inputs.push(self.gathered.len());
        }
        self.line(|out| Event::Input(*input).write_annotated(annotations, out));
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
            self.inputs.clear();
            self.error = Some(error);
        }
    }

    fn write_gathered(&mut self) -> io::Result<()> {
        self.out.write(&self.gathered, &self.inputs)?;
        self.gathered.clear();
        self.inputs.clear();
        Ok(())
    }

    fn rotate(&mut self) -> io::Result<()> {
        self.write_gathered()?;
        self.out = LineSink::create(&Self::part(&self.path, self.part + 1), self.recording)?;
        self.part += 1;
        self.gathered.extend_from_slice(&self.header);
        self.size = self.header.len() as u64;
        Ok(())
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.flush();
    }
}

impl LineSink {
    fn create(path: &Path, recording: Recording) -> io::Result<Self> {
        Ok(Self { file: File::create(path)?, recording, len: 0, packed: Vec::new() })
    }

    /// Writes all bytes, or else as many as end with all decisions of an input. Inputs begin at
    /// `inputs`.
    fn write(&mut self, bytes: &[u8], inputs: &[usize]) -> io::Result<()> {
        if bytes.is_empty() {
            return Ok(());
        }
        // Each write is a gzip member of its own, so that what is on the disk can be unpacked to
        // its end.
        self.packed.clear();
        let (mut bytes, mut whole) = (bytes, inputs);
        if self.recording.gzip {
            let mut packer = GzEncoder::new(&mut self.packed, Compression::default());
            packer.write_all(bytes)?;
            packer.finish()?;
            (bytes, whole) = (&self.packed, &[]);
        }
        let written = write_all(&mut self.file, bytes);
        let (Ok(count) | Err((count, _))) = &written;
        let kept = if *count == bytes.len() {
            *count
        } else {
            whole.iter().copied().rfind(|place| place <= count).unwrap_or(0)
        };
        self.len += kept as u64;
        if let Err((_, error)) = written {
            // A device or a pipe has no length; bytes written there stay.
            let _ = self.file.set_len(self.len);
            return Err(error);
        }
        if self.recording.sync {
            self.file.sync_data()?;
        }
        Ok(())
    }
}

/// Writes all bytes, or returns the number of bytes written before the error.
fn write_all(file: &mut File, bytes: &[u8]) -> Result<usize, (usize, io::Error)> {
    let mut written = 0;
    while let Some(rest) = bytes.get(written..).filter(|rest| !rest.is_empty()) {
        match file.write(rest) {
            Ok(0) => return Err((written, io::ErrorKind::WriteZero.into())),
            Ok(count) => written += count,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err((written, error)),
        }
    }
    Ok(written)
}

#[cfg(test)]
mod tests;
