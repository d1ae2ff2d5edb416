//! The live executor: a thread a process, each waking at its period, on the wall clock.
//!
//! What a cycle sees and what it writes is captured and published under one short lock, which also hands out strictly
//! increasing times: every capture and every publication has a place in one order. A [`rcs::CycleRecord`] per cycle
//! tells that place, so that [`Stepped`](crate::Stepped) can run that very schedule again.

use crate::error::RunError;
use crate::journal::{EventPlace, ExternalEvent};
use crate::live_tally::LiveTally;
use crate::machine::Machine;
use crate::node::Node;
use crate::options::RunOptions;
use crate::overrides::Keeper;
use crate::pool::Pool;
use crate::record::{RecordOptions, RecordWhat, Recording};
use crate::stack::{Plan, names};
use crate::summary::Summary;
use crate::workers::Slot;
use rcs_bus::{Bus, Draft, WriterId};
use rcs_log::RecorderStatus;
use rcs_msg::{AnyMessage, Stamp, rcs};
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// How a stack is run live.
#[derive(Clone, Debug, Default)]
pub struct LiveOptions {
    /// Seed, threads and names, as for a stepped run.
    pub run: RunOptions,
    /// Where to record; nowhere if `None`.
    pub record: Option<PathBuf>,
    /// What is recorded.
    pub what: RecordWhat,
}

/// A stack on the wall clock.
pub struct Live {
    shared: Arc<Shared>,
    machine: Machine,
    threads: Vec<JoinHandle<()>>,
    tally: Option<LiveTally>,
    recording: Option<Recording>,
    start: Stamp,
}

struct Shared {
    order: Mutex<Stamp>,
    epoch: Stamp,
    clock: Instant,
    stop: Mutex<bool>,
    stopped: Condvar,
    pool: Pool,
    schedule: rcs_bus::Writer,
    timing: rcs_bus::Writer,
    keeper: Arc<Keeper>,
}

impl Shared {
    /// Does `f` at a time that no other commit has, later than all before.
    fn commit<R>(&self, f: impl FnOnce(Stamp) -> R) -> R {
        let mut last = self.order.lock().unwrap_or_else(PoisonError::into_inner);
        let now = self.epoch.after_ns(self.clock.elapsed().as_nanos() as u64);
        *last = now.max(last.after_ns(1));
        f(*last)
    }

    /// Waits until `deadline`; `true` where the run is to stop.
    fn wait_until(&self, deadline: Instant) -> bool {
        let mut stop = self.stop.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            if *stop {
                return true;
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return false;
            }
            stop = self.stopped.wait_timeout(stop, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

/// How a live run ended.
#[derive(Clone, Debug, Default)]
pub struct Stopped {
    /// How the recording went; `None` where there was none.
    pub recording: Option<RecorderStatus>,
    /// Processes that did not end in time: their threads were left behind.
    pub hung: Vec<String>,
    /// What the run has done.
    pub summary: Summary,
}

impl Live {
    /// Starts every process of a plan.
    pub fn start(plan: Arc<Plan>, options: &LiveOptions) -> Result<Self, RunError> {
        let mut machine = Machine::new(plan, options.run.seed)?;
        // The threads own the nodes; what is left are the buffers.
        let nodes = std::mem::take(&mut machine.nodes);
        let runtime_writer = |name: &str| machine.buffer(name).map(|buffer| buffer.writer(WriterId::RUNTIME));
        let unix_ns = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64);
        let shared = Arc::new(Shared {
            order: Mutex::new(Stamp(0)),
            epoch: Stamp(unix_ns),
            clock: Instant::now(),
            stop: Mutex::new(false),
            stopped: Condvar::new(),
            pool: Pool::new(options.run.threads),
            schedule: runtime_writer(names::SCHEDULE)?,
            timing: runtime_writer(names::TIMING)?,
            keeper: Arc::clone(&machine.keeper),
        });
        let record =
            RecordOptions { lossless: false, build: options.run.build.clone(), what: options.what.clone() };
        let recording = match &options.record {
            Some(path) => Some(Recording::start(path, &machine.plan, &machine.buffers, &record)?),
            None => None,
        };
        let tally = LiveTally::tap(&machine.plan, &machine.buffers, options.run.hash);
        let tally = tally
            .map_err(|error| RunError::Refused(format!("no thread could be started for hashing: {error}")))?;
        let start = shared.commit(|now| machine.begin(now, &options.run, true).map(|()| now))?;
        let mut threads = Vec::new();
        for (node, process) in nodes.into_iter().map(Slot::into_node).zip(&machine.plan.processes) {
            let shared = Arc::clone(&shared);
            let name = Arc::clone(&process.name);
            let thread = std::thread::Builder::new().name(name.to_string());
            let spawned = thread.spawn(move || run_node(&shared, node, &name));
            threads.push(spawned.map_err(|error| {
                RunError::Refused(format!("no thread could be started for {}: {error}", process.name))
            })?);
        }
        Ok(Self { shared, machine, threads, tally: Some(tally), recording, start })
    }

    /// The run's buffers.
    pub fn bus(&self) -> &Bus {
        &self.machine.bus
    }

    /// What runs.
    pub fn plan(&self) -> &Arc<Plan> {
        &self.machine.plan
    }

    /// When the run began.
    pub fn started(&self) -> Stamp {
        self.start
    }

    /// The time by which everything in this run is stamped.
    pub fn now(&self) -> Stamp {
        self.shared.commit(|now| now)
    }

    /// Takes an event from outside: an operator's, a sensor's, a link's.
    pub fn take(&self, event: ExternalEvent) -> Result<(), RunError> {
        // A check may take long (it reads a world, say): nobody waits for it.
        self.machine.check(&event)?;
        self.shared.commit(|time| self.machine.apply(event.at(EventPlace { events: 0, time })))
    }

    /// How the recording goes.
    pub fn recording(&self) -> Option<RecorderStatus> {
        self.recording.as_ref().map(Recording::status)
    }

    /// Ends every process after its cycle, and the recording after them.
    pub fn stop(mut self) -> Result<Stopped, RunError> {
        self.end_threads();
        let now = self.now();
        let recording = self.recording.take().map(|recording| recording.finish_at(now)).transpose()?;
        let (plan, buffers) = (&self.machine.plan, &self.machine.buffers);
        let summary = self.tally.take().map(|tally| tally.finish(plan, buffers, self.start, now));
        Ok(Stopped { recording, hung: Vec::new(), summary: summary.unwrap_or_default() })
    }

    fn end_threads(&mut self) {
        *self.shared.stop.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.shared.stopped.notify_all();
        for thread in self.threads.drain(..) {
            if thread.join().is_err() {
                tracing::error!("a process's thread panicked outside its cycle");
            }
        }
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.end_threads();
    }
}

fn run_node(shared: &Shared, mut node: Node, name: &str) {
    let period = Duration::from_nanos(node.period_ns);
    let mut wake = Instant::now();
    let mut timing = rcs::ProcessTiming { process: name.to_owned(), ..rcs::ProcessTiming::default() };
    let mut total_us = 0.0;
    let mut timing_due = wake + Duration::from_secs(1);
    while !shared.wait_until(wake) {
        let (started, input_sequence) = shared.commit(|now| {
            node.capture();
            shared.keeper.tend(now);
            (now, node.captured())
        });
        let clock = Instant::now();
        node.run(started, &shared.pool);
        let took = clock.elapsed();
        shared.commit(|now| {
            node.publish(started, now);
            shared.keeper.tend(now);
            let record = rcs::CycleRecord {
                process: name.to_owned(),
                cycle: node.status().cycle,
                start_ns: started.0,
                end_ns: now.0,
                input_sequence,
            };
            report(&shared.schedule, now, AnyMessage::new(record));
        });
        let took_us = took.as_secs_f64() * 1e6;
        timing.cycles += 1;
        total_us += took_us;
        timing.mean_us = total_us / timing.cycles as f64;
        timing.max_us = timing.max_us.max(took_us);
        timing.overruns += u64::from(took > period);
        let now = Instant::now();
        if now >= timing_due {
            timing_due = now + Duration::from_secs(1);
            shared.commit(|now| {
                let message = rcs::Timing {
                    timestamp: Some(now.to_proto()),
                    processes: vec![timing.clone()],
                    lag_s: 0.0,
                };
                report(&shared.timing, now, AnyMessage::new(message));
            });
        }
        // After an overrun the next cycle starts at once, and those that were missed are not made up for.
        wake = (wake + period).max(now);
    }
}

fn report(writer: &rcs_bus::Writer, now: Stamp, message: AnyMessage) {
    if let Err(error) = writer.write(Draft { log_time: now, acq_time: now, message }) {
        tracing::warn!("{error}");
    }
}
