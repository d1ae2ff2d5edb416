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
