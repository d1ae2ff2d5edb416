//! State that the threads of a live run share: the lock that orders everything, the clock, and the stop flag.

use crate::journal::{EventPlace, ExternalEvent};
use crate::machine::{CheckedEvent, Machine};
use crate::work::Work;
use rcs_bus::{Buffer, Draft, Writer, WriterId};
use rcs_msg::{AnyMessage, Stamp, rcs};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::measure::Measured;

/// State that the threads of a live run share.
pub(super) struct Shared {
    /// The buffers; the threads own the nodes.
    pub(super) machine: Machine,
    order: Mutex<Stamp>,
    epoch: Stamp,
    pub(super) clock: Instant,
    stop: AtomicBool,
    pub(super) schedule: Writer,
    pub(super) timing: Writer,
}

impl Shared {
    pub(super) fn new(machine: Machine, epoch: Stamp, schedule: Writer, timing: Writer) -> Self {
        let (order, stop) = (Mutex::new(Stamp(0)), AtomicBool::new(false));
        Self { machine, order, epoch, clock: Instant::now(), stop, schedule, timing }
    }

    /// Calls `f` with a time that is unique and later than that of all earlier commits.
    pub(super) fn commit<R>(&self, f: impl FnOnce(Stamp) -> R) -> R {
        self.commit_measured(f).0
    }

    /// Like [`Shared::commit`]; also returns how long it waited for the lock.
    pub(super) fn commit_measured<R>(&self, f: impl FnOnce(Stamp) -> R) -> (R, Duration) {
        let asked = Instant::now();
        let mut last = self.order.lock().unwrap_or_else(PoisonError::into_inner);
        let got = Instant::now();
        let now = self.epoch.after_ns(got.saturating_duration_since(self.clock).as_nanos() as u64);
        *last = now.max(last.after_ns(1));
        (f(*last), got.saturating_duration_since(asked))
    }

    /// Sleeps until `deadline`; `true` if the run is to stop. The threads park instead of sharing a lock, and stopping
    /// unparks them.
    pub(super) fn sleep_until(&self, deadline: Instant) -> bool {
        while !self.is_stopping() {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return false;
            }
            std::thread::park_timeout(left);
        }
        true
    }

    pub(super) fn is_stopping(&self) -> bool {
        self.stop.load(Ordering::Acquire)
    }

    pub(super) fn stop(&self) {
        self.stop.store(true, Ordering::Release);
    }

    fn elapsed_ns(&self) -> u64 {
        self.clock.elapsed().as_nanos() as u64
    }
}

pub(super) fn report(writer: &Writer, now: Stamp, message: AnyMessage) {
    if let Err(error) = writer.write(Draft { log_time: now, acq_time: now, message }) {
        tracing::warn!("{error}");
    }
}

/// State of one process's thread that other threads can read.
pub(super) struct WorkerState {
    pub(super) name: Arc<str>,
    pub(super) period: Duration,
    status: Arc<Buffer>,
    /// Start of the current cycle, in nanoseconds of the run's clock; 0 between cycles.
    began_ns: AtomicU64,
    is_hung: AtomicBool,
    measured: Mutex<Measured>,
    work: Mutex<Work>,
}

impl WorkerState {
    pub(super) fn new(name: Arc<str>, period: Duration, status: Arc<Buffer>) -> Self {
        let (began_ns, is_hung) = (AtomicU64::new(0), AtomicBool::new(false));
        Self { name, period, status, began_ns, is_hung, measured: Mutex::default(), work: Mutex::default() }
    }

    pub(super) fn begin_cycle(&self, shared: &Shared) {
        self.began_ns.store(shared.elapsed_ns().max(1), Ordering::Release);
    }

    /// Whether the watchdog had reported the process as hung.
    pub(super) fn end_cycle(&self) -> bool {
        self.began_ns.store(0, Ordering::Release);
        self.is_hung.swap(false, Ordering::AcqRel)
    }

    /// Duration of the current cycle, if it is longer than `limit` and has not been reported.
    pub(super) fn newly_hung(&self, shared: &Shared, limit: Duration) -> Option<Duration> {
        let began_ns = self.began_ns.load(Ordering::Acquire);
        if began_ns == 0 {
            return None;
        }
        let lasted = Duration::from_nanos(shared.elapsed_ns().saturating_sub(began_ns));
        (lasted > limit && !self.is_hung.swap(true, Ordering::AcqRel)).then_some(lasted)
    }

    pub(super) fn measured<R>(&self, f: impl FnOnce(&mut Measured) -> R) -> R {
        f(&mut self.measured.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// The process has done its last cycle, with this work.
    pub(super) fn ended(&self, work: &Work) {
        self.work.lock().unwrap_or_else(PoisonError::into_inner).clone_from(work);
    }

    /// What the process made of its inputs, once it has ended.
    pub(super) fn work(&self) -> Work {
        self.work.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Writes `ERROR` into the status of a process that cannot do so itself. Supervisors read statuses, so this is how
    /// they learn of it. The status does not follow from the process's cycles, so it is journalled.
    pub(super) fn write_error(&self, shared: &Shared, text: &str) {
        tracing::error!("{}: {text}", self.name);
        let written = shared.commit(|now| {
            let last = self.status.latest().and_then(|sample| sample.message.to::<rcs::Status>());
            let mut status = last
                .unwrap_or_else(|| rcs::Status { process: self.name.to_string(), ..rcs::Status::default() });
            status.timestamp = Some(now.to_proto());
            status.set_state(rcs::ProcessState::Error);
            text.clone_into(&mut status.state_text);
            status.source_line.clear();
            let message = AnyMessage::new(status);
            let event = ExternalEvent {
                place: EventPlace { events: 0, time: now },
                buffer: self.status.name().into(),
                writer: WriterId::RUNTIME,
                acq_time: Some(now),
                message,
            };
            shared.machine.apply(CheckedEvent::own(event))
        });
        if let Err(error) = written {
            tracing::error!("{}: {error}", self.name);
        }
    }
}
