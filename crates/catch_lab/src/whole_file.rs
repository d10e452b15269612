//! Writes results as a whole or not at all, whenever a program is ended.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use catch_body::InputError;

/// What would help where nothing can be written.
const PLACE: &str = "a place that can be written to";

/// Writes a file under another name and gives it its own when it is complete; `advice` says what would help where that fails.
///
/// # Errors
/// If it cannot be written; what was there before stays.
pub fn replace(path: &Path, advice: &str, write: impl FnOnce(&Path) -> io::Result<()>) -> Result<(), InputError> {
    let unfinished = unfinished(path);
    write(&unfinished).and_then(|()| fs::rename(&unfinished, path)).map_err(|fault| {
        // Best effort: what is reported is why it could not be written.
        let _ = fs::remove_file(&unfinished);
        InputError::unwritten(path.display(), &fault, advice)
    })
}

/// Writes a file's whole content.
///
/// # Errors
/// As [`replace`].
pub fn write(path: &Path, content: impl AsRef<[u8]>) -> Result<(), InputError> {
    replace(path, PLACE, |path| fs::write(path, content))
}

/// Tells before a long work whether its result can be written there. Makes the folder if there is none.
///
/// # Errors
/// If it cannot.
pub fn check_place(path: &Path) -> Result<(), InputError> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let unfinished = unfinished(path);
    let made = folder.map_or(Ok(()), fs::create_dir_all);
    let tried = made.and_then(|()| fs::write(&unfinished, [])).and_then(|()| fs::remove_file(&unfinished));
    tried.map_err(|fault| InputError::unwritten(path.display(), &fault, PLACE))
}

/// What a file is called until it is complete.
fn unfinished(path: &Path) -> PathBuf {
    path.with_file_name(format!(".{}.unfinished", path.file_name().unwrap_or_default().to_string_lossy()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_cannot_be_written_leaves_the_old_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        fs::write(&path, "old").unwrap();
        let fault = replace(&path, "room", |_| Err(io::Error::other("no room"))).unwrap_err().to_string();
        assert!(fault.contains("no room, expected room") && fault.contains("table.csv"), "{fault}");
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        write(&path, "new").unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
