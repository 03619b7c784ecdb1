//! Reads traces from bytes, files and iterables of lines.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use fuseline_traces::packed::unpack;
use pyo3::exceptions::{PyOSError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PyBytes, PyIterator, PyString};

/// The time between two checks whether the user wants to stop.
const PATIENCE: Duration = Duration::from_millis(50);
/// The number of bytes that are read, or collected from lines, at once.
const CHUNK: usize = 64 * 1024;

/// The source of a trace.
enum TraceSource {
    Bytes(PyBackedBytes),
    File(PathBuf),
    Stream(Py<PyAny>),
    Lines(Py<PyIterator>),
}

/// Opens a trace and passes it to `read`, with the name for verdicts and errors. The interpreter is
/// released, because opening may wait too, for instance for the writer of a pipe.
///
/// Bytes are a trace, texts and paths are files, an object with `read` is an open file, and
/// anything else gives lines. A packed trace is unpacked.
pub(crate) fn with_trace<T: Send>(
    trace: &Bound<'_, PyAny>,
    name: Option<String>,
    read: impl FnOnce(&str, Box<dyn BufRead>) -> PyResult<T> + Send,
) -> PyResult<T> {
    let (origin, own) = if let Ok(bytes) = trace.cast::<PyBytes>() {
        (TraceSource::Bytes(bytes.clone().into()), "<bytes>".to_owned())
    } else if trace.is_instance_of::<PyString>() || trace.hasattr("__fspath__")? {
        if let Ok(text) = trace.extract::<String>()
            && text.trim_start().starts_with('{')
        {
            let message = "the text of a trace was given instead of its path; give its bytes: \
                           text.encode()";
            return Err(PyValueError::new_err(message));
        }
        let path: PathBuf = trace.extract()?;
        let own = path.display().to_string();
        (TraceSource::File(path), own)
    } else if trace.hasattr("read")? && !trace.hasattr("encoding")? {
        // A file with an encoding gives text, which is read by the line.
        (TraceSource::Stream(trace.clone().unbind()), "<stream>".to_owned())
    } else if let Ok(lines) = trace.try_iter() {
        (TraceSource::Lines(lines.unbind()), "<lines>".to_owned())
    } else {
        let message = format!(
            "a trace is bytes, a path, an open file, or something that gives lines, not {}",
            trace.get_type().name()?
        );
        return Err(PyTypeError::new_err(message));
    };
    let name = name.unwrap_or_else(|| own.clone());
    trace.py().detach(|| {
        let trace = origin.open().map_err(|error| named(&own, error))?;
        read(&name, trace)
    })
}

impl TraceSource {
    fn open(self) -> io::Result<Box<dyn BufRead>> {
        match self {
            Self::Bytes(bytes) => packed(Cursor::new(bytes)),
            Self::File(path) => packed(BufReader::with_capacity(CHUNK, File::open(path)?)),
            Self::Stream(stream) => packed(BufReader::with_capacity(CHUNK, Stream(stream))),
            Self::Lines(lines) => {
                packed(IteratorLines { from: lines, ends: None, held: Vec::new(), taken: 0 })
            }
        }
    }
}

/// Returns a reader that unpacks the trace if necessary, and ends if the user interrupts it.
fn packed(trace: impl BufRead + 'static) -> io::Result<Box<dyn BufRead>> {
    Ok(Box::new(InterruptibleReader::new(unpack(trace)?)))
}

/// Returns the Python exception within an error, or an error of the system that names the file.
fn named(path: &str, error: io::Error) -> PyErr {
    let error = match error.downcast::<PyErr>() {
        Ok(raised) => return raised,
        Err(error) => error,
    };
    let Some(number) = error.raw_os_error() else { return error.into() };
    let words = error.to_string();
    let words = words.split(" (os error").next().unwrap_or_default().to_owned();
    PyOSError::new_err((number, words, path.to_owned()))
}

/// An open file of Python's, or an object that is read in the same way.
struct Stream(Py<PyAny>);

impl Read for Stream {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        Python::attach(|py| {
            let read = self.0.bind(py).call_method1("read", (buffer.len(),))?;
            let Ok(bytes) = read.cast::<PyBytes>() else {
                let message = format!(
                    "an open file gives bytes, not {}; open it in mode \"rb\"",
                    read.get_type().name()?
                );
                return Err(PyTypeError::new_err(message));
            };
            let mut bytes = bytes.as_bytes();
            if bytes.len() > buffer.len() {
                let (len, room) = (bytes.len(), buffer.len());
                let message = format!("an open file gave {len} bytes when asked for {room}");
                return Err(PyOSError::new_err(message));
            }
            Ok(bytes.read(buffer)?)
        })
        .map_err(io::Error::other)
    }
}

/// Collects lines of an iterator while the interpreter is held.
struct IteratorLines {
    from: Py<PyIterator>,
    /// `true` if lines have their own line ends. The first line decides.
    ends: Option<bool>,
    held: Vec<u8>,
    taken: usize,
}

impl IteratorLines {
    fn gather(&mut self, py: Python<'_>) -> PyResult<()> {
        let mut lines = self.from.bind(py).clone();
        while self.held.len() < CHUNK {
            let Some(line) = lines.next() else { break };
            let line = line?;
            if let Ok(text) = line.cast::<PyString>() {
                self.held.extend_from_slice(text.to_cow()?.as_bytes());
            } else if let Ok(bytes) = line.cast::<PyBytes>() {
                self.held.extend_from_slice(bytes.as_bytes());
            } else {
                let message = format!("a line is str or bytes, not {}", line.get_type().name()?);
                return Err(PyTypeError::new_err(message));
            }
            let ends = *self.ends.get_or_insert_with(|| self.held.ends_with(b"\n"));
            if !ends {
                self.held.push(b'\n');
            }
        }
        Ok(())
    }
}

impl BufRead for IteratorLines {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.taken == self.held.len() {
            self.held.clear();
            self.taken = 0;
            Python::attach(|py| self.gather(py)).map_err(io::Error::other)?;
        }
        Ok(self.held.get(self.taken..).unwrap_or_default())
    }

    fn consume(&mut self, amount: usize) {
        self.taken = self.held.len().min(self.taken + amount);
    }
}

impl Read for IteratorLines {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let len = self.fill_buf()?.read(buffer)?;
        self.consume(len);
        Ok(len)
    }
}

/// A reader that lets Ctrl-C interrupt it although the interpreter is released.
struct InterruptibleReader<R> {
    inner: R,
    checked_at: Instant,
}

impl<R> InterruptibleReader<R> {
    fn new(inner: R) -> Self {
        Self { inner, checked_at: Instant::now() }
    }
}

impl<R: BufRead> BufRead for InterruptibleReader<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.checked_at.elapsed() > PATIENCE {
            Python::attach(|py| py.check_signals().map_err(io::Error::other))?;
            self.checked_at = Instant::now();
        }
        self.inner.fill_buf()
    }

    fn consume(&mut self, amount: usize) {
        self.inner.consume(amount);
    }
}

impl<R: BufRead> Read for InterruptibleReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let len = self.fill_buf()?.read(buffer)?;
        self.consume(len);
        Ok(len)
    }
}
