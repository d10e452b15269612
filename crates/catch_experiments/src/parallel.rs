//! Trials on all cores, their results in order.

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

/// The results of `job` for 0 to `count`, in that order, whatever the number of cores.
pub fn map<T: Send>(count: usize, job: impl Fn(usize) -> T + Sync) -> Vec<T> {
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
        // As many others as the system allows, and this one.
        let others = (1..threads()).take_while(|_| thread::Builder::new().spawn_scoped(scope, work).is_ok());
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
