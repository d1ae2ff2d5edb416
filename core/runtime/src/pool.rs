//! Parallel work of processes in fixed chunks, so that the number of threads does not change results.

use rayon::prelude::*;

/// A pool of threads; with one thread, everything runs on the caller's.
pub struct Pool {
    threads: usize,
    inner: Option<rayon::ThreadPool>,
}

impl Pool {
    /// A pool of this many threads, at least one. If threads cannot be created, everything runs on the caller's.
    pub fn new(threads: usize) -> Self {
        Self::starting_with(threads, || {})
    }

    /// Like [`Pool::new`]; each thread first calls `start`.
    pub(crate) fn starting_with(threads: usize, start: impl Fn() + Send + Sync + 'static) -> Self {
        let builder = rayon::ThreadPoolBuilder::new().num_threads(threads).start_handler(move |_| start());
        let inner = (threads > 1).then(|| builder.build().ok()).flatten();
        Self { threads: if inner.is_some() { threads } else { 1 }, inner }
    }

    /// Number of threads.
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
        match &self.inner {
            Some(pool) => pool.install(|| {
                data.par_chunks_mut(chunk_len).enumerate().for_each(|(index, chunk)| f(index, chunk));
            }),
            None => data.chunks_mut(chunk_len).enumerate().for_each(|(index, chunk)| f(index, chunk)),
        }
    }

    /// The results `f(0), f(1), … f(count − 1)` in that order, computed in any order.
    pub fn map<R: Send>(&self, count: usize, f: impl Fn(usize) -> R + Sync + Send) -> Vec<R> {
        match &self.inner {
            Some(pool) => pool.install(|| (0..count).into_par_iter().map(f).collect()),
            None => (0..count).map(f).collect(),
        }
    }
}
