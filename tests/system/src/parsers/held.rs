//! Presents bytes as a file in memory, for code that reads a file by its path.

use std::fs::File;
use std::io;
use std::os::fd::AsRawFd;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex, PoisonError};

/// The folder for files in memory.
const MEMORY: &str = "/dev/shm";

/// The only file of this program. It has no name in any folder, and disappears with the program.
static HELD: LazyLock<Mutex<File>> = LazyLock::new(|| {
    let file = tempfile::tempfile_in(MEMORY).or_else(|_| tempfile::tempfile());
    Mutex::new(file.expect("a temporary file"))
});

/// Lets `read` read a file of these bytes by its path.
pub(super) fn as_file<T>(bytes: &[u8], read: impl FnOnce(&Path) -> T) -> io::Result<T> {
    let file = HELD.lock().unwrap_or_else(PoisonError::into_inner);
    file.set_len(0)?;
    file.write_all_at(bytes, 0)?;
    Ok(read(&PathBuf::from(format!("/proc/self/fd/{}", file.as_raw_fd()))))
}
