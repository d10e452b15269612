//! The enabling key: a dead man's switch on the terminal's keyboard. The arm moves while a key is held.
//!
//! A terminal tells no release of a key, only its repetitions: a key counts as released when they end.

use std::{
    io::{self, IsTerminal, Read},
    process::{self, Command, Stdio},
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use anyhow::ensure;

/// Time after the first press within which the keyboard begins to repeat.
const FIRST_REPEAT: Duration = Duration::from_millis(600);
/// Time between repetitions, at most: twice that of a slow keyboard.
const REPEAT: Duration = Duration::from_millis(120);

/// Byte of Ctrl-C, and the exit status of who was interrupted.
const CTRL_C: u8 = 3;
const INTERRUPTED: i32 = 130;

/// State of the enabling key, for all threads.
#[derive(Debug, Clone)]
pub struct EnablingKey {
    began: Instant,
    /// Time from the beginning until which the key counts as held, in nanoseconds.
    held_until_ns: Arc<AtomicU64>,
}

impl Default for EnablingKey {
    fn default() -> Self {
        Self { began: Instant::now(), held_until_ns: Arc::default() }
    }
}

impl EnablingKey {
    /// Returns whether the key is held.
    pub fn is_held(&self) -> bool {
        self.is_held_after(self.began.elapsed())
    }

    /// Holds or releases the key.
    pub fn set(&self, is_held: bool) {
        self.held_until_ns.store(if is_held { u64::MAX } else { 0 }, Ordering::Relaxed);
    }

    fn is_held_after(&self, elapsed: Duration) -> bool {
        nanoseconds(elapsed) < self.held_until_ns.load(Ordering::Relaxed)
    }

    /// Takes notice of a press, or of a repetition.
    fn press(&self, elapsed: Duration) {
        let patience = if self.is_held_after(elapsed) { REPEAT } else { FIRST_REPEAT };
        self.held_until_ns.store(nanoseconds(elapsed + patience), Ordering::Relaxed);
    }

    /// The key of the terminal: any that is held, without echo. Ctrl-C ends the program.
    ///
    /// # Errors
    /// If the standard input is no terminal.
    pub fn of_terminal() -> anyhow::Result<Self> {
        ensure!(
            io::stdin().is_terminal(),
            "standard input: found no terminal, expected one: the arm moves while a key of it is held"
        );
        // Keys come one by one, Ctrl-C too: by a signal the terminal would stay so.
        stty(["-icanon", "-echo", "-isig"]);
        let key = Self::default();
        let pressed = key.clone();
        thread::spawn(move || {
            let mut byte = [0];
            while io::stdin().read(&mut byte).is_ok_and(|count| count > 0) {
                if byte == [CTRL_C] {
                    restore_terminal();
                    process::exit(INTERRUPTED);
                }
                pressed.press(pressed.began.elapsed());
            }
        });
        Ok(key)
    }
}

fn nanoseconds(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

/// Gives the terminal back its lines, echo and signals.
pub fn restore_terminal() {
    stty(["icanon", "echo", "isig"]);
}

fn stty(modes: [&str; 3]) {
    let _ = Command::new("stty").args(modes).stdin(Stdio::inherit()).status();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_held_while_it_repeats() {
        let key = EnablingKey::default();
        let mut time = Duration::from_secs(3);
        assert!(!key.is_held_after(time));
        key.press(time);
        assert!(key.is_held_after(time + FIRST_REPEAT * 9 / 10), "before the keyboard repeats");
        assert!(!key.is_held_after(time + FIRST_REPEAT), "pressed and released");
        time += FIRST_REPEAT / 2;
        for _ in 0..10 {
            key.press(time);
            time += REPEAT / 2;
            assert!(key.is_held_after(time));
        }
        assert!(!key.is_held_after(time + REPEAT / 2), "released");
        key.set(true);
        assert!(key.is_held());
        key.set(false);
        assert!(!key.is_held());
    }
}
