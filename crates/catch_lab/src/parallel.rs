//! Work on several threads, its results in order.

use std::{
    sync::{
        Mutex,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
};

/// One for each core.
pub fn threads() -> usize {
    thread::available_parallelism().map_or(1, usize::from)
}

/// The results of `job` for 0 to `count`, in that order, by one thread for each core.
pub fn map<T: Send>(count: usize, job: impl Fn(usize) -> T + Sync) -> Vec<T> {
    map_on(threads(), count, job)
}

/// Maps over this number of threads, or as many as the system allows.
pub fn map_on<T: Send>(threads: usize, count: usize, job: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::with_capacity(count));
    let work = || {
        loop {
            let at = next.fetch_add(1, Ordering::Relaxed);
            if at >= count {
                return;
            }
            let result = job(at);
            done.lock().expect("no thread panics while it holds the lock").push((at, result));
        }
    };
    thread::scope(|scope| {
        // This one, and others.
        let others = (1..threads.min(count)).take_while(|_| thread::Builder::new().spawn_scoped(scope, work).is_ok());
        others.for_each(drop);
        work();
    });
    let mut done = done.into_inner().expect("all threads have ended");
    done.sort_by_key(|(at, _)| *at);
    done.into_iter().map(|(_, result)| result).collect()
}

#[cfg(test)]
mod tests {
    #[test]
    fn results_are_in_order() {
        assert_eq!(super::map(100, |it| it * it), (0..100).map(|it| it * it).collect::<Vec<_>>());
    }
}
