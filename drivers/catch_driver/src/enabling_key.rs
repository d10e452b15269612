//! The enabling key: a dead man's switch on the terminal's keyboard. The arm moves while a key is held.
//!
//! A terminal tells no release of a key, only its repetitions: a key counts as released when they end.

use std::{
    io::{self, IsTerminal, Read},
    process::{self, Command, Stdio},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc,
    },
    thread,
    time::Duration,
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
#[derive(Debug, Clone, Default)]
pub struct EnablingKey(Arc<AtomicBool>);

impl EnablingKey {
    /// Returns whether the key is held.
    pub fn is_held(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Holds or releases the key.
    pub fn set(&self, is_held: bool) {
        self.0.store(is_held, Ordering::Relaxed);
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
        let (pressed, presses) = mpsc::channel();
        thread::spawn(move || {
            let mut byte = [0];
            while io::stdin().read(&mut byte).is_ok_and(|count| count > 0) {
                if byte == [CTRL_C] {
                    restore_terminal();
                    process::exit(INTERRUPTED);
                }
                if pressed.send(()).is_err() {
                    break;
                }
            }
        });
        let key = Self::default();
        let held = key.clone();
        thread::spawn(move || held.follow(&presses));
        Ok(key)
    }

    /// Follows key presses until their sender is gone.
    fn follow(&self, presses: &mpsc::Receiver<()>) {
        while presses.recv().is_ok() {
            self.set(true);
            let mut patience = FIRST_REPEAT;
            while presses.recv_timeout(patience).is_ok() {
                patience = REPEAT;
            }
            self.set(false);
        }
    }
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
        let (pressed, presses) = mpsc::channel();
        let held = key.clone();
        let thread = thread::spawn(move || held.follow(&presses));
        assert!(!key.is_held());
        pressed.send(()).unwrap();
        thread::sleep(FIRST_REPEAT / 2);
        assert!(key.is_held(), "before the keyboard repeats");
        for _ in 0..10 {
            pressed.send(()).unwrap();
            thread::sleep(REPEAT / 4);
            assert!(key.is_held());
        }
        thread::sleep(REPEAT * 2);
        assert!(!key.is_held(), "released");
        drop(pressed);
        thread.join().unwrap();
    }
}
