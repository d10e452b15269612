//! Reads the user's files: regular ones only, and none larger than what its kind can need.

use std::{
    fs::{self, File},
    io::{self, Read},
    path::{Path, PathBuf},
};

use catch_body::InputError;

/// Kind of a file: its description in error messages and its largest size.
#[derive(Debug, Clone, Copy)]
pub struct FileKind<'a> {
    /// Description of a valid file, for error messages.
    pub expected: &'a str,
    /// The most bytes that are read.
    pub most_bytes: u64,
}

const MIB: u64 = 1 << 20;
/// First bytes of a Git LFS pointer, which stands for a large file in a repository.
const GIT_LFS_POINTER: &[u8] = b"version https://git-lfs.github.com/spec/v1";

impl<'a> FileKind<'a> {
    /// Settings and descriptions in TOML.
    pub const fn toml(expected: &'a str) -> Self {
        Self { expected, most_bytes: MIB }
    }

    /// Robots, tracks and cases: numbers as text.
    pub const fn text(expected: &'a str) -> Self {
        Self { expected, most_bytes: 16 * MIB }
    }

    /// Meshes and point clouds.
    pub const fn geometry(expected: &'a str) -> Self {
        Self { expected, most_bytes: 64 * MIB }
    }

    /// Recordings, packed, and rows of results.
    pub const fn recorded(expected: &'a str) -> Self {
        Self { expected, most_bytes: 2048 * MIB }
    }

    /// Opens a file.
    ///
    /// # Errors
    /// If it does not exist, is no regular file, is too large or cannot be read.
    pub fn open(&self, path: &Path) -> Result<File, InputError> {
        let file = path.display().to_string();
        let fault = |field: &str, found: String, expected: String| InputError::new(&file, field, found, expected);
        // A pipe without a writer would never be opened.
        let metadata = fs::metadata(path).map_err(|it| fault("the file", in_words(&it), self.expected.to_owned()))?;
        if !metadata.is_file() {
            let found = if metadata.is_dir() { "a folder" } else { "a device or a pipe" };
            return Err(fault("the file", found.to_owned(), format!("a regular file: {}", self.expected)));
        }
        if metadata.len() > self.most_bytes {
            return Err(self.too_large(&file, metadata.len()));
        }
        File::open(path).map_err(|it| fault("the file", in_words(&it), self.expected.to_owned()))
    }

    /// Reads a whole file.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn read(&self, path: &Path) -> Result<Vec<u8>, InputError> {
        let file = path.display().to_string();
        let mut bytes = Vec::new();
        // A file may grow after it was opened, or say that it is empty.
        let read = self.open(path)?.take(self.most_bytes + 1).read_to_end(&mut bytes);
        read.map_err(|it| InputError::new(&file, "the file", in_words(&it), self.expected))?;
        if bytes.len() as u64 > self.most_bytes {
            return Err(self.too_large(&file, bytes.len() as u64));
        }
        if bytes.starts_with(GIT_LFS_POINTER) {
            let expected = format!("the file itself, which `git lfs pull` fetches: {}", self.expected);
            return Err(InputError::new(&file, "the file", "a pointer of Git LFS", expected));
        }
        Ok(bytes)
    }

    /// Reads a whole file as text.
    ///
    /// # Errors
    /// As [`open`](Self::open), or if it is not UTF-8.
    pub fn read_text(&self, path: &Path) -> Result<String, InputError> {
        self.decode(&path.display().to_string(), self.read(path)?)
    }

    /// The content of a file as text.
    ///
    /// # Errors
    /// If it is not UTF-8.
    pub fn decode(&self, file: &str, content: Vec<u8>) -> Result<String, InputError> {
        String::from_utf8(content).map_err(|fault| {
            let field = format!("byte {}", fault.utf8_error().valid_up_to());
            InputError::new(file, field, "binary data", format!("text in UTF-8: {}", self.expected))
        })
    }

    fn too_large(&self, file: &str, bytes: u64) -> InputError {
        let found = format!("{} MiB", bytes.div_ceil(MIB));
        InputError::new(file, "size", found, format!("at most {} MiB: {}", self.most_bytes / MIB, self.expected))
    }
}

/// Most entries of a folder that are read.
const MOST_ENTRIES: usize = 10_000;

/// Paths of what is in a folder, in the order of their names; `expected` says what the folder should be.
///
/// # Errors
/// If it cannot be read, or has too many entries.
pub fn paths_in(folder: &Path, expected: &str) -> Result<Vec<PathBuf>, InputError> {
    let fault = |it: io::Error| InputError::new(folder.display(), "the folder", it, expected);
    let entries = fs::read_dir(folder).map_err(fault)?.flatten().take(MOST_ENTRIES + 1);
    let mut paths: Vec<PathBuf> = entries.map(|it| it.path()).collect();
    if paths.len() > MOST_ENTRIES {
        let most = format!("at most {MOST_ENTRIES} of them: {expected}");
        return Err(InputError::new(folder.display(), "the folder", "more entries", most));
    }
    paths.sort();
    Ok(paths)
}

/// States why a file cannot be read.
fn in_words(fault: &io::Error) -> String {
    match fault.kind() {
        io::ErrorKind::NotFound => "nothing there".to_owned(),
        io::ErrorKind::PermissionDenied => "that it may not be read".to_owned(),
        _ => fault.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_of_some_size_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.toml");
        let kind = FileKind { expected: "settings", most_bytes: 3 };
        fs::write(&path, "abc").unwrap();
        assert_eq!(kind.read_text(&path).unwrap(), "abc");
        fs::write(&path, [b'a', 255]).unwrap();
        assert!(kind.read_text(&path).unwrap_err().to_string().contains("byte 1: found binary data"));
        fs::write(&path, "abcd").unwrap();
        assert!(kind.read(&path).unwrap_err().to_string().ends_with("expected at most 0 MiB: settings"));
        let fault = kind.read(folder.path()).unwrap_err().to_string();
        assert!(fault.contains("found a folder, expected a regular file: settings"), "{fault}");
        assert!(kind.read(&folder.path().join("none")).is_err());
        let pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n";
        fs::write(&path, pointer).unwrap();
        let fault = FileKind::toml("settings").read(&path).unwrap_err().to_string();
        assert!(
            fault.contains("found a pointer of Git LFS, expected the file itself, which `git lfs pull`"),
            "{fault}"
        );
        #[cfg(target_os = "linux")]
        for endless in ["/dev/zero", "/dev/stdin"] {
            let fault = kind.read(Path::new(endless)).map(|bytes| bytes.len());
            assert!(fault.is_err(), "{endless}: {fault:?}");
        }
    }
}
