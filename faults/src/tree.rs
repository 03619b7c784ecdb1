//! The project's files.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use sha2::{Digest, Sha256};

use crate::error::FaultsError;

/// The root folder of the project, or of a copy of it.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Tree {
    root: PathBuf,
}

impl Tree {
    /// Creates a tree with this root folder.
    #[must_use]
    pub const fn new(root: PathBuf) -> Self {
        Self { root }
    }

    /// Returns the root folder.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Returns the path of a file or folder that is named from the root.
    #[must_use]
    pub fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.root.join(name)
    }

    /// Reads a text file that is named from the root.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read.
    pub fn text(&self, name: &str) -> Result<String, FaultsError> {
        let path = self.path(name);
        fs::read_to_string(&path).map_err(FaultsError::file(&path))
    }

    /// Returns all files at or below these names, by their names from the root.
    ///
    /// # Errors
    /// Returns an error if a folder cannot be read or a name does not exist.
    pub fn files(&self, names: &[&str]) -> Result<Vec<String>, FaultsError> {
        let mut files = Vec::new();
        for name in names {
            self.walk(&self.path(name), &mut files)?;
        }
        files.sort();
        Ok(files)
    }

    /// Returns a digest of all files at or below these names. A name after a `!` excludes the files
    /// whose names begin with it.
    ///
    /// In Rust files, comment lines and empty lines do not count, because they change no result.
    ///
    /// # Errors
    /// Returns the same errors as [`files`](Self::files).
    pub fn digest(&self, names: &[&str]) -> Result<String, FaultsError> {
        let (without, with): (Vec<&str>, Vec<&str>) =
            names.iter().partition(|name| name.starts_with('!'));
        let is_without = |name: &str| without.iter().any(|start| name.starts_with(&start[1..]));
        let mut digest = Sha256::new();
        for name in self.files(&with)?.into_iter().filter(|name| !is_without(name)) {
            let path = self.path(&name);
            let mut content = fs::read(&path).map_err(FaultsError::file(&path))?;
            if path.extension().is_some_and(|extension| extension == "rs") {
                content = code(&content);
            }
            digest.update(name.len().to_le_bytes());
            digest.update(&name);
            digest.update(content.len().to_le_bytes());
            digest.update(content);
        }
        Ok(hex(&digest.finalize()))
    }

    /// Makes `copy` contain the files that git would keep of this tree, and nothing else. `changed`
    /// has texts that replace the tree's own.
    ///
    /// A file that is already the same stays untouched, so that it is not built again.
    ///
    /// # Errors
    /// Returns an error if git cannot list the files, or a file cannot be copied.
    pub fn copy_to(
        &self,
        copy: &Self,
        changed: BTreeMap<String, String>,
    ) -> Result<(), FaultsError> {
        let mut wanted = self.listed_files()?;
        wanted.extend(changed.into_iter().map(|(name, text)| (name, text.into_bytes())));
        fs::create_dir_all(&copy.root).map_err(FaultsError::file(&copy.root))?;
        for name in copy.files(&["."])? {
            if !wanted.contains_key(&name) {
                let path = copy.path(&name);
                fs::remove_file(&path).map_err(FaultsError::file(&path))?;
            }
        }
        for (name, content) in wanted {
            let path = copy.path(&name);
            if !fs::read(&path).is_ok_and(|there| there == content) {
                if let Some(folder) = path.parent() {
                    fs::create_dir_all(folder).map_err(FaultsError::file(folder))?;
                }
                fs::write(&path, content).map_err(FaultsError::file(&path))?;
            }
            // A script stays executable.
            if let Ok(own) = fs::metadata(self.path(&name)) {
                fs::set_permissions(&path, own.permissions()).map_err(FaultsError::file(&path))?;
            }
        }
        Ok(())
    }

    /// Returns the contents of the files that git tracks and of new ones, by name.
    fn listed_files(&self) -> Result<BTreeMap<String, Vec<u8>>, FaultsError> {
        let listed = Command::new("git")
            .args(["ls-files", "-z", "--cached", "--others", "--exclude-standard"])
            .current_dir(&self.root)
            .output()
            .map_err(FaultsError::file(Path::new("git")))?;
        if !listed.status.success() {
            return Err(FaultsError::content(
                &self.root,
                String::from_utf8_lossy(&listed.stderr).trim(),
            ));
        }
        let mut files = BTreeMap::new();
        for name in String::from_utf8_lossy(&listed.stdout).split_terminator('\0') {
            // Git also lists a file that was removed and not yet committed.
            if let Ok(content) = fs::read(self.path(name)) {
                files.insert(name.to_owned(), content);
            }
        }
        Ok(files)
    }

    fn walk(&self, path: &Path, files: &mut Vec<String>) -> Result<(), FaultsError> {
        if path.is_file() {
            let name = path.strip_prefix(&self.root).unwrap_or(path);
            let parts: Vec<_> = name.components().collect();
            let names: Vec<_> =
                parts.iter().map(|part| part.as_os_str().to_string_lossy()).collect();
            files.push(names.join("/").trim_start_matches("./").to_owned());
            return Ok(());
        }
        for entry in fs::read_dir(path).map_err(FaultsError::file(path))? {
            self.walk(&entry.map_err(FaultsError::file(path))?.path(), files)?;
        }
        Ok(())
    }
}

/// Writes a file, with the folders above it.
///
/// # Errors
/// Returns an error if the file cannot be written.
pub fn write(path: &Path, text: &str) -> Result<(), FaultsError> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(FaultsError::file(folder))?;
    }
    fs::write(path, text).map_err(FaultsError::file(path))
}

/// Formats bytes in hexadecimal.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// Returns a Rust file without its comment lines and its empty lines.
fn code(content: &[u8]) -> Vec<u8> {
    let says_something = |line: &&[u8]| {
        let line = line.trim_ascii();
        !line.is_empty() && !line.starts_with(b"//")
    };
    content
        .split_inclusive(|&byte| byte == b'\n')
        .filter(says_something)
        .flatten()
        .copied()
        .collect()
}

#[cfg(test)]
mod tests {
    use std::fs::Permissions;
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    #[test]
    fn comments_change_no_digest_and_code_does() -> Result<(), FaultsError> {
        let root = std::env::temp_dir().join(format!("fuseline-tree-{}", std::process::id()));
        let tree = Tree::new(root.clone());
        let reported = |name: &str, content: &str| {
            let path = tree.path(name);
            fs::create_dir_all(&root).map_err(FaultsError::file(&path))?;
            fs::write(&path, content).map_err(FaultsError::file(&path))?;
            tree.digest(&[name])
        };
        let code = reported("a.rs", "//! Words.\n\nfn f() {\n    g() // why\n}\n")?;
        assert_eq!(
            reported("a.rs", "/// Others.\nfn f() {\n    // More.\n    g() // why\n}\n")?,
            code
        );
        assert_ne!(reported("a.rs", "fn f() {\n    h() // why\n}\n")?, code);
        assert_ne!(reported("a.txt", "// Words.\n")?, reported("a.txt", "// Others.\n")?);
        fs::remove_dir_all(&root).map_err(FaultsError::file(&root))
    }

    #[test]
    fn scripts_of_a_copy_are_executable() -> Result<(), FaultsError> {
        let folder = std::env::temp_dir().join(format!("fuseline-copy-{}", std::process::id()));
        let (tree, copy) = (Tree::new(folder.join("tree")), Tree::new(folder.join("copy")));
        let script = tree.path("run");
        write(&script, "true\n")?;
        let begun = Command::new("git").args(["init", "--quiet"]).current_dir(tree.root()).status();
        assert!(begun.is_ok_and(|status| status.success()));
        for mode in [0o755, 0o644] {
            let permissions = Permissions::from_mode(mode);
            fs::set_permissions(&script, permissions).map_err(FaultsError::file(&script))?;
            tree.copy_to(&copy, BTreeMap::new())?;
            let copied = copy.path("run");
            let copied = fs::metadata(&copied).map_err(FaultsError::file(&copied))?;
            assert_eq!(copied.permissions().mode() & 0o777, mode);
        }
        fs::remove_dir_all(&folder).map_err(FaultsError::file(&folder))
    }
}
