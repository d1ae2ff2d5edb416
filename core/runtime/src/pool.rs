//! Parallel work of processes in fixed chunks, so that the number of threads does not change results.

use std::sync::{Mutex, PoisonError};

/// Threads that help with the work of processes. The thread that has the work takes part in it; with one thread,
/// everything runs on the caller's.
///
/// A helper takes the chunks of one work until none is left, and never begins another work in between, as a
/// work-stealing join does while it waits: then the end of one process's work would wait for that of another one.
pub struct Pool {
    threads: usize,
    /// One thread less, for the caller's.
    helpers: Option<rayon::ThreadPool>,
}

impl Pool {
    /// A pool of this many threads, at least one. If threads cannot be created, everything runs on the caller's.
    pub fn new(threads: usize) -> Self {
        Self::starting_with(threads, || {})
    }

    /// Like [`Pool::new`]; each thread but the caller's first calls `start`.
    pub(crate) fn starting_with(threads: usize, start: impl Fn() + Send + Sync + 'static) -> Self {
        let helpers = threads.saturating_sub(1);
        let builder = rayon::ThreadPoolBuilder::new().num_threads(helpers).start_handler(move |_| start());
        let helpers = (helpers > 0).then(|| builder.build().ok()).flatten();
        Self { threads: if helpers.is_some() { threads } else { 1 }, helpers }
    }

    /// Number of threads, with the caller's.
    pub fn threads(&self) -> usize {
        self.threads
    }

    /// Calls `f(index, chunk)` for each chunk of `chunk_len` elements (the last may be shorter), in any order.
    ///
    /// # Panics
    /// If `chunk_len` is 0.
    pub fn for_each_chunk_mut<T: Send>(
        &self,
        data: &mut [T],
        chunk_len: usize,
        f: impl Fn(usize, &mut [T]) + Sync + Send,
    ) {
        let chunks = data.chunks_mut(chunk_len).enumerate();
        let Some(helpers) = self.helpers.as_ref().filter(|_| chunks.len() > 1) else {
            chunks.for_each(|(index, chunk)| f(index, chunk));
            return;
        };
        let useful = chunks.len().min(self.threads) - 1;
        let todo = Mutex::new(chunks);
        let work = || {
            loop {
                let next = todo.lock().unwrap_or_else(PoisonError::into_inner).next();
                let Some((index, chunk)) = next else { break };
                f(index, chunk);
            }
        };
        helpers.in_place_scope(|scope| {
            (0..useful).for_each(|_| scope.spawn(|_| work()));
            work();
        });
    }

    /// The results `f(0), f(1), … f(count − 1)` in that order, computed in any order.
    pub fn map<R: Send>(&self, count: usize, f: impl Fn(usize) -> R + Sync + Send) -> Vec<R> {
        let mut results: Vec<Option<R>> = (0..count).map(|_| None).collect();
        self.for_each_chunk_mut(&mut results, 1, |index, result| {
            result.fill_with(|| Some(f(index)));
        });
        results.into_iter().flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::AssertUnwindSafe;

    #[test]
    fn callers_at_the_same_time_each_get_all_their_chunks_once_and_in_place() {
        for threads in [1, 2, 4] {
            let pool = Pool::new(threads);
            assert_eq!(pool.threads(), threads);
            std::thread::scope(|scope| {
                for caller in 0..4_usize {
                    let pool = &pool;
                    scope.spawn(move || {
                        for len in [0, 1, 7, 64] {
                            let mut data = vec![0_usize; len];
                            pool.for_each_chunk_mut(&mut data, 3, |index, chunk| {
                                for value in chunk {
                                    *value += 1 + index + 1000 * caller;
                                }
                            });
                            let expected: Vec<usize> =
                                (0..len).map(|at| 1 + at / 3 + 1000 * caller).collect();
                            assert_eq!(data, expected);
                            let squares = pool.map(len, |index| index * index);
                            assert_eq!(squares, (0..len).map(|index| index * index).collect::<Vec<_>>());
                        }
                    });
                }
            });
        }
    }

    #[test]
    fn a_panic_in_a_chunk_reaches_the_caller_and_the_pool_goes_on() {
        let pool = Pool::new(3);
        let work = AssertUnwindSafe(|| pool.map(16, |index| assert!(index != 5, "chunk {index}")));
        let caught = std::panic::catch_unwind(work);
        assert!(caught.is_err());
        assert_eq!(pool.map(4, |index| index), [0, 1, 2, 3]);
    }
}
