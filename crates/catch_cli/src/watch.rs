//! `--watch`: a page that follows a run while it lasts: counts, misses as they come, the throws themselves.
//!
//! It is served to this machine alone. Its address holds a secret; a request without it, for another host or
//! from another page gets nothing, not even an answer. The page asks twice a second; what it shows of a
//! throw is made when it asks, so a run that nobody watches costs nothing. It ends with the program.

use std::{
    collections::VecDeque,
    env,
    hash::{BuildHasher, RandomState},
    io::{self, Read, Write},
    net::{Ipv4Addr, TcpListener, TcpStream},
    path::Path,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use catch_lab::{recording::recorded_throw, referee::reason::Reason, scenario::setup::Setup};
use catch_recording::whole_file;
use catch_view::{
    pages::{self, catch_page},
    playback::Playback,
};
use serde::Serialize;

use crate::{opening, screen};

const PAGE: &str = include_str!("watch/watch.html");
/// Misses that the page lists, the last ones.
const MOST_MISSES: usize = 100;
/// Requests that are answered at the same time, and the longest one.
const MOST_REQUESTS: usize = 8;
const LONGEST_REQUEST: u64 = 8_192;
/// Longest time for a request to arrive and for its answer to leave.
const PATIENCE: Duration = Duration::from_secs(5);
/// Longest time that the program waits in the end until the page has shown the last throw.
const FAREWELL: Duration = Duration::from_secs(10);

/// Makes the page of a throw.
type Source = Arc<dyn Fn() -> anyhow::Result<String> + Send + Sync>;

/// A throw that is over.
#[derive(Clone, Serialize)]
struct Throw {
    /// Number in the run, from 1 on.
    number: usize,
    label: String,
    /// Reason of a miss.
    reason: Option<String>,
    #[serde(skip)]
    source: Source,
}

/// State of the run as the page shows it.
#[derive(Serialize)]
struct State {
    title: String,
    /// Throws of the run; none where they come as they come, and nobody judges them.
    total: Option<usize>,
    thrown: usize,
    caught: usize,
    last: Option<Throw>,
    misses: VecDeque<Throw>,
    is_over: bool,
    /// Last throw whose page was asked for.
    #[serde(skip)]
    shown: usize,
}

/// A run with its page.
pub struct Watch {
    state: Arc<Mutex<State>>,
}

impl Watch {
    /// Begins to serve the page of `total` throws if it is wanted, says where, and opens it. No total means
    /// throws that come as they come and that nobody judges.
    ///
    /// # Errors
    /// If the system lets nobody listen.
    pub fn start(is_wanted: bool, title: &str, total: Option<usize>) -> io::Result<Option<Self>> {
        if !is_wanted {
            return Ok(None);
        }
        let (title, last, misses) = (title.to_owned(), None, VecDeque::new());
        let state = State { title, total, thrown: 0, caught: 0, last, misses, is_over: false, shown: 0 };
        let state = Arc::new(Mutex::new(state));
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
        let host = listener.local_addr()?.to_string();
        // Each is seeded by the system.
        let secret: String = (0..2).map(|i| format!("{:016x}", RandomState::new().hash_one(i))).collect();
        let address = format!("http://{host}/{secret}/");
        let (shared, busy) = (state.clone(), Arc::new(AtomicUsize::new(0)));
        let serve = move || {
            for stream in listener.incoming().flatten() {
                let (state, busy, host, secret) = (shared.clone(), busy.clone(), host.clone(), secret.clone());
                if busy.fetch_add(1, Ordering::Relaxed) < MOST_REQUESTS {
                    // A browser that goes away is no fault.
                    thread::spawn(move || {
                        let _ = answer(stream, &state, (&host, &secret));
                        busy.fetch_sub(1, Ordering::Relaxed)
                    });
                } else {
                    busy.fetch_sub(1, Ordering::Relaxed);
                }
            }
        };
        thread::Builder::new().spawn(serve)?;
        screen::note(&format!("Watch it: {address}"));
        opening::open_address(&address);
        Ok(Some(Self { state }))
    }

    /// Counts a throw, and keeps what makes its page.
    pub fn thrown(
        &self,
        label: String,
        reason: Option<Reason>,
        source: impl Fn() -> anyhow::Result<String> + Send + Sync + 'static,
    ) {
        let mut state = locked(&self.state);
        state.thrown += 1;
        let reason = reason.map(|it| it.to_string());
        let throw = Throw { number: state.thrown, label, reason, source: Arc::new(source) };
        if throw.reason.is_some() {
            state.misses.push_front(throw.clone());
            state.misses.truncate(MOST_MISSES);
        } else {
            state.caught += 1;
        }
        state.last = Some(throw);
    }

    /// Ends the run: waits a little until a page that follows has shown the last throw.
    pub fn end(self) {
        locked(&self.state).is_over = true;
        let started = Instant::now();
        let is_waiting = || {
            let state = locked(&self.state);
            state.shown < state.thrown && (state.shown > 0 || opening::has_display())
        };
        while is_waiting() && started.elapsed() < FAREWELL {
            thread::sleep(Duration::from_millis(50));
        }
    }
}

/// Makes the page of a recording.
pub fn recorded(path: &Path) -> anyhow::Result<String> {
    Ok(catch_page::page(&Playback::read(path)?))
}

/// Makes the page of a throw by throwing once more, which gives the same again.
pub fn again(setup: &Setup, seed: u64, index: u64) -> anyhow::Result<String> {
    let folder = whole_file::unfinished_folder(&env::temp_dir().join("catchingbot-watch"))?;
    let thrown = recorded_throw::record(setup, seed, index, folder.path(), &mut |_| Ok(()))?;
    recorded(&thrown.recording)
}

fn locked(state: &Mutex<State>) -> MutexGuard<'_, State> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Answers one request, or closes without a word.
fn answer(mut stream: TcpStream, state: &Mutex<State>, (host, secret): (&str, &str)) -> io::Result<()> {
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut request = Vec::new();
    let mut limited = io::Read::by_ref(&mut stream).take(LONGEST_REQUEST);
    let mut piece = [0; 1024];
    while !request.windows(4).any(|it| it == b"\r\n\r\n") {
        match limited.read(&mut piece)? {
            0 => return Ok(()),
            count => request.extend_from_slice(&piece[..count]),
        }
    }
    let request = String::from_utf8_lossy(&request);
    let Some(path) = path_of(&request, host, secret) else { return Ok(()) };
    let (kind, content) = match path {
        "" => ("text/html", page()),
        "state" => ("application/json", serde_json::to_string(&*locked(state))?),
        _ => match path.strip_prefix("throw?").and_then(|it| it.parse().ok()).and_then(|it| throw(state, it)) {
            Some(page) => ("text/html", page),
            None => return Ok(()),
        },
    };
    write!(
        stream,
        "HTTP/1.1 200 OK\r\nContent-Type: {kind}; charset=utf-8\r\nContent-Length: {}\r\nCache-Control: no-store\r\n\
         Referrer-Policy: no-referrer\r\nX-Content-Type-Options: nosniff\r\nX-Frame-Options: SAMEORIGIN\r\n\
         Connection: close\r\n\r\n{content}",
        content.len()
    )
}

/// What is asked for, behind the secret; `None` for whoever does not know it, or comes from elsewhere.
fn path_of<'a>(request: &'a str, host: &str, secret: &str) -> Option<&'a str> {
    let mut lines = request.split("\r\n");
    let path = lines.next()?.strip_prefix("GET /")?.strip_suffix(" HTTP/1.1")?;
    let headers: Vec<(&str, &str)> = lines.filter_map(|it| it.split_once(':')).map(|(a, b)| (a, b.trim())).collect();
    let values = |name: &'static str| headers.iter().filter(move |it| it.0.eq_ignore_ascii_case(name)).map(|it| it.1);
    let is_ours = values("host").eq([host])
        && values("origin").all(|it| it.strip_prefix("http://") == Some(host))
        && values("sec-fetch-site").all(|it| ["same-origin", "none"].contains(&it));
    path.strip_prefix(secret)?.strip_prefix('/').filter(|_| is_ours)
}

fn page() -> String {
    pages::document("Watching", "watch", "", PAGE)
        .replace("default-src 'none'", "default-src 'none'; connect-src 'self'; frame-src 'self'")
}

/// The page of a throw that is still known.
fn throw(state: &Mutex<State>, number: usize) -> Option<String> {
    let source = {
        let state = locked(state);
        state.last.iter().chain(&state.misses).find(|it| it.number == number)?.source.clone()
    };
    let page = source().ok()?;
    locked(state).shown = number;
    Some(page)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_who_knows_the_secret_and_comes_from_the_page_is_answered() {
        let ask = |path: &str, headers: &str| {
            path_of(&format!("GET {path} HTTP/1.1\r\n{headers}\r\n\r\n"), "127.0.0.1:8000", "5ec7e7").map(str::to_owned)
        };
        let ours = "Host: 127.0.0.1:8000";
        assert_eq!(ask("/5ec7e7/", ours).as_deref(), Some(""));
        assert_eq!(
            ask("/5ec7e7/throw?3", &format!("{ours}\r\nOrigin: http://127.0.0.1:8000")).as_deref(),
            Some("throw?3")
        );
        for path in ["/", "/5ec7e8/", "/5ec7e7", "/../5ec7e7/", "5ec7e7/"] {
            assert_eq!(ask(path, ours), None, "{path}");
        }
        for headers in [
            "",
            "Host: localhost:8000",
            "Host: evil.example:8000",
            "Host: 127.0.0.1:8000\r\nHost: evil.example",
            "Host: 127.0.0.1:8000\r\nOrigin: http://evil.example",
            "Host: 127.0.0.1:8000\r\nOrigin: null",
            "Host: 127.0.0.1:8000\r\nSec-Fetch-Site: cross-site",
        ] {
            assert_eq!(ask("/5ec7e7/state", headers), None, "{headers}");
        }
        assert_eq!(path_of("POST /5ec7e7/ HTTP/1.1\r\nHost: 127.0.0.1:8000\r\n\r\n", "127.0.0.1:8000", "5ec7e7"), None);
    }
}
