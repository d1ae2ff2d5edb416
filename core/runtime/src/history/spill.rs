//! The thread that writes the past to disk.

use super::disk::Disk;
use super::pack::{Origin, PackedSamples, PackedSnapshot, Packer};
use super::samples::Samples;
use crate::snapshot::Snapshot;
use crate::stack::Plan;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

/// What is to be written, each for a stretch by its number.
pub(crate) enum Job {
    Samples {
        stretch: usize,
        run: usize,
        samples: Arc<Samples>,
    },
    Snapshot {
        stretch: usize,
        run: usize,
        snapshot: Arc<Snapshot>,
    },
    /// A run began.
    Begun {
        run: usize,
        origin: Origin,
    },
}

/// What was written, or the error.
pub(crate) enum Done {
    Samples { stretch: usize, packed: Result<Arc<PackedSamples>, String> },
    Snapshot { stretch: usize, packed: Result<Arc<PackedSnapshot>, String> },
}

/// The thread that writes the past to disk. Dropping it ends the thread after its current piece of work.
pub(crate) struct Spill {
    jobs: Option<Sender<Job>>,
    done: Receiver<Done>,
    thread: Option<JoinHandle<()>>,
    waiting: usize,
}

impl Spill {
    pub(crate) fn start(disk: Arc<Disk>, plan: Arc<Plan>) -> std::io::Result<Self> {
        let (jobs, receiver) = channel();
        let (sender, done) = channel();
        let thread = std::thread::Builder::new().name("past".to_owned()).spawn(move || {
            let mut packer = Packer::new(disk, plan);
            for job in receiver {
                let done = match job {
                    Job::Begun { run, origin } => {
                        packer.origins.insert(run, origin);
                        continue;
                    }
                    Job::Samples { stretch, run, samples } => {
                        let packed = packer.samples(run, &samples);
                        let packed = packed.map(Arc::new).map_err(|error| error.to_string());
                        Done::Samples { stretch, packed }
                    }
                    Job::Snapshot { stretch, run, snapshot } => {
                        let packed = packer.snapshot(run, &snapshot);
                        let packed = packed.map(Arc::new).map_err(|error| error.to_string());
                        Done::Snapshot { stretch, packed }
                    }
                };
                if sender.send(done).is_err() {
                    return;
                }
            }
        })?;
        Ok(Self { jobs: Some(jobs), done, thread: Some(thread), waiting: 0 })
    }

    pub(crate) fn send(&mut self, job: Job) {
        self.waiting += usize::from(!matches!(job, Job::Begun { .. }));
        if let Some(jobs) = &self.jobs {
            // Dropping this value ends the thread.
            let _ = jobs.send(job);
        }
    }

    /// Number of unfinished pieces of work.
    pub(crate) fn waiting(&self) -> usize {
        self.waiting
    }

    /// The results since the last call; waits for one if `wait` is true.
    pub(crate) fn done(&mut self, wait: bool) -> Vec<Done> {
        let mut list = Vec::new();
        if wait && self.waiting > 0 {
            match self.done.recv() {
                Ok(done) => list.push(done),
                // The thread panicked: nothing more is written.
                Err(_) => self.waiting = 0,
            }
        }
        list.extend(self.done.try_iter());
        self.waiting = self.waiting.saturating_sub(list.len());
        list
    }
}

impl Drop for Spill {
    fn drop(&mut self) {
        self.jobs = None;
        // Results are no longer needed: the thread ends when it tries to send the next one.
        let (_, closed) = channel();
        self.done = closed;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
