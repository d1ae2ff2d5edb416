//! The stepped executor: one event after another in simulated time.
//!
//! Events are ordered by time. At the same time, messages of the log come first, in file order, then output that
//! becomes visible, then cycles by rank. The result depends on the inputs, the stack, the parameters and the seed
//! alone. A cycle with a latency computes on another thread until its output is due, if there is one.

use crate::cycle::Staged;
use crate::error::RunError;
use crate::feed::Feed;
use crate::journal::{EventPlace, ExternalEvent, Journal};
use crate::machine::{CheckedEvent, Machine};
use crate::node::{CycleFaults, Output};
use crate::options::RunOptions;
use crate::pool::Pool;
use crate::script::{Refused, Repeated, ScheduledCycle, Script};
use crate::stack::{Plan, ProcessPlan, names};
use crate::summary::AtLogEnd;
use crate::tally::Tallies;
use crate::workers::{CycleWork, PendingOutput, Slot, Workers};
use rcs_bus::{Buffer, Bus, Draft, WriterId};
use rcs_log::Log;
use rcs_msg::{AnyMessage, Stamp, foxglove, rcs};
use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::sync::{Arc, OnceLock};

/// A cycle with a shorter latency computes on the executor's own thread, because handing it over would take longer.
const WORTH_SENDING_NS: u64 = 1_000_000;

/// What an event was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Happened {
    /// A message of the log was fed into the stack.
    Input,
    /// A process started a cycle, whose output becomes visible later.
    Started(usize),
    /// A cycle of a process ended: its output and its status are visible now.
    Cycle(usize),
    /// An event of a recorded journal was repeated.
    Written,
    /// A fault on demand took effect: a stopped process did not begin its cycle, or late messages became visible.
    Fault,
}

/// A future event.
#[derive(Clone)]
pub(crate) struct Event {
    pub(crate) time: Stamp,
    pub(crate) rank: u32,
    pub(crate) order: u64,
    pub(crate) kind: EventKind,
}

#[derive(Clone)]
pub(crate) enum EventKind {
    /// Output becomes visible; the time is the start of its cycle.
    Publish {
        started: Stamp,
        output: PendingOutput,
    },
    Cycle,
    /// An event of a live run's journal, which was accepted at this time.
    Write,
}

impl Event {
    fn key(&self) -> (Stamp, u8, u32, u64) {
        let class = match self.kind {
            EventKind::Publish { .. } | EventKind::Write => 0,
            EventKind::Cycle => 1,
        };
        (self.time, class, self.rank, self.order)
    }
}

impl PartialEq for Event {
    fn eq(&self, other: &Self) -> bool {
        self.key() == other.key()
    }
}

impl Eq for Event {}

impl PartialOrd for Event {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Event {
    /// Reversed: a [`BinaryHeap`] returns the greatest first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.key().cmp(&self.key())
    }
}

/// A stack in simulated time.
pub struct Stepped {
    machine: Machine,
    options: RunOptions,
    pub(crate) now: Stamp,
    pub(crate) start: Stamp,
    pub(crate) events: u64,
    pub(crate) order: u64,
    pub(crate) queue: BinaryHeap<Event>,
    pub(crate) feed: Option<Feed>,
    pub(crate) tallies: Option<Tallies>,
    /// Cycles and journal of a live run that is repeated; `None` for the nominal schedule.
    script: Option<Script>,
    /// The journal of a recorded stepped run that is repeated.
    journal: Repeated,
    pool: Arc<Pool>,
    workers: Option<Workers>,
    pub(crate) timing_due: Stamp,
    /// What the processes said when the log ended, once it has.
    pub(crate) at_log_end: Option<AtLogEnd>,
    /// Whether its first messages were written, by this run or by the one of a restored snapshot.
    pub(crate) has_begun: bool,
}

impl Stepped {
    /// A run before its start, on `log` if the stack reads one, else from time 0.
    pub fn new(plan: Arc<Plan>, log: Option<&Log>, options: RunOptions) -> Result<Self, RunError> {
        let machine = Machine::new(plan, options.seed)?;
        let (feed, log_identity) = match log {
            Some(log) => (Some(Feed::new(log, &machine)?), log.identity()?),
            None => (None, String::new()),
        };
        if feed.is_none()
            && let Some(input) = machine.plan.inputs.first()
        {
            return Err(RunError::Refused(format!(
                "stack {} reads topic {} of a log; expected a log to read it from",
                machine.plan.file.name(),
                input.topic
            )));
        }
        let start = feed.as_ref().map_or(Stamp(0), |feed| feed.range.0);
        let options = RunOptions { log_identity, ..options };
        let mut stepped = Self::at(machine, feed, options, start);
        for rank in 0..stepped.machine.nodes.len() {
            stepped.schedule_cycle(rank, start);
        }
        Ok(stepped)
    }

    /// A live run to be repeated: with its recorded cycles instead of the nominal ones, and its journal.
    pub(crate) fn on_schedule(
        plan: Arc<Plan>,
        options: RunOptions,
        start: Stamp,
        cycles: Vec<ScheduledCycle>,
        journal: Journal,
    ) -> Result<Self, RunError> {
        let machine = Machine::new(plan, options.seed)?;
        let mut stepped = Self::at(machine, None, options, start);
        stepped.script = Some(Script::new(cycles, journal));
        stepped.schedule_next_cycle(start);
        stepped.schedule_next_event(start);
        Ok(stepped)
    }

    fn at(machine: Machine, feed: Option<Feed>, options: RunOptions, start: Stamp) -> Self {
        let pool = Arc::new(Pool::new(options.threads));
        let tallies = options.hash.then(|| Tallies::tap(&machine.plan, &machine.buffers, pool.threads()));
        Self {
            options,
            now: start,
            start,
            events: 0,
            order: 0,
            queue: BinaryHeap::new(),
            feed,
            tallies,
            script: None,
            workers: Workers::new(&pool),
            journal: Repeated::default(),
            pool,
            timing_due: start,
            at_log_end: None,
            has_begun: false,
            machine,
        }
    }

    /// Adds the next cycle of a recorded schedule to the queue.
    fn schedule_next_cycle(&mut self, after: Stamp) {
        if let Some(cycle) = self.script.as_ref().and_then(|script| script.cycle_after(after)) {
            self.schedule_cycle(cycle.node, cycle.start);
        }
    }

    /// Adds the next event of a recorded journal to the queue.
    fn schedule_next_event(&mut self, after: Stamp) {
        if let Some(time) = self.script.as_ref().and_then(|script| script.event_after(after)) {
            self.order += 1;
            self.queue.push(Event { time, rank: 0, order: self.order, kind: EventKind::Write });
        }
    }

    /// Writes the first messages of every run, after adding taps and before the first event. In a run that has begun, or
    /// was restored from a snapshot, it does nothing: the operator's first `RUN` would be refused as an old one.
    pub fn begin(&mut self) -> Result<(), RunError> {
        if std::mem::replace(&mut self.has_begun, true) {
            return Ok(());
        }
        self.machine.begin(self.start, &self.options, self.script.is_some())?;
        let start = self.start;
        for fault in self.feed.as_mut().map(|feed| feed.give_fixed(start)).unwrap_or_default() {
            self.report(fault.time, &fault.text);
        }
        Ok(())
    }

    fn schedule_cycle(&mut self, rank: usize, time: Stamp) {
        self.order += 1;
        self.queue.push(Event { time, rank: rank as u32, order: self.order, kind: EventKind::Cycle });
    }

    /// Time of the next event; `None` if there is none.
    pub fn next_time(&mut self) -> Result<Option<Stamp>, RunError> {
        let queued = self.queue.peek().map(|event| event.time);
        let input = match &mut self.feed {
            Some(feed) => feed.next_time()?,
            None => None,
        };
        Ok(match (input, queued) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        })
    }

    /// Executes the next event; `None` if there is none.
    pub fn advance(&mut self) -> Result<Option<Happened>, RunError> {
        if let Some(refused) = self.take_due() {
            self.report(self.now, &refused.to_string());
        }
        let queued = self.queue.peek().map(|event| event.time);
        let input = match &mut self.feed {
            Some(feed) => feed.next_time()?,
            None => None,
        };
        let happened = match (input, queued) {
            (Some(time), queued) if queued.is_none_or(|queued| time <= queued) => {
                self.now = time;
                let given = self.feed.as_mut().map_or(Ok(()), Feed::give_next);
                if let Err(fault) = given {
                    self.report(fault.time, &fault.text);
                }
                Happened::Input
            }
            _ => {
                let Some(event) = self.queue.pop() else { return Ok(None) };
                self.note_log_end(event.time);
                self.now = event.time;
                self.run_event(event)
            }
        };
        self.machine.overrides.update(self.now);
        self.events += 1;
        Ok(Some(happened))
    }

    fn run_event(&mut self, event: Event) -> Happened {
        let index = event.rank as usize;
        match event.kind {
            EventKind::Publish { started, output } => {
                // Waits for its cycle if that is still computing.
                let node = self.machine.nodes[index].get();
                let output =
                    Arc::try_unwrap(output).map_or_else(|shared| shared.get().cloned(), OnceLock::into_inner);
                let is_late = output.as_ref().is_some_and(|output| output.status.is_none());
                if let Some(mut output) = output {
                    let is_checked = !is_late && self.machine.overrides.is_any();
                    let late =
                        if is_checked { node.split_late(&mut output.staged, event.time) } else { Vec::new() };
                    node.publish_output(output, started, event.time);
                    self.schedule_late(index, started, late);
                }
                if is_late {
                    return Happened::Fault;
                }
                if self.script.is_some() {
                    self.record_cycle(index, started, event.time);
                }
                Happened::Cycle(index)
            }
            EventKind::Write => {
                let taken = self.script.as_ref().and_then(|script| script.event_at(event.time)).cloned();
                if let Some(Err(error)) = taken.map(|taken| self.machine.take(taken)) {
                    self.report(event.time, &error.to_string());
                }
                self.schedule_next_event(event.time);
                Happened::Written
            }
            EventKind::Cycle => {
                let happened = self.cycle(index, event.time);
                if self.now >= self.timing_due {
                    self.timing_due = self.now.after_ns(1_000_000_000);
                    self.write_runtime(names::TIMING, self.now, AnyMessage::new(self.timing()));
                }
                happened
            }
        }
    }

    /// Starts a cycle of the process with that rank: captures its inputs.
    fn cycle(&mut self, index: usize, now: Stamp) -> Happened {
        let is_overridden = self.machine.overrides.is_any();
        let slot = &mut self.machine.nodes[index];
        let node = slot.get();
        // A recorded schedule has the cycles that ran, and their times.
        let is_checked = is_overridden && self.script.is_none();
        let faults = if is_checked { node.cycle_faults(now) } else { CycleFaults::default() };
        let period_ns = node.period_ns;
        if faults.stopped {
            self.schedule_after(index, now, period_ns);
            return Happened::Fault;
        }
        node.capture();
        let visible = match &self.script {
            None => now.after_ns(node.latency_ns + faults.slowed_ns),
            Some(script) => script.end_of(now),
        };
        let happened = if visible == now {
            let node = slot.run(now, &self.pool);
            let late = if is_overridden { node.take_late(now) } else { Vec::new() };
            node.publish(now, visible);
            self.schedule_late(index, now, late);
            Happened::Cycle(index)
        } else {
            self.order += 1;
            let output = PendingOutput::default();
            let work = CycleWork { now, output: Arc::clone(&output) };
            let kind = EventKind::Publish { started: now, output };
            self.queue.push(Event { time: visible, rank: index as u32, order: self.order, kind });
            match &self.workers {
                Some(workers) if visible >= now.after_ns(WORTH_SENDING_NS) => {
                    slot.send(workers, work, (visible, self.order));
                }
                _ => work.keep(slot.run(now, &self.pool)),
            }
            Happened::Started(index)
        };
        match &self.script {
            None => {
                // A process that is slowed skips the cycles that would begin before this one has ended.
                let took_ns = visible.0 - now.0;
                let periods =
                    if faults.slowed_ns > 0 { took_ns.div_ceil(period_ns.max(1)).max(1) } else { 1 };
                self.schedule_after(index, now, periods * period_ns);
            }
            Some(_) => self.schedule_next_cycle(now),
        }
        happened
    }

    /// Adds the next cycle of a process, that much after this one, to the queue.
    fn schedule_after(&mut self, index: usize, now: Stamp, after_ns: u64) {
        let due = now.after_ns(after_ns);
        let (period_ns, slack_ns) = (self.plan().processes[index].period_ns, self.slack_ns());
        let due = self.feed.as_ref().map_or(due, |feed| feed.after_gap(due, period_ns, slack_ns));
        self.schedule_cycle(index, due);
    }

    /// Adds the publication of messages that a fault delays to the queue.
    fn schedule_late(&mut self, index: usize, started: Stamp, late: Vec<(u64, Vec<Staged>)>) {
        for (delay_ns, staged) in late {
            self.order += 1;
            let output = Arc::new(Output { staged, status: None }.into());
            let kind = EventKind::Publish { started, output };
            let time = self.now.after_ns(delay_ns);
            self.queue.push(Event { time, rank: index as u32, order: self.order, kind });
        }
    }

    /// End of a run on a log: the end of the log, and one more cycle of every process.
    pub fn horizon(&self) -> Option<Stamp> {
        self.feed.as_ref().map(|feed| feed.range.1.after_ns(self.slack_ns()))
    }

    /// Greatest time after a message in which it can have an effect: one cycle of every process, at most two seconds.
    fn slack_ns(&self) -> u64 {
        let cycles = self.plan().processes.iter().map(|process| process.period_ns + process.latency_ns);
        cycles.sum::<u64>().min(2_000_000_000)
    }

    /// Executes everything up to and including `until`; returns whether anything is left after that.
    pub fn run_until(&mut self, until: Stamp) -> Result<bool, RunError> {
        loop {
            match self.next_time()? {
                Some(time) if time <= until => {
                    self.advance()?;
                }
                next => return Ok(next.is_some()),
            }
        }
    }

    /// Whether an external event would be accepted now.
    pub fn check(&self, event: &ExternalEvent) -> Result<(), RunError> {
        self.machine.check(event.clone()).map(|_| ())
    }

    /// Accepts an external event now, and returns it with its position.
    pub fn take(&mut self, event: ExternalEvent) -> Result<ExternalEvent, RunError> {
        let event = event.at(EventPlace { events: self.events, time: self.now });
        self.machine.take(event.clone())?;
        Ok(event)
    }

    /// Sets a recorded journal to be repeated, each event at its position.
    pub(crate) fn repeat(&mut self, journal: Journal) {
        self.journal = Repeated::new(journal);
    }

    /// Repeats the journalled events of this point; returns the first one that is refused.
    pub(crate) fn take_due(&mut self) -> Option<Refused> {
        let mut refused = None;
        while let Some(event) = self.journal.next_at(self.events) {
            let (buffer, time) = (event.buffer.to_string(), event.place.time);
            if let Err(error) = self.machine.take(event) {
                refused.get_or_insert(Refused { buffer, time, error });
            }
        }
        refused
    }

    /// Accepts an event of a session's journal again, at its position.
    pub(crate) fn retake(&mut self, event: ExternalEvent) -> Result<(), RunError> {
        // It was accepted before, so it is not refused now.
        self.machine.take(event)
    }

    /// Called after the run has been moved: the journalled events of its new position are repeated.
    pub(crate) fn rewind(&mut self) {
        self.journal.rewind();
    }

    /// Publishes the record of a repeated cycle as the live run did: its inputs and its times.
    fn record_cycle(&mut self, index: usize, started: Stamp, ended: Stamp) {
        let node = self.machine.nodes[index].get();
        let record = rcs::CycleRecord {
            process: node.status().process().to_string(),
            cycle: node.status().cycle,
            start_ns: started.0,
            end_ns: ended.0,
            input_sequence: node.captured(),
        };
        self.write_runtime(names::SCHEDULE, ended, AnyMessage::new(record));
    }

    /// Whether a cycle is computing on another thread; a snapshot would wait for it.
    pub(crate) fn is_computing(&self) -> bool {
        self.machine.nodes.iter().any(Slot::is_computing)
    }

    /// Limits for the past of a session of this run.
    pub(crate) fn past_options(&self) -> &crate::history::PastOptions {
        &self.options.past
    }

    /// Whether an external event would be accepted; changes nothing.
    pub(crate) fn check_event(&self, event: &ExternalEvent) -> Result<(), RunError> {
        self.machine.check(event.clone())?;
        let buffer = self.machine.buffer(&event.buffer)?;
        let expected = &buffer.spec().schema;
        if event.message.is_a(expected) {
            return Ok(());
        }
        Err(rcs_bus::WriteError::WrongType {
            buffer: event.buffer.to_string(),
            got: event.message.schema().name().to_owned(),
            expected: expected.name().to_owned(),
        }
        .into())
    }

    /// Announces that the run continues as another one, which branched from `parent`; returns the event of the
    /// announcement.
    pub(crate) fn begin_branch(&mut self, parent: &str) -> Result<ExternalEvent, RunError> {
        let told = self.machine.buffer(names::RUN)?.latest();
        let info = told.and_then(|sample| sample.message.to::<rcs::RunInfo>()).unwrap_or_default();
        let info = rcs::RunInfo { branched_from: parent.to_owned(), branch_time_ns: self.now.0, ..info };
        let event = ExternalEvent::sensed(names::RUN, self.now, AnyMessage::new(info));
        let event = event.at(EventPlace { events: self.events, time: self.now });
        self.machine.apply(CheckedEvent::own(event.clone()))?;
        Ok(event)
    }

    /// Reports a text in `/runtime/log`.
    fn report(&mut self, time: Stamp, text: &str) {
        let message = foxglove::Log {
            timestamp: Some(time.to_proto()),
            level: foxglove::log::Level::Warning.into(),
            message: text.to_owned(),
            name: "runtime".to_owned(),
            ..foxglove::Log::default()
        };
        self.write_runtime(names::LOG, time, AnyMessage::new(message));
    }

    fn write_runtime(&self, name: &str, time: Stamp, message: AnyMessage) {
        if let Some(buffer) = self.machine.bus.get(name) {
            let draft = Draft { log_time: time, acq_time: time, message };
            if let Err(error) = buffer.writer(WriterId::RUNTIME).write(draft) {
                tracing::warn!("{error}");
            }
        }
    }

    /// The durations known so far; does not wait for cycles that are computing.
    pub(crate) fn timing(&self) -> rcs::Timing {
        let timing = |(slot, process): (&Slot, &ProcessPlan)| {
            let times = slot.times();
            rcs::ProcessTiming {
                process: process.name.to_string(),
                cycles: times.begun,
                mean_us: times.mean_us(),
                max_us: times.max_us(),
                overruns: times.overruns,
                ..rcs::ProcessTiming::default()
            }
        };
        rcs::Timing {
            timestamp: Some(self.now.to_proto()),
            processes: self.machine().nodes.iter().zip(&self.plan().processes).map(timing).collect(),
            lag_s: 0.0,
        }
    }

    /// The run's buffers.
    pub fn bus(&self) -> &Bus {
        &self.machine.bus
    }

    /// The run's buffers, in the order of the plan.
    pub fn buffers(&self) -> &[Arc<Buffer>] {
        &self.machine.buffers
    }

    /// The plan.
    pub fn plan(&self) -> &Arc<Plan> {
        &self.machine.plan
    }

    /// Simulated time.
    pub fn now(&self) -> Stamp {
        self.now
    }

    /// Simulated time at which the run began.
    pub fn start(&self) -> Stamp {
        self.start
    }

    /// Number of events executed, which identifies a moment exactly.
    pub fn events(&self) -> u64 {
        self.events
    }

    pub(crate) fn machine(&self) -> &Machine {
        &self.machine
    }

    pub(crate) fn machine_mut(&mut self) -> &mut Machine {
        &mut self.machine
    }
}
