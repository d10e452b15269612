//! Writes files as a whole or not at all, whenever a program is ended, and new ones in the place of none.

use std::{
    fs::{self, File},
    io::{self, Write},
    path::{Path, PathBuf},
    time::Duration,
};

use catch_body::InputError;
use tempfile::{Builder, NamedTempFile, TempDir};

/// Name of the command line in error messages.
pub const COMMAND_LINE: &str = "command line";
/// Advice where nothing can be written.
const PLACE: &str = "a place that can be written to";
/// Advice where a file exists already.
const FREE: &str = "another place: nothing is overwritten";
/// Prefix of the names of unfinished files; the number of the process that writes follows.
const PREFIX: &str = ".catchingbot-";
/// Suffix of the names of unfinished files.
const SUFFIX: &str = ".unfinished";
/// Age from which an unfinished file is swept out; a younger one may be written by another machine.
const SWEPT_AFTER: Duration = Duration::from_secs(600);

/// A file that has no name of its own until it is complete; one that is dropped is gone.
#[derive(Debug)]
pub struct Unfinished(NamedTempFile);

impl Unfinished {
    /// Begins a file beside `path`, in a folder that is made where there is none.
    ///
    /// # Errors
    /// If folder or file cannot be made.
    pub fn beside(path: &Path) -> io::Result<Self> {
        let folder = folder_of(path);
        fs::create_dir_all(folder)?;
        let prefix = prefix();
        let mut builder = Builder::new();
        builder.prefix(&prefix).suffix(SUFFIX);
        // Permissions of any file, less those that the user's mask takes away.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        builder.tempfile_in(folder).map(Self)
    }

    /// Gives the file its name; another that had it is gone.
    ///
    /// # Errors
    /// If that fails; the other file stays then.
    pub fn replace(self, path: &Path) -> io::Result<()> {
        self.0.as_file().sync_all()?;
        self.0.persist(path).map(drop).map_err(|it| it.error)
    }

    /// Gives the file a name that nothing has yet.
    ///
    /// # Errors
    /// If something has it, or if that fails.
    pub fn appear(self, path: &Path) -> io::Result<()> {
        self.0.as_file().sync_all()?;
        self.0.persist_noclobber(path).map(drop).map_err(|it| it.error)
    }
}

impl Write for Unfinished {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

/// A folder beside `path`, in one that is made where there is none; it goes away unless it is renamed.
///
/// # Errors
/// If it cannot be made.
pub fn unfinished_folder(path: &Path) -> Result<TempDir, InputError> {
    let folder = folder_of(path);
    let made =
        fs::create_dir_all(folder).and_then(|()| Builder::new().prefix(&prefix()).suffix(SUFFIX).tempdir_in(folder));
    made.map_err(|fault| InputError::unwritten(path.display(), &fault, PLACE))
}

/// Beginning of the names of what this process has not finished.
fn prefix() -> String {
    format!("{PREFIX}{}-", std::process::id())
}

/// Writes a file and gives it its name when it is complete; `advice` says what would help where that fails.
///
/// # Errors
/// If it cannot be written; what was there before stays.
pub fn replace(path: &Path, advice: &str, write: impl FnOnce(&mut File) -> io::Result<()>) -> Result<(), InputError> {
    let written = Unfinished::beside(path).and_then(|mut unfinished| {
        write(unfinished.0.as_file_mut())?;
        unfinished.replace(path)
    });
    written.map_err(|fault| InputError::unwritten(path.display(), &fault, advice))
}

/// Writes a file's whole content; another that had its name is gone.
///
/// # Errors
/// As [`replace`].
pub fn write(path: &Path, content: impl AsRef<[u8]>) -> Result<(), InputError> {
    replace(path, PLACE, |file| file.write_all(content.as_ref()))
}

/// Tells before a long work whether new files can be written there, and leaves nothing; `asked_by` is the
/// argument that names them.
///
/// # Errors
/// If one of them is there already, or if its folder cannot be written.
pub fn check_new<'a>(paths: impl IntoIterator<Item = &'a PathBuf>, asked_by: &str) -> Result<(), InputError> {
    for path in paths {
        // A link that leads nowhere is there, too.
        if fs::symlink_metadata(path).is_ok() {
            return Err(already_there(path, asked_by));
        }
        let folder = folder_of(path);
        let missing: Vec<&Path> = folder.ancestors().take_while(|it| !it.exists()).collect();
        let tried = make_writable(folder, asked_by);
        for made in missing {
            // One in which somebody else has put something stays.
            let _ = fs::remove_dir(made);
        }
        tried?;
    }
    Ok(())
}

/// Writes new files, all of them or none; `asked_by` is the argument that names them.
///
/// # Errors
/// If one of them is there already or cannot be written.
pub fn write_new(files: &[(PathBuf, Vec<u8>)], asked_by: &str) -> Result<(), InputError> {
    check_new(files.iter().map(|(path, _)| path), asked_by)?;
    let mut complete = Vec::new();
    for (path, content) in files {
        let written = Unfinished::beside(path).and_then(|mut file| file.write_all(content).map(|()| file));
        complete.push(written.map_err(|fault| InputError::unwritten(path.display(), &fault, PLACE))?);
    }
    for (i, file) in complete.into_iter().enumerate() {
        let path = &files[i].0;
        file.appear(path).map_err(|fault| {
            for (made, _) in &files[..i] {
                // Best effort: what is reported is why not all of them are there.
                let _ = fs::remove_file(made);
            }
            match fault.kind() {
                io::ErrorKind::AlreadyExists => already_there(path, asked_by),
                _ => InputError::unwritten(path.display(), &fault, PLACE),
            }
        })?;
    }
    Ok(())
}

/// Error for a file that would have to be overwritten.
fn already_there(path: &Path, asked_by: &str) -> InputError {
    InputError::new(COMMAND_LINE, asked_by, format!("`{}`, which is already there", path.display()), FREE)
}

/// Makes a folder, where there is none, writes into it to see whether that is possible, and takes away what
/// killed programs left there; `asked_by` is the argument that names it.
///
/// # Errors
/// If it cannot be written.
pub fn make_writable(folder: &Path, asked_by: &str) -> Result<(), InputError> {
    let tried = Unfinished::beside(&folder.join("file")).and_then(|_| sweep_out(folder));
    tried.map_err(|fault| {
        let found = format!("`{}`: {fault}", folder.display());
        let of_output = InputError::unwritten("", &fault, "").of_output;
        InputError { of_output, ..InputError::new(COMMAND_LINE, asked_by, found, "a folder that can be written") }
    })
}

/// Takes away what was left unfinished by processes that were killed, where processes can be looked up.
///
/// # Errors
/// If the folder cannot be read.
pub fn sweep_out(folder: &Path) -> io::Result<()> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    for entry in fs::read_dir(folder)?.flatten() {
        let name = entry.file_name();
        let stem = name.to_str().and_then(|name| name.strip_prefix(PREFIX)?.strip_suffix(SUFFIX));
        let Some((process, _)) = stem.and_then(|stem| stem.split_once('-')) else { continue };
        let modified = entry.metadata().and_then(|it| it.modified()).ok();
        let is_old = modified.and_then(|it| it.elapsed().ok()).is_some_and(|since| since > SWEPT_AFTER);
        if is_old && is_gone(process) {
            // Somebody else may have been quicker.
            let _ = fs::remove_file(entry.path()).or_else(|_| fs::remove_dir_all(entry.path()));
        }
    }
    Ok(())
}

/// Returns whether no process of this machine has that number; `false` where the system does not show it.
fn is_gone(process: &str) -> bool {
    let processes = Path::new("/proc");
    process.parse::<u32>().is_ok() && processes.join("self").exists() && !processes.join(process).exists()
}

/// The folder in which a file is.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|it| !it.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::SystemTime;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            fs::read_dir(folder).unwrap().map(|it| it.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_that_cannot_be_written_leaves_the_old_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        fs::write(&path, "old").unwrap();
        let fault = replace(&path, "room", |_| Err(io::Error::other("no room"))).unwrap_err().to_string();
        assert!(fault.contains("no room, expected room") && fault.contains("table.csv"), "{fault}");
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        write(&path, "new").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        assert_eq!(names(folder.path()), ["table.csv"]);
    }

    #[test]
    fn new_files_appear_together_and_replace_none() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str| (folder.path().join(name), name.as_bytes().to_vec());
        write_new(&[file("a"), file("b/c")], "--out").unwrap();
        let fault = write_new(&[file("d"), file("a")], "--out").unwrap_err();
        assert!(!fault.of_output && fault.to_string().contains("a`, which is already there"), "{fault}");
        // A file that is found in the way only when it is to be named.
        let late = [file("e"), file("e")];
        assert!(write_new(&late, "--out").unwrap_err().to_string().contains("already there"));
        assert_eq!(names(folder.path()), ["a", "b"]);
        assert_eq!(fs::read_to_string(folder.path().join("b/c")).unwrap(), "b/c");
    }

    /// Nobody has promised that files of this program are for one user only.
    #[cfg(unix)]
    #[test]
    fn files_have_the_permissions_of_any_other() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (ours, other) = (folder.path().join("ours"), folder.path().join("other"));
        write(&ours, "").unwrap();
        fs::write(&other, "").unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&other));
    }

    #[test]
    fn what_killed_programs_left_is_swept_out() {
        let folder = tempfile::tempdir().unwrap();
        let left = ".catchingbot-4294967294-a.unfinished";
        let mine = format!(".catchingbot-{}-a.unfinished", std::process::id());
        let kept = [mine.as_str(), ".a.unfinished", "a.4294967294.unfinished", "a.catch"];
        for name in kept.iter().chain(&[left]) {
            fs::write(folder.path().join(name), "").unwrap();
        }
        make_writable(folder.path(), "--out").unwrap();
        assert!(folder.path().join(left).exists(), "it may still be written to");
        for name in [left, &mine] {
            let file = File::options().write(true).open(folder.path().join(name)).unwrap();
            file.set_modified(SystemTime::UNIX_EPOCH).unwrap();
        }
        make_writable(folder.path(), "--out").unwrap();
        assert!(kept.iter().all(|name| folder.path().join(name).exists()));
        assert_eq!(folder.path().join(left).exists(), !Path::new("/proc/self").exists());
    }
}
