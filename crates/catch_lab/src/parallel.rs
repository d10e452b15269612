//! Work on several threads, its results in order.

use std::{
    collections::BTreeMap,
    convert::Infallible,
    ops::Range,
    sync::{
        atomic::{AtomicUsize, Ordering},
        mpsc,
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
    let mut results = Vec::with_capacity(count);
    let Ok(()) = in_order(threads, 0..count, job, &mut |result| {
        results.push(result);
        Ok::<_, Infallible>(())
    });
    results
}

/// Hands over the results of `job` for all of `numbers`, in their order and each as soon as it can be, from
/// this number of threads, or as many as the system allows.
///
/// # Errors
/// The first of `done`; the jobs that are running then are given up.
pub fn in_order<T: Send, E>(
    threads: usize,
    numbers: Range<usize>,
    job: impl Fn(usize) -> T + Sync,
    done: &mut dyn FnMut(T) -> Result<(), E>,
) -> Result<(), E> {
    let next = AtomicUsize::new(numbers.start);
    let (sender, receiver) = mpsc::channel();
    thread::scope(|scope| {
        let started = (0..threads.clamp(1, numbers.len().max(1))).take_while(|_| {
            let (next, job, sender, end) = (&next, &job, sender.clone(), numbers.end);
            let work = move || {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    // Nobody receives any more once a result could not be taken.
                    if number >= end || sender.send((number, job(number))).is_err() {
                        return;
                    }
                }
            };
            thread::Builder::new().spawn_scoped(scope, work).is_ok()
        });
        if started.count() == 0 {
            // The system allows no other thread.
            return numbers.map(&job).try_for_each(done);
        }
        drop(sender);
        let (mut waiting, mut due) = (BTreeMap::new(), numbers.start);
        for (number, result) in receiver {
            waiting.insert(number, result);
            while let Some(result) = waiting.remove(&due) {
                due += 1;
                done(result)?;
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    #[test]
    fn results_are_in_order() {
        assert_eq!(super::map(100, |it| it * it), (0..100).map(|it| it * it).collect::<Vec<_>>());
    }
}
