//! Reach maps: worked out on all cores, and kept on disk from then on.
//!
//! A map belongs to a chain, its limits, its mount and its ready pose. It lies in `catchingbot/reach-maps` in
//! the user's folder for caches, `$XDG_CACHE_HOME` or `~/.cache`, which may be deleted at any time; where
//! nothing can be stored it is worked out again.

use std::{
    env, fs,
    io::{self, IsTerminal, Write},
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    thread,
    time::SystemTime,
};

use catch_body::Robot;
use catch_bot::trajectory_optimization::reach_map::{CHUNKS, ReachMap, ReachSamples, checksum};

use crate::{
    bounded_file::FileKind,
    whole_file::{Unfinished, sweep_out},
};

const KIND: FileKind = FileKind { expected: "a stored reach map", most_bytes: 64 << 20 };
/// Maps that are kept; of more those are deleted that were stored first.
const MOST_FILES: usize = 32;
const EXTENSION: &str = "map";

/// The map for an arm in its ready pose; `None` if it needs none.
pub fn of(robot: &Robot) -> Option<Arc<ReachMap>> {
    ReachMap::serves(robot).then(|| Arc::new(kept_in(folder().as_deref(), robot)))
}

/// The user's folder for what can be worked out again.
fn folder() -> Option<PathBuf> {
    let absolute = |name: &str| env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let caches = absolute("XDG_CACHE_HOME").or_else(|| absolute("HOME").map(|home| home.join(".cache")))?;
    Some(caches.join("catchingbot").join("reach-maps"))
}

/// The map that is stored in a folder; else it is worked out and, if possible, stored there.
fn kept_in(folder: Option<&Path>, robot: &Robot) -> ReachMap {
    let file = folder.map(|it| it.join(format!("{:016x}.{EXTENSION}", checksum(&ReachMap::key(robot)))));
    let stored = file.as_ref().and_then(|file| ReachMap::from_bytes(robot, &KIND.read(file).ok()?));
    stored.unwrap_or_else(|| {
        let map = worked_out(robot);
        if let (Some(folder), Some(file)) = (folder, file) {
            // A map that cannot be stored is worked out again the next time.
            let _ = store(folder, &file, &map.to_bytes());
        }
        map
    })
}

/// Puts a file in its place as a whole, whoever else does the same, and deletes the oldest where there are
/// too many.
fn store(folder: &Path, file: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut unfinished = Unfinished::beside(file)?;
    unfinished.write_all(bytes)?;
    unfinished.replace(file)?;
    sweep_out(folder)?;
    let mut stored: Vec<(SystemTime, PathBuf)> = fs::read_dir(folder)?
        .filter_map(|entry| {
            let path = entry.ok()?.path();
            let is_map = path.extension().is_some_and(|it| it == EXTENSION);
            is_map.then_some((fs::metadata(&path).ok()?.modified().ok()?, path))
        })
        .collect();
    stored.sort();
    stored[..stored.len().saturating_sub(MOST_FILES)].iter().try_for_each(|(_, path)| fs::remove_file(path))
}

/// The map from samples that all cores draw, told on a terminal.
fn worked_out(robot: &Robot) -> ReachMap {
    let next = AtomicU64::new(0);
    let shows = io::stderr().is_terminal();
    let draw = || {
        let mut samples = ReachSamples::new(robot);
        loop {
            let chunk = next.fetch_add(1, Ordering::Relaxed);
            if chunk >= CHUNKS {
                return samples;
            }
            samples.draw(chunk);
            if shows {
                let percent = 100 * (chunk + 1) / CHUNKS;
                let _ = write!(io::stderr(), "\rreachable set of {}, computed once: {percent} %", robot.name);
            }
        }
    };
    let threads = thread::available_parallelism().map_or(1, usize::from);
    let samples = thread::scope(|scope| {
        let others: Vec<_> =
            (1..threads).map_while(|_| thread::Builder::new().spawn_scoped(scope, draw).ok()).collect();
        let panicked = "samples are drawn from an arm that was checked";
        others.into_iter().fold(draw(), |samples, other| samples.merged(&other.join().expect(panicked)))
    });
    if shows {
        let _ = write!(io::stderr(), "\r\x1b[2K");
    }
    samples.map()
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_body::robot_file::RobotFiles;

    #[test]
    fn a_map_is_stored_once_and_read_only_if_it_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        // One of the built-in arms whose inverse kinematics need a map.
        let arm = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/robots").join(["ur", "10e"].concat());
        let [urdf, toml] = ["robot.urdf", "robot.toml"].map(|it| fs::read_to_string(arm.join(it)).unwrap());
        let files = RobotFiles { urdf_file: "robot.urdf", urdf: &urdf, toml_file: "robot.toml", toml: &toml };
        let robot = Robot::from_files(&files).unwrap();
        let map = kept_in(Some(folder.path()), &robot);
        let file = fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        let bytes = fs::read(&file).unwrap();
        assert_eq!(kept_in(Some(folder.path()), &robot), map);

        assert!(ReachMap::from_bytes(&robot, &bytes).is_some_and(|it| it == map));
        for (at, what) in
            [(0, "another format"), (100, "another arm"), (bytes.len() / 2, "a time"), (bytes.len() - 1, "the sum")]
        {
            let mut changed = bytes.clone();
            changed[at] ^= 1;
            assert!(ReachMap::from_bytes(&robot, &changed).is_none(), "{what}");
        }
        assert!(ReachMap::from_bytes(&robot, &bytes[..bytes.len() - 1]).is_none());
        let mut elsewhere = robot.clone();
        elsewhere.ready_q[0] += 0.1;
        assert!(ReachMap::from_bytes(&elsewhere, &bytes).is_none());
        let mut faster = robot;
        faster.joints[1].limits.velocity *= 1.1;
        assert!(ReachMap::from_bytes(&faster, &bytes).is_none());
    }

    #[test]
    fn only_so_many_files_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        for i in 0..MOST_FILES + 3 {
            store(folder.path(), &folder.path().join(format!("{i:03}.{EXTENSION}")), b"map").unwrap();
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), MOST_FILES);
    }
}
