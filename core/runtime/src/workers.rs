//! Cycles that compute in parallel with the executor.
//!
//! A cycle uses the inputs that were captured at its start, and its output becomes visible after its latency. Nothing
//! can depend on it in between. So its node is handed to a thread of the [`Workers`] together with the captured inputs,
//! and returned when it is needed: when its output becomes visible, at its next capture, for a snapshot, for a summary.
//! Only the executor decides the order of captures and publications, so the results are the same with any number of
//! threads.

use crate::node::{Node, Output};
use crate::pool::Pool;
use crate::summary::CycleTimes;
use rcs_msg::Stamp;
use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

/// The output of a cycle, available when it has ended.
pub(crate) type PendingOutput = Arc<OnceLock<Output>>;

/// Location of a node: with the executor, or with the workers for a cycle.
pub(crate) struct Slot(Mutex<Inner>);

struct Inner {
    place: Place,
    times: CycleTimes,
    period_ns: u64,
}

enum Place {
    Here(Box<Node>),
    Away(Arc<Job>),
}

impl Inner {
    /// The node; waits for its cycle.
    fn settle(&mut self) -> &mut Node {
        if let Place::Away(job) = &self.place {
            let (node, took_ns) = job.finish();
            self.place = Place::Here(node);
            self.count(took_ns);
        }
        match &mut self.place {
            Place::Here(node) => node,
            Place::Away(_) => unreachable!("it has just come back"),
        }
    }

    fn count(&mut self, took_ns: Option<u64>) {
        if let Some(took_ns) = took_ns {
            self.times.count(took_ns, self.period_ns);
        }
    }
}

impl Slot {
    pub(crate) fn new(node: Node) -> Self {
        let period_ns = node.period_ns;
        Self(Mutex::new(Inner {
            place: Place::Here(Box::new(node)),
            times: CycleTimes::default(),
            period_ns,
        }))
    }

    /// The node; waits for its cycle.
    pub(crate) fn get(&mut self) -> &mut Node {
        self.inner().settle()
    }

    /// Reads the node and its measured times; waits for its cycle.
    pub(crate) fn look<R>(&self, f: impl FnOnce(&Node, &CycleTimes) -> R) -> R {
        let mut inner = lock(&self.0);
        inner.settle();
        let Inner { place: Place::Here(node), times, .. } = &*inner else {
            unreachable!("it has just come back")
        };
        f(node, times)
    }

    /// Whether its cycle is computing.
    pub(crate) fn is_computing(&self) -> bool {
        match &lock(&self.0).place {
            Place::Here(_) => false,
            Place::Away(job) => !matches!(*lock(&job.state), JobState::Done(..)),
        }
    }

    /// Measured times of the cycles known to have ended; does not wait.
    pub(crate) fn times(&self) -> CycleTimes {
        lock(&self.0).times
    }

    /// Replaces the measured times: those of another moment count from now on.
    pub(crate) fn set_times(&mut self, times: CycleTimes) {
        self.inner().times = times;
    }

    /// The node itself, for an executor that keeps it.
    pub(crate) fn into_node(self) -> Node {
        match self.0.into_inner().unwrap_or_else(PoisonError::into_inner).place {
            Place::Here(node) => *node,
            Place::Away(job) => *job.finish().0,
        }
    }

    /// Runs the cycle for which the node has captured its inputs on this thread. The output stays in the node.
    pub(crate) fn run(&mut self, now: Stamp, pool: &Pool) -> &mut Node {
        let inner = self.inner();
        let is_measured = inner.times.begin();
        let took_ns = run(inner.settle(), now, pool, is_measured);
        inner.count(took_ns);
        inner.settle()
    }

    /// Hands the cycle for which the node has captured its inputs to the workers. `due` is its priority.
    pub(crate) fn send(&mut self, workers: &Workers, work: CycleWork, due: (Stamp, u64)) {
        let inner = self.inner();
        inner.settle();
        let job = Arc::new(Job {
            state: Mutex::new(JobState::Taken),
            done: Condvar::new(),
            work,
            is_measured: inner.times.begin(),
            pool: Arc::clone(&workers.pool),
        });
        if let Place::Here(node) = std::mem::replace(&mut inner.place, Place::Away(Arc::clone(&job))) {
            *lock(&job.state) = JobState::Waiting(node);
        }
        workers.push(Queued { due, job });
    }

    fn inner(&mut self) -> &mut Inner {
        self.0.get_mut().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Runs one cycle; returns its duration if that is to be measured.
fn run(node: &mut Node, now: Stamp, pool: &Pool, is_measured: bool) -> Option<u64> {
    let clock = is_measured.then(Instant::now);
    node.run(now, pool);
    clock.map(|clock| clock.elapsed().as_nanos() as u64)
}

/// One cycle of a node.
pub(crate) struct CycleWork {
    /// Start time of the cycle.
    pub(crate) now: Stamp,
    /// Receives the output.
    pub(crate) output: PendingOutput,
}

impl CycleWork {
    /// Passes on the output of the cycle that has just run.
    pub(crate) fn keep(&self, node: &mut Node) {
        // Set once, because a cycle runs once.
        let _ = self.output.set(node.take_output(self.now));
    }
}

struct Job {
    state: Mutex<JobState>,
    done: Condvar,
    work: CycleWork,
    is_measured: bool,
    pool: Arc<Pool>,
}

enum JobState {
    Waiting(Box<Node>),
    Running,
    /// With its duration, if it was measured.
    Done(Box<Node>, Option<u64>),
    /// The executor has taken the node back, or has not handed it over yet.
    Taken,
}

impl Job {
    /// Runs the cycle if no other thread has started it.
    fn run(&self) {
        let mut state = lock(&self.state);
        let mut node = match std::mem::replace(&mut *state, JobState::Running) {
            JobState::Waiting(node) => node,
            other => {
                *state = other;
                return;
            }
        };
        drop(state);
        let took_ns = run(&mut node, self.work.now, &self.pool, self.is_measured);
        self.work.keep(&mut node);
        *lock(&self.state) = JobState::Done(node, took_ns);
        self.done.notify_all();
    }

    /// The node after its cycle, which runs on this thread if no worker has started it.
    fn finish(&self) -> (Box<Node>, Option<u64>) {
        self.run();
        let mut state = lock(&self.state);
        loop {
            match std::mem::replace(&mut *state, JobState::Taken) {
                JobState::Done(node, took_ns) => return (node, took_ns),
                other => *state = other,
            }
            state = self.done.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// Threads that run cycles, those with the earliest output first.
pub(crate) struct Workers {
    shared: Arc<Shared>,
    pool: Arc<Pool>,
    threads: Vec<JoinHandle<()>>,
}

#[derive(Default)]
struct Shared {
    queue: Mutex<Queue>,
    changed: Condvar,
}

#[derive(Default)]
struct Queue {
    jobs: BinaryHeap<Queued>,
    stopped: bool,
}

struct Queued {
    due: (Stamp, u64),
    job: Arc<Job>,
}

impl PartialEq for Queued {
    fn eq(&self, other: &Self) -> bool {
        self.due == other.due
    }
}

impl Eq for Queued {}

impl PartialOrd for Queued {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Queued {
    /// Reversed: a [`BinaryHeap`] returns the greatest first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.due.cmp(&self.due)
    }
}

impl Workers {
    /// As many threads as the pool has; `None` if that is one, or if no thread can be created.
    pub(crate) fn new(pool: &Arc<Pool>) -> Option<Self> {
        if pool.threads() < 2 {
            return None;
        }
        let mut workers = Self { shared: Arc::default(), pool: Arc::clone(pool), threads: Vec::new() };
        for index in 0..pool.threads() {
            let shared = Arc::clone(&workers.shared);
            let thread = std::thread::Builder::new().name(format!("cycle {index}"));
            workers.threads.extend(thread.spawn(move || work(&shared)).ok());
        }
        (!workers.threads.is_empty()).then_some(workers)
    }

    fn push(&self, queued: Queued) {
        lock(&self.shared.queue).jobs.push(queued);
        self.shared.changed.notify_one();
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        lock(&self.shared.queue).stopped = true;
        self.shared.changed.notify_all();
        for thread in self.threads.drain(..) {
            if thread.join().is_err() {
                tracing::error!("a thread for cycles panicked outside a cycle");
            }
        }
    }
}

fn work(shared: &Shared) {
    loop {
        let mut queue = lock(&shared.queue);
        let queued = loop {
            if queue.stopped {
                return;
            }
            match queue.jobs.pop() {
                Some(queued) => break queued,
                None => queue = shared.changed.wait(queue).unwrap_or_else(PoisonError::into_inner),
            }
        };
        drop(queue);
        queued.job.run();
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // A panic of a thread leaves no inconsistent state, because a process's panic is caught in its cycle.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
