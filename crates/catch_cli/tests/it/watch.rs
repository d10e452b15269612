//! `--watch` as a stranger on the same machine meets it: who knows the address and comes from nowhere else is
//! answered, nobody else is.

use std::{
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    process::{Child, Command, Stdio},
    thread,
    time::Duration,
};

use serde_json::Value;

/// A run that is watched, which ends with the test.
struct Watched(Child);

impl Drop for Watched {
    fn drop(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

/// Starts a command that is watched, and waits for the address of its page.
fn watched(command: &mut Command) -> (Watched, String) {
    let command = command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").stdout(Stdio::null());
    let mut run = command.stderr(Stdio::piped()).spawn().unwrap();
    let mut told = BufReader::new(run.stderr.take().unwrap());
    let run = Watched(run);
    let mut line = String::new();
    told.read_line(&mut line).unwrap();
    // What it says later is read, so that it may say more than a pipe holds.
    thread::spawn(move || told.lines().count());
    let address = line.trim().strip_prefix("Watch it: http://").unwrap_or_else(|| panic!("{line}"));
    (run, address.to_owned())
}

/// Asks for the state until so many throws are over.
fn state_after(thrown: u64, state: impl Fn() -> Value) -> Value {
    for _ in 0..600 {
        let seen = state();
        if seen["thrown"].as_u64() >= Some(thrown) {
            return seen;
        }
        thread::sleep(Duration::from_millis(100));
    }
    panic!("{}", state());
}

/// What is answered to a request as it stands.
fn answer(host: &str, request: &str) -> String {
    let mut stream = TcpStream::connect(host).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = String::new();
    // One who is turned away may find the line cut.
    let _ = stream.read_to_string(&mut answer);
    answer
}

#[test]
fn the_page_follows_and_strangers_get_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_catchingbot"));
    command
        .args(["eval", "--watch", "--scenario", "paper", "--object", "banana", "--trials", "100000", "--threads", "1"])
        .args(["--out", folder.path().join("out").to_str().unwrap()]);
    let (_run, address) = watched(&mut command);
    let (host, path) = address.split_once('/').unwrap();
    assert!(host.starts_with("127.0.0.1:") && path.len() == 33, "{address}");
    let ask = |what: &str| answer(host, &format!("GET /{path}{what} HTTP/1.1\r\nHost: {host}\r\n\r\n"));
    let state = || serde_json::from_str::<Value>(ask("state").split_once("\r\n\r\n").unwrap().1).unwrap();
    let seen = state_after(2, state);
    let (thrown, caught) = (seen["thrown"].as_u64().unwrap(), seen["caught"].as_u64().unwrap());
    assert!(thrown > 1 && seen["total"] == 100_000 && seen["is_over"] == false, "{seen}");
    assert_eq!(thrown - caught, seen["misses"].as_array().unwrap().len() as u64, "{seen}");
    assert!(ask("").contains("connect-src 'self'"), "the page may ask for the state");
    let page = ask(&format!("throw?{}", seen["last"]["number"]));
    assert!(page.starts_with("HTTP/1.1 200 OK\r\n") || state()["thrown"].as_u64() > Some(thrown), "{page:.200}");

    let wrong = format!("GET /{}x/state HTTP/1.1\r\nHost: {host}\r\n\r\n", &path[..31]);
    assert_eq!(answer(host, &wrong), "");
    let asks = |headers: &str| answer(host, &format!("GET /{path}state HTTP/1.1\r\n{headers}\r\n\r\n"));
    assert!(asks(&format!("Host: {host}\r\nOrigin: http://{host}")).starts_with("HTTP/1.1 200 OK"));
    for headers in
        ["Host: example.org".to_owned(), format!("Host: {host}\r\nOrigin: http://example.org"), String::new()]
    {
        assert_eq!(asks(&headers), "", "{headers}");
    }
    assert_eq!(ask(&format!("throw?{}", u64::MAX)), "", "a throw that never was");
    assert_eq!(answer(host, &format!("GET /{path}{} HTTP/1.1\r\n", "x".repeat(20_000))), "", "a request without end");
}

#[cfg(unix)]
#[test]
fn what_a_driver_records_is_shown() {
    use std::{fs, os::unix::fs::PermissionsExt};

    let folder = tempfile::tempdir().unwrap();
    let catchingbot = || {
        let mut command = Command::new(env!("CARGO_BIN_EXE_catchingbot"));
        command.current_dir(folder.path());
        command
    };
    for arguments in ["new cell my_cell", "catch --out thrown --json"] {
        assert!(catchingbot().args(arguments.split(' ')).output().unwrap().status.success(), "{arguments}");
    }
    let recordings = fs::read_dir(folder.path().join("thrown")).unwrap().map(|it| it.unwrap().path());
    let recording = recordings.into_iter().find(|it| it.extension().is_some_and(|it| it == "catch")).unwrap();
    let driver = folder.path().join("recorder");
    fs::write(&driver, format!("#!/bin/sh\necho hold a key\necho recorded: {}\nsleep 60\n", recording.display()))
        .unwrap();
    let quick = fs::read_to_string(&driver).unwrap().replace("sleep 60", "exit 0");
    fs::set_permissions(&driver, fs::Permissions::from_mode(0o755)).unwrap();
    let cell = folder.path().join("my_cell.toml");
    let text = fs::read_to_string(&cell).unwrap().replace("\"catch_franka\"", &format!("{driver:?}"));
    fs::write(&cell, text).unwrap();
    let (_run, address) = watched(catchingbot().args(["drive", "my_cell.toml", "--dry-run", "--watch"]));
    let (host, path) = address.split_once('/').unwrap();
    let ask = |what: &str| answer(host, &format!("GET /{path}{what} HTTP/1.1\r\nHost: {host}\r\n\r\n"));
    let seen = state_after(1, || serde_json::from_str(ask("state").split_once("\r\n\r\n").unwrap().1).unwrap());
    assert!(seen["total"].is_null() && seen["misses"] == Value::Array(Vec::new()), "nobody judges: {seen}");
    assert!(ask("throw?1").contains("<title>"), "the recording's page");

    // The running shell reads on in its own file.
    fs::remove_file(&driver).unwrap();
    fs::write(&driver, quick).unwrap();
    fs::set_permissions(&driver, fs::Permissions::from_mode(0o755)).unwrap();
    let output = catchingbot().args(["drive", "my_cell.toml", "--json"]).output().unwrap();
    let document: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(document["recordings"][0], recording.to_str().unwrap());
    assert!(String::from_utf8(output.stderr).unwrap().contains("hold a key"), "what the driver says");
}
