//! Counts and hashes what is written to the buffers of a run.
//!
//! Hashing encodes every message that has no [`Digester`]. Where the run has more than one thread, both are done on a
//! thread of their own, so that nothing that reads the message waits for them.

use crate::stack::{BufferPlan, Plan, names};
use rcs_bus::{Buffer, Sample};
use rcs_msg::{DeltaCodec, Digest, Digester};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use twox_hash::XxHash3_128;

/// Messages that may wait to be hashed in a stepped run; they stay in memory.
const MOST_WAITING: usize = 256;

/// What was written to one buffer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Tally {
    pub(crate) hash: u128,
    pub(crate) bytes: u64,
}

/// What was written to one buffer, and what the next message needs.
struct Counter {
    tally: Tally,
    digester: Option<Box<dyn Digester>>,
}

impl Counter {
    /// Counts one more message.
    fn take(&mut self, sample: &Sample) {
        let header = &sample.header;
        let digest = self.digester.as_mut().and_then(|digester| digester.digest(&sample.message));
        let digest = digest.unwrap_or_else(|| {
            let bytes = sample.message.bytes();
            Digest { hash: XxHash3_128::oneshot(&bytes), bytes: bytes.len() }
        });
        let chained = [
            &self.tally.hash.to_le_bytes()[..],
            &header.sequence.to_le_bytes(),
            &header.log_time.0.to_le_bytes(),
            &header.acq_time.0.to_le_bytes(),
            &digest.hash.to_le_bytes(),
        ];
        self.tally.hash = XxHash3_128::oneshot(&chained.concat());
        self.tally.bytes += digest.bytes as u64;
    }
}

/// Counts what is written to each buffer, in the order of the plan.
pub(crate) struct Tallies {
    counted: Arc<Mutex<Vec<Counter>>>,
    thread: Option<Thread>,
}

struct Thread {
    sender: SyncSender<Todo>,
    handle: Option<JoinHandle<()>>,
}

enum Todo {
    Count(usize, Sample),
    /// Answers when everything before it is counted.
    Answer(SyncSender<()>),
    End,
}

impl Tallies {
    /// Counts for a stepped run with this many threads: on the writer's if that is one, else in the time in which the
    /// cycles leave a core idle.
    pub(crate) fn tap(plan: &Plan, buffers: &[Arc<Buffer>], threads: usize) -> Self {
        if threads > 1
            && let Ok(tallies) = Self::tap_on_a_thread(plan, buffers, MOST_WAITING, crate::lower_priority)
        {
            return tallies;
        }
        let counted = Arc::new(Mutex::new(counters(plan)));
        for (index, buffer) in counted_buffers(buffers) {
            let counted = Arc::clone(&counted);
            buffer.tap(Box::new(move |sample: &Sample| lock(&counted)[index].take(sample)));
        }
        Self { counted, thread: None }
    }

    /// Counts on a thread of its own, which calls `start` first; a writer waits while `most_waiting` messages are waiting
    /// to be counted.
    pub(crate) fn tap_on_a_thread(
        plan: &Plan,
        buffers: &[Arc<Buffer>],
        most_waiting: usize,
        start: fn(),
    ) -> std::io::Result<Self> {
        let counted = Arc::new(Mutex::new(counters(plan)));
        let (sender, todo) = sync_channel(most_waiting);
        let handle = {
            let counted = Arc::clone(&counted);
            let count = move || {
                start();
                count(&todo, &counted);
            };
            std::thread::Builder::new().name("hash".to_owned()).spawn(count)?
        };
        for (index, buffer) in counted_buffers(buffers) {
            let sender = sender.clone();
            buffer.tap(Box::new(move |sample: &Sample| {
                // After the end of the run no one counts.
                let _ = sender.send(Todo::Count(index, sample.clone()));
            }));
        }
        Ok(Self { counted, thread: Some(Thread { sender, handle: Some(handle) }) })
    }

    /// What was written so far; `None` if the thread that counts has panicked.
    pub(crate) fn get(&self) -> Option<Vec<Tally>> {
        self.is_up_to_date().then(|| lock(&self.counted).iter().map(|counter| counter.tally).collect())
    }

    /// Continues from what had been written at another time.
    pub(crate) fn set(&self, saved: &[Tally]) {
        if self.is_up_to_date() {
            let mut counted = lock(&self.counted);
            counted.iter_mut().zip(saved).for_each(|(counter, &tally)| counter.tally = tally);
        }
    }

    /// Waits until everything that was written is counted; false if the thread that counts has panicked.
    fn is_up_to_date(&self) -> bool {
        let Some(thread) = &self.thread else { return true };
        let (answer, answered) = sync_channel(1);
        thread.sender.send(Todo::Answer(answer)).is_ok() && answered.recv().is_ok()
    }
}

impl Drop for Thread {
    fn drop(&mut self) {
        let _ = self.sender.send(Todo::End);
        if self.handle.take().is_some_and(|handle| handle.join().is_err()) {
            tracing::error!("the thread that hashes messages panicked; the run has no hash");
        }
    }
}

fn counted_buffers(buffers: &[Arc<Buffer>]) -> impl Iterator<Item = (usize, &Arc<Buffer>)> {
    buffers.iter().enumerate().filter(|(_, buffer)| buffer.name() != names::TIMING)
}

fn count(todo: &Receiver<Todo>, counted: &Mutex<Vec<Counter>>) {
    while let Ok(todo) = todo.recv() {
        match todo {
            Todo::Count(index, sample) => lock(counted)[index].take(&sample),
            Todo::Answer(answer) => {
                let _ = answer.send(());
            }
            Todo::End => return,
        }
    }
}

/// A counter for each buffer of the plan.
fn counters(plan: &Plan) -> Vec<Counter> {
    let counter = |buffer: &BufferPlan| Counter {
        tally: Tally::default(),
        digester: buffer.codec.map(DeltaCodec::digester),
    };
    plan.buffers.iter().map(counter).collect()
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
