//! Simulated devices as processes of their own.

use std::{
    env,
    io::{BufRead, BufReader},
    net::TcpListener,
    path::{Path, PathBuf},
    process::{Child, ChildStdout, Command, Stdio},
};

use catch_body::JointVector;
use franka::{RealtimeConfig, Robot};

pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// An address of this machine that nobody uses.
pub fn free_address() -> String {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string()
}

pub fn port(address: &str) -> &str {
    address.rsplit_once(':').unwrap().1
}

/// A robot controller of franka-sim.
pub struct Server {
    pub child: Child,
    pub address: String,
    lines: BufReader<ChildStdout>,
}

impl Server {
    /// An arm alone, at `q`.
    pub fn start(q: &JointVector, more: &[&str]) -> Self {
        let address = free_address();
        let q: Vec<String> = q.iter().take(7).map(f64::to_string).collect();
        let robot = root().join("assets/robots/fr3").display().to_string();
        let arguments = [robot, port(&address).to_owned(), format!("--q={}", q.join(","))];
        Self::run("server.py", address, arguments.iter().map(String::as_str).chain(more.iter().copied()))
    }

    /// Runs a script, and waits until it listens.
    pub fn run<'a>(script: &str, address: String, arguments: impl Iterator<Item = &'a str>) -> Self {
        let python =
            env::var_os("FRANKA_PYTHON").map_or_else(|| root().join("target/franka/venv/bin/python"), PathBuf::from);
        let mut child = Command::new(python)
            .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("lockstep").join(script))
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("drivers/catch_franka/test installs franka-sim");
        let lines = BufReader::new(child.stdout.take().unwrap());
        let mut server = Self { child, address, lines };
        assert_eq!(server.line(), "ready\n", "{script}");
        server
    }

    /// The next line that it prints.
    pub fn line(&mut self) -> String {
        let mut line = String::new();
        self.lines.read_line(&mut line).unwrap();
        line
    }

    pub fn connect(&self) -> Robot {
        Robot::new(&self.address, RealtimeConfig::Ignore).unwrap()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
