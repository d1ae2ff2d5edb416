//! The live executor: one thread per process, each woken at its period, on the wall clock.
//!
//! Inputs are captured and outputs published under one short lock, which also assigns strictly increasing times. So all
//! captures and publications have one total order. A [`rcs::CycleRecord`] per cycle records its position in this order,
//! so that [`Stepped`](crate::Stepped) can run the same schedule again.
//!
//! Under the lock only references change hands: the recorder's thread encodes messages; parameters are checked by the
//! thread that writes them, and decoded by the process that receives them. The delay of waking, the wait for the lock
//! and the computing time are measured separately. A process that overruns skips cycles and keeps its phase.
//!
//! A watchdog reports a hung process as `ERROR` by writing a status on its behalf. Stopping waits for a hung process
//! for a limited time, and then leaves its thread behind.

mod class;
mod measure;
mod pools;
mod shared;
mod watchdog;
mod worker;

pub use class::lower_priority;

pub(crate) use class::apply as apply_class;

use crate::error::RunError;
use crate::journal::{EventPlace, ExternalEvent};
use crate::live_tally::LiveTally;
use crate::machine::Machine;
use crate::options::RunOptions;
use crate::record::{RecordOptions, RecordWhat, Recording};
use crate::stack::{Plan, names};
use crate::summary::Summary;
use crate::workers::Slot;
use pools::Pools;
use rcs_bus::{Bus, WriterId};
use rcs_log::RecorderStatus;
use rcs_msg::{Stamp, rcs};
use shared::{Shared, WorkerState};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use worker::Worker;

/// Time from the start of the threads to the first cycle, so that all of them are running by then.
const LEAD: Duration = Duration::from_millis(10);

/// Options of a live run.
#[derive(Clone, Debug)]
pub struct LiveOptions {
    /// Seed, threads of each pool, and names, as for a stepped run.
    pub run: RunOptions,
    /// File of the recording; `None` for no recording.
    pub record: Option<PathBuf>,
    /// What is recorded.
    pub what: RecordWhat,
    /// Whether an existing file may be replaced.
    pub replace: bool,
    /// A process counts as hung if a cycle lasts longer than this and longer than ten of its periods.
    pub hang_limit: Duration,
    /// How long stopping waits for cycles in progress.
    pub stop_limit: Duration,
}

impl Default for LiveOptions {
    fn default() -> Self {
        Self {
            run: RunOptions::default(),
            record: None,
            what: RecordWhat::default(),
            replace: false,
            hang_limit: Duration::from_secs(2),
            stop_limit: Duration::from_secs(5),
        }
    }
}

/// A stack that runs on the wall clock.
pub struct Live {
    shared: Arc<Shared>,
    worker_states: Vec<Arc<WorkerState>>,
    threads: Vec<NamedThread>,
    /// Threads that have ended, by their index in `threads`.
    ended: (Sender<usize>, Mutex<Receiver<usize>>),
    stop_limit: Duration,
    tally: Option<LiveTally>,
    recording: Option<Recording>,
    start: Stamp,
}

/// Starts a thread; tests replace it by a function that fails.
type Spawn<'a> =
    &'a mut dyn FnMut(std::thread::Builder, Box<dyn FnOnce() + Send>) -> std::io::Result<JoinHandle<()>>;

struct NamedThread {
    name: Arc<str>,
    handle: JoinHandle<()>,
}

/// Result of a live run.
#[derive(Debug, Default)]
pub struct Stopped {
    /// Result of the recording; `None` if there was none.
    pub recording: Option<Result<RecorderStatus, RunError>>,
    /// Processes that did not end in time and whose threads were left behind.
    pub hung: Vec<String>,
    /// Summary of the run.
    pub summary: Summary,
    /// Measurements of each process, in the order of the stack file.
    pub timings: Vec<rcs::ProcessTiming>,
}

impl Live {
    /// Starts every process of a plan. If that fails, no thread remains.
    pub fn start(plan: Arc<Plan>, options: &LiveOptions) -> Result<Self, RunError> {
        Self::start_with(plan, options, &mut |thread, work| thread.spawn(work))
    }

    fn start_with(plan: Arc<Plan>, options: &LiveOptions, spawn: Spawn<'_>) -> Result<Self, RunError> {
        let mut machine = Machine::new(plan, options.run.seed)?;
        // The threads own the nodes; the buffers remain here.
        let nodes = std::mem::take(&mut machine.nodes);
        let runtime_writer = |name: &str| machine.buffer(name).map(|buffer| buffer.writer(WriterId::RUNTIME));
        let unix_ns = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64);
        let (schedule, timing) = (runtime_writer(names::SCHEDULE)?, runtime_writer(names::TIMING)?);
        let record = RecordOptions {
            lossless: false,
            build: options.run.build.clone(),
            what: options.what.clone(),
            replace: options.replace,
            from: None,
        };
        let recording = match &options.record {
            Some(path) => Some(Recording::start(path, &machine.plan, &machine.buffers, &record)?),
            None => None,
        };
        let tally = LiveTally::tap(&machine.plan, &machine.buffers, options.run.hash)
            .map_err(|error| RunError::Refused(format!("no thread could be started for hashing: {error}")))?;
        let shared = Arc::new(Shared::new(machine, Stamp(unix_ns), schedule, timing));
        let (machine, plan) = (&shared.machine, Arc::clone(&shared.machine.plan));
        let pools = Pools::new(&plan, options.run.threads);
        let start = shared.commit(|now| machine.begin(now, &options.run, true).map(|()| now))?;
        let state = |process: &crate::stack::ProcessPlan| {
            let status = Arc::clone(&machine.buffers[process.status_buffer]);
            Arc::new(WorkerState::new(
                Arc::clone(&process.name),
                Duration::from_nanos(process.period_ns),
                status,
            ))
        };
        let worker_states: Vec<_> = plan.processes.iter().map(state).collect();
        let (ended, receiver) = channel();
        // From here on, dropping `live` ends the threads that are running.
        let mut live = Self {
            shared,
            worker_states,
            threads: Vec::new(),
            ended: (ended, Mutex::new(receiver)),
            stop_limit: options.stop_limit,
            tally: Some(tally),
            recording,
            start,
        };
        let origin = Instant::now() + LEAD;
        for ((node, process), index) in nodes.into_iter().map(Slot::into_node).zip(&plan.processes).zip(0..) {
            let worker = Worker {
                shared: Arc::clone(&live.shared),
                state: Arc::clone(&live.worker_states[index]),
                node,
                pool: pools.of(process),
                class: process.class,
                origin,
            };
            live.spawn(spawn, Arc::clone(&process.name), move || worker.run())?;
        }
        let (shared, worker_states, limit) =
            (Arc::clone(&live.shared), live.worker_states.clone(), options.hang_limit);
        live.spawn(spawn, "watchdog".into(), move || watchdog::run(&shared, &worker_states, limit))?;
        Ok(live)
    }

    fn spawn(
        &mut self,
        spawn: Spawn<'_>,
        name: Arc<str>,
        work: impl FnOnce() + Send + 'static,
    ) -> Result<(), RunError> {
        let ended = self.ended.0.clone();
        let index = self.threads.len();
        let work = Box::new(move || {
            work();
            // No one waits for the thread if the run has been abandoned.
            let _ = ended.send(index);
        });
        let handle = spawn(std::thread::Builder::new().name(name.to_string()), work)
            .map_err(|error| RunError::Refused(format!("no thread could be started for {name}: {error}")))?;
        self.threads.push(NamedThread { name, handle });
        Ok(())
    }

    /// The run's buffers.
    pub fn bus(&self) -> &Bus {
        &self.shared.machine.bus
    }

    /// The plan.
    pub fn plan(&self) -> &Arc<Plan> {
        &self.shared.machine.plan
    }

    /// Start time of the run.
    pub fn started(&self) -> Stamp {
        self.start
    }

    /// The current time of the run.
    pub fn now(&self) -> Stamp {
        self.shared.commit(|now| now)
    }

    /// Measurements of each process so far, in the order of the stack file.
    pub fn timings(&self) -> Vec<rcs::ProcessTiming> {
        watchdog::timings(&self.worker_states)
    }

    /// Accepts an external event: of the operator, a sensor or a link.
    pub fn take(&self, event: ExternalEvent) -> Result<(), RunError> {
        // A check may take long (for example, it reads a world), so it is done without the lock.
        let mut checked = self.shared.machine.check(event)?;
        if checked.is_late() {
            return Err(RunError::Refused(
                "a live run cannot deliver messages late; expected another fault, or a stepped run"
                    .to_owned(),
            ));
        }
        self.shared.commit(|time| {
            checked.event = checked.event.at(EventPlace { events: 0, time });
            self.shared.machine.apply(checked)
        })
    }

    /// State of the recording.
    pub fn recording(&self) -> Option<RecorderStatus> {
        self.recording.as_ref().map(Recording::status)
    }

    /// Ends every process after its cycle, then the recording. A hung process is left behind.
    pub fn stop(mut self) -> Stopped {
        let hung = self.end_threads();
        let now = self.now();
        let recording = self.recording.take().map(|recording| recording.finish_at(now));
        let Machine { plan, buffers, .. } = &self.shared.machine;
        let work: Vec<_> = self.worker_states.iter().map(|state| state.work()).collect();
        let summary = self.tally.take().map(|tally| tally.finish(plan, buffers, &work, (self.start, now)));
        Stopped { recording, hung, summary: summary.unwrap_or_default(), timings: self.timings() }
    }

    /// Ends the threads, and returns the names of the processes that did not end in time.
    fn end_threads(&mut self) -> Vec<String> {
        self.shared.stop();
        for thread in &self.threads {
            thread.handle.thread().unpark();
        }
        let receiver = self.ended.1.get_mut().unwrap_or_else(PoisonError::into_inner);
        let deadline = Instant::now() + self.stop_limit;
        let mut threads: Vec<_> = self.threads.drain(..).map(Some).collect();
        while threads.iter().any(Option::is_some) {
            let left = deadline.saturating_duration_since(Instant::now());
            let Ok(index) = receiver.recv_timeout(left) else { break };
            if let Some(thread) = threads[index].take()
                && thread.handle.join().is_err()
            {
                tracing::error!("the thread of {} panicked", thread.name);
            }
        }
        let left: Vec<_> = threads.into_iter().flatten().map(|thread| thread.name.to_string()).collect();
        for name in &left {
            tracing::error!("{name} did not end within {:?}: its thread is left behind", self.stop_limit);
        }
        left
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.end_threads();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Cycle, NoCommands, PortBuilder, Process, ProcessDef, ProcessType, StackFile};
    use serde::{Deserialize, Serialize};
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[derive(Clone, Serialize, Deserialize)]
    struct Idle;

    impl Process for Idle {
        type Params = rcs::NoParams;
        type Ports = ();
        type Command = NoCommands;
        const DEF: ProcessDef = ProcessDef {
            plugin: "idle",
            summary: "Idles.",
            period_ms: 1.0,
            latency_ms: 0.0,
            reads_ground_truth: false,
        };

        fn ports(_: &mut PortBuilder) -> Self::Ports {}

        fn new(_: &Self::Params) -> Self {
            Self
        }

        fn cycle(&mut self, (): &Self::Ports, _: &Self::Params, _: &mut Cycle<'_>) {}
    }

    #[test]
    fn a_start_that_fails_half_way_names_the_process_and_leaves_no_thread() {
        let process =
            |name| format!("[[process]]\nname = \"{name}\"\nplugin = \"idle\"\nsupervisor = \"viewer\"\n");
        let text =
            format!("format = 1\nname = \"x\"\n{}", ["first", "second", "third"].map(process).concat());
        let file = StackFile::parse("test.toml", &text).unwrap();
        let plan = Arc::new(Plan::new(file, &[ProcessType::of::<Idle>()], &[]).unwrap());
        let (begun, ended) = (AtomicUsize::new(0), Arc::new(AtomicUsize::new(0)));
        let failed = Live::start_with(plan, &LiveOptions::default(), &mut |thread, work| {
            if begun.fetch_add(1, Ordering::Relaxed) == 2 {
                return Err(std::io::ErrorKind::OutOfMemory.into());
            }
            let ended = Arc::clone(&ended);
            thread.spawn(move || {
                work();
                ended.fetch_add(1, Ordering::Relaxed);
            })
        });
        let error = failed.err().unwrap().to_string();
        assert!(error.contains("no thread could be started for third"), "{error}");
        assert_eq!((begun.into_inner(), ended.load(Ordering::Relaxed)), (3, 2));
    }
}
