//! Work on plain threads.
//!
//! Trials use rayon inside (images, pose estimates). While a thread of a work-stealing pool waits for such inner work,
//! it would begin another trial, whose time would count towards the decision of the first. So trials run on their own
//! threads.

use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Result, anyhow};

/// Runs `work` for every item, in order, on `jobs` threads (at least one, and no more than items). After an error the other threads finish
/// their item and stop.
pub fn for_each<T: Sync>(jobs: usize, items: &[T], work: impl Fn(usize, &T) -> Result<()> + Sync) -> Result<()> {
    let next = AtomicUsize::new(0);
    let worker = || -> Result<()> {
        loop {
            let n = next.fetch_add(1, Ordering::Relaxed);
            let Some(item) = items.get(n) else { return Ok(()) };
            work(n, item).inspect_err(|_| next.store(items.len(), Ordering::Relaxed))?;
        }
    };
    std::thread::scope(|scope| {
        // A thread without an item would have nothing to do.
        let workers: Vec<_> = (0..jobs.clamp(1, items.len().max(1))).map(|_| scope.spawn(worker)).collect();
        workers.into_iter().try_for_each(|worker| worker.join().map_err(|_| anyhow!("a worker panicked"))?)
    })
}

/// Returns the number of threads that the machine can run at once.
pub fn available_threads() -> usize {
    std::thread::available_parallelism().map_or(1, |threads| threads.get())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::sync::Mutex;

    use super::*;

    #[test]
    fn every_item_is_worked_on_once() {
        let items: Vec<usize> = (0..100).collect();
        for jobs in [0, 1, 3] {
            let done = Mutex::new(Vec::new());
            for_each(jobs, &items, |n, item| {
                assert_eq!(n, *item);
                done.lock().unwrap().push(n);
                Ok(())
            })
            .unwrap();
            let done = done.into_inner().unwrap();
            assert_eq!((done.len(), done.iter().collect::<BTreeSet<_>>().len()), (100, 100));
        }
    }

    /// One thread works in order and does nothing after an error.
    #[test]
    fn an_error_stops_the_work() {
        let done = Mutex::new(Vec::new());
        let error = for_each(1, &[1, 2, 3, 4], |_, item| {
            done.lock().unwrap().push(*item);
            if *item == 3 { Err(anyhow!("three")) } else { Ok(()) }
        });
        assert_eq!(error.unwrap_err().to_string(), "three");
        assert_eq!(done.into_inner().unwrap(), [1, 2, 3]);
    }
}
