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
    let mut run = Command::new(env!("CARGO_BIN_EXE_catchingbot"))
        .args(["eval", "--watch", "--scenario", "paper", "--object", "banana", "--trials", "100000", "--threads", "1"])
        .args(["--out", folder.path().join("out").to_str().unwrap()])
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut told = BufReader::new(run.stderr.take().unwrap());
    let _run = Watched(run);
    let mut line = String::new();
    told.read_line(&mut line).unwrap();
    let address = line.trim().strip_prefix("Watch it: http://").unwrap_or_else(|| panic!("{line}")).to_owned();
    let (host, path) = address.split_once('/').unwrap();
    assert!(host.starts_with("127.0.0.1:") && path.len() == 33, "{address}");
    let ask = |what: &str| answer(host, &format!("GET /{path}{what} HTTP/1.1\r\nHost: {host}\r\n\r\n"));
    let state = || serde_json::from_str::<Value>(ask("state").split_once("\r\n\r\n").unwrap().1).unwrap();
    let mut seen = state();
    for _ in 0..600 {
        if seen["thrown"].as_u64() > Some(1) {
            break;
        }
        thread::sleep(Duration::from_millis(100));
        seen = state();
    }
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
